"""Scripted opponents of Deep Line Wars. They see what an agent sees: planes and action mask."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.bot_plans import (
    plan_by_worth,
    plan_economist,
    plan_random,
    plan_turtle,
    plan_zigzag,
)
from marl_cair.games.deep_line_wars.bot_sight import (
    COUNTER_WEIGHTS,
    RUSHER_WEIGHTS,
    Knowledge,
    make_knowledge,
    make_sight,
    pass_turn,
)
from marl_cair.games.deep_line_wars.scenarios import Scenario
from marl_cair.games.game import Agent, GameSpec

PLANS = ("random", "rusher", "turtle", "economist", "zigzag", "counter")
RANDOM, RUSHER, TURTLE, ECONOMIST, ZIGZAG, COUNTER = range(len(PLANS))
WEIGHTS = {RUSHER: RUSHER_WEIGHTS}  # of the others: COUNTER_WEIGHTS


@compiled
def decide(plan: int, planes: Any, mask: Any, known: Any, sight: Any, random: Any) -> int:
    """The action that a plan takes in one player's position; an illegal one becomes the no-op."""
    if plan == RANDOM:
        return plan_random(mask, known, random)
    if plan == TURTLE:
        action = plan_turtle(planes, known, sight)
    elif plan == ECONOMIST:
        action = plan_economist(planes, known, sight)
    elif plan == ZIGZAG:
        action = plan_zigzag(planes, known, sight)
    else:
        action = plan_by_worth(planes, known, sight)
    return action if mask[action] else pass_turn(known)


@compiled
def decide_all(
    plan: int, planes: Any, mask: Any, known: Any, sight: Any, random: Any, out: Any
) -> None:
    """Decide for each of N rows: planes [N, C, H, W], mask [N, A], out [N]."""
    for index in range(planes.shape[0]):
        out[index] = decide(plan, planes[index], mask[index], known, sight, random)


class ScriptedPlayer:
    """A plan that answers each row of a batch on its own; its only memory is a random word.

    Args:
        name: one of PLANS.
        scenario: the game that it will play.
        spec: of that scenario.
        known: what it takes the numbers of the game to be; None reads them from the scenario.
    """

    representation = "planes"

    def __init__(
        self, name: str, scenario: Scenario, spec: GameSpec, known: Knowledge | None = None
    ) -> None:
        self.name = name
        self._plan = PLANS.index(name)
        weights = WEIGHTS.get(self._plan, COUNTER_WEIGHTS)
        self._known = known or make_knowledge(scenario, spec, weights)
        self._sight = make_sight(scenario)
        self._random = np.zeros(1, np.uint64)

    def seed(self, seed: int) -> None:
        self._random[0] = seed % 2**64

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        num_rows = len(observation)
        actions = np.zeros(num_rows, np.int64)
        planes = np.ascontiguousarray(observation)
        mask = np.ascontiguousarray(action_mask)
        with np.errstate(over="ignore"):
            decide_all(self._plan, planes, mask, self._known, self._sight, self._random, actions)
        return actions

    def state_dict(self) -> dict[str, Any]:
        return {"random": int(self._random[0])}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._random[0] = state["random"]


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    name: partial(ScriptedPlayer, name) for name in PLANS
}
