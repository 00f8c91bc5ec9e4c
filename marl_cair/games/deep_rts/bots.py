"""Scripted opponents of Deep RTS. They see what an agent sees: planes and action mask."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.bot_plans import plan_by_doctrine, plan_random
from marl_cair.games.deep_rts.bot_sight import Doctrine, make_knowledge, make_sight
from marl_cair.games.deep_rts.orders import NOOP
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game import Agent, GameSpec

RANDOM = "random"
DOCTRINES = {
    "economist": Doctrine(
        workers_first=6,
        workers=18,
        halls=1,
        barracks=2,
        attack_size=10,
        free_food=2,
        lumber_weight=35,
        footmen=1,
        archers=2,
        cavalry=0,
        militia=6,
        adapts=0,
    ),
    "rusher": Doctrine(
        workers_first=3,
        workers=7,
        halls=1,
        barracks=1,
        attack_size=2,
        free_food=1,
        lumber_weight=15,
        footmen=1,
        archers=0,
        cavalry=0,
        militia=0,
        adapts=0,
    ),
    "boomer": Doctrine(
        workers_first=4,
        workers=14,
        halls=2,
        barracks=2,
        attack_size=8,
        free_food=1,
        lumber_weight=40,
        footmen=0,
        archers=1,
        cavalry=0,
        militia=6,
        adapts=0,
    ),
    "archers": Doctrine(
        workers_first=3,
        workers=8,
        halls=1,
        barracks=2,
        attack_size=6,
        free_food=1,
        lumber_weight=40,
        footmen=0,
        archers=1,
        cavalry=0,
        militia=0,
        adapts=0,
    ),
    "turtle": Doctrine(
        workers_first=3,
        workers=8,
        halls=1,
        barracks=2,
        attack_size=8,
        free_food=1,
        lumber_weight=25,
        footmen=1,
        archers=1,
        cavalry=0,
        militia=0,
        adapts=0,
    ),
    "mixed": Doctrine(
        workers_first=3,
        workers=8,
        halls=1,
        barracks=2,
        attack_size=4,
        free_food=1,
        lumber_weight=40,
        footmen=0,
        archers=1,
        cavalry=0,
        militia=6,
        adapts=1,
    ),
}
_NO_DOCTRINE = Doctrine(*(0 for _ in Doctrine._fields))


@compiled
def decide_all(
    is_random: bool, planes: Any, mask: Any, known: Any, sight: Any, random: Any, out: Any
) -> None:
    """Decide for each of N rows: planes [N, C, H, W], mask [N, A], out [N]."""
    for index in range(planes.shape[0]):
        if is_random:
            action = plan_random(mask[index], known, random)
        else:
            action = plan_by_doctrine(planes[index], mask[index], known, sight)
        out[index] = action if mask[index, action] else NOOP


class ScriptedPlayer:
    """A plan that answers each row of a batch on its own; its only memory is a random word.

    Args:
        name: of the table; `random`, or a doctrine.
        scenario: the game that it will play.
        spec: of that scenario.
        doctrine: how to play; None plays at random.

    Raises:
        ValueError: a doctrine with an action space other than `unit`.
    """

    representation = "planes"

    def __init__(
        self, name: str, scenario: Scenario, spec: GameSpec, doctrine: Doctrine | None = None
    ) -> None:
        if doctrine is not None and scenario.actions != "unit":
            raise ValueError(
                f"deep_rts: the bot {name} cannot play the action space {scenario.actions!r}; "
                f"make the game with actions='unit', or play the bot {RANDOM!r}"
            )
        self.name = name
        self._is_random = doctrine is None
        self._known = make_knowledge(scenario, spec, doctrine or _NO_DOCTRINE)
        self._sight = make_sight(scenario)
        self._random = np.zeros(1, np.uint64)

    def seed(self, seed: int) -> None:
        self._random[0] = seed % 2**64

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        actions = np.zeros(len(observation), np.int64)
        planes = np.ascontiguousarray(observation)
        mask = np.ascontiguousarray(action_mask)
        with np.errstate(over="ignore"):
            decide_all(
                self._is_random, planes, mask, self._known, self._sight, self._random, actions
            )
        return actions

    def state_dict(self) -> dict[str, Any]:
        return {"random": int(self._random[0])}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._random[0] = state["random"]


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    RANDOM: partial(ScriptedPlayer, RANDOM),
    **{name: partial(ScriptedPlayer, name, doctrine=plan) for name, plan in DOCTRINES.items()},
}
