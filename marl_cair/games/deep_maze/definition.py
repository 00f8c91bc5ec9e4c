"""The definition of Deep Maze as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import game_package as package
from marl_cair.games.deep_maze import bots, rendering, rules
from marl_cair.games.deep_maze import observation as obs
from marl_cair.games.deep_maze import scenarios as sc
from marl_cair.games.deep_maze import state as s
from marl_cair.games.deep_maze import tables as t
from marl_cair.games.deep_maze.ranges import state_limits
from marl_cair.games.deep_maze.rulebook import make_rules
from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.game import Game, GameSpec, Representation

VERSION = "1"


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    players = scenario.num_players
    never_changes = scenario.visibility == "full" and scenario.mode != "sequence"
    unchanging = (obs.WALLS, obs.OPEN_CELLS, obs.GOALS, obs.VISIBLE, obs.EXPLORED)
    return package.make_plain_spec(
        t.ACTION_NAMES,
        num_players=players,
        noop_action=t.NOOP,
        representations=_list_representations(scenario),
        static_planes=unchanging if never_changes else (),
        exclusive_planes=((obs.WALLS, obs.OPEN_CELLS),),
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
        return t.GOAL_REWARD
    lowest = scenario.num_cells / (scenario.rows + scenario.columns) + scenario.num_mazes
    return t.GOAL_REWARD - t.STEP_REWARD + lowest


def _list_representations(scenario: Scenario) -> Mapping[str, Representation]:
    rows, columns, pixels = scenario.rows, scenario.columns, scenario.cell_pixels
    picture = (rendering.IMAGE_HEIGHT, rendering.IMAGE_WIDTH)
    if pixels:
        picture = (rows * pixels, columns * pixels)
    last_id = obs.ID_HUNTER if scenario.is_chase else obs.ID_MATE
    cells = tuple(f"row {row} column {column}" for row in range(rows) for column in range(columns))
    board, high = (rows, columns), vector_high(scenario)
    return package.list_by_name(
        package.show_board(
            "planes", obs.PLANE_NAMES, board, obs.observe_planes, num_uniform=obs.NUM_UNIFORM
        ),
        package.show_board("classic", ("cell",), board, obs.observe_classic, last_id),
        package.show_board("flat", cells, (), obs.observe_flat, last_id),
        package.show_picture(*picture, rendering.observe_image),
        package.show_gray(rendering.GRAY_SIDE, rendering.observe_gray),
        package.show_numbers("vector", obs.VECTOR_NAMES, high, obs.observe_vector),
    )


def vector_high(scenario: Scenario) -> tuple[float, ...]:
    """The largest value of each entry of VECTOR_NAMES; 1 where it is 0 in all of the scenario."""
    place = (scenario.rows - 1, scenario.columns - 1)
    free = (place[0], place[0], place[1], place[1])  # down, up, left, right
    left = (scenario.num_mazes - 1, scenario.preview_moves, scenario.max_ticks)
    others = (1, *place, 1) * (t.MAX_PLAYERS - 1)
    highest = (*place, 1, *place, *free, 1, *left, *others)
    return tuple(float(max(1, value)) for value in highest)


def read_info(worlds: s.World) -> dict[str, NDArray[Any]]:
    """Of every seat [B, P]: the optimal moves of the mazes entered so far, the moves made, and by
    how many they are more.
    """
    moves = np.repeat(worlds.clock[:, [s.TICK]], worlds.optimal.shape[1], axis=1)
    optimal = worlds.optimal + worlds.clock[:, [s.EARLIER_OPTIMAL]]
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
    player_range=(1, t.MAX_PLAYERS),
    scenarios=MappingProxyType(sc.SCENARIOS),
    default_scenario=sc.DEFAULT_SCENARIO,
    make_rules=make_rules,
    make_spec=make_spec,
    allocate=s.allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=rules.legal_actions,
    draw=rendering.draw,
    bots=MappingProxyType(bots.BOTS),
    rewards=MappingProxyType(sc.REWARDS),
    hidden_fields=("random", "order"),  # what comes next, and scratch
    gymnasium_prefix=sc.GYMNASIUM_PREFIX,
    info=read_info,
    state_limits=state_limits,
)
