"""One decision of all players: who is told what, and what is refused."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.orders.classic import (
    CLASSIC_BUILD,
    NUM_CLASSIC_BUILDS,
    obey_classic_action,
)
from marl_cair.games.deep_rts.orders.cursor import pass_cursor
from marl_cair.games.deep_rts.orders.grid import obey_grids
from marl_cair.games.deep_rts.orders.orders import FIRST_PRODUCT, obey_unit_action
from marl_cair.games.deep_rts.rules.board import is_building
from marl_cair.games.deep_rts.rules.building import (
    can_produce,
    claim_site,
    clear_site_claims,
    produce,
)
from marl_cair.games.deep_rts.rules.paths import NOWHERE
from marl_cair.games.deep_rts.rules.rulebook import CLASSIC_ACTIONS
from marl_cair.games.deep_rts.state import (
    CURSOR,
    IS_ALIVE,
    NO_UNIT,
    UNIT_KIND,
)
from marl_cair.games.deep_rts.tables import (
    NUM_PRODUCTS,
)


@compiled
def product_of(world: Any, rules: Any, player: int, action: int) -> int:
    """The product that an action asks the cursor's unit for, NOWHERE for none."""
    if rules.action_space == CLASSIC_ACTIONS:
        unit = world.players[player, CURSOR]
        slot = action - CLASSIC_BUILD
        if unit == NO_UNIT or not 0 <= slot < NUM_CLASSIC_BUILDS:
            return NOWHERE
        return int(rules.products[world.units[unit, UNIT_KIND], slot])
    product = action - FIRST_PRODUCT
    return int(product) if 0 <= product < NUM_PRODUCTS else NOWHERE


@compiled
def wants_site(world: Any, rules: Any, player: int, action: int) -> bool:
    """True where a peasant is told to build."""
    unit = int(world.players[player, CURSOR])
    if unit == NO_UNIT or is_building(world, unit):
        return False
    return product_of(world, rules, player, action) != NOWHERE


@compiled
def obey(world: Any, rules: Any, player: int, action: int, may_build: bool) -> bool:
    """The order of one player; False for an illegal one."""
    product = product_of(world, rules, player, action)
    if product != NOWHERE:
        unit = int(world.players[player, CURSOR])
        is_legal = may_build or can_produce(world, rules, player, unit, product)
        if is_legal:
            produce(world, rules, player, unit, product)
            if rules.action_space != CLASSIC_ACTIONS:
                pass_cursor(world, player)
        return is_legal
    if rules.action_space == CLASSIC_ACTIONS:
        return obey_classic_action(world, rules, player, action)
    return obey_unit_action(world, rules, player, action)


@compiled
def obey_all(world: Any, rules: Any, actions: Any) -> None:
    """The orders of a decision, [P] or [P, H, W] of `grid`.

    Sites that two players want to build on at once are refused to both.
    """
    # Known when compiling: the rules of one kind of actions hold nothing of the other.
    if actions.ndim == 1:
        obey_cursors(world, rules, actions)
    else:
        obey_grids(world, rules, actions)


@compiled
def obey_cursors(world: Any, rules: Any, actions: Any) -> None:
    """One order of each player, for the unit under its cursor."""
    site_wishes, may_build = 0, 0  # bits of players
    for player in range(rules.num_players):
        if wants_site(world, rules, player, actions[player]):
            site_wishes |= 1 << player
            product = product_of(world, rules, player, actions[player])
            unit = int(world.players[player, CURSOR])
            if can_produce(world, rules, player, unit, product):
                may_build |= 1 << player
                claim_site(world, rules, player, unit, product)
    for turn in range(2 * rules.num_players):
        # Sites come last: all other orders are about the board that their players saw.
        player = turn % rules.num_players
        is_site = site_wishes >> player & 1
        if world.players[player, IS_ALIVE] == 0 or is_site != turn // rules.num_players:
            continue
        is_allowed = may_build >> player & 1 != 0
        if (is_site != 0 and not is_allowed) or not obey(
            world, rules, player, actions[player], is_allowed
        ):
            world.illegal[player] += 1
    if may_build > 0:
        clear_site_claims(world)
