"""The definition of Flash games as a `Game`: functions, actions and representations."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any

from numpy.typing import NDArray

from marl_cair.games import game_package as package
from marl_cair.games.flash import bots, rules
from marl_cair.games.flash.description import find_description
from marl_cair.games.flash.scenarios import GYMNASIUM_PREFIX, NUMBERS, REWARDS, SCENARIOS, Scenario
from marl_cair.games.flash.state import NUM_FRAMES, SIDE, World, allocate
from marl_cair.games.game import Game, GameSpec

VERSION = "1"


def make_spec(scenario: Scenario) -> GameSpec:
    """What `scenario` offers to agents: actions, representations, limits.

    Raises:
        DescriptionError: of a SWF that cannot be used.
        ValueError: the description lacks what `actions` or the transport `numbers` needs.
    """
    described = find_description(scenario.description)
    actions = tuple(action.name for action in rules.list_actions(described, scenario.actions))
    if len(actions) == 1:
        field, other = ("keys", "mouse") if scenario.actions == "keys" else ("mouse_grid", "keys")
        raise ValueError(
            f"flash: actions is {scenario.actions!r}, but {scenario.description} has no {field}: "
            f"take actions={other}, or add {field} to the description"
        )
    width, height = described.size
    luma = tuple(f"luma {age} steps ago" for age in range(NUM_FRAMES - 1, 0, -1))
    frames: tuple[Any, ...] = (*luma, "luma"), (SIDE, SIDE), rules.observe_gray
    shown = [
        package.show_board("planes", *frames, num_frames=NUM_FRAMES),  # every game has some
        package.show_board("gray_stack", *frames, num_frames=NUM_FRAMES),
        package.show_gray(SIDE, rules.observe_gray),
        package.show_board("rgb84", ("red", "green", "blue"), (SIDE, SIDE), rules.observe_small),
        package.show_picture(height, width, rules.observe_image),
    ]
    if described.numbers:
        names, low, high, _ = zip(*described.numbers, strict=True)
        last = float(max(1, len(described.keys) - 1))
        shown.append(
            package.show_numbers(
                "vector", ("player", *names), (last, *high), rules.observe_numbers, (0.0, *low)
            )
        )
    if scenario.transport == NUMBERS:
        if described.reads_pixels or not described.numbers:
            raise ValueError(
                f"flash: transport is {NUMBERS!r}, which has no pictures, but "
                f"{scenario.description} reports no numbers, or its score or end is read from "
                "pictures: take the transport 'bridge'"
            )
        shown = shown[-1:]
    return package.make_plain_spec(
        actions,
        num_players=len(described.keys),
        noop_action=0,
        representations=package.list_by_name(*shown),
        ticks_per_step=scenario.ticks_per_step,
        max_ticks=scenario.max_ticks,
        reward_bound=max(1.0, described.most_points),
        pays=REWARDS[next(iter(REWARDS))],
        ticks_per_second=float(described.fps),
    )


def read_info(worlds: World) -> dict[str, NDArray[Any]]:
    """Of every seat [B, P]: the score so far."""
    return {"score": worlds.score}


GAME = Game(
    name="flash",
    title="Flash",
    version=VERSION,
    summary="Flash games in a browser, frame by frame: multitask, duel, or your own SWF.",
    player_range=(1, 8),
    scenarios=MappingProxyType(SCENARIOS),
    default_scenario="multitask",
    make_rules=rules.Browsers,
    make_spec=make_spec,
    allocate=allocate,
    reset=rules.reset,
    step=rules.step,
    legal_actions=rules.legal_actions,
    draw=rules.draw,
    bots=MappingProxyType(bots.BOTS),
    rewards=MappingProxyType(REWARDS),
    hidden_fields=("slot", "film"),
    gymnasium_prefix=GYMNASIUM_PREFIX,
    info=read_info,
    has_snapshots=False,
)
