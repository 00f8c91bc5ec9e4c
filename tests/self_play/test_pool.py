"""The pool on disk: snapshots do not change, crashes lose nothing, and which snapshots retire."""

import dataclasses
import shutil

import numpy as np
import pytest
import torch

from marl_cair.checkpoint import AgentDescription, CheckpointError
from marl_cair.files import replaced_folder
from marl_cair.league.agents.load import find_fingerprint, load_agent
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.self_play import pool as pool_module
from marl_cair.self_play.pool import BOT, FOREIGN, Pool, choose_retired
from marl_cair.self_play.shared_folder import MAIN, MAIN_EXPLOITER, LeagueSeat
from marl_cair.self_play.win_rates import Evidence
from tests.games import last_standing
from tests.games.last_standing import GAME, SCORE, Bot

SCENARIO = GAME.scenario("duel")
SPEC = GAME.make_spec(SCENARIO)
SHAPE = SPEC.representations["vector"].shape


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    last_standing.register(monkeypatch)


def make_network(seed=0):
    config = QNetworkConfig(body="mlp", hidden_width=4)
    return make_q_network(config, SHAPE, SPEC.num_actions, seed=seed)


def about(network, frames):
    return AgentDescription(
        name=f"a@{frames}",
        game=GAME.name,
        game_version=GAME.version,
        scenario="duel",
        scenario_options={},
        representation="vector",
        observation_shape=SHAPE,
        action_names=SPEC.action_names,
        network=network.config.to_dict(),
        frames=frames,
        updates=0,
        seed=0,
    )


def make_pool(tmp_path, capacity=3):
    return Pool(tmp_path / "snapshots", GAME, SCENARIO, "vector", capacity)


def restored(tmp_path, state, capacity=3):
    pool = make_pool(tmp_path, capacity)
    pool.load_state_dict(state)
    return pool


def freeze(pool, frames, met=None, seed=0):
    network = make_network(seed)
    return pool.add_snapshot(network, about(network, frames), met or {})


def frames_of(pool):
    return [member.frames for member in pool.snapshots]


# --- frozen ----------------------------------------------------------------------------------


def test_a_snapshot_does_not_change_while_the_learner_trains(tmp_path):
    pool, network = make_pool(tmp_path), make_network()
    member = pool.add_snapshot(network, about(network, 10), {})
    agent = pool.agent(member.number)
    optimizer = torch.optim.Adam(network.parameters(), lr=0.01)
    for step in range(1_000):
        optimizer.zero_grad()
        network(torch.full((2, *SHAPE), float(step % 3))).square().mean().backward()
        optimizer.step()
    assert find_fingerprint(agent, GAME) == member.fingerprint
    pool.release([])
    again = pool.agent(member.number)
    assert again is not agent
    assert find_fingerprint(again, GAME) == member.fingerprint
    assert not any(parameter.requires_grad for parameter in again.network.parameters())
    learner = load_agent(tmp_path / "snapshots" / member.name)
    learner.network.load_state_dict(network.state_dict())
    assert find_fingerprint(learner, GAME) != member.fingerprint


def test_a_network_that_is_not_the_frozen_one_is_refused(tmp_path):
    pool = make_pool(tmp_path)
    first, second = freeze(pool, 10, seed=1), freeze(pool, 20, seed=2)
    pool.release([])
    folder = tmp_path / "snapshots"
    shutil.copy(folder / second.name / "weights.pt", folder / first.name / "weights.pt")
    (folder / first.name / "manifest.json").unlink()
    with pytest.raises(CheckpointError, match="is not the network that was frozen"):
        pool.agent(first.number)
    pool.agent(second.number)


# --- crashes ---------------------------------------------------------------------------------


class Crash(BaseException):
    """Not caught by any handler, as in a killed process."""


@pytest.mark.parametrize("moment", ["save_agent", "find_fingerprint"])
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("capacity", [1, 3])
def test_a_crash_at_any_moment_leaves_the_pool_of_the_saved_state(
    tmp_path, monkeypatch, moment, when, capacity
):
    pool = make_pool(tmp_path, capacity)
    freeze(pool, 10, seed=1)
    state = pool.state_dict()
    original = getattr(pool_module, moment)

    def crash(*args):
        if when == "after":
            original(*args)
        raise Crash

    with monkeypatch.context() as patched:
        patched.setattr(pool_module, moment, crash)
        with pytest.raises(Crash):
            freeze(pool, 20, {1_000: Evidence(1.0, 2.0)}, seed=2)
    pool = restored(tmp_path, state, capacity)
    assert frames_of(pool) == [10]
    pool.agent(1_000)
    freeze(pool, 20, {1_000: Evidence(1.0, 2.0)}, seed=2)
    again = restored(tmp_path, pool.state_dict(), capacity)
    assert frames_of(again) == ([20] if capacity == 1 else [10, 20])
    assert again.snapshots == pool.snapshots
    again.agent(1_001)


def test_a_crash_while_a_snapshot_is_written_again_keeps_the_old_one(tmp_path):
    pool = make_pool(tmp_path)
    member = freeze(pool, 10)
    folder = tmp_path / "snapshots" / member.name
    # Killed between the two renames.
    folder.rename(folder.with_name(f".{folder.name}.marl_cair.old"))
    pool = restored(tmp_path, pool.state_dict())
    assert find_fingerprint(pool.agent(member.number), GAME) == member.fingerprint
    with replaced_folder(folder):
        pass


def test_an_earlier_state_restores_the_pool(tmp_path):
    """Later snapshots leave the pool and retired ones return; nothing on disk is deleted."""
    pool = make_pool(tmp_path, capacity=3)
    for frames in (10, 20, 30):
        freeze(pool, frames, seed=frames)
    before = pool.state_dict()
    freeze(pool, 40)
    assert frames_of(pool) == [10, 30, 40]
    pool.load_state_dict(before)
    assert frames_of(pool) == [10, 20, 30]
    pool.agent(1_001)
    assert freeze(pool, 40).number == 1_003


# --- retiring --------------------------------------------------------------------------------


def test_the_snapshot_with_the_smallest_gap_retires_and_can_finish_its_games(tmp_path):
    pool = make_pool(tmp_path)
    for frames in (10, 20, 30, 40):
        freeze(pool, frames)
    assert frames_of(pool) == [10, 30, 40]
    assert pool.name(1_001) == "frames_0000000020"
    pool.agent(1_001)
    assert (tmp_path / "snapshots" / "frames_0000000020" / "agent.json").is_file()


def test_the_pool_covers_the_whole_run_evenly():
    """No gap is more than 2.5 times what equal gaps would be, however long the run."""
    kept = []
    for number in range(1, 400):
        kept.append(50_000 * number + number % 3)
        if len(kept) > 8:
            kept.pop(choose_retired(kept))
            assert (kept[0], kept[-1]) == (50_001, 50_000 * number + number % 3)
            assert max(np.diff(kept)) <= 2.5 * (kept[-1] - kept[0]) / 7


def test_snapshots_of_the_nash_mixture_stay(tmp_path):
    """Rock, paper and scissors close in time, and a later copy of scissors."""
    pool = make_pool(tmp_path, capacity=4)
    won, lost = Evidence(500.0, 500.0), Evidence(0.0, 500.0)
    freeze(pool, 100)
    freeze(pool, 200, {1_000: lost})  # loses to all
    freeze(pool, 201, {1_000: lost, 1_001: won})
    freeze(pool, 202, {1_000: won, 1_001: won, 1_002: lost})
    freeze(pool, 900, {1_000: lost, 1_001: won, 1_002: lost, 1_003: lost})
    assert [member.number for member in pool.snapshots] == [1_000, 1_002, 1_003, 1_004]
    assert choose_retired([100, 200, 201, 202, 900]) == 2
    assert choose_retired([100, 200, 201, 202, 900], [1, 2]) == 3
    assert choose_retired([100, 200, 300], [0, 1, 2]) == 1
    assert choose_retired([100, 200]) == choose_retired([100]) == 0


def test_payoffs_are_the_results_of_the_learner(tmp_path):
    pool = make_pool(tmp_path)
    bot = pool.add(BOT, Bot("scorer", SCORE), 0)
    first = freeze(pool, 10, {bot: Evidence(3.0, 4.0)}).number
    second = freeze(pool, 20, {bot: Evidence(0.0, 8.0), first: Evidence(18.0, 18.0)}).number
    assert pool.payoff([bot, first, second]) == pytest.approx(
        np.array([[0.5, 1 / 3, 0.9], [2 / 3, 0.5, 0.05], [0.1, 0.95, 0.5]])
    )
    assert pool.best_snapshot().number == second
    with pytest.raises(ValueError, match=r"no member 77, only \[1, 1000, 1001\]"):
        pool.payoff([77])


def test_bots_and_foreign_agents_stay_and_have_names_of_their_own(tmp_path):
    pool = make_pool(tmp_path, capacity=1)
    pool.add(BOT, Bot("scorer", SCORE), 0)
    pool.add(FOREIGN, Bot("mine", SCORE), 0)
    for frames in (10, 20, 30):
        freeze(pool, frames)
    assert [member.name for member in pool.members] == ["scorer", "mine", "frames_0000000030"]
    with pytest.raises(ValueError, match="has a member 'mine' already"):
        pool.add(FOREIGN, Bot("mine", SCORE), 0)
    with pytest.raises(ValueError, match="capacity is 0, it must be 1 or more"):
        make_pool(tmp_path, capacity=0)


# --- leagues ---------------------------------------------------------------------------------


def make_seat(tmp_path, owner, role=MAIN, generation=0):
    return LeagueSeat(tmp_path / "shared", owner, role, generation, mains=("main_0",))


def make_member_pool(tmp_path, seat, capacity=9):
    return Pool(tmp_path / seat.owner, GAME, SCENARIO, "vector", capacity, seat=seat)


def test_players_of_other_learners_are_adopted_once_and_played_from_the_shared_folder(tmp_path):
    main = make_seat(tmp_path, "main_0")
    theirs = make_member_pool(tmp_path, main)
    first = freeze(theirs, 10, seed=1)
    freeze(theirs, 20, {first.number: Evidence(6.0, 8.0)}, seed=2)
    seat = make_seat(tmp_path, "main_exploiter_0", MAIN_EXPLOITER)
    pool = make_member_pool(tmp_path, seat)
    assert [pool.adopt(player) for player in seat.find_new_players()] == [True, True]
    assert [pool.adopt(player) for player in seat.find_new_players()] == [False, False]
    names = [kept.name for kept in pool.snapshots]
    assert names == ["main_0-000-0000000010", "main_0-000-0000000020"]
    assert {kept.role for kept in pool.snapshots} == {MAIN}
    older, newer = (kept.number for kept in pool.snapshots)
    assert pool.payoff([newer, older])[0, 1] == (6.0 + 1.0) / (8.0 + 2.0)
    for kept in pool.snapshots:
        assert find_fingerprint(pool.agent(kept.number), GAME) == kept.fingerprint
    assert main.find_new_players() == []
    again = make_seat(tmp_path, "main_0", generation=1)
    assert len(again.find_new_players()) == 2


def test_frames_of_generations_of_a_learner_add_up(tmp_path):
    """A later generation is younger than the newest player of an earlier one."""
    for generation, before in ((0, 0), (1, 40)):
        other = make_seat(tmp_path, "main_exploiter_0", MAIN_EXPLOITER, generation=generation)
        other = dataclasses.replace(other, frames_before=before)
        theirs = make_member_pool(tmp_path, other)
        for frames in (10, 30):
            freeze(theirs, frames, seed=before + frames)
    freeze(make_member_pool(tmp_path, make_seat(tmp_path, "main_0")), 45)
    seat = make_seat(tmp_path, "main_0", generation=1)
    pool = make_member_pool(tmp_path, seat)
    for player in seat.find_new_players():
        pool.adopt(player)
    assert [(kept.owner, kept.frames) for kept in pool.snapshots] == [
        ("main_exploiter_0", 10),
        ("main_exploiter_0", 30),
        ("main_0", 45),
        ("main_exploiter_0", 50),
        ("main_exploiter_0", 70),
    ]


def test_a_player_of_the_learner_with_most_players_retires(tmp_path):
    for owner, count in (("main_0", 4), ("league_exploiter_0", 1)):
        other = make_member_pool(tmp_path, make_seat(tmp_path, owner))
        for number in range(count):
            freeze(other, 10 * (number + 1), seed=number)
    seat = make_seat(tmp_path, "main_exploiter_0", MAIN_EXPLOITER)
    pool = make_member_pool(tmp_path, seat, capacity=4)
    for player in seat.find_new_players():
        pool.adopt(player)
    assert [kept.owner for kept in pool.snapshots].count("main_0") == 3
    assert {kept.owner for kept in pool.snapshots} == {"main_0", "league_exploiter_0"}


def test_a_damaged_player_is_refused(tmp_path):
    seat = make_seat(tmp_path, "main_0")
    freeze(make_member_pool(tmp_path, seat), 10)
    path = tmp_path / "shared" / "players" / "main_0-000-0000000010" / "player.json"
    path.write_text("{}", "utf-8")
    with pytest.raises(CheckpointError, match="cannot be read as a player of a league"):
        make_seat(tmp_path, "main_1").find_new_players()
