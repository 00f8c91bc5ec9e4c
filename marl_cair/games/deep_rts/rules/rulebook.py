"""The constants of a scenario, as the arrays that the compiled rules read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts import tables
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.maps import from_own

if TYPE_CHECKING:
    from marl_cair.games.deep_rts.maps.maps import GameMap
    from marl_cair.games.deep_rts.scenarios import Scenario

UNIT_ACTIONS, CLASSIC_ACTIONS, GRID_ACTIONS = range(3)
ACTION_NUMBERS = {"unit": UNIT_ACTIONS, "classic": CLASSIC_ACTIONS, "grid": GRID_ACTIONS}
CONQUEST, GOLD_GOAL, LUMBER_GOAL, SCORE_GOAL, ARMY_GOAL = range(5)
GOAL_NUMBERS = {
    "conquest": CONQUEST,
    "gold": GOLD_GOAL,
    "lumber": LUMBER_GOAL,
    "score": SCORE_GOAL,
    "army": ARMY_GOAL,
}

# Directions: the four straight ones, then the diagonals; even a turn of the board keeps the halves.
NUM_DIRECTIONS, NUM_STRAIGHT = 8, 4
NO_DIRECTION = 8
NO_FEATURE = -1
ROW_STEP = (-1, 0, 1, 0, -1, 1, 1, -1)
COLUMN_STEP = (0, 1, 0, -1, 1, 1, -1, -1)
NUM_FRAMES = 8
EXIT_CELLS = 5  # how far from its building a unit may appear

# --- columns -----------------------------------------------------------------------------------

(
    KIND_HEALTH,
    KIND_FOOD_PRODUCED,
    KIND_FOOD_CONSUMED,
    KIND_DAMAGE_MIN,
    KIND_DAMAGE_MAX,
    KIND_PIERCING,
    KIND_RANGE_TILES,
    KIND_ARMOUR,
    KIND_SIGHT,
    KIND_WALK_TICKS,
    KIND_ATTACK_TICKS,
    KIND_HALF_SIZE,  # cells from the centre to the side of a building
) = range(12)
PRODUCT_IS_ENABLED, PRODUCT_TICKS, PRODUCT_COST = range(3)  # the cost has a column per resource
UPGRADE_LEVELS, UPGRADE_BONUS = range(2)
WALK_PERCENT, TILE_DAMAGE, TILE_AMOUNT, TILE_YIELD, TILE_RESOURCE = range(5)
START_RESOURCES = 0
START_ARMY = START_RESOURCES + t.NUM_RESOURCES  # units at the start in place of a base, by kind
SEAT_SPAWN, SEAT_FRAME = range(2)
CELL_ROW, CELL_COLUMN = range(2)
EXIT_ROW, EXIT_COLUMN = range(2)


class Rules(NamedTuple):
    """The constants of a scenario, handed to the kernels so that none is compiled in.

    K kinds, N cells with the border, M maps, P players, D = rows * columns own cells.
    """

    kinds: NDArray[np.int32]  # [K, NUM_KIND_COLUMNS]
    product: NDArray[np.int32]  # [products, NUM_PRODUCT_COLUMNS]
    products: NDArray[np.int8]  # [K, MAX_PRODUCTS] what each kind makes, or -1
    can_make: NDArray[np.bool_]  # [K, products]
    upgrade: NDArray[np.int32]  # [upgrades, NUM_UPGRADE_COLUMNS]
    tiles: NDArray[np.int32]  # [tile kinds, NUM_TILE_COLUMNS]
    start: NDArray[np.int32]  # [NUM_START_COLUMNS]
    team: NDArray[np.int8]  # [P]
    map_tiles: NDArray[np.uint8]  # [M, N]
    seats: NDArray[np.int16]  # [M, P, NUM_SEAT_COLUMNS]
    cells: NDArray[np.int16]  # [N, NUM_CELL_COLUMNS]
    offset: NDArray[np.int32]  # [NUM_DIRECTIONS] to the neighbouring cell
    own_direction: NDArray[np.int8]  # [NUM_FRAMES, NUM_DIRECTIONS] own -> direction on the board
    own_offset: NDArray[np.int32]  # [NUM_FRAMES, NUM_DIRECTIONS] own -> to the neighbouring cell
    world_cell: NDArray[np.int16]  # [NUM_FRAMES, D] own row * columns + column -> cell
    own_cell: NDArray[np.int16]  # [NUM_FRAMES, N] cell -> own row * columns + column
    own_place: NDArray[np.int16]  # [NUM_FRAMES, N, 2] cell -> own row and column
    features: NDArray[np.int16]  # [M, F] cells that are not grass at the start, then NO_FEATURE
    exits: NDArray[np.int8]  # [NUM_FRAMES, E, NUM_EXIT_COLUMNS] steps, the nearest first
    sight_span: NDArray[np.int16]  # [16 radii, 16 rows away] columns to each side, -1 none
    rows: int
    columns: int
    stride: int
    num_players: int
    slots: int  # of each player
    food_limit: int
    start_food: int
    start_peasants: int
    starts_with_hall: int
    harvest_ticks: int
    carry_capacity: int
    oil_ticks: int
    armour_percent: int
    adds_minimum_twice: int
    roll_low: int
    roll_high: int
    harvests_forever: int
    has_auto_attack: int
    has_instant_build: int
    repair_percent: int
    fog: int
    action_space: int
    goal: int
    goal_amount: int
    tile_pixels: int
    ticks_per_step: int
    max_ticks: int
    shaping: float
    discount: float


def make_rules(scenario: Scenario) -> Rules:
    """The numbers of `scenario` as arrays."""
    preset = t.PRESETS[scenario.preset]
    rows, columns = scenario.rows, scenario.columns
    stride = columns + 2
    row_of, column_of = np.divmod(np.arange((rows + 2) * stride), stride)
    world_cell, own_cell = _own_views(rows, columns)
    offset = np.array(ROW_STEP, np.int32) * stride + np.array(COLUMN_STEP, np.int32)
    own_direction = _own_directions()
    return Rules(
        **_unit_numbers(preset, scenario),
        **_product_numbers(preset),
        **_map_numbers(scenario),
        cells=np.stack([row_of - 1, column_of - 1], axis=-1).astype(np.int16),
        offset=offset,
        own_direction=own_direction,
        own_offset=offset[own_direction],
        world_cell=world_cell,
        own_cell=own_cell,
        own_place=np.stack(np.divmod(own_cell, columns), axis=-1).astype(np.int16),
        exits=_exits(),
        sight_span=_sight_spans(),
        rows=rows,
        columns=columns,
        stride=stride,
        num_players=scenario.num_players,
        slots=scenario.slots_per_player,
        food_limit=preset.food_limit,
        start_food=preset.start_food,
        start_peasants=preset.start_peasants,
        starts_with_hall=int(preset.starts_with_hall),
        harvest_ticks=preset.harvest_ticks,
        carry_capacity=preset.carry_capacity,
        oil_ticks=preset.oil_ticks,
        armour_percent=preset.armour_percent,
        adds_minimum_twice=int(preset.adds_minimum_twice),
        roll_low=preset.roll_low_percent,
        roll_high=preset.roll_high_percent,
        harvests_forever=int(preset.harvests_forever),
        has_auto_attack=int(preset.has_auto_attack),
        has_instant_build=int(preset.has_instant_build),
        repair_percent=preset.repair_percent,
        fog=int(scenario.fog),
        action_space=ACTION_NUMBERS[scenario.actions],
        goal=GOAL_NUMBERS[scenario.goal],
        goal_amount=scenario.goal_amount,
        tile_pixels=scenario.tile_pixels,
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        shaping=float(scenario.reward == "shaped"),
        discount=float(scenario.shaping_discount),
    )


def _unit_numbers(preset: t.Preset, scenario: Scenario) -> dict[str, Any]:
    kinds = (
        preset.health,
        preset.food_produced,
        preset.food_consumed,
        preset.damage_min,
        preset.damage_max,
        preset.piercing,
        preset.range_tiles,
        preset.armour,
        preset.sight_tiles,
        preset.walk_ticks,
        preset.attack_ticks,
        tuple(size // 2 for size in preset.size_tiles),
    )
    tiles = (
        preset.walk_percent,
        preset.tile_damage,
        preset.tile_amount,
        preset.tile_yield,
        tables.TILE_RESOURCE,
    )
    store = (preset.start_gold, preset.start_lumber, preset.start_stone, preset.start_oil)
    army = scenario.army or (0,) * t.NUM_MOBILE_KINDS
    return {
        "kinds": np.stack(kinds, axis=-1).astype(np.int32),
        "tiles": np.stack(tiles, axis=-1).astype(np.int32),
        "start": np.array((*store, *army), np.int32),
        "upgrade": np.stack((preset.upgrade_levels, preset.upgrade_bonus), axis=-1).astype(
            np.int32
        ),
    }


def _product_numbers(preset: t.Preset) -> dict[str, Any]:
    numbers = np.zeros((t.NUM_PRODUCTS, PRODUCT_COST + t.NUM_RESOURCES), np.int32)
    units, upgrades = numbers[: t.NUM_KINDS], numbers[t.NUM_KINDS :]
    units[:, PRODUCT_IS_ENABLED] = preset.is_enabled
    upgrades[:, PRODUCT_IS_ENABLED] = preset.is_enabled[tables.SMITHY]
    units[:, PRODUCT_TICKS], upgrades[:, PRODUCT_TICKS] = preset.build_ticks, preset.upgrade_ticks
    if preset.has_instant_build:
        numbers[:, PRODUCT_TICKS] = 1
    units[:, PRODUCT_COST:] = np.stack(
        [preset.cost_gold, preset.cost_lumber, preset.cost_stone, preset.cost_oil], axis=-1
    )
    upgrades[:, PRODUCT_COST + tables.GOLD] = preset.upgrade_gold
    upgrades[:, PRODUCT_COST + tables.OIL] = preset.upgrade_oil
    products = np.full((t.NUM_KINDS, t.MAX_PRODUCTS), -1, np.int8)
    can_make = np.zeros((t.NUM_KINDS, t.NUM_PRODUCTS), np.bool_)
    for kind, made in enumerate(t.PRODUCTS):
        products[kind, : len(made)] = made
        can_make[kind, list(made)] = True
    return {"product": numbers, "products": products, "can_make": can_make}


def _map_numbers(scenario: Scenario) -> dict[str, Any]:
    players = scenario.num_players
    return {
        "map_tiles": np.stack([_with_border(game_map) for game_map in scenario.maps]),
        "seats": np.array(
            [
                [
                    ((row + 1) * (scenario.columns + 2) + column + 1, frame)
                    for (row, column), frame in zip(m.spawns, m.frames, strict=True)
                ][:players]
                for m in scenario.maps
            ],
            np.int16,
        ),
        "features": _features(scenario),
        "team": np.array(scenario.teams or range(players), np.int8),
    }


def _features(scenario: Scenario) -> NDArray[np.int16]:
    """Cells of each map that a plane shows something of; they only become fewer."""
    listed = [np.flatnonzero(_with_border(game_map)) for game_map in scenario.maps]
    inside = (scenario.columns + 2) * np.arange(1, scenario.rows + 1)[:, None]
    inside = (inside + np.arange(1, scenario.columns + 1)).ravel()
    listed = [np.intersect1d(cells, inside) for cells in listed]
    table = np.full((len(listed), max(map(len, listed)) + 1), NO_FEATURE, np.int16)
    for row, cells in zip(table, listed, strict=True):
        row[: len(cells)] = cells
    return table


def _with_border(game_map: GameMap) -> NDArray[np.uint8]:
    return np.pad(game_map.tiles, 1, constant_values=t.WALL).astype(np.uint8).ravel()


def _own_directions() -> NDArray[np.int8]:
    """For each frame the direction on the board of each direction of the own view."""
    steps = list(zip(ROW_STEP, COLUMN_STEP, strict=True))
    side = 3
    table = np.zeros((NUM_FRAMES, NUM_DIRECTIONS), np.int8)
    for frame in range(NUM_FRAMES):
        centre = from_own(frame, 1, 1, side, side)
        for direction, (row, column) in enumerate(steps):
            there = from_own(frame, 1 + row, 1 + column, side, side)
            table[frame, direction] = steps.index((there[0] - centre[0], there[1] - centre[1]))
    return table


def _exits() -> NDArray[np.int8]:
    """Steps [frames, E, 2] from a building's centre on the board, in an order of the own view."""
    span = range(-EXIT_CELLS, EXIT_CELLS + 1)
    own = [(row, column) for row in span for column in span if (row, column) != (0, 0)]
    own.sort(key=lambda step: (max(abs(step[0]), abs(step[1])), step[0] ** 2 + step[1] ** 2))
    side = 2 * EXIT_CELLS + 1
    table = np.zeros((NUM_FRAMES, len(own), 2), np.int8)
    for frame in range(NUM_FRAMES):
        for index, (row, column) in enumerate(own):
            there = from_own(frame, EXIT_CELLS + row, EXIT_CELLS + column, side, side)
            table[frame, index] = there[0] - EXIT_CELLS, there[1] - EXIT_CELLS
    return table


def _own_views(rows: int, columns: int) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """Own cells -> cells with the border, and back, for each frame that fits the board."""
    stride = columns + 2
    world_cell = np.zeros((NUM_FRAMES, rows * columns), np.int16)
    own_cell = np.zeros((NUM_FRAMES, (rows + 2) * stride), np.int16)
    for frame in range(NUM_FRAMES if rows == columns else 4):
        for own in range(rows * columns):
            row, column = from_own(frame, own // columns, own % columns, rows, columns)
            cell = (row + 1) * stride + column + 1
            world_cell[frame, own] = cell
            own_cell[frame, cell] = own
    return world_cell, own_cell


def _sight_spans() -> NDArray[np.int16]:
    """How far a unit sees to each side, by its sight and by the rows away: a round disc."""
    radius, away = np.arange(16)[:, None], np.arange(16)[None, :]
    reach = radius * radius + radius - away * away
    spans = np.where(reach >= 0, np.floor(np.sqrt(np.maximum(0, reach))), -1)
    return np.where(away <= radius, spans, -1).astype(np.int16)
