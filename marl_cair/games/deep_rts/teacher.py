"""A scripted player of Deep RTS that beats the bots, for agents to learn from.

Its numbers are the result of a search against the six scripted bots of 1v1-15x15
(`python -m benchmarks.doctrine_search`). It is no bot of the game, because agents are rated by the
bots: its name is `marl_cair.games.deep_rts.teacher:make_teacher`.
"""

from __future__ import annotations

from marl_cair.games.deep_rts.bots.bots import make_bot
from marl_cair.games.deep_rts.bots.doctrines import Doctrine
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game import GameSpec
from marl_cair.games.scripted import ScriptedPlayer

TEACHER = Doctrine(
    workers_first=1,
    workers=5,
    halls=1,
    barracks=3,
    wells=1,
    upgrades=3,
    attack_size=11,
    caution=28,
    free_food=2,
    lumber_weight=40,
    footmen=2,
    archers=2,
    cavalry=0,
    answers=3,
    militia=5,
    scouts=1,
)


def make_teacher(scenario: Scenario, spec: GameSpec) -> ScriptedPlayer:
    """The player, for `demonstration.agents`, `opponent.agents`, leagues and matches.

    Raises ValueError with an action space other than `unit`.
    """
    return make_bot("teacher", scenario, spec, TEACHER)
