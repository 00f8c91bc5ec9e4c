"""The definition of Deep RTS as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.art import rendering
from marl_cair.games.deep_rts.bots import bots
from marl_cair.games.deep_rts.orders import (
    classic as classic_orders,
)
from marl_cair.games.deep_rts.orders import (
    grid as grid_orders,
)
from marl_cair.games.deep_rts.orders import (
    masks,
    orders,
)
from marl_cair.games.deep_rts.ranges import state_limits
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules import step as rules
from marl_cair.games.deep_rts.scenarios import GYMNASIUM_PREFIX, PAYS, REWARDS, SCENARIOS, Scenario
from marl_cair.games.deep_rts.views import observation, other_views, planes
from marl_cair.games.deep_rts.views.other_views import CLASSIC_NAMES, VECTOR_NAMES
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation

VERSION = "2"
# Its games went on alike: only who was named the winner out of time has changed.
_ALIKE = ("1",)

_SCRATCH = ("seed", "path", "acting")
_MAKE_NAMES = tuple(f"make_{name}" for name in t.PRODUCT_NAMES)
_CELL_ORDERS = ("go", "advance", "select")
# As rulebook.ROW_STEP and COLUMN_STEP list the directions.
_WAYS = ("up", "right", "down", "left", "up_right", "down_right", "down_left", "up_left")
_CLASSIC_NAMES = (
    "previous_unit",
    "next_unit",
    *(f"move_{way}" for way in ("left", "right", "up", "down")),
    *(f"move_{way}" for way in ("up_left", "up_right", "down_left", "down_right")),
    "attack",
    "harvest",
    *(f"build_{slot}" for slot in range(classic_orders.NUM_CLASSIC_BUILDS)),
    "noop",
)


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    names, group_names, groups, cells, noop = _ACTIONS[scenario.actions](scenario)
    return GameSpec(
        num_players=scenario.num_players,
        action_names=names,
        action_groups=np.array(groups, np.int16),
        action_group_names=group_names,
        action_cells=np.array(cells, np.int32),
        noop_action=noop,
        representations=MappingProxyType(_representations(scenario)),
        static_planes=(),
        exclusive_planes=(
            tuple(range(planes.FIRST_TILE, planes.RESOURCE_LEFT)),
            tuple(range(planes.FIRST_KIND, planes.OWN)),
            tuple(range(planes.OWN, planes.HEALTH)),
        ),
        event_planes=(tuple(range(planes.FIRST_KIND, planes.SELECTED)),),
        resources=t.RESOURCE_NAMES,
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        reward_bound=_reward_bound(scenario),
        pays=PAYS[scenario.goal].format(scenario.goal_amount),
        action_shape=(scenario.rows, scenario.columns) if scenario.actions == "grid" else (),
        teams=scenario.teams,
    )


def name_maps(worlds: Any, scenario: Scenario) -> tuple[str, ...]:
    """The name of the map that each world [B] is played on."""
    maps = scenario.maps
    return tuple(maps[index].name for index in worlds.clock[:, s.MAP_INDEX])


def _reward_bound(scenario: Scenario) -> float:
    """A win from far behind, or more score than one decision can bring."""
    if scenario.goal == "score":
        return 100.0
    return 1.0 + (1.6 if scenario.reward == "shaped" else 0.0)


Actions = tuple[tuple[str, ...], tuple[str, ...], list[int], list[int], int]


def _unit_actions(scenario: Scenario) -> Actions:
    names = ["noop", "next_unit", "stop", "cancel", *_MAKE_NAMES]
    group_names = (*names, *_CELL_ORDERS)
    groups = list(range(len(names)))
    cells = [NO_CELL] * len(names)
    for kind, order in enumerate(_CELL_ORDERS):
        for row in range(scenario.rows):
            for column in range(scenario.columns):
                names.append(f"{order}_r{row}_c{column}")
                groups.append(orders.FIRST_CELL + kind)
                cells.append(row * scenario.columns + column)
    return tuple(names), group_names, groups, cells, orders.NOOP


def _classic_actions(scenario: Scenario) -> Actions:
    numbers = list(range(classic_orders.NUM_CLASSIC))
    return (
        _CLASSIC_NAMES,
        _CLASSIC_NAMES,
        numbers,
        [NO_CELL] * len(numbers),
        classic_orders.CLASSIC_NOOP,
    )


def _grid_actions(scenario: Scenario) -> Actions:
    """The cells are the units' own; what an order points at is relative to it."""
    names = ["noop", "stop", "cancel", *_MAKE_NAMES]
    group_names = (*names, "go", "advance")
    groups = list(range(len(names)))
    for index in range(grid_orders.NUM_WINDOW):
        row, column = grid_orders.window_row(index), grid_orders.window_column(index)
        names.append(f"go_r{row:+d}_c{column:+d}")
        groups.append(group_names.index("go"))
    for way in _WAYS:
        names.append(f"advance_{way}")
        groups.append(group_names.index("advance"))
    return tuple(names), group_names, groups, [NO_CELL] * len(names), grid_orders.GRID_NOOP


_ACTIONS = {"unit": _unit_actions, "classic": _classic_actions, "grid": _grid_actions}


def _representations(scenario: Scenario) -> dict[str, Representation]:
    board = (scenario.rows, scenario.columns)
    gray, pixels = rendering.GRAY_SIDE, scenario.tile_pixels
    picture = (3, scenario.rows * pixels, scenario.columns * pixels)
    rgb = ("red", "green", "blue")
    listed = (
        Representation(
            "planes",
            (len(planes.PLANE_NAMES), *board),
            np.uint8,
            255,
            planes.PLANE_NAMES,
            observation.observe_planes,
            num_uniform=planes.NUM_UNIFORM,
            make_memory=partial(observation.make_memory, scenario),
        ),
        Representation(
            "classic", (10, *board), np.uint8, 255, CLASSIC_NAMES, other_views.observe_classic
        ),
        Representation("image", picture, np.uint8, 255, rgb, rendering.observe_image),
        Representation("gray", (1, gray, gray), np.uint8, 255, ("luma",), rendering.observe_gray),
        Representation(
            "vector",
            (len(VECTOR_NAMES),),
            np.float32,
            other_views.vector_high(scenario),
            VECTOR_NAMES,
            other_views.observe_vector,
            low=(0.0,) * len(VECTOR_NAMES),
        ),
    )
    return {representation.name: representation for representation in listed}


GAME = Game(
    name="deep_rts",
    title="Deep RTS",
    version=VERSION,
    summary="Gather, build, train and fight on a board of tiles until one is left.",
    player_range=(1, t.MAX_PLAYERS),
    scenarios=MappingProxyType(SCENARIOS),
    default_scenario="1v1-15x15",
    make_rules=rb.make_rules,
    make_spec=make_spec,
    allocate=s.allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=masks.legal_actions,
    draw=rendering.draw,
    bots=MappingProxyType(bots.BOTS),
    rewards=MappingProxyType(REWARDS),
    hidden_fields=_SCRATCH,
    gymnasium_prefix=GYMNASIUM_PREFIX,
    map_names=name_maps,
    other_shapes=(MappingProxyType({"actions": "grid"}),),
    state_limits=state_limits,
    agents_of=_ALIKE,
)
