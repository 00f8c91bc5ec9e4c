"""Files that are no replays, of other rules or games, or edited: each has its message."""

import dataclasses
import json
import zlib

import numpy as np
import pytest

from marl_cair import memory
from marl_cair.games import make_engine
from marl_cair.games.replays import (
    ReplayError,
    ReplayWriter,
    layout,
    read_replay,
    reader,
    replay_steps,
)
from marl_cair.memory import NotEnoughMemoryError
from marl_cair.stored import MAX_BYTES, REPLAY, DamagedFileError


@pytest.fixture
def path(tmp_path):
    """Of a game of two steps."""
    engine = make_engine("deep_line_wars")
    engine.reset(3)
    place = tmp_path / "a.replay"
    with ReplayWriter(place, engine, map_seeds=[3], players=[["a", "b"]]) as recorder:
        for _ in range(2):
            engine.step(np.zeros((1, 2), np.int32))
            recorder.add(np.zeros((1, 2)))
    return place


def change_head(path, **changes):
    """Change entries of the head, or of its only game."""
    line, mark, body = path.read_bytes().partition(b"\n")
    head = json.loads(line)
    for name, value in changes.items():
        (head["games"][0] if name in head["games"][0] else head)[name] = value
    path.write_bytes(json.dumps(head).encode() + mark + body)


def replace_records(path, *records):
    line, mark, _ = path.read_bytes().partition(b"\n")
    path.write_bytes(line + mark + b"".join(layout.pack_record(*one) for one in records))


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x89PNG\r\n\x1a\n",
        b"PK\x03\x04",
        b"{}\n",
        b"[1]\n",
        b"null\n",
        b"[" * 90_000,
        b"\0" * 9,
    ],
)
def test_foreign_files_are_refused(tmp_path, content):
    place = tmp_path / "a.replay"
    place.write_bytes(content)
    with pytest.raises(ReplayError, match=r"a\.replay is no replay of marl_cair \(.*--record"):
        read_replay(place)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "pickle"}, "its format is 'pickle'"),
        ({"format_version": 9}, "its format has version 9, this program reads 2"),
        ({"games": []}, "it has no games"),
        ({"games": [1]}, "TypeError"),
        ({"players": "ab"}, "players is 'ab'"),
        ({"map_seed": -1}, "map_seed is wrong"),
        ({"map_seed": 2**64}, "map_seed is wrong"),
        ({"map_seed": "3"}, "map_seed is '3'"),
        ({"scenario": []}, r"scenario is \[\]"),
        ({"players": ["a"]}, "damaged replay, it names 1 players, not 2"),
        ({"game": "chess"}, "unknown game 'chess'.* Install the package that adds this game"),
        ({"scenario": {"rows": "many"}}, "rows"),
    ],
)
def test_heads_that_no_writer_writes_are_refused(path, changes, message):
    change_head(path, **changes)
    with pytest.raises(ValueError, match=message):
        read_replay(path)


def test_a_replay_of_other_rules_is_refused_with_both_versions(path):
    version = read_replay(path).rules_version
    change_head(path, rules_version="0.1")
    with pytest.raises(
        ReplayError,
        match=rf"played by version 0\.1 of the rules of deep_line_wars, this is version {version}",
    ):
        read_replay(path)


def deflate(content):
    """Of one step, as a payload."""
    return layout.COUNTED.pack(1) + zlib.compress(content)


HASH_AT_0 = layout.HASH, layout.HASHED.pack(0, 0, bytes(8))
END_AT_0 = layout.END, layout.ENDED.pack(0, 0, -1)


@pytest.mark.parametrize(
    ("records", "message"),
    [
        ([(b"x", b"")], "a record of the kind b'x'"),
        ([(layout.STEPS, b"\1\0\0\0no stream")], "error: Error -3"),
        ([(layout.STEPS, b"")], "unpack_from requires"),
        ([(layout.STEPS, deflate(bytes(3)))], "its last step is not whole"),
        ([(layout.STEPS, deflate(bytes(4)))], "it has 2 steps in place of those that it counts"),
        ([(layout.STEPS, deflate(b"\xff" * 2))], r"an action is \d+ of \d+"),
        ([(layout.HASH, b"short")], "unpack requires"),
        ([(layout.HASH, layout.HASHED.pack(1, 0, bytes(8)))], "a record is of game 1"),
        ([(layout.END, b"short")], "unpack requires"),
        ([(layout.END, layout.ENDED.pack(1, 0, 0))], "a record is of game 1"),
        ([(layout.END, layout.ENDED.pack(0, 0, 2))], "its winner is 2"),
        ([(layout.END, layout.ENDED.pack(0, 0, -2))], "its winner is -2"),
        ([(layout.END, layout.ENDED.pack(0, 1, 0))], "game 0 ends after 1 steps without a hash"),
        ([HASH_AT_0, END_AT_0, END_AT_0], "a record is of game 0"),
        ([(layout.VALUES, b"[]")], "AttributeError"),
        ([(layout.VALUES, b'{"q": [-1]}')], ""),
        ([(layout.VALUES, b'{"q": [9999999999]}')], ""),
    ],
)
def test_records_that_no_writer_writes_are_refused(path, records, message):
    replace_records(path, *records)
    with pytest.raises(ReplayError, match=rf"a\.replay is a damaged replay, .*{message}"):
        read_replay(path)


def test_a_stream_that_expands_beyond_the_limit_is_refused(path, monkeypatch):
    monkeypatch.setattr(reader, "MAX_GAME_BYTES", 1 << 20)
    replace_records(path, (layout.STEPS, deflate(bytes(3 << 20))))
    with pytest.raises(ReplayError, match="a game has more than 1 MiB of steps"):
        read_replay(path)


def test_games_beyond_the_memory_are_refused(path, monkeypatch):
    monkeypatch.setattr(reader, "MAX_GAME_BYTES", 10)  # smaller games are not compared
    monkeypatch.setattr(memory, "total_memory", lambda: 19)
    with pytest.raises(NotEnoughMemoryError, match=r"the games of .*a\.replay needs? \d+ bytes"):
        read_replay(path)


def test_a_file_larger_than_any_game_is_not_read(path, monkeypatch):
    monkeypatch.setitem(MAX_BYTES, REPLAY, 100)
    with pytest.raises(DamagedFileError, match="a replay file has at most 100"):
        read_replay(path)


def test_a_game_that_differs_is_found_at_its_step(path):
    replay = read_replay(path)
    other = dataclasses.replace(replay, hashes={**replay.hashes, 2: b"another!"})
    with pytest.raises(ReplayError, match="game differs from the recorded one at step 2"):
        list(replay_steps(other))
    with pytest.raises(ReplayError, match="at step 2"):
        list(replay_steps(dataclasses.replace(replay, map_seed=4)))


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="none.replay"):
        read_replay(tmp_path / "none.replay")
