"""The definition of Flappy Bird as a `Game`: its functions, actions and representations."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flappy_bird import bots, gray, observation, rendering, rules
from marl_cair.games.flappy_bird.observation import (
    COLUMNS,
    FEATURE_NAMES,
    NUM_UNIFORM,
    PLANE_NAMES,
    ROWS,
    VECTOR_NAMES,
)
from marl_cair.games.flappy_bird.ranges import state_limits
from marl_cair.games.flappy_bird.rulebook import make_rules, reward_bound
from marl_cair.games.flappy_bird.scenarios import GYMNASIUM_PREFIX, REWARDS, SCENARIOS, Scenario
from marl_cair.games.flappy_bird.state import NUM_FRAMES, World, allocate
from marl_cair.games.flappy_bird.tables import (
    MAX_PLAYERS,
    NOOP,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
    TICKS_PER_SECOND,
)
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation

VERSION = "1"

_ACTION_NAMES = ("noop", "flap")
_HIDDEN = ("random", "newest_frame", "film")


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits."""
    return GameSpec(
        num_players=scenario.num_players,
        action_names=_ACTION_NAMES,
        action_groups=np.arange(len(_ACTION_NAMES), dtype=np.int16),
        action_group_names=_ACTION_NAMES,
        action_cells=np.full(len(_ACTION_NAMES), NO_CELL, np.int32),
        noop_action=NOOP,
        representations=MappingProxyType(_representations()),
        static_planes=(),
        exclusive_planes=(),
        event_planes=(),
        resources=(),
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        reward_bound=reward_bound(scenario),
        pays=REWARDS[next(iter(REWARDS))],
        ticks_per_second=TICKS_PER_SECOND,
    )


def _representations() -> dict[str, Representation]:
    large, small = gray.GRAY_SIDE, gray.GRAY_SMALL_SIDE
    picture = (3, SCREEN_HEIGHT, SCREEN_WIDTH)
    rgb, luma = ("red", "green", "blue"), ("luma",)
    past = tuple(f"luma {age} decisions ago" for age in range(NUM_FRAMES - 1, 0, -1))
    listed = (
        Representation(
            "planes",
            (len(PLANE_NAMES), ROWS, COLUMNS),
            np.uint8,
            255,
            PLANE_NAMES,
            observation.observe_planes,
            num_uniform=NUM_UNIFORM,
        ),
        Representation("image", picture, np.uint8, 255, rgb, rendering.observe_image),
        Representation("gray", (1, large, large), np.uint8, 255, luma, gray.observe_gray),
        Representation("gray_80", (1, small, small), np.uint8, 255, luma, gray.observe_gray_80),
        Representation(
            "gray_stack",
            (NUM_FRAMES, large, large),
            np.uint8,
            255,
            (*past, "luma"),
            gray.observe_gray_stack,
            num_frames=NUM_FRAMES,
        ),
        Representation(
            "vector",
            (len(VECTOR_NAMES),),
            np.float32,
            observation.VECTOR_HIGH,
            VECTOR_NAMES,
            observation.observe_vector,
            low=observation.VECTOR_LOW,
        ),
        Representation(
            "features",
            (len(FEATURE_NAMES),),
            np.float32,
            observation.FEATURE_HIGH,
            FEATURE_NAMES,
            observation.observe_features,
            low=observation.FEATURE_LOW,
        ),
    )
    return {representation.name: representation for representation in listed}


def read_info(worlds: World) -> dict[str, NDArray[Any]]:
    """Of every seat [B, P]: the pipes passed so far."""
    return {"pipes_passed": worlds.pipes_passed}


GAME = Game(
    name="flappy_bird",
    title="Flappy Bird",
    version=VERSION,
    summary="Flap through the gaps between pipes, alone or in a race.",
    player_range=(1, MAX_PLAYERS),
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
    hidden_fields=_HIDDEN,
    gymnasium_prefix=GYMNASIUM_PREFIX,
    info=read_info,
    state_limits=state_limits,
)
