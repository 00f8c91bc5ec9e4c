"""The original's 16 actions, corrected: the diagonals lead where they say, archers shoot."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders.cursor import num_others, step_cursor
from marl_cair.games.deep_rts.orders.orders import give_order, obey_go
from marl_cair.games.deep_rts.orders.sights import order_at
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_building, sees
from marl_cair.games.deep_rts.rules.combat import aim_at, in_range, is_enemy, is_on_board, seniority
from marl_cair.games.deep_rts.rules.paths import NOWHERE

CLASSIC_PREVIOUS, CLASSIC_NEXT, CLASSIC_MOVE = 0, 1, 2
CLASSIC_ATTACK, CLASSIC_HARVEST, CLASSIC_BUILD, CLASSIC_NOOP = 10, 11, 12, 15
NUM_CLASSIC_BUILDS = 3
NUM_CLASSIC = 16
# Left, right, up, down, then the diagonals: directions of the own view.
CLASSIC_DIRECTIONS = (3, 1, 0, 2, 7, 4, 6, 5)


@compiled
def classic_cell(world: Any, rules: Any, player: int, direction: int) -> int:
    """The neighbour of the cursor's unit in a direction of the own view."""
    frame = rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME]
    offset = rules.offset[rules.own_direction[frame, direction]]
    return int(world.units[world.players[player, s.CURSOR], s.UNIT_CELL] + offset)


@compiled
def may_step(world: Any, rules: Any, player: int, cell: int) -> bool:
    """True where a classic move leads somewhere or to something to do."""
    unit = int(world.players[player, s.CURSOR])
    if world.board[s.OCCUPANT, cell] != s.NO_UNIT and not is_enemy(
        rules, unit, int(world.board[s.OCCUPANT, cell])
    ):
        return False
    return order_at(world, rules, player, unit, cell) != s.NO_ORDER


@compiled
def classic_victim(world: Any, rules: Any, player: int) -> int:
    """The enemy in sight and range that the cursor's unit would attack, the first by seniority."""
    unit = int(world.players[player, s.CURSOR])
    if rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_DAMAGE_MAX] == 0:
        return s.NO_UNIT
    best, best_rank = s.NO_UNIT, np.int64(2) ** 62
    for step in range(1, rules.num_players):
        other = (player + step) % rules.num_players
        if rules.team[other] == rules.team[player]:
            continue
        for place in range(world.players[other, s.NUM_UNITS]):
            enemy = int(world.roster[other, place])
            rank = np.int64(seniority(world, rules, player, enemy))
            if (
                rank < best_rank
                and in_range(world, rules, unit, enemy)
                and is_on_board(world, enemy)
                and sees(world, rules, player, int(world.units[enemy, s.UNIT_CELL]))
            ):
                best, best_rank = enemy, rank
    return best


@compiled
def classic_tile(world: Any, rules: Any, player: int) -> int:
    """The resource tile beside the cursor's peasant, the first in its view; or NOWHERE."""
    unit = int(world.players[player, s.CURSOR])
    if world.units[unit, s.UNIT_KIND] != t.PEASANT:
        return NOWHERE
    for direction in range(rb.NUM_DIRECTIONS):
        cell = classic_cell(world, rules, player, direction)
        resource = rules.tiles[world.board[s.TILE, cell], rb.TILE_RESOURCE]
        if resource not in (t.NO_RESOURCE, t.OIL) and world.board[s.AMOUNT, cell] > 0:
            return cell
    return NOWHERE


@compiled
def obey_classic_action(world: Any, rules: Any, player: int, action: int) -> bool:
    """One of the 16 actions but the builds; False for an illegal one."""
    if action <= CLASSIC_NEXT:
        is_legal = num_others(world, player) > 0
        if is_legal:
            step_cursor(world, player, 1 if action == CLASSIC_NEXT else -1)
        return is_legal
    if action == CLASSIC_NOOP:
        return True
    unit = int(world.players[player, s.CURSOR])
    if unit == s.NO_UNIT or is_building(world, unit):
        return False
    if action < CLASSIC_ATTACK:
        cell = classic_cell(world, rules, player, CLASSIC_DIRECTIONS[action - CLASSIC_MOVE])
        return may_step(world, rules, player, cell) and obey_go(world, rules, player, unit, cell)
    if action == CLASSIC_ATTACK:
        victim = classic_victim(world, rules, player)
        if victim != s.NO_UNIT:
            give_order(world, unit, s.ATTACK, s.NO_GOAL)
            aim_at(world, unit, victim)
        return victim != s.NO_UNIT
    if action == CLASSIC_HARVEST:
        tile = classic_tile(world, rules, player)
        if tile != NOWHERE:
            give_order(world, unit, s.HARVEST, tile)
        return tile != NOWHERE
    return False
