"""The player that agents learn from."""

import pytest

from benchmarks._matches import play_match
from marl_cair.games import GAMES, make_engine
from marl_cair.league.agents.load import load_agent

SOURCE = "marl_cair.games.deep_rts.teacher:make_teacher"


@pytest.mark.slow
def test_the_teacher_beats_every_bot():
    game, engine = GAMES["deep_rts"], make_engine("deep_rts", "1v1-15x15", 64)
    teacher = load_agent(SOURCE, "deep_rts", "1v1-15x15")
    assert teacher.name == "teacher"
    for number, name in enumerate(game.bots):
        result = play_match(engine, teacher, game.bot(name, engine.scenario), seed=900 + number)
        assert result.wins > 0.6 * result.games, name
    assert (engine.illegal_actions == 0).all()
