"""The plans of the scripted birds, functions of what one bird sees (`features`): no memory."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
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
from marl_cair.games.flappy_bird.tables import (
    BIRD_HEIGHT,
    FLAP_IMPULSE,
    FLAP_VELOCITY,
    GRAVITY,
    GROUND_TOP_HUNDREDTHS,
    HUNDREDTHS,
    MAX_FALL,
    PIPE_WIDTH,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
    TOUCH_DEPTH,
)
from marl_cair.games.game import GameSpec

# Pixels that a bird rises with one flap.
RISE = 8 + sum(range(1, 9))
CAUTIONS = (8, 4, 0)  # pixels to keep from edges, tried in this order
MAX_DEPTH = 128  # ticks that the oracle looks ahead
NUM_SPEEDS = MAX_FALL - FLAP_VELOCITY + 1
NUM_HEIGHTS = GROUND_TOP_HUNDREDTHS // HUNDREDTHS
NODE_BUDGET = 50_000  # states tried for one decision
_LOWEST_Y = GROUND_TOP_HUNDREDTHS - BIRD_HEIGHT * HUNDREDTHS
_TOUCH = (PIPE_WIDTH + TOUCH_DEPTH) * HUNDREDTHS  # the end of a pipe that can be touched is nearer
UNTRIED, TRIED_FIRST, TRIED_BOTH = range(3)


class Knowledge(NamedTuple):
    """Public numbers of a scenario."""

    speed: int  # hundredths of a pixel per tick
    pipe_gap: int  # pixels
    ticks_per_step: int  # ticks that a decision lasts
    groups: NDArray[np.int16]  # [actions] kind of each action


class Search(NamedTuple):
    """The oracle's scratch, overwritten for each row of a batch."""

    y: NDArray[np.int32]  # [depth] of the bird on the way that is tried
    velocity: NDArray[np.int32]  # [depth] pixels per tick
    has_flapped: NDArray[np.bool_]  # [depth]
    tried: NDArray[np.int8]  # [depth] UNTRIED, TRIED_FIRST or TRIED_BOTH
    # [depth, speed, flapped, height] number of the last search that has been in a state.
    seen: NDArray[np.int32]
    number: NDArray[np.int32]  # [1] of this search


def make_knowledge(scenario: Scenario, spec: GameSpec) -> Knowledge:
    """What bots know of a scenario."""
    return Knowledge(
        scenario.speed_hundredths, scenario.pipe_gap, scenario.ticks_per_step, spec.action_groups
    )


def make_search() -> Search:
    """Scratch for the oracle, 8 MB, which the system takes from memory as it is used."""
    depth = MAX_DEPTH + 1
    return Search(
        y=np.zeros(depth, np.int32),
        velocity=np.zeros(depth, np.int32),
        has_flapped=np.zeros(depth, np.bool_),
        tried=np.zeros(depth, np.int8),
        seen=np.zeros((depth, NUM_SPEEDS, 2, NUM_HEIGHTS), np.int32),
        number=np.zeros(1, np.int32),
    )


@compiled
def read(value: float, unit: int) -> int:
    """A feature in whole numbers of its unit."""
    return int(np.floor(value * unit + 0.5))


@compiled
def flap_line(top: int, pipe_gap: int) -> int:
    """The height (hundredths) below which to flap: the rise of a flap lies mid in the gap."""
    middle = top + (pipe_gap - BIRD_HEIGHT) // 2
    return (middle + RISE // 2) * HUNDREDTHS


@compiled
def plan_reflex(seen: Any, known: Any) -> bool:
    """Flap below a line in the next gap; no thought of the one after it."""
    y = read(seen[BIRD_Y], SCREEN_HEIGHT * HUNDREDTHS)
    return bool(y > flap_line(read(seen[NEXT_TOP], SCREEN_HEIGHT), known.pipe_gap))


@compiled
def is_free(y: int, ends: Any, tops: Any, known: Any, depth: int, caution: int) -> bool:
    """Whether a bird is alive at height y in `depth` ticks."""
    room = caution * HUNDREDTHS
    if y <= room or y >= _LOWEST_Y - room:
        return False
    for pipe in range(2):
        end = ends[pipe] - known.speed * depth
        if 0 < end < _TOUCH:
            top = tops[pipe] * HUNDREDTHS
            lowest = top + (known.pipe_gap - BIRD_HEIGHT) * HUNDREDTHS
            if y <= top + room or y > lowest - room:
                return False
    return True


@compiled
def enter(
    search: Search, depth: int, velocity: int, has_flapped: bool, y: int, number: int
) -> bool:
    """Begin to search from a state; False where this search has been before."""
    place = velocity - FLAP_VELOCITY
    height = y // HUNDREDTHS
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
    y = read(seen[BIRD_Y], SCREEN_HEIGHT * HUNDREDTHS)
    y = min(max(y, 0), _LOWEST_Y)
    velocity = read(seen[VELOCITY], MAX_FALL)
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
        else:  # between two decisions a bird glides
            flaps = False
            search.tried[depth] = TRIED_BOTH
        velocity = 0 if flaps else int(search.velocity[depth])
        has_flapped = False
        if not search.has_flapped[depth]:
            velocity = min(velocity + GRAVITY, MAX_FALL)
            if flaps:
                velocity -= FLAP_IMPULSE
                has_flapped = True
        y = int(search.y[depth]) + velocity * HUNDREDTHS + wind
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
        read(seen[NEXT_END], SCREEN_WIDTH * HUNDREDTHS),
        read(seen[LATER_END], SCREEN_WIDTH * HUNDREDTHS),
    )
    tops = (read(seen[NEXT_TOP], SCREEN_HEIGHT), read(seen[LATER_TOP], SCREEN_HEIGHT))
    wind = read(seen[WIND], WIND_HUNDREDTHS)
    for caution in CAUTIONS:
        action = find_way(seen, known, search, ends, tops, wind, caution)
        if action >= 0:
            return action == 1
    return plan_reflex(seen, known)
