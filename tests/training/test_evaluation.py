"""Evaluation while training: fair shares, returns in scenarios of one team, held-out scenarios."""

import dataclasses

import pytest

from marl_cair.games.replays import read_replays
from marl_cair.training.curves import draw_curves
from marl_cair.training.evaluation import evaluate, rate_on
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import EvaluationSettings, ExplorationSettings, TrainConfig
from tests.games.last_standing import GAME
from tests.training.runs import small, train

pytestmark = pytest.mark.usefixtures("test_game")


def agent(name):
    return GAME.bots[name](None, None)


@pytest.mark.parametrize(
    ("scenario", "num_games", "fair"), [("ffa-3", 5, 1 / 3), ("uneven", 6, 1 / 3), ("duel", 5, 0.5)]
)
def test_win_rates_stand_beside_the_fair_share(scenario, num_games, fair):
    chosen = GAME.scenario(scenario)
    scores, row = rate_on(agent("finisher"), GAME, chosen, ("idle", "quitter"), num_games, 0)
    assert scores == [1.0, 1.0]
    assert row["win_rate/idle"] == row["win_rate/idle/high"] == 1.0
    assert 0.3 < row["win_rate/idle/low"] < 1.0
    assert row.get("fair_share/learner", 0.5) == pytest.approx(fair)


def test_alone_the_return_stands_beside_those_of_bots():
    scores, row = rate_on(agent("scorer"), GAME, GAME.scenario("alone"), ("idle", "random"), 20, 0)
    assert scores == [row["return/learner"]]
    assert row["return/idle"] == 0.0
    assert row["return_gain/idle"] == pytest.approx(row["return/learner"])
    assert row["return_gain/random"] == pytest.approx(row["return/learner"] - row["return/random"])
    assert row["return/learner/low"] < row["return/learner"] < row["return/learner/high"]


def test_held_out_scenarios_are_rated_beside_the_training_one(tmp_path):
    """In the held-out scenario all returns are 0, unlike in training."""
    settings = EvaluationSettings(
        games=4, bots=("idle",), scenarios={"heldout": {"gain": 0}, "short": {"max_ticks": 2}}
    )
    config = small(tmp_path, "alone", evaluation=settings)
    scores, row = evaluate(agent("scorer"), GAME, config, 0)
    assert scores == [row["return/learner"]]
    assert row["return/learner@heldout"] == row["return/idle@heldout"] == 0.0
    assert row["return/learner@short"] == pytest.approx(row["return/learner"] / 6)
    assert {"return/learner@heldout/low", "return_gain/idle@short/high"} <= set(row)


def test_replays_of_the_first_map_are_kept_of_the_newest_evaluation(tmp_path):
    settings = EvaluationSettings(games=8, bots=("idle",), scenarios={"short": {"max_ticks": 2}})
    config = small(tmp_path, "duel", evaluation=settings)
    for _ in range(2):
        evaluate(agent("finisher"), GAME, config, 0, tmp_path)
    replays = [one for path in tmp_path.glob("*.replay") for one in read_replays(path)]
    assert len(replays) == 4  # one in each seat, on two scenarios
    assert {one.players[one.winner] for one in replays} == {"learner"}


def test_the_best_agent_is_chosen_by_the_training_scenario(tmp_path):
    settings = EvaluationSettings(
        every_frames=128, games=4, bots=("idle",), scenarios={"heldout": {"gain": 0}}
    )
    config = small(tmp_path / "a", "alone", frames=256, evaluation=settings)
    train(config)
    rows = read_log(tmp_path / "a" / "log.csv")
    run = TrainingRun(config, resume=True)
    assert run.best_score == max(row["return/learner"] for row in rows)
    assert all(row["return/learner@heldout"] == 0.0 for row in rows)
    run.close()


def stopping(folder, stop_score, anneal_frames=1):
    settings = EvaluationSettings(every_frames=128, games=4, bots=("idle",))
    config = small(folder, "alone", frames=384, evaluation=settings)
    exploration = ExplorationSettings(anneal_frames=anneal_frames)
    return dataclasses.replace(config, stop_score=stop_score, exploration=exploration)


@pytest.mark.parametrize(
    ("stop_score", "anneal_frames", "frames", "reached"),
    [
        (-1e9, 1, 128, True),
        (-1e9, 200, 256, True),  # not while it explores
        (1e9, 1, 384, False),
        (None, 1, 384, False),
    ],
)
def test_a_run_ends_at_its_stop_score(tmp_path, stop_score, anneal_frames, frames, reached):
    config = stopping(tmp_path / "a", stop_score, anneal_frames)
    result = train(config)
    assert (result.frames, result.reached_score) == (frames, reached)
    rows = read_log(tmp_path / "a" / "log.csv")
    assert ["confirmed_score" in row for row in rows] == [False] * (len(rows) - 1) + [reached]
    assert train(config, resume=True).frames == frames  # also when the command is repeated
    later = dataclasses.replace(config, stop_score=None)
    assert train(later, resume=True).frames == 384


def test_a_score_that_new_games_do_not_confirm_does_not_end_a_run(tmp_path, monkeypatch):
    seen = []

    def rate(agent, game, config, seed, record=None):
        seen.append(seed)
        return [1.0 if seed == seen[0] else 0.0], {}

    monkeypatch.setattr("marl_cair.training.trainer.evaluate", rate)
    result = train(stopping(tmp_path / "a", 0.5))
    assert (result.frames, result.reached_score) == (384, False)
    assert len(seen) == 6
    assert len(set(seen)) == 4  # the confirming games are others each time


def test_a_stop_score_needs_bots():
    with pytest.raises(ValueError, match=r"evaluation.bots is \(\), it must be one or more"):
        TrainConfig(stop_score=0.9, evaluation=EvaluationSettings(bots=()))


@pytest.mark.parametrize("score", [float("nan"), float("inf")])
def test_a_stop_score_is_a_number(tmp_path, score):
    with pytest.raises(ValueError, match=f"stop_score is {score}, it must be a number or null"):
        stopping(tmp_path, score)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scenarios": {"a/b": {}}}, "names of letters, digits, _ and -"),
        ({"scenarios": {"a": {"reward": "sparse"}}}, "without reward: the game's own rates"),
        ({"scenarios": {"a": {"gian": 3}}}, "unknown last_standing option 'gian'"),
        ({"options": {"reward": "sparse"}}, "evaluation.options is .* without reward"),
        ({"options": {"gian": 3}}, "unknown last_standing option 'gian'"),
    ],
)
def test_scenarios_that_cannot_be_rated_are_refused(tmp_path, settings, message):
    with pytest.raises(ValueError, match=message):
        small(tmp_path, "alone", evaluation=EvaluationSettings(**settings))


def test_a_board_of_another_size_is_refused():
    small_board = {"rows": 11, "columns": 11}
    with pytest.raises(ValueError, match=r"heldout shows \[28, 11, 11\] and has .* training shows"):
        TrainConfig(evaluation=EvaluationSettings(scenarios={"heldout": small_board}))
    with pytest.raises(ValueError, match=r"evaluation\.options shows \[28, 11, 11\]"):
        TrainConfig(evaluation=EvaluationSettings(options=small_board))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "expected"),
    [
        ("alone", {"run: learner", "run: idle", "run: learner@heldout", "run: idle@heldout"}),
        ("ffa-3", {"run v idle", "run v idle@heldout", "fair share"}),
        ("duel", {"run v idle", "run v idle@heldout"}),
    ],
)
def test_curves_show_what_was_rated(tmp_path, monkeypatch, scenario, expected):
    settings = EvaluationSettings(
        every_frames=128, games=2, bots=("idle",), scenarios={"heldout": {"gain": 0}}
    )
    train(small(tmp_path / "a", scenario, frames=128, evaluation=settings))
    shown = []
    monkeypatch.setattr(
        "marl_cair.training.curves._add_legend",
        lambda panel, **_: shown.append(set(panel.get_legend_handles_labels()[1])),
    )
    draw_curves({"run": tmp_path / "a"}, tmp_path / "curves.png")
    assert shown[0] == expected
    assert (tmp_path / "curves.png").stat().st_size > 0


@pytest.mark.parametrize(("frames", "expected"), [(512, [256, 512]), (384, [256, 384]), (128, [])])
def test_a_run_is_evaluated_at_its_end_too_unless_it_is_too_short(tmp_path, frames, expected):
    settings = EvaluationSettings(every_frames=256, games=4, bots=("idle",))
    train(small(tmp_path, "duel", frames=frames, evaluation=settings))
    rows = read_log(tmp_path / "log.csv")
    assert [row["frames"] for row in rows if "win_rate/idle" in row] == expected
