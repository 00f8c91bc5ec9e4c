"""The definition of Flappy Bird as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from numpy.typing import NDArray

from marl_cair.games import game_package as package
from marl_cair.games.flappy_bird import bots, gray, rendering, rules
from marl_cair.games.flappy_bird import observation as obs
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.flappy_bird.ranges import state_limits
from marl_cair.games.flappy_bird.rulebook import make_rules, reward_bound
from marl_cair.games.flappy_bird.scenarios import GYMNASIUM_PREFIX, REWARDS, SCENARIOS, Scenario
from marl_cair.games.flappy_bird.state import NUM_FRAMES, World, allocate
from marl_cair.games.game import Game, GameSpec, Representation

VERSION = "1"


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    return package.make_plain_spec(
        ("noop", "flap"),
        num_players=scenario.num_players,
        noop_action=t.NOOP,
        representations=_list_representations(),
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        reward_bound=reward_bound(scenario),
        pays=REWARDS[next(iter(REWARDS))],
        ticks_per_second=t.TICKS_PER_SECOND,
    )


def _list_representations() -> Mapping[str, Representation]:
    large, small = gray.GRAY_SIDE, gray.GRAY_SMALL_SIDE
    frames = (*(f"luma {age} decisions ago" for age in range(NUM_FRAMES - 1, 0, -1)), "luma")
    board, square = (obs.ROWS, obs.COLUMNS), (large, large)
    vector, features = obs.observe_vector, obs.observe_features
    return package.list_by_name(
        package.show_board(
            "planes", obs.PLANE_NAMES, board, obs.observe_planes, num_uniform=obs.NUM_UNIFORM
        ),
        package.show_picture(t.SCREEN_HEIGHT, t.SCREEN_WIDTH, rendering.observe_image),
        package.show_gray(large, gray.observe_gray),
        package.show_gray(small, gray.observe_gray, "gray_80"),
        package.show_board("gray_stack", frames, square, gray.observe_gray, num_frames=NUM_FRAMES),
        package.show_numbers("vector", obs.VECTOR_NAMES, obs.VECTOR_HIGH, vector, obs.VECTOR_LOW),
        package.show_numbers(
            "features", obs.FEATURE_NAMES, obs.FEATURE_HIGH, features, obs.FEATURE_LOW
        ),
    )


def read_info(worlds: World) -> dict[str, NDArray[Any]]:
    """Of every seat [B, P]: the pipes passed so far."""
    return {"pipes_passed": worlds.pipes_passed}


GAME = Game(
    name="flappy_bird",
    title="Flappy Bird",
    version=VERSION,
    summary="Flap through the gaps between pipes, alone or in a race.",
    player_range=(1, t.MAX_PLAYERS),
    scenarios=MappingProxyType(SCENARIOS),
    default_scenario="classic",
    make_rules=make_rules,
    make_spec=make_spec,
    allocate=allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=rules.legal_actions,
    draw=rendering.draw,
    bots=MappingProxyType(bots.BOTS),
    rewards=MappingProxyType(REWARDS),
    hidden_fields=("random", "newest_frame", "film"),
    gymnasium_prefix=GYMNASIUM_PREFIX,
    info=read_info,
    state_limits=state_limits,
)
