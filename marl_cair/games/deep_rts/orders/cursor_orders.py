"""Carries out the orders of all players in the action spaces `unit` and `classic`."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders.classic import (
    CLASSIC_BUILD,
    NUM_CLASSIC_BUILDS,
    obey_classic_action,
)
from marl_cair.games.deep_rts.orders.cursor import pass_cursor
from marl_cair.games.deep_rts.orders.orders import FIRST_PRODUCT, obey_unit_action
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_building
from marl_cair.games.deep_rts.rules.building import (
    can_produce,
    claim_site,
    clear_site_claims,
    produce,
)
from marl_cair.games.deep_rts.rules.paths import NOWHERE


@compiled
def product_of(world: Any, rules: Any, player: int, action: int) -> int:
    """The product that an action asks the cursor's unit for, NOWHERE for none."""
    if rules.action_space == rb.CLASSIC_ACTIONS:
        unit = world.players[player, s.CURSOR]
        slot = action - CLASSIC_BUILD
        if unit == s.NO_UNIT or not 0 <= slot < NUM_CLASSIC_BUILDS:
            return NOWHERE
        return int(rules.products[world.units[unit, s.UNIT_KIND], slot])
    product = action - FIRST_PRODUCT
    return int(product) if 0 <= product < t.NUM_PRODUCTS else NOWHERE


@compiled
def obey_cursors(world: Any, rules: Any, actions: Any) -> None:
    """One order of each player, for the unit under its cursor.

    Sites that two players want to build on at once are refused to both. Sites come last: all other
    orders are about the board that their players saw.
    """
    sites, allowed = 0, 0  # bits of players whose peasants build; of those whose site is free
    for player in range(rules.num_players):
        unit = int(world.players[player, s.CURSOR])
        product = product_of(world, rules, player, actions[player])
        if unit != s.NO_UNIT and product != NOWHERE and not is_building(world, unit):
            sites |= 1 << player
            if can_produce(world, rules, player, unit, product):
                allowed |= 1 << player
                claim_site(world, rules, player, unit, product)
    for turn in range(2 * rules.num_players):
        player = turn % rules.num_players
        is_site = sites >> player & 1
        if world.players[player, s.IS_ALIVE] == 0 or is_site != turn // rules.num_players:
            continue
        is_allowed = allowed >> player & 1 != 0
        if (is_site != 0 and not is_allowed) or not obey(
            world, rules, player, actions[player], is_allowed
        ):
            world.illegal[player] += 1
    if allowed > 0:
        clear_site_claims(world)


@compiled
def obey(world: Any, rules: Any, player: int, action: int, may_build: bool) -> bool:
    """Carry out the order of one player; False for an illegal one."""
    product = product_of(world, rules, player, action)
    if product != NOWHERE:
        unit = int(world.players[player, s.CURSOR])
        is_legal = may_build or can_produce(world, rules, player, unit, product)
        if is_legal:
            produce(world, rules, player, unit, product)
            if rules.action_space != rb.CLASSIC_ACTIONS:
                pass_cursor(world, player)
        return is_legal
    if rules.action_space == rb.CLASSIC_ACTIONS:
        return obey_classic_action(world, rules, player, action)
    return obey_unit_action(world, rules, player, action)
