"""The constants of a scenario, as the arrays that the compiled rules read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.maps import transform_tiles
from marl_cair.games.deep_rts.scenarios import ACTION_SPACES, GOALS

if TYPE_CHECKING:
    from marl_cair.games.deep_rts.scenarios import Scenario

UNIT_ACTIONS, CLASSIC_ACTIONS, GRID_ACTIONS = range(3)  # in the order of ACTION_SPACES
CONQUEST, GOLD_GOAL, LUMBER_GOAL, SCORE_GOAL, ARMY_GOAL = range(5)  # in the order of GOALS

# Directions: the four straight ones, then the diagonals; even a turn of the board keeps the halves.
NUM_DIRECTIONS = 8
NO_DIRECTION = 8
NO_FEATURE = -1
ROW_STEP = (-1, 0, 1, 0, -1, 1, 1, -1)
COLUMN_STEP = (0, 1, 0, -1, 1, 1, -1, -1)
NUM_FRAMES = 8
EXIT_CELLS = 5  # how far from its building a unit may appear

# --- columns -----------------------------------------------------------------------------------

KIND_HEALTH, KIND_FOOD_PRODUCED, KIND_FOOD_CONSUMED, KIND_DAMAGE_MIN, KIND_DAMAGE_MAX = range(5)
KIND_PIERCING, KIND_RANGE_TILES, KIND_ARMOUR, KIND_SIGHT, KIND_WALK_TICKS = range(5, 10)
KIND_ATTACK_TICKS, KIND_HALF_SIZE = range(10, 12)  # half: cells from the centre to the side
PRODUCT_IS_ENABLED, PRODUCT_TICKS, PRODUCT_COST = range(3)  # the cost has a column per resource
UPGRADE_LEVELS, UPGRADE_BONUS = range(2)
WALK_PERCENT, TILE_DAMAGE, TILE_AMOUNT, TILE_YIELD, TILE_RESOURCE = range(5)
START_RESOURCES = 0
START_ARMY = START_RESOURCES + t.NUM_RESOURCES  # units at the start in place of a base, by kind
SEAT_SPAWN, SEAT_FRAME = range(2)
CELL_ROW, CELL_COLUMN = range(2)
EXIT_ROW, EXIT_COLUMN = range(2)


class Rules(NamedTuple):
    """The constants of a scenario, passed to the compiled rules so that none is compiled in.

    K kinds, N cells with the border, M maps, P players, D = rows * columns own cells. The whole
    numbers that a preset or scenario has too are those, with the same name.
    """

    kinds: NDArray[np.int32]  # [K, NUM_KIND_COLUMNS]
    product: NDArray[np.int32]  # [products, NUM_PRODUCT_COLUMNS]
    products: NDArray[np.int8]  # [K, MAX_PRODUCTS] what each kind makes, or -1
    can_make: NDArray[np.bool_]  # [K, products]
    upgrade: NDArray[np.int32]  # [upgrades, NUM_UPGRADE_COLUMNS]
    tiles: NDArray[np.int32]  # [tile kinds, NUM_TILE_COLUMNS]
    start: NDArray[np.int32]  # [NUM_START_COLUMNS]
    team: NDArray[np.int8]  # [P] the first seat of the player's team
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
    roll_low_percent: int
    roll_high_percent: int
    harvests_forever: int
    has_auto_attack: int
    repair_percent: int
    fog: int
    action_space: int
    goal: int
    goal_amount: int
    tile_pixels: int
    wealth: int
    ticks_per_step: int
    max_ticks: int
    shaping: float
    discount: float
    keeps_potential: bool  # at the end of the game


def make_rules(scenario: Scenario) -> Rules:
    """The numbers of `scenario` as arrays."""
    preset = t.PRESETS[scenario.preset]
    same: dict[str, Any] = {
        name: int(getattr(source, name))
        for source in (preset, scenario)
        for name in Rules._fields
        if isinstance(getattr(source, name, None), int)
    }
    return Rules(
        **same,
        **_preset_arrays(preset),
        **_map_arrays(scenario),
        **_own_views(scenario.rows, scenario.columns),
        start=np.array(
            (
                *preset.start_stores,
                *(scenario.army or (0,) * t.NUM_MOBILE_KINDS),
            ),
            np.int32,
        ),
        sight_span=_sight_spans(),
        stride=scenario.columns + 2,
        slots=scenario.slots_per_player,
        action_space=list(ACTION_SPACES).index(scenario.actions),
        goal=list(GOALS).index(scenario.goal),
        shaping=float(scenario.reward != "sparse"),
        discount=1.0 if scenario.reward == "gains" else float(scenario.shaping_discount),
        keeps_potential=scenario.reward == "gains",
    )


def _preset_arrays(preset: t.Preset) -> dict[str, Any]:
    kinds = [preset.health, preset.food_produced, preset.food_consumed, preset.damage_min]
    kinds += [preset.damage_max, preset.piercing, preset.range_tiles, preset.armour]
    kinds += [preset.sight_tiles, preset.walk_ticks, preset.attack_ticks]
    kinds += [tuple(size // 2 for size in preset.size_tiles)]
    tiles = [preset.walk_percent, preset.tile_damage, preset.tile_amount, preset.tile_yield]
    costs = [preset.cost_gold, preset.cost_lumber, preset.cost_stone, preset.cost_oil]
    product = np.zeros((t.NUM_PRODUCTS, PRODUCT_COST + t.NUM_RESOURCES), np.int32)
    units, upgrades = product[: t.NUM_KINDS], product[t.NUM_KINDS :]
    units[:, PRODUCT_IS_ENABLED] = preset.is_enabled
    upgrades[:, PRODUCT_IS_ENABLED] = preset.is_enabled[t.SMITHY]
    units[:, PRODUCT_TICKS], upgrades[:, PRODUCT_TICKS] = preset.build_ticks, preset.upgrade_ticks
    if preset.has_instant_build:
        product[:, PRODUCT_TICKS] = 1
    units[:, PRODUCT_COST:] = np.transpose(costs)
    upgrades[:, PRODUCT_COST + t.GOLD] = preset.upgrade_gold
    upgrades[:, PRODUCT_COST + t.OIL] = preset.upgrade_oil
    products = np.full((t.NUM_KINDS, t.MAX_PRODUCTS), -1, np.int8)
    can_make = np.zeros((t.NUM_KINDS, t.NUM_PRODUCTS), np.bool_)
    for kind, made in enumerate(t.PRODUCTS):
        products[kind, : len(made)] = made
        can_make[kind, list(made)] = True
    return {
        "kinds": np.stack(kinds, axis=-1).astype(np.int32),
        "product": product,
        "products": products,
        "can_make": can_make,
        "upgrade": np.stack([preset.upgrade_levels, preset.upgrade_bonus], -1).astype(np.int32),
        "tiles": np.stack([*tiles, t.TILE_RESOURCE], axis=-1).astype(np.int32),
    }


def _map_arrays(scenario: Scenario) -> dict[str, Any]:
    maps, teams = scenario.maps, scenario.teams or tuple(range(scenario.num_players))
    tiles = [np.pad(game_map.tiles, 1, constant_values=t.WALL).ravel() for game_map in maps]
    seats = [
        [
            ((row + 1) * (scenario.columns + 2) + column + 1, frame)
            for (row, column), frame in zip(game_map.spawns, game_map.frames, strict=True)
        ][: scenario.num_players]
        for game_map in maps
    ]
    # A plane shows something of these cells; they only become fewer. The border is none of them.
    listed = [np.flatnonzero(np.pad(game_map.tiles, 1)) for game_map in maps]
    features = np.full((len(maps), max(map(len, listed)) + 1), NO_FEATURE, np.int16)
    for row, cells in zip(features, listed, strict=True):
        row[: len(cells)] = cells
    return {
        "map_tiles": np.stack(tiles).astype(np.uint8),
        "seats": np.array(seats, np.int16),
        "features": features,
        "team": np.array([teams.index(team) for team in teams], np.int8),
    }


def _own_views(rows: int, columns: int) -> dict[str, Any]:
    """Cells and directions of the own view in each frame, and cells with the border."""
    stride = columns + 2
    cells: NDArray[Any] = np.arange((rows + 2) * stride).reshape(rows + 2, stride)
    world_cell = np.zeros((NUM_FRAMES, rows * columns), np.int16)
    own_cell = np.zeros((NUM_FRAMES, cells.size), np.int16)
    for frame in range(NUM_FRAMES if rows == columns else 4):  # only a square can be turned
        world_cell[frame] = transform_tiles(cells[1:-1, 1:-1], frame).ravel()
        own_cell[frame, world_cell[frame]] = np.arange(rows * columns)
    steps = np.stack([ROW_STEP, COLUMN_STEP], axis=-1)
    offset = (steps @ [stride, 1]).astype(np.int32)
    own_steps = _turn_steps(steps)
    is_same = (own_steps[:, :, None] == steps).all(axis=-1)
    own_direction = is_same.argmax(axis=-1).astype(np.int8)
    around = np.stack(np.divmod(np.arange((2 * EXIT_CELLS + 1) ** 2), 2 * EXIT_CELLS + 1), axis=-1)
    around -= EXIT_CELLS
    nearest = np.lexsort(((around**2).sum(axis=-1), abs(around).max(axis=-1)))[1:]
    return {
        "cells": np.stack(np.divmod(cells.ravel(), stride), axis=-1).astype(np.int16) - 1,
        "offset": offset,
        "own_direction": own_direction,
        "own_offset": offset[own_direction],
        "world_cell": world_cell,
        "own_cell": own_cell,
        "own_place": np.stack(np.divmod(own_cell, columns), axis=-1).astype(np.int16),
        "exits": _turn_steps(around[nearest]).astype(np.int8),
    }


def _turn_steps(steps: NDArray[Any]) -> NDArray[np.intp]:
    """Steps (rows, columns) of the own view [N, 2] as steps on the board [NUM_FRAMES, N, 2]."""
    most = int(abs(steps).max())
    side = 2 * most + 1
    cells: NDArray[Any] = np.arange(side * side).reshape(side, side)
    own = tuple((steps + most).T)
    turned = [transform_tiles(cells, frame)[own] for frame in range(NUM_FRAMES)]
    return np.stack(np.divmod(turned, side), axis=-1) - most


def _sight_spans() -> NDArray[np.int16]:
    """How far a unit sees to each side, by its sight and by the rows away: a round disc."""
    radius, away = np.arange(16)[:, None], np.arange(16)[None, :]
    reach = radius * radius + radius - away * away
    spans = np.where(reach >= 0, np.floor(np.sqrt(np.maximum(0, reach))), -1)
    return np.where(away <= radius, spans, -1).astype(np.int16)
