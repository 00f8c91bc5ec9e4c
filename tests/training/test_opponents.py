"""Opponents in training: drawn between games, results recorded to the right one, the pool."""

import sys
from collections import defaultdict

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.players.weak_bot import STRENGTHS, list_strengths
from marl_cair.games.torchrl_env import LastStep
from marl_cair.league.agents.foreign import ForeignAgentError
from marl_cair.league.agents.load import find_fingerprint
from marl_cair.league.agents.mixtures import save_mixture
from marl_cair.replay.transition import NO_OPPONENT
from marl_cair.self_play.pool import FIRST_NUMBERS, FOREIGN, SNAPSHOT
from marl_cair.self_play.samplers import LATEST_ID
from marl_cair.training.collecting.metrics import Decisions, find_meetings
from marl_cair.training.collecting.opponents import Meeting, make_bots
from marl_cair.training.collecting.seats import find_met
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import OpponentSettings
from tests.games.last_standing import FINISH, LEAVE
from tests.training import runs
from tests.training.runs import collect, digest, small, train

FIRST = FIRST_NUMBERS[SNAPSHOT]
IDLE = "last_standing/idle"


@pytest.fixture(autouse=True)
def _module_of_a_user(test_game, monkeypatch):
    monkeypatch.setitem(sys.modules, "users_module", sys.modules[__name__])


def make_run(tmp_path, scenario, mixture, **settings):
    opponent = OpponentSettings(mixture, **settings)
    return TrainingRun(small(tmp_path / "run", scenario, opponent=opponent))


def test_a_curriculum_makes_the_bots_stronger_as_they_are_beaten(tmp_path):
    """`quitter` loses at once at any strength, `finisher` wins in time unless it is very weak."""
    run = make_run(tmp_path, "duel", {"curriculum": 1.0}, redraw_every_frames=1)
    numbers = {member.name: member.number for member in run.book.pool.members}
    assert {"quitter@0.02", "quitter", "finisher@0.4", "random"} <= numbers.keys()
    quits = [numbers[name] for name in list_strengths("quitter")]
    assert set(run.book.draw(200, 0)) & {*quits} == {quits[0]}
    for beaten, number in enumerate(quits[:-1]):
        run.book.note([Meeting(number, 1.0, 1.0, 0)] * 20, frames=beaten, running=1)
        assert set(run.book.draw(200, beaten + 1)) & {*quits} == {quits[beaten + 1]}
        strength = run.book.report(beaten + 1)["curriculum/quitter"]
        assert strength == [*STRENGTHS, 1][beaten + 1]


def test_bots_have_one_order_in_every_process():
    """Sets of names have another in each: their numbers in the pool are saved with a run."""
    game = GAMES["deep_line_wars"]
    scenario = game.scenario("11x11")
    listed = [*game.bots]
    for names in ({*listed}, {"bots", *listed[:2]}):
        assert [bot.name for bot in make_bots(names, game, scenario)] == listed
    weak = {f"{listed[0]}@0.{digit}" for digit in range(9, 0, -1)}
    made = [bot.name for bot in make_bots({*weak, *listed[1:3]}, game, scenario)]
    assert made == [*listed[1:3], *sorted(weak)]


# --- outcomes --------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["duel", "ffa-4", "teams"])
def test_every_result_is_recorded_to_the_opponent_that_played(tmp_path, scenario):
    """Each opponent does one thing only, so that its actions identify it in the data."""
    run = make_run(tmp_path, scenario, {"idle": 1.0, "quitter": 1.0, "finisher": 1.0})
    names = {member.name: member.number for member in run.book.pool.members}
    says = {0: names["idle"], LEAVE: names["quitter"], FINISH: names["finisher"]}
    teams = run.spec.team_of_seat
    data = collect(run)
    played, scores = defaultdict(int), defaultdict(float)
    for game in runs.by_game(data):
        own = game["player", "learned"][0].numpy()
        first = game["player", "action"][0].numpy()
        paid = game["next", "player", "reward"][-1, :, 0].numpy()
        left = set(teams[~game["player", "done"][-1, :, 0].numpy()].tolist())
        winners = set(teams[paid >= 1.0].tolist())
        points = {team: float(team in winners) for team in range(teams.max() + 1)}
        if not winners:
            points = {team: (team in left) / len(left) for team in points}
        (mine,) = set(teams[own].tolist())
        for team in set(points) - {mine}:
            (action,) = set(first[teams == team].tolist())  # a team is one opponent
            played[says[action]] += 1
            scores[says[action]] += (1 + points[mine] - points[team]) / 2
    assert len(played) == 3
    for number, count in played.items():
        assert run.book.records.count(number) == count
        evidence = run.book.records.evidence(number, run.router.frames)
        fading = evidence.games / count
        assert 0.9 < fading <= 1.0
        assert evidence.points == pytest.approx(scores[number] * fading, rel=0.02)
    # An opponent that wins at once is never beaten, one that leaves is not lost to in a duel.
    rate = {name: run.book.records.estimate(n, run.router.frames) for name, n in names.items()}
    assert rate["finisher"] < rate["idle"] <= rate["quitter"] or scenario != "duel"


@pytest.mark.parametrize("scenario", ["ffa-4", "uneven", "duel"])
def test_opponents_are_drawn_for_each_rival_team_and_stay_for_the_game(tmp_path, scenario):
    mixture = {"idle": 1.0, "quitter": 1.0, "scorer": 1.0, "latest": 1.0}
    run = make_run(tmp_path, scenario, mixture)
    teams, seen = run.spec.team_of_seat, []
    router, forward = run.router, run.router.forward

    def note(tensordict):
        done = forward(tensordict)
        taken = router.taken
        seen.append((router._episode.copy(), taken.opponent.copy(), taken.team.copy()))
        return done

    router.forward = note
    collect(run, 4)
    several = 0
    for (episodes, opponents, own), (then, before, _) in zip(seen[1:], seen, strict=False):
        same = episodes == then
        assert (opponents[same] == before[same]).all()
        assert (opponents[own[:, None] == teams] == LATEST_ID).all()
        for team in range(teams.max() + 1):
            of_team = opponents[:, teams == team]
            assert (of_team == of_team[:, :1]).all()
        several += sum(len(set(row) - {LATEST_ID}) > 1 for row in opponents.tolist())
    assert (several > 0) == (scenario != "duel")


def test_rows_name_their_opponent_where_it_is_one():
    drawn = np.array([[5, 7, 7], [5, 7, 8], [0, 0, 0]], np.int16)
    assert find_met(drawn, np.array([0, 0, 1])).tolist() == [7, NO_OPPONENT, 0]
    assert find_met(np.array([[NO_OPPONENT]], np.int16), np.array([0])).tolist() == [NO_OPPONENT]


def test_teams_of_the_learner_are_no_rivals_and_games_with_demonstrations_do_not_count():
    taken = Decisions(
        actions=np.zeros((3, 3), np.int64),
        owned=np.array([[True, True, False]] * 3),
        shown=np.zeros((3, 3), np.bool_),
        assisted=np.array([[False] * 3, [True, False, False], [False] * 3]),
        out=np.zeros((3, 3), np.bool_),
        team=np.zeros(3, np.int64),
        opponent=np.array([[0, 0, 9]] * 3, np.int16),
    )
    ended = np.array([True, True, False])
    last = LastStep(np.zeros((3, 3), np.float32), ended, np.array([2, 2, 2], np.int8))
    found = find_meetings(taken, last, np.arange(3), np.arange(3))
    assert found == [Meeting(9, 0.0, 0.0, game=0)]


# --- the pool --------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_snapshot_is_of_the_averaged_weights_and_outlasts_further_updates(tmp_path):
    config = small(tmp_path / "run", "duel", {"latest": 0.5, "uniform": 0.5})
    train(config)
    run = TrainingRun(config, resume=True)
    members = run.book.pool.snapshots
    assert [member.frames for member in members] == [128, 256, 384, 512]
    for member in members:
        assert find_fingerprint(run.book.pool.agent(member.number), run.game) == member.fingerprint
    assert len({member.fingerprint for member in members}) == 4
    assert [member.number for member in members] == [FIRST + n for n in range(4)]
    assert members[-1].met
    run.close()


def test_a_learner_that_surely_beats_the_best_is_frozen_early(tmp_path):
    run = make_run(tmp_path, "duel", {"uniform": 1.0}, snapshot_every_frames=400)
    book = run.book
    run.add_snapshot()
    run.frames = 99
    book.note([Meeting(FIRST, 1.0, 1.0, 0)] * 200, 99, running=1)
    assert not book.beats_the_best(99)  # a snapshot of just now
    assert book.beats_the_best(100)
    book.note([Meeting(FIRST, 0.0, 0.0, 1)] * 120, 100, running=2)
    assert not book.beats_the_best(100)  # 62 % of 320 games: not surely above 60 %
    run.frames = 100
    run.add_snapshot()
    assert book.pool.best_snapshot().number == FIRST + 1
    assert not book.beats_the_best(10_000)  # no games against it yet
    run.close()


def test_without_a_margin_only_the_clock_freezes(tmp_path):
    run = make_run(tmp_path, "duel", {"uniform": 1.0}, snapshot_margin=None)
    run.add_snapshot()
    run.book.note([Meeting(FIRST, 1.0, 1.0, 0)] * 500, 10, running=1)
    assert not run.book.beats_the_best(10**6)
    run.close()


def test_the_line_up_is_drawn_again_with_time_and_with_each_snapshot(tmp_path):
    run = make_run(tmp_path, "duel", {"uniform": 1.0}, pool_active=2, redraw_every_frames=1_000)
    book = run.book
    assert set(book.draw(20, 0).tolist()) == {LATEST_ID}  # the pool is empty
    for frames in range(1, 9):
        run.frames = frames
        run.add_snapshot()
    first = set(book.draw(100, 8).tolist())
    assert len(first) == 2
    assert min(first) >= FIRST
    assert set(book.draw(100, 999).tolist()) == first
    met = set()
    for period in range(1, 40):
        met |= set(book.draw(10, 1_000 * period).tolist())
    assert met == {FIRST + number for number in range(8)}
    book.forget_unused(np.array([[FIRST]], np.int16))
    run.close()


class Quitter:
    """An agent of a user: leaves at once."""

    def act(self, observation, action_mask):
        return np.where(action_mask[:, LEAVE], LEAVE, 0)


def make_quitter(scenario, spec):
    return Quitter()


def test_agents_of_others_play_by_their_names(tmp_path):
    agents = {"mine": "users_module:make_quitter"}
    run = make_run(tmp_path, "ffa-3", {"mine": 1.0}, agents=agents)
    data = collect(run, 2)
    number = FIRST_NUMBERS[FOREIGN]
    assert (data["player", "opponent"] == number).all()
    theirs = ~data["player", "learned"] & ~data["player", "done"].squeeze(-1)
    assert (data["player", "action"][theirs] == LEAVE).all()
    row = run.statistics.report(run.book.name, run.spec.action_group_names)
    assert "collect_win_rate/mine" in row


class Cheater:
    """An agent of a user that plays an illegal action."""

    def act(self, observation, action_mask):
        return np.full(len(action_mask), 99)


def make_cheater(scenario, spec):
    return Cheater()


def test_an_agent_of_others_that_cannot_play_ends_the_run_with_its_reason(tmp_path):
    agents = {"mine": "users_module:make_cheater"}
    with pytest.raises(ForeignAgentError, match="^opponent mine played the illegal action 99"):
        make_run(tmp_path, "duel", {"mine": 1.0}, agents=agents)  # the collector calls it at once


@pytest.fixture
def agent(tmp_path):
    return runs.make_agent(small(tmp_path / "run", "duel", {"random": 1.0}))


def test_a_checkpoint_is_an_opponent_by_its_name(tmp_path, agent):
    agents = {"older": agent}
    again = make_run(tmp_path / "again", "duel", {"older": 1.0}, agents=agents)
    assert (collect(again, 2)["player", "opponent"] == FIRST_NUMBERS[FOREIGN]).all()
    assert again.book.pool.name(FIRST_NUMBERS[FOREIGN]) == "older"


def test_each_member_of_a_mixture_is_an_opponent_by_a_name_and_a_share_of_its_own(tmp_path, agent):
    save_mixture(tmp_path / "mix", [agent, IDLE], (1, 3))
    agents = {"mixed": str(tmp_path / "mix"), "mine": "users_module:make_quitter"}
    met = {"mixed": 4.0, "mine": 1.0, "random": 1.0}
    book = make_run(tmp_path / "again", "duel", met, agents=agents).book
    drawn = [book.pool.name(number) for number in book.draw(6_000, 1_000).tolist()]
    shares = {name: drawn.count(name) / 1_000 for name in set(drawn)}
    assert shares == pytest.approx(
        {"mixed_00": 1.0, "mixed_01": 3.0, "mine": 1.0, "random": 1.0}, abs=0.25
    )
    save_mixture(tmp_path / "single", [IDLE], (1,))
    alone = {"only": str(tmp_path / "single")}
    settings = make_run(tmp_path / "one", "duel", {"only": 1.0}, agents=alone).book.settings
    assert (settings.agents, settings.mixture) == ({"only_00": IDLE}, {"only_00": 1.0})
    taken = {"mixed": agents["mixed"], "mixed_01": "users_module:make_quitter"}
    with pytest.raises(ValueError, match="has 'mixed_01', as a member of mixed is called"):
        make_run(tmp_path / "taken", "duel", {"mixed": 1.0}, agents=taken)


@pytest.mark.slow
def test_a_run_with_every_sampler_resumes_bit_for_bit(tmp_path):
    names = ("pfsp", "pfsp_variance", "pfsp_easy", "delta_uniform", "recent", "nash", "pfsp_bots")
    opponent = OpponentSettings(
        dict.fromkeys(("latest", "mine", *names), 1.0),
        agents={"mine": "users_module:make_quitter"},
        snapshot_every_frames=128,
        redraw_every_frames=128,
        pool_capacity=3,
    )
    runs.train_whole_and_in_parts(
        tmp_path, lambda to: small(to, "ffa-4", frames=768, opponent=opponent), until=512
    )


@pytest.mark.slow
def test_snapshots_after_the_saved_state_are_written_again_the_same(tmp_path):
    """After a crash between them and the next state."""

    def make(name):
        return small(tmp_path / name, "duel", {"latest": 0.4, "pfsp": 0.6})

    train(make("run"), until_frames=256)
    run = TrainingRun(make("run"), resume=True)
    run.frames = 384
    with_noise = {name: value + 1 for name, value in run.learner.average.state_dict().items()}
    run.learner.average.load_state_dict(with_noise)
    run.add_snapshot()
    run.close()
    train(make("run"), resume=True)
    train(make("whole"))
    assert digest(tmp_path / "run") == digest(tmp_path / "whole")
