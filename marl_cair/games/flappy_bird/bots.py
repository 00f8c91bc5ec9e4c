"""Scripted birds. They see what an agent sees: the representation `features` and the mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.flappy_bird.observation import (
    BIRD_Y,
    HAS_FLAPPED,
    LATER_END,
    LATER_TOP,
    NEXT_END,
    NEXT_TOP,
    VELOCITY,
    WIND,
    WIND_HUNDREDTHS,
)
from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.scripted import ScriptedPlayer

PLANS = ("reflex", "oracle")
REFLEX, ORACLE = range(len(PLANS))
# Pixels that a bird rises with one flap.
RISE = 8 + sum(range(1, 9))
CAUTIONS = (8, 4, 0)  # pixels to keep from edges, tried in this order
MAX_DEPTH = 128  # ticks that the oracle looks ahead
NUM_SPEEDS = t.MAX_FALL - t.FLAP_VELOCITY + 1
NUM_HEIGHTS = t.GROUND_TOP_HUNDREDTHS // t.HUNDREDTHS
NODE_BUDGET = 50_000  # states tried for one action
_LOWEST_Y = t.GROUND_TOP_HUNDREDTHS - t.BIRD_HEIGHT * t.HUNDREDTHS
# A pipe can be touched while its end is nearer than this.
_TOUCH = (t.PIPE_WIDTH + t.TOUCH_DEPTH) * t.HUNDREDTHS
UNTRIED, TRIED_FIRST, TRIED_BOTH = range(3)


class Knowledge(NamedTuple):
    """Public numbers of a scenario."""

    speed: int  # hundredths of a pixel per tick
    pipe_gap: int  # pixels
    ticks_per_step: int


class Search(NamedTuple):
    """The oracle's scratch, overwritten for each row of a batch."""

    y: NDArray[np.int32]  # [depth] of the bird on the way that is tried
    velocity: NDArray[np.int32]  # [depth] pixels per tick
    has_flapped: NDArray[np.bool_]  # [depth]
    tried: NDArray[np.int8]  # [depth] UNTRIED, TRIED_FIRST or TRIED_BOTH
    # [depth, speed, flapped, height] number of the last search that has been in a state.
    seen: NDArray[np.int32]
    number: NDArray[np.int32]  # [1] of this search


def make_search() -> Search:
    """Scratch for the oracle, 8 MB, which the system takes from memory as it is used."""
    depth = MAX_DEPTH + 1
    y, velocity = np.zeros((2, depth), np.int32)
    has_flapped, tried = np.zeros(depth, np.bool_), np.zeros(depth, np.int8)
    seen = np.zeros((depth, NUM_SPEEDS, 2, NUM_HEIGHTS), np.int32)
    return Search(y, velocity, has_flapped, tried, seen, np.zeros(1, np.int32))


@compiled
def read(value: float, unit: int) -> int:
    """A feature in whole numbers of its unit."""
    return int(np.floor(value * unit + 0.5))


@compiled
def flap_line(top: int, pipe_gap: int) -> int:
    """The height (hundredths) below which to flap: the rise of a flap lies mid in the gap."""
    middle = top + (pipe_gap - t.BIRD_HEIGHT) // 2
    return (middle + RISE // 2) * t.HUNDREDTHS


@compiled
def plan_reflex(seen: Any, known: Any) -> bool:
    """Flap below a line in the next gap; no thought of the one after it."""
    y = read(seen[BIRD_Y], t.SCREEN_HEIGHT * t.HUNDREDTHS)
    return bool(y > flap_line(read(seen[NEXT_TOP], t.SCREEN_HEIGHT), known.pipe_gap))


@compiled
def is_free(y: int, ends: Any, tops: Any, known: Any, depth: int, caution: int) -> bool:
    """Whether a bird is alive at height y in `depth` ticks."""
    room = caution * t.HUNDREDTHS
    if y <= room or y >= _LOWEST_Y - room:
        return False
    for pipe in range(2):
        end = ends[pipe] - known.speed * depth
        if 0 < end < _TOUCH:
            top = tops[pipe] * t.HUNDREDTHS
            lowest = top + (known.pipe_gap - t.BIRD_HEIGHT) * t.HUNDREDTHS
            if y <= top + room or y > lowest - room:
                return False
    return True


@compiled
def enter(
    search: Search, depth: int, velocity: int, has_flapped: bool, y: int, number: int
) -> bool:
    """Begin to search from a state; False where this search has been before."""
    place = velocity - t.FLAP_VELOCITY
    height = y // t.HUNDREDTHS
    if search.seen[depth, place, int(has_flapped), height] == number:
        return False
    search.seen[depth, place, int(has_flapped), height] = number
    search.y[depth] = y
    search.velocity[depth] = velocity
    search.has_flapped[depth] = has_flapped
    search.tried[depth] = UNTRIED
    return True


@compiled
def find_way(
    seen: Any, known: Any, search: Any, ends: Any, tops: Any, wind: int, caution: int
) -> int:
    """The first action of a way past both pipes that are in sight: 0, 1, or -1 for none.

    Depth first through all ways, the likelier action first; states are tried once.
    ends, tops: of both pipes, hundredths of a pixel and pixels.
    """
    search.number[0] += 1
    number = int(search.number[0])
    last = min(MAX_DEPTH, int(ends[1] // known.speed) + 1)
    y = read(seen[BIRD_Y], t.SCREEN_HEIGHT * t.HUNDREDTHS)
    y = min(max(y, 0), _LOWEST_Y)
    velocity = read(seen[VELOCITY], t.MAX_FALL)
    enter(search, 0, velocity, seen[HAS_FLAPPED] > 0.5, y, number)
    depth = 0
    first_action = -1
    for _ in range(NODE_BUDGET):
        if depth == last:
            return first_action
        if search.tried[depth] == TRIED_BOTH:
            if depth == 0:
                return -1
            depth -= 1
            continue
        if depth % known.ticks_per_step == 0:
            near = 0 if ends[0] > known.speed * depth else 1
            wants = search.y[depth] > flap_line(tops[near], known.pipe_gap)
            flaps = wants if search.tried[depth] == UNTRIED else not wants
            search.tried[depth] += 1
        else:  # between two steps of the environment a bird glides
            flaps = False
            search.tried[depth] = TRIED_BOTH
        velocity = 0 if flaps else int(search.velocity[depth])
        has_flapped = False
        if not search.has_flapped[depth]:
            velocity = min(velocity + t.GRAVITY, t.MAX_FALL)
            if flaps:
                velocity -= t.FLAP_IMPULSE
                has_flapped = True
        y = int(search.y[depth]) + velocity * t.HUNDREDTHS + wind
        if is_free(y, ends, tops, known, depth + 1, caution) and enter(
            search, depth + 1, velocity, has_flapped, y, number
        ):
            if depth == 0:
                first_action = int(flaps)
            depth += 1
    return -1


@compiled
def plan_oracle(seen: Any, known: Any, search: Any) -> bool:
    """Look for a way past both pipes in sight, first one that keeps well away from edges."""
    ends = (
        read(seen[NEXT_END], t.SCREEN_WIDTH * t.HUNDREDTHS),
        read(seen[LATER_END], t.SCREEN_WIDTH * t.HUNDREDTHS),
    )
    tops = (read(seen[NEXT_TOP], t.SCREEN_HEIGHT), read(seen[LATER_TOP], t.SCREEN_HEIGHT))
    wind = read(seen[WIND], WIND_HUNDREDTHS)
    for caution in CAUTIONS:
        action = find_way(seen, known, search, ends, tops, wind, caution)
        if action >= 0:
            return action == 1
    return plan_reflex(seen, known)


@compiled
def decide_all(
    plan: int, known: Any, search: Any, seen: Any, mask: Any, random: Any, out: Any
) -> None:
    """The action of a plan for each of N rows: seen float32 [N, 12], mask [N, 2], out [N]."""
    for index in range(seen.shape[0]):
        flaps = False
        if mask[index, t.FLAP]:
            if plan == REFLEX:
                flaps = plan_reflex(seen[index], known)
            else:
                flaps = plan_oracle(seen[index], known, search)
        out[index] = t.FLAP if flaps else t.NOOP


def make_bot(name: str, scenario: Scenario, spec: GameSpec) -> ScriptedPlayer:
    """The bot of one of PLANS for a scenario and its spec."""
    known = Knowledge(scenario.speed_hundredths, scenario.pipe_gap, scenario.ticks_per_step)
    decide = partial(decide_all, PLANS.index(name), known, make_search())
    return ScriptedPlayer(name, decide, "features")


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    "random": lambda scenario, spec: ScriptedPlayer.by_kind(spec, "features"),
    **{name: partial(make_bot, name) for name in PLANS},
}
