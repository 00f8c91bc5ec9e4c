"""What the engine checks of the arrays that users hand to it; the rules trust them afterwards."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import GameSpec


def check_seeds(game: str, seeds: NDArray[np.uint64] | int, num_worlds: int) -> NDArray[np.uint64]:
    """Seeds uint64 [B]; an int seeds a batch of one.

    Raises:
        ValueError: wrong shape or dtype.
    """
    if isinstance(seeds, int | np.integer) and num_worlds == 1:
        return np.array([int(seeds) % 2**64], np.uint64)
    seeds = np.asarray(seeds)
    if seeds.shape != (num_worlds,) or seeds.dtype != np.uint64:
        raise ValueError(
            f"{game}: seeds are {seeds.dtype} {list(seeds.shape)}, they must be "
            f"uint64 [{num_worlds}] (worlds); randomness.episode_seeds makes them"
        )
    return seeds


def check_actions(game: str, actions: Any, num_worlds: int, spec: GameSpec) -> NDArray[np.int32]:
    """Actions as contiguous int32 [B, P, *action_shape].

    Raises:
        ValueError: wrong shape, not integers, or an action outside 0..A-1 (names world, player
            and the place within the action shape).
    """
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
    return np.ascontiguousarray(actions, np.int32)
