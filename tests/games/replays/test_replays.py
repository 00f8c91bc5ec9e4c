"""Recorded games are played again to the exact same states, whatever cuts the recording off."""

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from marl_cair.games import GAMES, make_engine
from marl_cair.games.replays import (
    ReplayError,
    ReplayWriter,
    count_games,
    hash_state,
    read_replay,
    read_replays,
    replay_steps,
    write_replay,
    writer,
)
from marl_cair.games.replays.reader import is_whole
from tests.games.cases import CASES, IN_PROCESS, Luck, choose_actions

MOST_STEPS = 40
QUICK = settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def start(engine, path, seed, **more):
    engine.reset(np.array([seed], np.uint64))
    names = [f"player {seat}" for seat in range(engine.num_players)]
    return ReplayWriter(path, engine, map_seeds=[seed], players=[names], **more)


def record(engine, path, seed, num_steps, luck_seed=0):
    """Play and record; the state after each number of steps, as bytes by name."""
    luck = Luck.draw(num_steps, 1, engine.num_players, luck_seed)
    with start(engine, path, seed) as recorder:
        states = [engine.state_dict()]
        for numbers in luck.numbers:
            actions = choose_actions(engine, numbers)
            engine.step(actions)
            recorder.add(actions)
            states.append(engine.state_dict())
    return states


def assert_same(states, replay):
    played = 0
    for engine, state in zip(replay_steps(replay), states, strict=False):
        for name, value in engine.state_dict().items():
            np.testing.assert_array_equal(value, state[name], name)
        played += 1
    assert played == len(replay.actions) + 1


@pytest.mark.parametrize("name", IN_PROCESS)
@QUICK
@given(
    seed=st.integers(0, 2**64 - 1),
    num_steps=st.integers(0, MOST_STEPS),
    luck_seed=st.integers(0, 99),
    hash_every=st.integers(1, MOST_STEPS),
    is_late=st.booleans(),
)
def test_any_recorded_game_is_played_again(
    tmp_path, name, seed, num_steps, luck_seed, hash_every, is_late
):
    engine = make_engine(name)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "HASH_EVERY_STEPS", hash_every)
        patch.setattr(writer, "FLUSH_SECONDS", 0.0 if is_late else 1.0)
        states = record(engine, tmp_path / "a.replay", seed, num_steps, luck_seed)
    replay = read_replay(tmp_path / "a.replay")
    assert (replay.game, replay.map_seed) == (name, seed)
    assert replay.rules_version == GAMES[name].version
    assert replay.scenario == engine.scenario
    assert replay.is_complete
    over = [bool(one["outcome.terminated"][0] | one["outcome.truncated"][0]) for one in states]
    length = over.index(True) if True in over else num_steps
    assert len(replay.actions) == length
    assert max(replay.hashes) == length
    assert_same(states, replay)


def test_each_scenario_and_action_space_is_played_again(case, tmp_path):
    states = record(case.engine(), tmp_path / "a.replay", 3, 12)
    assert_same(states, read_replay(tmp_path / "a.replay"))


@pytest.fixture(scope="module")
def short_game(tmp_path_factory):
    """A file with many records, and its states."""
    path = tmp_path_factory.mktemp("replays") / "a.replay"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "HASH_EVERY_STEPS", 4)
        patch.setattr(writer, "FLUSH_SECONDS", 0.0)
        states = record(make_engine("deep_maze", "7x7-full_deterministic"), path, 5, 12)
    return path, states


def test_a_file_torn_at_any_byte_is_read_up_to_the_tear(short_game, tmp_path):
    path, states = short_game
    content, whole = path.read_bytes(), read_replay(path)
    torn, lengths = tmp_path / "torn.replay", []
    head = content.index(b"\n") + 1
    for size in range(len(content)):
        torn.write_bytes(content[:size])
        if size < head:
            with pytest.raises(ReplayError, match=r"torn\.replay is no replay of marl_cair \("):
                read_replay(torn)
            continue
        replay = read_replay(torn)
        assert not replay.is_complete
        np.testing.assert_array_equal(replay.actions, whole.actions[: len(replay.actions)])
        lengths.append(len(replay.actions))
    assert sorted(set(lengths)) == list(range(13))
    assert lengths == sorted(lengths)
    assert_same(states, replay)
    torn.write_bytes(content[: size - 20] + bytes(100))  # as some disks leave it after a power cut
    assert not read_replay(torn).is_complete


def test_a_changed_byte_is_found(short_game, tmp_path):
    """Or the file ends there: a changed length may reach beyond its end."""
    path, _ = short_game
    content, whole = path.read_bytes(), read_replay(path)
    changed = tmp_path / "changed.replay"
    for place in range(content.index(b"\n") + 1, len(content)):
        changed.write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
        replay = read_or_refuse(changed, "a damaged replay, the record at byte")
        if replay is not None:
            assert not replay.is_complete
            np.testing.assert_array_equal(replay.actions, whole.actions[: len(replay.actions)])


def read_or_refuse(path, message):
    """The replay, or None where its error has this message."""
    with contextlib.suppress(ReplayError):
        return read_replay(path)
    with pytest.raises(ReplayError, match=message):
        read_replay(path)
    return None


PLAY_AND_DIE = """
import os, signal, sys, time
import numpy as np
from marl_cair.games import make_engine
from marl_cair.games.replays import ReplayWriter

engine = make_engine("deep_maze", "7x7-full_deterministic")
engine.reset(np.array([5], np.uint64))
writer = ReplayWriter(sys.argv[1], engine, map_seeds=[5], players=[["a"]])
for step in range(60):
    engine.step(np.zeros((1, 1), np.int32))
    writer.add(np.zeros((1, 1)))
    time.sleep(0.05)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="needs SIGKILL")
def test_a_killed_process_loses_the_last_second_at_most(tmp_path):
    path = tmp_path / "a.replay"
    done = subprocess.run([sys.executable, "-c", PLAY_AND_DIE, str(path)], check=False)
    assert done.returncode == -signal.SIGKILL
    replay = read_replay(path)
    assert not replay.is_complete
    assert 60 - 20 <= len(replay.actions) < 60
    assert sum(1 for _ in replay_steps(replay)) == len(replay.actions) + 1


def test_an_exception_leaves_the_steps_and_no_end(tmp_path):
    engine = make_engine("deep_maze")
    recorder = start(engine, tmp_path / "a.replay", 1)
    engine.step(np.zeros((1, 1), np.int32))
    with contextlib.suppress(KeyboardInterrupt), recorder:
        recorder.add(np.zeros((1, 1)))
        raise KeyboardInterrupt
    replay = read_replay(tmp_path / "a.replay")
    assert (len(replay.actions), replay.is_complete) == (1, False)


def test_a_game_has_a_few_kilobytes(tmp_path):
    engine = make_engine("deep_line_wars")
    record(engine, tmp_path / "a.replay", 3, 300)
    assert (tmp_path / "a.replay").stat().st_size < 3_000


def test_values_and_notes_are_kept(tmp_path):
    engine = make_engine("deep_line_wars")
    recorder = start(engine, tmp_path / "a.replay", 3, extras=[{"by": "test", "numbers": [1, 2]}])
    with recorder:
        for step in range(3):
            engine.step(np.zeros((1, 2), np.int32))
            values = {"q": np.full((1, 2, 5), step / 4), "chance": np.array([[np.nan, 1.0]])}
            recorder.add(np.zeros((1, 2)), values)
    replay = read_replay(tmp_path / "a.replay")
    assert {name: held.dtype for name, held in replay.values.items()} == {
        "q": np.float16,
        "chance": np.float16,
    }
    assert replay.values["q"][:, 1, 4].tolist() == [0.0, 0.25, 0.5]
    assert np.isnan(replay.values["chance"][:, 0]).all()
    assert replay.extra == {"by": "test", "numbers": [1, 2]}


@pytest.mark.parametrize("worlds", [None, [2], [0, 2]])
def test_a_file_holds_the_games_of_a_batch(tmp_path, worlds):
    engine = make_engine("deep_maze", "7x7-full_deterministic", num_worlds=3, max_ticks=9)
    seeds, chosen = np.array([7, 8, 9], np.uint64), worlds or [0, 1, 2]
    engine.reset(seeds)
    path, ended = tmp_path / "a.replay", {}
    players = [[f"player {world}"] for world in chosen]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "FLUSH_SECONDS", 0.0)
        with ReplayWriter(
            path, engine, map_seeds=seeds[chosen].tolist(), players=players, worlds=worlds
        ) as recorder:
            for step, numbers in enumerate(Luck.draw(12, 3, 1).numbers):
                actions = choose_actions(engine, numbers)
                engine.step(actions)
                for world in np.flatnonzero(engine.terminated | engine.truncated):
                    ended.setdefault(world, (step + 1, hash_state(engine, world)))
                recorder.add(actions[chosen])
    assert count_games(path) == len(chosen)
    assert is_whole(path)
    replays = read_replays(path)
    for game, world in enumerate(chosen):
        steps, state = ended[world]
        for replay in (replays[game], read_replay(f"{path}#{game}")):
            assert replay.players == (f"player {world}",)
            assert replay.map_seed == seeds[world]
            assert len(replay.actions) == steps
            assert replay.is_complete
            *_, last = replay_steps(replay)
            assert hash_state(last) == state
    with pytest.raises(ValueError, match=rf"has no game {len(chosen)}, only 0\.\."):
        read_replay(f"{path}#{len(chosen)}")
    if len(chosen) > 1:
        with pytest.raises(ValueError, match=rf"holds {len(chosen)} games: name one, .*#0"):
            read_replay(path)


def test_a_file_of_several_games_is_read_up_to_a_tear(tmp_path):
    """A game is whole, or cut off: its steps and its state are its own."""
    engine = make_engine("deep_maze", "7x7-full_deterministic", num_worlds=3, max_ticks=5)
    seeds = np.array([7, 8, 9], np.uint64)
    engine.reset(seeds)
    path, torn = tmp_path / "a.replay", tmp_path / "torn.replay"
    with ReplayWriter(path, engine, map_seeds=seeds.tolist(), players=[["a"]] * 3) as recorder:
        for step, numbers in enumerate(Luck.draw(5, 3, 1).numbers):
            actions = choose_actions(engine, numbers)
            engine.step(actions)
            recorder.add(actions, winners={1: 0} if step == 2 else None)  # forfeited
            if step % 2:
                recorder.flush()
    content, whole = path.read_bytes(), read_replays(path)
    assert [len(one.actions) for one in whole] == [5, 3, 5]
    assert whole[1].winner == 0
    for size in range(content.index(b"\n") + 1, len(content)):
        torn.write_bytes(content[:size])
        found = read_replays(torn)
        assert is_whole(torn) == all(one.is_complete for one in found)
        for replay, other in zip(found, whole, strict=True):
            if replay.is_complete:
                np.testing.assert_array_equal(replay.actions, other.actions)
            elif len(replay.actions) <= len(other.actions):
                cut = other.actions[: len(replay.actions)]
                np.testing.assert_array_equal(replay.actions, cut)
            else:
                raise AssertionError("a game has steps after its end")
            for _ in replay_steps(replay):
                pass
    assert not is_whole(torn)


def test_values_of_several_games_are_kept(tmp_path):
    engine = make_engine("deep_maze", num_worlds=2)
    engine.reset(np.array([7, 8], np.uint64))
    path = tmp_path / "a.replay"
    with ReplayWriter(path, engine, map_seeds=[7, 8], players=[["a"], ["b"]]) as recorder:
        for step in range(3):
            engine.step(np.zeros((2, 1), np.int32))
            recorder.add(np.zeros((2, 1)), {"q": np.array([[step], [step + 0.5]])})
    assert read_replay(f"{path}#1").values["q"].tolist() == [[0.5], [1.5], [2.5]]


def test_a_winner_that_the_rules_do_not_name_is_kept(tmp_path):
    for winner in (None, 1):
        recorder = start(make_engine("deep_line_wars"), tmp_path / "a.replay", 3)
        recorder.close(winner)
        recorder.close()
        assert read_replay(tmp_path / "a.replay").winner == winner


def test_a_replay_is_written_again_with_hashes(tmp_path):
    record(make_engine("deep_line_wars"), tmp_path / "a.replay", 3, 30)
    first = read_replay(tmp_path / "a.replay")
    write_replay(tmp_path / "b.replay", dataclasses.replace(first, hashes={}, winner=1))
    second = read_replay(tmp_path / "b.replay")
    assert second.hashes == first.hashes
    assert second.winner == 1
    ended = dataclasses.replace(first, hashes={}, winner=1, actions=first.actions[:1])
    write_replay(tmp_path / "c.replay", ended)
    assert read_replay(tmp_path / "c.replay").winner == 1
    np.testing.assert_array_equal(second.actions, first.actions)


@pytest.mark.parametrize(
    ("actions", "values", "message"),
    [
        (np.zeros((1, 3)), None, r"actions have shape \(1, 3\), the games' are \(1, 2\)"),
        (np.zeros((1, 2)), {"q": np.zeros((1, 3))}, r"values of 'q' have shape \(1, 3\), it must"),
    ],
)
def test_steps_of_another_shape_are_refused(tmp_path, actions, values, message):
    recorder = start(make_engine("deep_line_wars"), tmp_path / "a.replay", 3)
    with pytest.raises(ValueError, match=message), recorder:
        recorder.add(actions, values)


def test_values_must_stay_the_same(tmp_path):
    recorder = start(make_engine("deep_line_wars"), tmp_path / "a.replay", 3)
    recorder.add(np.zeros((1, 2)), {"q": np.zeros((1, 2))})
    message = "values have the names and shapes .* at the first step"
    with pytest.raises(ValueError, match=message), recorder:
        recorder.add(np.zeros((1, 2)))


def test_each_seat_has_a_name(tmp_path):
    engine = make_engine("deep_line_wars")
    engine.reset(3)
    with pytest.raises(ValueError, match=r"players are \['a'\], the game has 2 seats"):
        ReplayWriter(tmp_path / "a.replay", engine, map_seeds=[3], players=[["a"]])
    with pytest.raises(ValueError, match="2 map seeds, 1 rows of players and 1 extras for 1 games"):
        ReplayWriter(tmp_path / "a.replay", engine, map_seeds=[3, 4], players=[["a", "b"]])
    assert list(tmp_path.iterdir()) == []


def test_cases_are_those_of_all_games():
    assert {case.values[0].game for case in CASES} == set(IN_PROCESS)
