"""The definition of Deep Maze as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_maze import bots, observation, rendering, rules
from marl_cair.games.deep_maze.observation import (
    CLASSIC_NAMES,
    EXPLORED,
    GOALS,
    ID_HUNTER,
    ID_MATE,
    NUM_UNIFORM,
    OPEN_CELLS,
    PLANE_NAMES,
    VECTOR_NAMES,
    VISIBLE,
    WALLS,
)
from marl_cair.games.deep_maze.ranges import state_limits
from marl_cair.games.deep_maze.rulebook import make_rules
from marl_cair.games.deep_maze.scenarios import (
    DEFAULT_SCENARIO,
    GYMNASIUM_PREFIX,
    REWARDS,
    SCENARIOS,
    Scenario,
)
from marl_cair.games.deep_maze.state import EARLIER_OPTIMAL, TICK, World, allocate
from marl_cair.games.deep_maze.tables import (
    ACTION_NAMES,
    GOAL_REWARD,
    MAX_PLAYERS,
    NOOP,
    STEP_REWARD,
)
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation

VERSION = "1"

_HIDDEN = ("random", "order")  # of the state: what comes next, and scratch


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    players, num_actions = scenario.num_players, len(ACTION_NAMES)
    never_changes = scenario.visibility == "full" and scenario.mode != "sequence"
    return GameSpec(
        num_players=players,
        action_names=ACTION_NAMES,
        action_groups=np.arange(num_actions, dtype=np.int16),
        action_group_names=ACTION_NAMES,
        action_cells=np.full(num_actions, NO_CELL, np.int32),
        noop_action=NOOP,
        representations=MappingProxyType(_representations(scenario)),
        static_planes=(WALLS, OPEN_CELLS, GOALS, VISIBLE, EXPLORED) if never_changes else (),
        exclusive_planes=((WALLS, OPEN_CELLS),),
        event_planes=(),
        resources=(),
        ticks_per_step=1,
        max_ticks=scenario.max_ticks,
        reward_bound=_reward_bound(scenario),
        pays=_describe_pay(scenario),
        teams=(0, *[1] * (players - 1)) if scenario.is_chase else (),
    )


def _describe_pay(scenario: Scenario) -> str:
    if scenario.num_players == 1:
        return "+1 at the goal, -0.01 a move"
    return f"+1 win, -1 loss, -0.01 a move{' of the hunter' if scenario.is_chase else ''}"


def _reward_bound(scenario: Scenario) -> float:
    """Of `distance`: the goal, and the potential of a maze of a single way with all to come."""
    if scenario.reward != "distance":
        return GOAL_REWARD
    lowest = scenario.num_cells / (scenario.rows + scenario.columns) + scenario.num_mazes
    return GOAL_REWARD - STEP_REWARD + lowest


def _representations(scenario: Scenario) -> dict[str, Representation]:
    board = (scenario.rows, scenario.columns)
    gray, pixels = rendering.GRAY_SIDE, scenario.cell_pixels
    picture = (3, rendering.IMAGE_HEIGHT, rendering.IMAGE_WIDTH)
    if pixels:
        picture = (3, scenario.rows * pixels, scenario.columns * pixels)
    last_id = ID_HUNTER if scenario.is_chase else ID_MATE
    cells = tuple(
        f"row {row} column {column}" for row in range(board[0]) for column in range(board[1])
    )
    listed = (
        Representation(
            "planes",
            (len(PLANE_NAMES), *board),
            np.uint8,
            255,
            PLANE_NAMES,
            observation.observe_planes,
            num_uniform=NUM_UNIFORM,
        ),
        Representation(
            "classic", (1, *board), np.uint8, last_id, CLASSIC_NAMES, observation.observe_classic
        ),
        Representation(
            "flat", (scenario.num_cells,), np.uint8, last_id, cells, observation.observe_flat
        ),
        Representation(
            "image", picture, np.uint8, 255, ("red", "green", "blue"), rendering.observe_image
        ),
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


def vector_high(scenario: Scenario) -> tuple[float, ...]:
    """The largest value of each entry of VECTOR_NAMES; 1 where it is 0 in all of the scenario."""
    place = (scenario.rows - 1, scenario.columns - 1)
    free = (place[0], place[0], place[1], place[1])  # down, up, left, right
    left = (scenario.num_mazes - 1, scenario.preview_moves, scenario.max_ticks)
    others = (1, *place, 1) * (MAX_PLAYERS - 1)
    highest = (*place, 1, *place, *free, 1, *left, *others)
    return tuple(float(max(1, value)) for value in highest)


def read_info(worlds: World) -> dict[str, NDArray[Any]]:
    """Of every seat [B, P]: the optimal moves of the mazes entered so far, the moves made, and by
    how many they are more.
    """
    moves = np.repeat(worlds.clock[:, [TICK]], worlds.optimal.shape[1], axis=1)
    optimal = worlds.optimal + worlds.clock[:, [EARLIER_OPTIMAL]]
    return {
        "optimal_steps": optimal,
        "step_count": moves,
        "extra_steps": np.maximum(moves - optimal, 0),
    }


GAME = Game(
    name="deep_maze",
    title="Deep Maze",
    version=VERSION,
    summary="Find the shortest way to the goal of a maze, alone, in a race or chased.",
    player_range=(1, MAX_PLAYERS),
    scenarios=MappingProxyType(SCENARIOS),
    default_scenario=DEFAULT_SCENARIO,
    make_rules=make_rules,
    make_spec=make_spec,
    allocate=allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=rules.legal_actions,
    draw=rendering.draw,
    bots=MappingProxyType(bots.BOTS),
    rewards=MappingProxyType(REWARDS),
    hidden_fields=_HIDDEN,
    gymnasium_prefix=GYMNASIUM_PREFIX,
    info=read_info,
    state_limits=state_limits,
)
