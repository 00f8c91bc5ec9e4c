"""Scripted opponents of Deep Line Wars. They see what an agent sees: planes and action mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.bot_plans import (
    plan_by_worth,
    plan_economist,
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
from marl_cair.games.scripted import ScriptedPlayer, choose_by_kind

PLANS = ("random", "rusher", "turtle", "economist", "zigzag", "counter")
RANDOM, RUSHER, TURTLE, ECONOMIST, ZIGZAG, COUNTER = range(len(PLANS))
WEIGHTS = {RUSHER: RUSHER_WEIGHTS}  # of the others: COUNTER_WEIGHTS


@compiled
def decide(plan: int, planes: Any, mask: Any, known: Any, sight: Any, random: Any) -> int:
    """The action that a plan takes in one player's position; an illegal one becomes the no-op."""
    if plan == RANDOM:
        return choose_by_kind(mask, known.groups, random)
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
    plan: int, known: Any, sight: Any, planes: Any, mask: Any, random: Any, out: Any
) -> None:
    """Decide for each of N rows: planes [N, C, H, W], mask [N, A], out [N]."""
    for index in range(planes.shape[0]):
        out[index] = decide(plan, planes[index], mask[index], known, sight, random)


def make_bot(
    name: str, scenario: Scenario, spec: GameSpec, known: Knowledge | None = None
) -> ScriptedPlayer:
    """The bot of one of PLANS for a scenario and its spec.

    `known` is what it takes the numbers of the game to be; None reads them from the scenario.
    """
    plan = PLANS.index(name)
    known = known or make_knowledge(scenario, spec, WEIGHTS.get(plan, COUNTER_WEIGHTS))
    return ScriptedPlayer(name, partial(decide_all, plan, known, make_sight(scenario)))


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    name: partial(make_bot, name) for name in PLANS
}
