"""Checks of the arguments of engines and environments; the rules trust them afterwards."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import GameSpec


def read_index(value: Any) -> int | None:
    """A whole number of Python, NumPy or torch as an int; None of anything else."""
    try:
        return operator.index(value)
    except TypeError:
        return None


def make_plain(values: NDArray[Any], dtype: Any) -> NDArray[Any]:
    """The values as contiguous, aligned and writeable, as kernels are compiled for. Read-only
    arrays (of JAX, memory maps, broadcast ones) are copied.
    """
    plain = np.ascontiguousarray(values, dtype)
    return plain if plain.flags.carray else plain.copy()


def check_seed(owner: str, seed: Any) -> int:
    """A seed modulo 2**64: generators take none below 0. Raises ValueError unless it is whole."""
    number = read_index(seed)
    if number is None:
        raise ValueError(f"{owner}: seed is {seed!r}, it must be a whole number, as 3")
    return number % 2**64


def check_count(game: str, name: str, value: Any) -> int:
    """A number of worlds, threads or steps. Raises ValueError unless it is whole and at least 1."""
    count = read_index(value)
    if count is None or count < 1:
        raise ValueError(f"{game}: {name} is {value!r}, it must be at least 1, and a whole number")
    return count


def check_mask(game: str, name: str, mask: Any, num_worlds: int) -> NDArray[np.bool_]:
    """A mask of worlds, bool [B]; None stands for all. Raises ValueError."""
    mask = np.ones(num_worlds, np.bool_) if mask is None else np.asarray(mask)
    if mask.shape != (num_worlds,) or mask.dtype != np.bool_:
        raise ValueError(
            f"{game}: {name} is {mask.dtype} {list(mask.shape)}, it must be bool [{num_worlds}] "
            "(worlds)"
        )
    return make_plain(mask, np.bool_)


def check_start(game: str, num_chosen: int, num_worlds: int) -> None:
    """Raise ValueError unless the first reset or restore is of all worlds."""
    if num_chosen < num_worlds:
        raise ValueError(
            f"{game}: the engine begins with {num_chosen} of its {num_worlds} worlds, the others "
            "would have no state; reset all worlds first (without a mask)"
        )


def check_num_worlds(
    game: str, options: dict[str, Any], num_worlds: int, instead: str
) -> dict[str, Any]:
    """An environment's options without `num_worlds`. Raises ValueError if that is another number
    than the environment has; `instead` says what to do.
    """
    asked = options.get("num_worlds", num_worlds)
    if asked != num_worlds:
        raise ValueError(
            f"{game}: num_worlds is {asked!r}, this environment has {num_worlds}; {instead}"
        )
    return {name: value for name, value in options.items() if name != "num_worlds"}


def check_seeds(game: str, seeds: NDArray[np.uint64] | int, num_worlds: int) -> NDArray[np.uint64]:
    """Seeds uint64 [B]; an int seeds a batch of one. Raises ValueError: wrong shape or dtype."""
    if isinstance(seeds, int | np.integer) and num_worlds == 1:
        return np.array([int(seeds) % 2**64], np.uint64)
    seeds = np.asarray(seeds)
    if seeds.shape != (num_worlds,) or seeds.dtype != np.uint64:
        raise ValueError(
            f"{game}: seeds are {seeds.dtype} {list(seeds.shape)}, they must be "
            f"uint64 [{num_worlds}] (worlds); randomness.episode_seeds makes them"
        )
    return make_plain(seeds, np.uint64)


def check_actions(game: str, actions: Any, num_worlds: int, spec: GameSpec) -> NDArray[np.int32]:
    """Actions as plain int32 [B, P, *action_shape]. Raises ValueError as `BatchedEngine.step`."""
    actions = np.asarray(actions)
    expected = (num_worlds, spec.num_players, *spec.action_shape)
    if actions.shape != expected or actions.dtype.kind not in "iu":
        axes = "worlds, players" + (", action shape" if spec.action_shape else "")
        raise ValueError(
            f"{game}: actions are {actions.dtype} {list(actions.shape)}, they must "
            f"be integers {list(expected)} ({axes})"
        )
    if actions.min() < 0 or actions.max() >= spec.num_actions:
        wrong = np.argwhere((actions < 0) | (actions >= spec.num_actions))[0].tolist()
        world, player, *place = wrong
        where = f" at place {place}" if place else ""
        raise ValueError(
            f"{game}: action {actions[tuple(wrong)]} of player {player} in world "
            f"{world}{where} is outside 0..{spec.num_actions - 1}"
        )
    return make_plain(actions, np.int32)


def check_out(
    game: str, method: str, out: NDArray[Any], shape: tuple[int, ...], dtype: Any
) -> None:
    """Raise ValueError unless `out` is contiguous, of that shape and type, and writeable."""
    if out.shape != shape or out.dtype != dtype or not out.flags.carray:
        raise ValueError(
            f"{game}: {method} cannot write to {out.dtype} {list(out.shape)}, `out` "
            f"must be contiguous {np.dtype(dtype).name} {list(shape)} that can be written to"
        )
