"""The definition of Deep Line Wars as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from marl_cair.games import game_package as package
from marl_cair.games.deep_line_wars import bots, orders, rendering, rules
from marl_cair.games.deep_line_wars import observation as obs
from marl_cair.games.deep_line_wars.ranges import state_limits, vector_high
from marl_cair.games.deep_line_wars.rulebook import make_rules
from marl_cair.games.deep_line_wars.scenarios import GYMNASIUM_PREFIX, REWARDS, SCENARIOS, Scenario
from marl_cair.games.deep_line_wars.state import NUM_PLAYERS, allocate
from marl_cair.games.deep_line_wars.tables import NUM_TOWER_KINDS, TOWER_NAMES, UNIT_NAMES
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation

VERSION = "1"

_PURCHASES = (*(f"buy_{name}" for name in UNIT_NAMES), *(f"build_{name}" for name in TOWER_NAMES))
_CLASSIC_ACTIONS = (
    *("cursor_up", "cursor_down", "cursor_right", "cursor_left"),
    *_PURCHASES,
    *("build_none", "noop"),
)


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    names, noop, others = _CLASSIC_ACTIONS, orders.CLASSIC_NOOP, dict[str, Any]()
    if scenario.actions == "spatial":
        names, others = _describe_spatial_actions(scenario)
        noop = orders.SPATIAL_NOOP
    own_units = range(obs.OWN_UNITS, obs.ENEMY_UNITS)
    enemy_units = range(obs.ENEMY_UNITS, obs.OWN_PROGRESS)
    return package.make_plain_spec(
        names,
        num_players=NUM_PLAYERS,
        noop_action=noop,
        representations=_list_representations(scenario),
        static_planes=(obs.TERRAIN,),
        exclusive_planes=(tuple(range(obs.OWN_TOWERS, obs.ENEMY_TOWERS + NUM_TOWER_KINDS)),),
        event_planes=((*own_units, obs.OWN_PROGRESS), (*enemy_units, obs.ENEMY_PROGRESS)),
        resources=("health", "gold", "lumber", "income"),
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        # A win from far behind: 1 plus the whole potential gained at once.
        reward_bound=1.0 + (1.6 if scenario.reward == "shaped" else 0.0),
        pays="+1 win, -1 loss",
        **others,
    )


def _describe_spatial_actions(scenario: Scenario) -> tuple[tuple[str, ...], dict[str, Any]]:
    group_names = ("noop", *_PURCHASES)
    names = ["noop", *_PURCHASES[: len(UNIT_NAMES)]]
    groups, cells = list(range(len(names))), [NO_CELL] * len(names)
    for kind in _PURCHASES[len(UNIT_NAMES) :]:
        for row in range(scenario.rows):
            for column in range(1, scenario.build_columns + 1):
                names.append(f"{kind}_r{row}_c{column}")
                groups.append(group_names.index(kind))
                cells.append(row * scenario.columns + column)
    return tuple(names), {
        "action_group_names": group_names,
        "action_groups": np.array(groups, np.int16),
        "action_cells": np.array(cells, np.int32),
    }


def _list_representations(scenario: Scenario) -> Mapping[str, Representation]:
    board, num_uniform = (scenario.rows, scenario.columns), len(obs.UNIFORM_NAMES)
    return package.list_by_name(
        package.show_board(
            "planes", obs.PLANE_NAMES, board, obs.observe_planes, num_uniform=num_uniform
        ),
        package.show_board("classic", obs.CLASSIC_NAMES, board, obs.observe_classic, high=4),
        package.show_board("heatmap", obs.HEATMAP_NAMES, board, obs.observe_heatmap),
        package.show_board("heatmap_gray", ("luma",), board, obs.observe_heatmap),
        package.show_picture(
            rendering.IMAGE_HEIGHT, rendering.IMAGE_WIDTH, rendering.observe_image
        ),
        package.show_gray(rendering.GRAY_SIDE, rendering.observe_gray),
        package.show_numbers("vector", obs.VECTOR_NAMES, vector_high(scenario), obs.observe_vector),
    )


GAME = Game(
    name="deep_line_wars",
    title="Deep Line Wars",
    version=VERSION,
    summary="Two players send units across a line and build towers against the other's.",
    player_range=(NUM_PLAYERS, NUM_PLAYERS),
    scenarios=MappingProxyType(SCENARIOS),
    default_scenario="10x15",
    make_rules=make_rules,
    make_spec=make_spec,
    allocate=allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=rules.legal_actions,
    draw=rendering.draw,
    bots=MappingProxyType(bots.BOTS),
    rewards=MappingProxyType(REWARDS),
    hidden_fields=("random",),
    gymnasium_prefix=GYMNASIUM_PREFIX,
    state_limits=state_limits,
)
