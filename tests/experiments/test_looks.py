"""Looks: what is measured, when one is due, and what a resumed run keeps."""

import dataclasses

import pytest

from marl_cair.experiments.looks import Looks, measure, read_overestimation
from marl_cair.experiments.plan import Length, RatingSettings
from marl_cair.games import GAMES
from marl_cair.training.run_log import format_rows
from tests.experiments.plans import list_cells, make_plan


@pytest.fixture(scope="module")
def cell():
    return list_cells(make_plan(seeds=[0]))[0]


def make_bot(name, cell):
    return GAMES[cell.config.game.name].bot(name, cell.config.game.rated_scenario)


def test_a_solo_game_gives_the_numbers_of_the_game(cell):
    rating = RatingSettings(games=4, number="extra_steps", times=-1)
    cell = dataclasses.replace(cell, rating=rating)
    row = measure(make_bot("oracle", cell), cell, 0)
    assert (row["score"], row["mean"], row["ended"], row["extra_steps"]) == (0.0, 0.0, 1.0, 0.0)
    assert 0 < row["return"] <= 1
    wrong = dataclasses.replace(cell, rating=dataclasses.replace(rating, number="extra_step"))
    with pytest.raises(ValueError, match="nearest are 'extra_steps'"):
        measure(make_bot("oracle", cell), wrong, 0)


def test_looks_and_seeds_play_different_games(cell):
    bot = make_bot("oracle", cell)
    cells = [cell, dataclasses.replace(cell, seed=1)]
    found = {measure(bot, one, look)["optimal_steps"] for one in cells for look in range(3)}
    assert len(found) > 3
    assert measure(bot, cell, 1) == measure(bot, cell, 1)


def test_random_moves_are_numbers_of_their_own(cell):
    rating = RatingSettings(games=4, number="ended", epsilons=(0.0, 0.1))
    cell = dataclasses.replace(cell, rating=rating)
    row = measure(make_bot("oracle", cell), cell, 0)
    assert {"ended", "ended (10 % random)"} <= row.keys()


def test_the_score_is_that_against_the_hardest_bot():
    words = ["game=deep_line_wars", "scenario=11x11", "max_ticks=100"]
    task = {"rating": {"games": 2, "bots": ["random", "rusher"], "times": 100}}
    cell, *_ = list_cells(make_plan(words=words, tasks={"war": task}))
    row = measure(make_bot("turtle", cell), cell, 0)
    scores = row["against random"], row["against rusher"]
    assert row["score"] == 100 * min(scores)
    assert row["mean"] == pytest.approx(50 * sum(scores))


def test_a_look_is_due_once_for_each_interval(cell, tmp_path):
    looks, bot = Looks(cell, tmp_path), make_bot("oracle", cell)
    times = [0, 64, 128, 200, 500]
    assert looks.is_due(0, 0.0)
    due = []
    for frames in times:
        if looks.is_due(frames, 0.0):
            due.append(frames)
            looks.add(bot, frames, 1.5)
    assert due == [0, 128, 500]  # 256 and 384 passed within one iteration
    assert [row["look"] for row in Looks(cell, tmp_path).rows] == [0, 1, 3]
    looks.drop_after(128)
    assert looks.last_frames == 128
    looks.add(bot, 512, 1.5)
    assert looks.rows[-1]["look"] == 4


def test_without_intervals_a_look_is_due_at_the_start_alone(cell, tmp_path):
    looks = Looks(dataclasses.replace(cell, looks=Length()), tmp_path)
    assert looks.is_due(0, 0.0)
    looks.add(make_bot("oracle", cell), 0, 0.0)
    assert not looks.is_due(10**6, 10.0**6)


def test_overestimation_is_that_since_the_last_look(tmp_path):
    rows = [{"frames": 100.0 * n, "q/overestimation": float(n)} for n in range(1, 10)]
    log = tmp_path / "log.csv"
    log.write_text(format_rows([*rows, {"frames": 1000.0, "loss": 1.0}]), "utf-8")
    assert read_overestimation(log, 800) == 9.0
    assert read_overestimation(log, -1) == 8.0  # of the last third: 7, 8 and 9
    assert read_overestimation(tmp_path / "none.csv", 0) != read_overestimation(log, 0)
