"""Scripted birds. They see what an agent sees: the representation `features` and the mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.flappy_bird.bot_plans import (
    make_knowledge,
    make_search,
    plan_oracle,
    plan_reflex,
)
from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.flappy_bird.tables import FLAP, NOOP
from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.scripted import ScriptedPlayer, choose_by_kind

PLANS = ("random", "reflex", "oracle")
RANDOM, REFLEX, ORACLE = range(len(PLANS))


class FeaturePlayer(ScriptedPlayer):
    """A plan that looks at `features`."""

    representation = "features"


@compiled
def decide_all(
    plan: int, known: Any, search: Any, seen: Any, mask: Any, random: Any, out: Any
) -> None:
    """Decide for each of N rows: seen float32 [N, 12], mask [N, 2], out [N]."""
    for index in range(seen.shape[0]):
        if plan == RANDOM:
            out[index] = choose_by_kind(mask[index], known.groups, random)
            continue
        if not mask[index, FLAP]:
            out[index] = NOOP
        elif plan == REFLEX:
            out[index] = FLAP if plan_reflex(seen[index], known) else NOOP
        else:
            out[index] = FLAP if plan_oracle(seen[index], known, search) else NOOP


def make_bot(name: str, scenario: Scenario, spec: GameSpec) -> FeaturePlayer:
    """The bot of one of PLANS for a scenario and its spec."""
    known = make_knowledge(scenario, spec)
    return FeaturePlayer(name, partial(decide_all, PLANS.index(name), known, make_search()))


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    name: partial(make_bot, name) for name in PLANS
}
