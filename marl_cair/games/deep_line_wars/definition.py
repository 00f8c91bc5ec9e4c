"""The definition of Deep Line Wars as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from marl_cair.games.deep_line_wars import bots, observation, orders, rendering, rules
from marl_cair.games.deep_line_wars.observation import (
    CLASSIC_NAMES,
    ENEMY_PROGRESS,
    ENEMY_TOWERS,
    ENEMY_UNITS,
    HEATMAP_NAMES,
    OWN_PROGRESS,
    OWN_TOWERS,
    OWN_UNITS,
    PLANE_NAMES,
    TERRAIN,
    UNIFORM_NAMES,
    VECTOR_NAMES,
)
from marl_cair.games.deep_line_wars.ranges import state_limits, vector_high
from marl_cair.games.deep_line_wars.rulebook import make_rules
from marl_cair.games.deep_line_wars.scenarios import GYMNASIUM_PREFIX, REWARDS, SCENARIOS, Scenario
from marl_cair.games.deep_line_wars.state import NUM_PLAYERS, allocate
from marl_cair.games.deep_line_wars.tables import (
    NUM_TOWER_KINDS,
    TOWER_NAMES,
    UNIT_NAMES,
)
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation

VERSION = "1"

_SHARED_GROUPS = (
    "noop",
    *(f"buy_{name}" for name in UNIT_NAMES),
    *(f"build_{name}" for name in TOWER_NAMES),
)
_CURSOR_GROUPS = ("cursor_up", "cursor_down", "cursor_right", "cursor_left")


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    actions = _classic_actions() if scenario.actions == "classic" else _spatial_actions(scenario)
    names, group_names, groups, cells, noop = actions
    return GameSpec(
        num_players=NUM_PLAYERS,
        action_names=names,
        action_groups=np.array(groups, np.int16),
        action_group_names=group_names,
        action_cells=np.array(cells, np.int32),
        noop_action=noop,
        representations=MappingProxyType(_representations(scenario)),
        static_planes=(TERRAIN,),
        exclusive_planes=(tuple(range(OWN_TOWERS, ENEMY_TOWERS + NUM_TOWER_KINDS)),),
        event_planes=(
            (*range(OWN_UNITS, ENEMY_UNITS), OWN_PROGRESS),
            (*range(ENEMY_UNITS, OWN_PROGRESS), ENEMY_PROGRESS),
        ),
        resources=("health", "gold", "lumber", "income"),
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        # A win from far behind: 1 plus the whole potential gained at once.
        reward_bound=1.0 + (1.6 if scenario.reward == "shaped" else 0.0),
        pays="+1 win, -1 loss",
    )


Actions = tuple[tuple[str, ...], tuple[str, ...], list[int], list[int], int]


def _spatial_actions(scenario: Scenario) -> Actions:
    names = ["noop", *(f"buy_{name}" for name in UNIT_NAMES)]
    groups = list(range(len(names)))
    cells = [NO_CELL] * len(names)
    for kind, tower in enumerate(TOWER_NAMES):
        for row in range(scenario.rows):
            for column in range(1, scenario.build_columns + 1):
                names.append(f"build_{tower}_r{row}_c{column}")
                groups.append(1 + len(UNIT_NAMES) + kind)
                cells.append(row * scenario.columns + column)
    return tuple(names), _SHARED_GROUPS, groups, cells, orders.SPATIAL_NOOP


def _classic_actions() -> Actions:
    missing_tower = "build_none"
    names = (*_CURSOR_GROUPS, *_SHARED_GROUPS[1:], missing_tower, "noop")
    return names, names, list(range(len(names))), [NO_CELL] * len(names), orders.CLASSIC_NOOP


def _representations(scenario: Scenario) -> dict[str, Representation]:
    board = (scenario.rows, scenario.columns)
    height, width = rendering.IMAGE_HEIGHT, rendering.IMAGE_WIDTH
    gray = rendering.GRAY_SIDE
    rgb = ("red", "green", "blue")
    listed = (
        Representation(
            "planes",
            (len(PLANE_NAMES), *board),
            np.uint8,
            255,
            PLANE_NAMES,
            observation.observe_planes,
            num_uniform=len(UNIFORM_NAMES),
        ),
        Representation(
            "classic", (5, *board), np.uint8, 4, CLASSIC_NAMES, observation.observe_classic
        ),
        Representation(
            "heatmap", (3, *board), np.uint8, 255, HEATMAP_NAMES, observation.observe_heatmap
        ),
        Representation(
            "heatmap_gray", (1, *board), np.uint8, 255, ("luma",), observation.observe_heatmap_gray
        ),
        Representation("image", (3, height, width), np.uint8, 255, rgb, rendering.observe_image),
        Representation("gray", (1, gray, gray), np.uint8, 255, ("luma",), rendering.observe_gray),
        Representation(
            "vector",
            (len(VECTOR_NAMES),),
            np.float32,
            vector_high(scenario),
            VECTOR_NAMES,
            observation.observe_vector,
            low=(0.0,) * len(VECTOR_NAMES),
        ),
    )
    return {representation.name: representation for representation in listed}


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
