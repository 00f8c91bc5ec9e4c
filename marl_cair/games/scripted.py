"""`ScriptedPlayer`, the agent around a bot's plan, and a random choice of actions by kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numba.core.errors import TypingError
from numpy.typing import NDArray

from marl_cair.games.checks.engine import check_seed
from marl_cair.games.compiled import compiled
from marl_cair.games.randomness import draw_below

if TYPE_CHECKING:
    from marl_cair.games.game import GameSpec


@compiled
def choose_by_kind(mask: Any, groups: Any, random: Any) -> int:
    """Uniform over the kinds of action that are legal, then over the legal actions of the kind.

    mask bool [A]; groups int16 [A], see `GameSpec.action_groups`; random uint64 [1]. Actions of a
    kind stand together, so a kind ends where the group number changes.
    """
    num_kinds = 0
    previous = -1
    for action in range(mask.shape[0]):
        if mask[action] and groups[action] != previous:
            num_kinds += 1
            previous = groups[action]
    kind = draw_below(random, 0, num_kinds)
    previous = -1
    chosen = 0
    count = 0
    for action in range(mask.shape[0]):
        if not mask[action]:
            continue
        if groups[action] != previous:
            kind -= 1
            previous = groups[action]
        if kind == -1:
            if count == 0:
                chosen = action
            count += 1
    nth = draw_below(random, 0, count)
    for action in range(chosen, mask.shape[0]):
        if mask[action]:
            if nth == 0:
                return action
            nth -= 1
    return chosen


@compiled
def choose_all_by_kind(groups: Any, seen: Any, mask: Any, random: Any, out: Any) -> None:
    """`choose_by_kind` for each of N rows: mask [N, A], out [N]."""
    for index in range(mask.shape[0]):
        out[index] = choose_by_kind(mask[index], groups, random)


class ScriptedPlayer:
    """A plan that acts on each row of a batch on its own; its only memory is a random word.

    Args:
        name: of the bot.
        decide_all: writes the actions of N rows: (planes [N, C, H, W], mask [N, A], random [1],
            out int64 [N]); with an action shape: mask [N, *action_shape, A], out
            [N, *action_shape].
        representation: that it is shown in the place of planes.
    """

    def __init__(
        self, name: str, decide_all: Callable[..., None], representation: str = "planes"
    ) -> None:
        self.name, self.representation = name, representation
        self._decide_all = decide_all
        self._random = np.zeros(1, np.uint64)

    @classmethod
    def by_kind(cls, spec: GameSpec, representation: str = "planes") -> ScriptedPlayer:
        """The bot `random`: draws a kind of action, then an action of it."""
        return cls("random", partial(choose_all_by_kind, spec.action_groups), representation)

    def seed(self, seed: int) -> None:
        self._random[0] = check_seed(self.name, seed)

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        actions = np.zeros(action_mask.shape[:-1], np.int64)
        planes = np.ascontiguousarray(observation)
        mask = np.ascontiguousarray(action_mask)
        with np.errstate(over="ignore"):
            try:
                self._decide_all(planes, mask, self._random, actions)
            except TypingError as error:
                seen = f"not {planes.dtype} {list(planes.shape)}"
                text = f"{self.name!r} reads the representation {self.representation!r}, {seen}"
                raise ValueError(text) from error
        return actions

    def state_dict(self) -> dict[str, Any]:
        return {"random": int(self._random[0])}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._random[0] = state["random"]
