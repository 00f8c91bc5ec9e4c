"""A scripted player of Deep RTS that beats the bots, for agents to learn from.

Its numbers, `bots.doctrines.TEACHER`, are the result of a search against the six scripted bots of
1v1-15x15, of 510 doctrines, before these fought off peasants. It is no bot
of the game, because agents are rated by the bots: its name is
`marl_cair.games.deep_rts.teacher:make_teacher`.
"""

from __future__ import annotations

from marl_cair.games.deep_rts.bots.bots import make_bot
from marl_cair.games.deep_rts.bots.doctrines import TEACHER
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game import GameSpec
from marl_cair.games.scripted import ScriptedPlayer


def make_teacher(scenario: Scenario, spec: GameSpec) -> ScriptedPlayer:
    """The player, for `demonstration.agents`, `opponent.agents`, leagues and matches.

    Raises ValueError with an action space other than `unit`.
    """
    return make_bot("teacher", scenario, spec, TEACHER)
