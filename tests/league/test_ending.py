"""A league that plays on until something is reached says what has ended it."""

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.league.play.adaptive import Target, play_adaptively
from marl_cair.league.play.stopping import Clock, describe_ending
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from tests.league.leagues import EDGES, make
from tests.league.play.test_schedules import Simulation

AT_ONCE = 1e-9  # seconds: time is up after the first batch


def count_games(folder):
    store = LeagueStore(folder / STORE_FILE)
    try:
        return len(store.read_games().agents)
    finally:
        store.close()


@pytest.mark.parametrize("workers", ["1", "2"])
def test_time_ends_the_first_round_too(tmp_path, capsys, monkeypatch, workers):
    """All pairs met first, which took hours of many agents, whatever --time said."""
    monkeypatch.setattr("marl_cair.cli.match_options.read_seconds", lambda text: AT_ONCE)
    words = ["league", "random", "turtle", "rusher", "--scenario", "11x11", "--no-replays"]
    words += ["--workers", workers, "--out", str(tmp_path)]
    assert main([*words, "--time", "1s"]) == 0
    assert count_games(tmp_path) == 8
    told = capsys.readouterr().out
    assert "the time of --time is up" in told.splitlines()[-1]
    assert main([*words, "--time", "1s", "--ci", "25"]) == 0
    assert count_games(tmp_path) == 16  # what is stored takes no time
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.startswith("Not reached: intervals within 25 Elo either way (--ci), there are non")
    assert "the time of --time is up" in told


def test_the_first_jobs_link_everybody():
    """So that there is a ladder as soon as can be."""
    target = Target(1.0, 8, lambda: True, lambda games: np.zeros(5))
    jobs = play_adaptively(5, 2, 4, 8, target, Simulation([0.0] * 5))
    assert [job.line_up for job in jobs[:4]] == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert len(jobs) == 10


def test_a_clock_that_never_started_is_never_up():
    clock = Clock(AT_ONCE)
    assert not clock.is_time_up()
    clock.start()
    assert clock.is_time_up()
    assert clock.has_ended
    endless = Clock(0.0)
    endless.start()
    assert not endless.is_time_up()


def test_what_is_reached_is_told():
    ratings = make(dict.fromkeys(EDGES, 22)).ratings
    within = "intervals are within 500 Elo either way (--ci)"
    assert describe_ending(500.0, ratings, is_time_up=True) == f"All {within}."
    told = describe_ending(1.0, ratings, is_time_up=False)
    assert told.startswith(
        "Not reached: intervals within 1 Elo either way (--ci), 4 of 4 are wider"
    )
    assert "there are none: the time of --time is up" in describe_ending(1.0, (), is_time_up=True)
    assert describe_ending(0.0, ratings, is_time_up=False) == ""


def test_a_bound_is_no_interval():
    told = describe_ending(500.0, make().ratings, is_time_up=False)
    assert told.endswith("(--ci), but for 2 of 4 agents that have none.")
