"""Seats in training: teams, seats that are out, scenarios of one team; on the test game."""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.replay.transition import NO_OPPONENT
from marl_cair.self_play.samplers import LATEST_ID
from marl_cair.training.collecting.opponents import make_bots
from marl_cair.training.collecting.rollout import make_rollout
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import ReplaySettings
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.trainer import train as train_aloud
from tests.games.last_standing import GAME, LEAVE, NOOP
from tests.training import runs
from tests.training.runs import by_game, collect, count_by_hand, small, was_out

pytestmark = pytest.mark.usefixtures("test_game")


def make_run(tmp_path, scenario, mixture=None, **changes):
    return TrainingRun(small(tmp_path / "run", scenario, mixture, **changes))


def report(run):
    return run.statistics.report(run.book.name, run.spec.action_group_names)


# --- who plays which seats -------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["ffa-4", "duel", "teams", "uneven"])
def test_the_learner_plays_one_team_whose_points_returns_and_actions_are_reported(
    tmp_path, scenario
):
    """The team changes with the games; actions of seats that are out do not count."""
    run = make_run(tmp_path, scenario, {"random": 1.0})
    teams, data = run.spec.team_of_seat, collect(run)
    played = set()
    for game in by_game(data):
        owned = game["player", "learned"][0].numpy()
        (team,) = set(teams[owned])
        assert (owned == (teams == team)).all()
        assert torch.equal(game["player", "learned"], torch.from_numpy(owned) & ~was_out(game))
        played.add(team)
    assert played == set(range(run.spec.num_teams))
    points, returns = count_by_hand(data, teams)
    row = report(run)
    assert row["episodes/finished"] == len(points) > 30
    assert row["collect_win_rate/random"] == pytest.approx(np.mean(points))
    assert row["episodes/return"] == pytest.approx(np.mean(returns), abs=1e-6)
    chosen = data["player", "action"][data["player", "learned"]]
    for action, name in enumerate(run.spec.action_group_names):
        assert row[f"actions/{name}"] == pytest.approx((chosen == action).float().mean().item())


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["ffa-8", "teams", "uneven", "alone"])
def test_against_itself_the_learner_plays_every_seat_that_is_in(tmp_path, scenario):
    data = collect(make_run(tmp_path, scenario, {"latest": 1.0}))
    out = data["player", "done"].squeeze(-1)
    assert torch.equal(data["player", "learned"], ~out)
    assert out.any() == (scenario in ("ffa-8", "uneven"))
    opponent = NO_OPPONENT if scenario in ("alone", "together") else LATEST_ID
    assert (data["player", "opponent"] == opponent).all()


@pytest.mark.slow
def test_a_seat_that_is_out_plays_the_no_op_without_asking_a_policy(tmp_path):
    run = make_run(tmp_path, "ffa-4", {"random": 1.0})
    (member,) = run.book.pool.members
    bot = run.book.pool.agent(member.number)
    data = collect(run)
    out = data["player", "done"].squeeze(-1)
    assert out.any()
    assert (data["player", "action"][out] == NOOP).all()
    assert not run.env.engine.illegal_actions.any()
    assert {has_left for _, has_left, _ in bot.rows} == {0}


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["alone", "together"])
def test_without_rivals_the_learner_plays_alone_whatever_the_mixture(tmp_path, scenario, capsys):
    run = make_run(tmp_path, scenario, {"random": 0.5, "uniform": 0.5})
    assert run.book.pool.members == []
    data = collect(run)
    assert data["player", "learned"].all()
    assert (data["player", "opponent"] == NO_OPPONENT).all()
    row = report(run)
    _, returns = count_by_hand(data, run.spec.team_of_seat)
    assert row["episodes/return"] == pytest.approx(np.mean(returns), abs=1e-6)
    assert not any(name.startswith("collect_win_rate") for name in row)
    train_aloud(small(tmp_path / "aloud", scenario, frames=128))
    assert f"{scenario} has no rivals, so opponent.* is not used" in capsys.readouterr().out


def test_bots_that_are_no_opponents_need_not_fit_the_scenario(tmp_path, monkeypatch):
    """Deep RTS's bots refuse some action spaces: that is no reason to refuse self-play."""

    def refuse(scenario, spec):
        raise ValueError("the bot cannot play this")

    monkeypatch.setitem(GAME.bots, "scorer", refuse)
    make_run(tmp_path / "a", "ffa-3", {"latest": 1.0}).close()
    with pytest.raises(ValueError, match="cannot play this; or leave 'scorer' out of opponent.mix"):
        make_run(tmp_path / "b", "ffa-3", {"scorer": 1.0, "bots": 1.0})
    run = make_run(tmp_path / "c", "ffa-3", {"bots": 1.0})
    assert {member.name for member in run.book.pool.members} == set(GAME.bots) - {"scorer"}
    run.close()
    without_players = dataclasses.replace(GAME, bots={"scorer": refuse, "random": refuse})
    with pytest.raises(ValueError, match="cannot play this; or leave 'bots' out of opponent.mixtu"):
        make_bots({"bots"}, without_players, GAME.scenario("ffa-3"))


# --- what is stored --------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["ffa-4", "uneven"])
def test_the_step_at_which_a_seat_goes_out_is_terminal_and_its_last(tmp_path, scenario):
    data = collect(make_run(tmp_path, scenario, {"latest": 1.0}))
    rollout = make_rollout(data, 1.0)
    num_early = 0
    for game in by_game(data):
        for seat in range(data["player", "action"].shape[-1]):
            stored = game["player", "learned"][:, seat]
            ends = game["next", "player", "terminated"][:, seat, 0]
            length = int(stored.sum())
            assert stored[:length].all()
            assert ends.nonzero().flatten().tolist() == list(range(length - 1, len(game)))
            if length < len(game):
                num_early += 1
                assert game["next", "player", "reward"][length - 1, seat, 0] == -1.0
    assert num_early > 10
    for stored, collected in (
        (rollout.learned, data["player", "learned"]),
        (rollout.terminated, data["next", "player", "terminated"].squeeze(-1)),
    ):
        assert torch.equal(stored, collected.transpose(0, 1).flatten(1))


@pytest.mark.parametrize("n_steps", [1, 4])
def test_returns_of_a_seat_that_goes_out_end_with_its_last_reward(tmp_path, n_steps):
    """Seats score 0.01 to 0.09 a step; a seat that leaves is paid -1 once, and ends."""
    learner = LearnerSettings(batch_size=16, n_steps=n_steps, gamma=0.5)
    replay = ReplaySettings(6_000, 300, min_transitions=64)  # holds all steps and ends
    run = make_run(tmp_path, "ffa-4", {"latest": 1.0}, learner=learner, replay=replay)
    batches = iter(run.collector)
    num_learned = 0
    for _ in range(6):
        rollout = make_rollout(next(batches), 1.0)
        num_learned += int(rollout.learned.sum())
        run.replay.real.extend_rollout(rollout)
    # All steps have an end that is known, but the newest of seats that are still in.
    num_open = int((rollout.learned & ~rollout.terminated & ~rollout.truncated)[-1].sum())
    assert run.replay.real.num_sampleable == num_learned - num_open
    rows = run.replay.real.sample(4_000)
    left = rows["observation"][:, 1, 0, 0] == 1
    assert not left.any()  # no state is stored of a seat that has left
    leaving = (rows["action"] == LEAVE) & (rows["steps_to_next_obs"].squeeze(1) == 1)
    assert leaving.sum() > 50
    assert rows["next", "terminated"].squeeze(1)[rows["action"] == LEAVE].all()
    assert (rows["next", "observation"][rows["action"] == LEAVE][:, 1, 0, 0] == 1).all()
    paid = rows["next", "reward"].squeeze(1)[rows["action"] == LEAVE]
    assert set(paid.unique().tolist()) <= {-1.0, 0.0}  # 0: all left who were left
    assert (rows["steps_to_next_obs"] > 1).any() == (n_steps > 1)
    # Of an ended return the reward of the end is discounted by the steps before it, and no more.
    ended = rows["next", "terminated"].squeeze(1)
    steps = rows["steps_to_next_obs"].squeeze(1)[ended].float()
    least = -(0.5 ** (steps - 1))
    assert (rows["next", "reward"].squeeze(1)[ended] >= least - 1e-6).all()
    run.close()


def test_the_generator_learns_nothing_of_seats_that_are_out(tmp_path):
    """It hears of each stored step once, with the end that replay gives to it."""
    run = make_run(tmp_path, "ffa-4", {"latest": 1.0})
    batches = iter(run.collector)
    heard, num_leaving = [], 0
    for _ in range(6):
        rollout = make_rollout(next(batches), 1.0)
        num_leaving += int((rollout.learned & (rollout.action == LEAVE)).sum())
        slots = run.replay.real.extend_rollout(rollout)
        heard.append(run.replay.real.read_steps(slots))
    rows = torch.cat(heard)
    assert (rows["action"] == LEAVE).sum() == num_leaving
    assert not (rows["observation"][:, 1, 0, 0] == 1).any()
    assert rows["next", "terminated"][rows["action"] == LEAVE].all()
    going_on = ~rows["next", "terminated"].squeeze(1)
    assert not (rows["next", "observation"][going_on][:, 1, 0, 0] == 1).any()
    run.close()


# --- whole runs ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scenario",
    ["uneven", *(pytest.param(s, marks=pytest.mark.slow) for s in ("ffa-4", "duel", "together"))],
)
def test_a_resumed_run_of_any_seats_equals_one_that_was_never_stopped(tmp_path, scenario):
    folders = runs.train_whole_and_in_parts(tmp_path, lambda to: small(to, scenario), until=256)
    logs = [read_log(folder / "log.csv")[-1] for folder in folders]
    assert logs[0]["updates"] == logs[1]["updates"] > 0
