"""The definition of Deep RTS as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from marl_cair.games import game_package as package
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.art import rendering
from marl_cair.games.deep_rts.bots import bots
from marl_cair.games.deep_rts.orders import cursor, grid, masks, orders
from marl_cair.games.deep_rts.ranges import state_limits
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules import step as rules
from marl_cair.games.deep_rts.scenarios import GOALS, GYMNASIUM_PREFIX, REWARDS, SCENARIOS, Scenario
from marl_cair.games.deep_rts.views import observation, planes
from marl_cair.games.deep_rts.views import other_views as views
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation

VERSION = "2"

# As rulebook.ROW_STEP and COLUMN_STEP list the directions.
WAYS = ("up", "right", "down", "left", "up_right", "down_right", "down_left", "up_left")


def make_spec(scenario: Scenario) -> GameSpec:
    """Actions, representations and limits of `scenario`."""
    names, groups = _ACTIONS[scenario.actions](scenario)
    group_names = tuple(dict.fromkeys(groups))
    cells = [NO_CELL] * len(names)
    if scenario.actions == "unit":
        cells[orders.FIRST_CELL :] = [*range(scenario.rows * scenario.columns)] * 3
    return GameSpec(
        num_players=scenario.num_players,
        action_names=tuple(names),
        action_groups=np.array([group_names.index(group) for group in groups], np.int16),
        action_group_names=group_names,
        action_cells=np.array(cells, np.int32),
        noop_action=names.index("noop"),
        representations=_representations(scenario),
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
        pays=GOALS[scenario.goal].format(scenario.goal_amount),
        action_shape=(scenario.rows, scenario.columns) if scenario.actions == "grid" else (),
        teams=scenario.teams,
    )


def name_maps(worlds: Any, scenario: Scenario) -> tuple[str, ...]:
    """The name of the map that each world [B] is played on."""
    maps = scenario.maps
    return tuple(maps[index].name for index in worlds.clock[:, s.MAP_INDEX])


def _reward_bound(scenario: Scenario) -> float:
    """A win from far behind, or more score than one step can bring."""
    if scenario.goal == "score":
        return 100.0
    return 1.0 + (1.6 if scenario.reward != "sparse" else 0.0)


# --- actions: names, and the group of each -------------------------------------------------------

Actions = tuple[list[str], list[str]]


def _unit_actions(scenario: Scenario) -> Actions:
    groups = ["noop", "next_unit", "stop", "cancel", *(f"make_{name}" for name in t.PRODUCT_NAMES)]
    names = list(groups)
    for order in ("go", "advance", "select"):
        for row, column in np.ndindex(scenario.rows, scenario.columns):
            names.append(f"{order}_r{row}_c{column}")
            groups.append(order)
    return names, groups


def _classic_actions(scenario: Scenario) -> Actions:
    names = ["previous_unit", "next_unit"]
    names += [f"move_{WAYS[direction]}" for direction in cursor.CLASSIC_DIRECTIONS]
    names += ["attack", "harvest"]
    names += [f"build_{slot}" for slot in range(cursor.NUM_CLASSIC_BUILDS)]
    return [*names, "noop"], [*names, "noop"]


def _grid_actions(scenario: Scenario) -> Actions:
    """The cells are the units' own; what an order points at is relative to it."""
    groups = ["noop", "stop", "cancel", *(f"make_{name}" for name in t.PRODUCT_NAMES)]
    span = range(-grid.REACH_TILES, grid.REACH_TILES + 1)
    names = [f"go_r{row:+d}_c{column:+d}" for row in span for column in span if row or column]
    names = [*groups, *names, *(f"advance_{way}" for way in WAYS)]
    return names, [*groups, *["go"] * grid.NUM_WINDOW, *["advance"] * len(WAYS)]


_ACTIONS = {"unit": _unit_actions, "classic": _classic_actions, "grid": _grid_actions}


def _representations(scenario: Scenario) -> Mapping[str, Representation]:
    board, pixels = (scenario.rows, scenario.columns), scenario.tile_pixels
    return package.list_by_name(
        package.show_board(
            "planes",
            planes.PLANE_NAMES,
            board,
            observation.observe_planes,
            num_uniform=planes.NUM_UNIFORM,
            make_memory=partial(observation.make_memory, scenario),
        ),
        package.show_board("classic", views.CLASSIC_NAMES, board, views.observe_classic),
        package.show_picture(board[0] * pixels, board[1] * pixels, rendering.observe_image),
        package.show_gray(rendering.GRAY_SIDE, rendering.observe_gray),
        package.show_numbers(
            "vector", views.VECTOR_NAMES, views.vector_high(scenario), views.observe_vector
        ),
    )


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
    hidden_fields=("seed", "path", "acting"),
    gymnasium_prefix=GYMNASIUM_PREFIX,
    map_names=name_maps,
    other_shapes=(MappingProxyType({"actions": "grid"}),),
    state_limits=state_limits,
    # Version 1 only named another winner at the time limit.
    agents_of=("1",),
)
