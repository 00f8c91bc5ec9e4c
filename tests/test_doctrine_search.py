"""The player that agents learn from, and the search that has found its numbers."""

import numpy as np
import pytest

from benchmarks import doctrine_search
from benchmarks._matches import play_match
from benchmarks.doctrine_search import HIGHEST, LOWEST, Search
from marl_cair.games import GAMES, make_engine
from marl_cair.games.deep_rts.bots.doctrines import DOCTRINES, Doctrine
from marl_cair.games.deep_rts.teacher import TEACHER
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


def test_children_stay_within_the_ranges_and_have_an_army(monkeypatch):
    monkeypatch.setattr(Search, "rate", lambda *_: None)  # no games
    search, parents = Search("1v1-15x15", 0), list(DOCTRINES.values())
    for low, number, high in zip(LOWEST, TEACHER, HIGHEST, strict=True):
        assert low <= number <= high
    seen = set()
    for _ in range(500):
        child = search._make_child(parents)
        seen.add(child)
        numbers = np.array(child)
        assert (numbers >= LOWEST).all()
        assert (numbers <= HIGHEST).all()
        assert child.footmen + child.archers + child.cavalry > 0
    assert len(seen) > 400


@pytest.mark.slow
def test_the_search_prefers_what_wins_and_finds_the_same_again(monkeypatch):
    for name in ("FIRST_GAMES", "NEXT_GAMES", "LAST_GAMES"):
        monkeypatch.setattr(doctrine_search, name, 2)
    unarmed = TEACHER._replace(footmen=0, archers=0, militia=0, barracks=0)
    plans = {"sound": TEACHER, "unarmed": unarmed, "idle": unarmed._replace(workers=1)}
    monkeypatch.setattr(doctrine_search, "DOCTRINES", plans)
    found = []
    for _ in range(2):
        search = Search("1v1-15x15", 3)
        assert search.rank(2)[0] == TEACHER
        search.run_generation()
        assert len(search.records) == len(plans) + doctrine_search.CHILDREN
        assert search.records[search.rank(4)[0]].worth >= 0.5
        assert search.rank(2)[-1] not in (TEACHER, search.rank(2)[0])
        found.append({one: (rec.games, *rec.points) for one, rec in search.records.items()})
    assert found[0] == found[1]


@pytest.mark.slow
def test_the_command_prints_the_doctrine_and_its_even_games_against_each_bot(monkeypatch, capsys):
    monkeypatch.setattr(doctrine_search, "NEXT_GAMES", 2)
    doctrine_search.main(["--generations", "0", "--games", "2"])
    table = capsys.readouterr().out
    assert table.startswith("6 doctrines; the best, of seed 1:\n")
    for name in Doctrine._fields:
        assert f"    {name}=" in table
    for name in DOCTRINES:
        assert f"| `{name}` | " in table
    with pytest.raises(SystemExit):
        doctrine_search.main(["--games", "3"])
    assert "--games is 3: give an even number" in capsys.readouterr().err
