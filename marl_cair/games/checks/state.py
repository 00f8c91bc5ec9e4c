"""Checks of saved states: shape, type and values, against the limits of `Game.state_limits`.

The rules check nothing. States from files and users are checked here, before the rules read them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER

MOST_COUNTED = 2**31 - 1  # of counters in int32
ANY_WORD = (0, 2**64 - 1)  # the range of a random word

# A condition between fields of a world, in words, and the worlds in which it holds: bool [N].
Condition = tuple[str, NDArray[np.bool_] | np.bool_]


class Range(NamedTuple):
    """The values that a field may hold, both ends included; NaN is in no range.

    low, high: numbers, or arrays that broadcast to the field of one world.
    columns: names of the entries along `axis` of the field of one world, for messages.
    """

    low: Any
    high: Any
    columns: tuple[str, ...] = ()
    axis: int = -1


class StateLimits(NamedTuple):
    """The values that the worlds of a scenario may hold, with which no rule leaves its arrays.

    ranges: of each field of World, by its name.
    conditions: World of N worlds -> conditions between fields. Each is computed when all fields are
        in their ranges and all earlier conditions hold.
    """

    ranges: Mapping[str, Range]
    conditions: Callable[[Any], Iterable[Condition]]


def check_arrays(
    game: str,
    names: Iterable[str],
    fields: Iterable[NDArray[Any]],
    saved: Iterable[NDArray[Any]],
    num_worlds: int,
) -> None:
    """Raise ValueError unless the saved arrays are [num_worlds, ...] of the fields' types."""
    for name, field, array in zip(names, fields, saved, strict=True):
        expected = (num_worlds, *field.shape[1:])
        if array.shape != expected or array.dtype != field.dtype:
            raise ValueError(
                f"{game}: the saved {name} is {array.dtype} {list(array.shape)}, this "
                f"engine needs {field.dtype} {list(expected)}; restore into the same scenario and "
                "as many worlds as were saved"
            )


def check_worlds(game: str, worlds: Any, limits: StateLimits) -> None:
    """Check the values of saved worlds, a World of arrays [N, ...]. Raises ValueError for a value
    out of its range, or a condition that does not hold.
    """
    for name, bounds in limits.ranges.items():
        check_range(game, name, getattr(worlds, name), bounds)
    for condition, holds in limits.conditions(worlds):
        if not holds.all():
            world = int(np.flatnonzero(~holds)[0])
            raise ValueError(
                f"{game}: the saved state is damaged: in world {world} {condition}, but it does "
                "not hold; restore a state that this game has saved"
            )


def check_range(game: str, name: str, values: NDArray[Any], bounds: Range) -> None:
    """Raise ValueError unless all values [N, ...] of a field are in its range."""
    is_allowed = (values >= bounds.low) & (values <= bounds.high)
    if is_allowed.all():
        return
    world, *place = np.argwhere(~is_allowed)[0].tolist()
    shape = values.shape[1:]
    low, high = (np.broadcast_to(end, shape)[tuple(place)] for end in (bounds.low, bounds.high))
    where = name if shape in ((), (1,)) else f"{name}{place}"
    if bounds.columns:
        where += f" ({bounds.columns[place[bounds.axis]]})"
    raise ValueError(
        f"{game}: the saved state is damaged: {where} of world {world} is "
        f"{values[(world, *place)]}, allowed are {low}..{high}; restore a state that this game has "
        "saved"
    )


def check_outcome(game: str, outcome: Any, num_players: int) -> None:
    """Raise ValueError unless the rewards of an Outcome are finite and its winners are seats."""
    highest = float(np.finfo(np.float32).max)
    check_range(game, "rewards", outcome.rewards, Range(-highest, highest))
    check_range(game, "winner", outcome.winner, Range(NO_WINNER, num_players - 1))


def has_time(tick: NDArray[Any], is_running: NDArray[np.bool_], max_ticks: int) -> Condition:
    """A world that runs has ticks left: tick [N], is_running bool [N]."""
    holds = ~is_running | (tick < max_ticks)
    return f"a game that runs has played less than {max_ticks} ticks", holds
