"""Foreign agents: any object with `act`, from a checkpoint or a function, held to the contract."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.agents import is_checkpoint, load_agent


class WrappedAgentError(ValueError):
    """An agent from elsewhere that cannot be made, or answers what no seat can play."""


class WrappedAgent:
    """Any object with `act(observation, action_mask) -> actions` as a full agent.

    What the object has of `representation`, `seed`, `state_dict` and `load_state_dict` is used. A
    resumed run continues the object's random stream only where it has the last two.

    Args:
        wrapped: the object.
        name: for tables, mixtures and errors.
        representation: what it looks at, where it does not say so itself.

    Raises:
        WrappedAgentError: it has no `act`.
    """

    def __init__(self, wrapped: Any, name: str, representation: str = "planes") -> None:
        if not callable(getattr(wrapped, "act", None)):
            raise WrappedAgentError(
                f"agent {name!r} is a {type(wrapped).__name__} without `act`: give an object with "
                "act(observation, action_mask) -> actions"
            )
        self.wrapped, self.name = wrapped, name
        self.representation: str = getattr(wrapped, "representation", representation)

    def seed(self, seed: int) -> None:
        """Restart its random generator, if it has one."""
        if hasattr(self.wrapped, "seed"):
            self.wrapped.seed(seed)

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Observation [N, *shape], mask bool [N, A] -> actions int64 [N].

        Raises:
            WrappedAgentError: other than one legal whole number for each row.
        """
        actions = np.asarray(self.wrapped.act(observation, action_mask))
        rows, num_actions = action_mask.shape
        if actions.shape != (rows,) or not np.issubdtype(actions.dtype, np.integer):
            raise WrappedAgentError(
                f"agent {self.name!r} answered {actions.dtype} of shape {list(actions.shape)} to "
                f"{rows} observations: `act` must return one whole number for each"
            )
        inside = (actions >= 0) & (actions < num_actions)
        legal = inside & action_mask[np.arange(rows), np.where(inside, actions, 0)]
        if not legal.all():
            row = int(np.flatnonzero(~legal)[0])
            allowed = np.flatnonzero(action_mask[row])[:8].tolist()
            raise WrappedAgentError(
                f"agent {self.name!r} chose action {actions[row]} in row {row}, where the mask "
                f"allows {allowed}{', ...' if action_mask[row].sum() > len(allowed) else ''}: "
                "`act` must choose where action_mask is true"
            )
        return actions.astype(np.int64)

    def state_dict(self) -> dict[str, Any]:
        """Its own state, or nothing."""
        return dict(self.wrapped.state_dict()) if hasattr(self.wrapped, "state_dict") else {}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`, where it can."""
        if hasattr(self.wrapped, "load_state_dict"):
            self.wrapped.load_state_dict(state)


def wrap_agent(
    name: str, source: str, game: Game, scenario: Any, representation: str = "planes"
) -> Agent:
    """An agent from `source`: a checkpoint's folder, or `package.module:function`.

    The function is called with the scenario and its `GameSpec`, as the factories of bots are.

    Raises:
        WrappedAgentError: nothing of the kind is there, or it makes no agent.
        CheckpointError: a folder that holds no agent, or one that does not fit.
    """
    if is_checkpoint(source):
        return WrappedAgent(load_agent(source, game.name, scenario), name)
    module_name, colon, function_name = source.partition(":")
    if not colon:
        raise WrappedAgentError(
            f"agent {name!r} is to come from {source!r}, which is neither a folder with a "
            "checkpoint nor package.module:function"
        )
    try:
        function = getattr(importlib.import_module(module_name), function_name)
    except (ImportError, AttributeError) as error:
        raise WrappedAgentError(
            f"agent {name!r} cannot be made from {source!r} ({error}): the module must be on "
            "Python's path and hold the function"
        ) from error
    made = function(scenario, game.make_spec(scenario))
    return WrappedAgent(made, name, representation)
