"""Recurrent agents: calls an agent of many seats with the states that these seats hold."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_NUMBERS = 1 << 16  # of one seat's state


def find_state_size(*agents: Any) -> int:
    """Return the largest `state_size` of the agents; 0 where none is recurrent.

    Raises ValueError for one that is no whole number in 0..65536.
    """
    sizes = [getattr(agent, "state_size", 0) for agent in agents]
    for agent, size in zip(agents, sizes, strict=True):
        if type(size) is not int or not 0 <= size <= MOST_NUMBERS:
            name = getattr(agent, "name", type(agent).__name__)
            raise ValueError(
                f"{name} has the state_size {size!r:.80}, it must be a whole number in "
                f"0..{MOST_NUMBERS}"
            )
    return max(sizes, default=0)


def call_agent(
    agent: Any,
    states: NDArray[np.float32],
    places: Any,
    observation: NDArray[Any],
    action_mask: NDArray[np.bool_],
    act: Callable[..., Any] | None = None,
) -> NDArray[np.int64]:
    """Return the agent's actions [N, ...]; if it is recurrent, update its states too.

    Args:
        agent: see `games.game.Agent`.
        states: float32 [*seats, S], S at least the agent's `state_size`; the caller makes the
            states of a seat 0 where its game begins. The agent uses the first numbers of each.
        places: index of its N seats in `states`: a mask bool [*seats], or a tuple of N numbers
            for each axis.
        observation: of these seats, [N, ...].
        action_mask: of these seats, bool [N, ..., A].
        act: what to call; None: the agent's own `act`.

    Raises ValueError for a returned state that is not finite, or of another shape.
    """
    act = act or agent.act
    if not getattr(agent, "state_size", 0):
        return np.asarray(act(observation, action_mask))
    held = states[..., : (size := find_state_size(agent))]
    actions, state = act(observation, action_mask, held[places])
    held[places] = check_state(state, (len(action_mask), size))
    return np.asarray(actions)


def check_state(state: Any, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return an agent's state as float32 [N, S]. Raises ValueError if it is something else."""
    try:
        with np.errstate(over="ignore"):
            array = np.asarray(state, np.float32)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"returned a state that is no array of numbers ({error})") from error
    if array.shape != shape:
        raise ValueError(f"returned a state of shape {list(array.shape)}, it must be {list(shape)}")
    if not np.isfinite(array).all():
        raise ValueError("returned a state that is not finite")
    return array


def widen_states(states: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """Return the states [..., S] with room for `size` numbers in each seat, new ones 0."""
    missing = max(0, size - states.shape[-1])
    return np.pad(states, [*[(0, 0)] * (states.ndim - 1), (0, missing)]) if missing else states
