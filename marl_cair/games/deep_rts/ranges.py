"""The values that a state of Deep RTS may hold; what must hold between fields: `consistency`."""

from __future__ import annotations

from functools import partial

from marl_cair.games.checks.state import ANY_WORD, MOST_COUNTED, Range, StateLimits
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.consistency import list_conditions
from marl_cair.games.deep_rts.orders.grid import NUM_GRID
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.motion import MAX_BLOCKED
from marl_cair.games.deep_rts.rules.paths import ANY_RESOURCE, LAST_SEARCH, NOT_FOR_RESOURCE
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game import NO_WINNER

_MOST_SERIALS = 2**24 - 1  # dice give each of these numbers of its own in a tick
_WIDEST = 2  # cells from the centre of the largest building to its side
_FARTHEST = 16**2  # the reach of a wish, from a range of 15

Columns = dict[str, tuple[int, int]]  # the range of each column of a table, in its order


def state_limits(scenario: Scenario) -> StateLimits:
    """What the worlds of `scenario` may hold."""
    rules = rb.make_rules(scenario)
    units = scenario.num_players * scenario.slots_per_player

    ranges = {
        "clock": _join(_clock_columns(rules, units, scenario.num_cells)),
        "seed": Range(*ANY_WORD),
        "board": _board_range(rules, units, scenario.num_cells),
        "players": _join(_player_columns(rules, units)),
        "illegal": Range(0, MOST_COUNTED),
        "roster": Range(s.NO_UNIT, units - 1),
        "vision": Range(0, scenario.slots_per_player if scenario.fog else 0),
        "known": Range(0 if scenario.fog else s.UNKNOWN, s.UNKNOWN),
        "units": _join(_unit_columns(rules, units, scenario.num_cells)),
        "due": Range(0, s.NEVER),
        "path": Range(*ANY_WORD),
        "acting": Range(0, units - 1),
    }
    return StateLimits(ranges, partial(list_conditions, rules=rules))


def _join(columns: Columns) -> Range:
    lowest, highest = zip(*columns.values(), strict=True)
    return Range(lowest, highest, tuple(columns))


def _clock_columns(rules: rb.Rules, units: int, cells: int) -> Columns:
    return {
        "TICK": (0, rules.max_ticks),
        "PHASE": (s.RUNNING, s.TRUNCATED),
        "WINNER": (NO_WINNER, rules.num_players - 1),
        "MAP_INDEX": (0, len(rules.map_tiles) - 1),
        "WAKE": (0, s.NEVER),
        "NUM_BURNING": (0, units),
        "NUM_SEARCHES": (0, LAST_SEARCH),
        "NUM_ACTING": (0, units),
        "NUM_FALLEN": (0, 0),
        "WISH goal": (0, cells - 1),
        "WISH half": (0, _WIDEST),
        "WISH reach": (0, _FARTHEST),
        "WISH resource": (NOT_FOR_RESOURCE, ANY_RESOURCE),
    }


def _board_range(rules: rb.Rules, units: int, cells: int) -> Range:
    layers = {
        "TILE": (0, t.NUM_TILE_KINDS - 1),
        "AMOUNT": (0, int(rules.tiles[:, rb.TILE_AMOUNT].max())),
        "OCCUPANT": (s.NO_UNIT, units - 1),
        "CLAIM": (0, 0),
        "REACHED": (0, LAST_SEARCH),
        "CAME": (0, rb.NUM_DIRECTIONS - 1),
        "FRONTIER": (0, max(cells, NUM_GRID) - 1),
    }
    bounds = _join(layers)
    lowest, highest = ([[end] for end in ends] for ends in (bounds.low, bounds.high))
    return Range(lowest, highest, bounds.columns, axis=-2)


def _player_columns(rules: rb.Rules, units: int) -> Columns:
    most_food = 2 * rules.slots * (s.QUEUE_LENGTH + 1) * max(1, rules.food_limit)
    levels = rules.upgrade[:, rb.UPGRADE_LEVELS]
    return {
        "IS_ALIVE": (0, 1),
        "FOOD_USED": (0, most_food),
        "FOOD_MADE": (0, most_food),
        "CURSOR": (s.NO_UNIT, units - 1),
        "DAMAGE_DONE": (0, MOST_COUNTED),
        "DAMAGE_TAKEN": (0, MOST_COUNTED),
        "NEXT_SERIAL": (0, _MOST_SERIALS),
        "NUM_UNITS": (0, rules.slots),
        "IS_OUT": (0, 1),
        **{f"RESOURCES {name}": (0, t.MAX_RESOURCE) for name in t.RESOURCE_NAMES},
        **{f"GATHERED {name}": (0, t.MAX_RESOURCE) for name in t.RESOURCE_NAMES},
        **{
            f"UPGRADES {name}": (0, int(level))
            for name, level in zip(t.UPGRADE_NAMES, levels, strict=True)
        },
        **{f"NUM_CREATED {name}": (0, _MOST_SERIALS) for name in t.UNIT_NAMES},
        **{f"NUM_OWNED {name}": (0, rules.slots) for name in t.UNIT_NAMES},
    }


def _unit_columns(rules: rb.Rules, units: int, cells: int) -> Columns:
    last_ready = rules.max_ticks + int(rules.kinds[:, rb.KIND_ATTACK_TICKS].max())
    most_carried = rules.carry_capacity + int(rules.tiles[:, rb.TILE_YIELD].max())
    return {
        "UNIT_KIND": (t.NO_KIND, t.NUM_KINDS - 1),
        "UNIT_STATE": (0, s.PUMPING),
        "UNIT_CELL": (0, cells - 1),
        "UNIT_HEALTH": (0, int(rules.kinds[:, rb.KIND_HEALTH].max())),
        "UNIT_ORDER": (s.NO_ORDER, s.REPAIR),
        "UNIT_FACING": (0, rb.NUM_DIRECTIONS - 1),
        "UNIT_GOAL": (0, cells - 1),
        "UNIT_TARGET": (s.NO_UNIT, units - 1),
        "UNIT_TARGET_SERIAL": (0, _MOST_SERIALS),
        "UNIT_PATH_STEPS": (0, s.PATH_STEPS),
        "UNIT_BLOCKED": (0, MAX_BLOCKED),
        "UNIT_EXIT": (s.NO_GOAL, s.NO_GOAL),
        "UNIT_SERIAL": (0, _MOST_SERIALS),
        "UNIT_SINCE": (0, rules.max_ticks),
        "UNIT_READY": (0, last_ready),
        "UNIT_CARRY": (0, most_carried),
        "UNIT_CARRY_KIND": (t.NO_RESOURCE, t.NUM_RESOURCES - 1),
        "UNIT_PARTNER": (s.NO_UNIT, units - 1),
        "UNIT_RALLY": (0, cells - 1),
        "UNIT_HURT": (0, 0),
        "UNIT_HURT_BY": (s.NO_UNIT, units - 1),
        "UNIT_QUEUE_LENGTH": (0, s.QUEUE_LENGTH),
        **{f"UNIT_QUEUE {place}": (0, t.NUM_PRODUCTS - 1) for place in range(s.QUEUE_LENGTH)},
    }
