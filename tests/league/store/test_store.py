"""The league file: whole blocks or none, refused if unfit."""

import contextlib
import dataclasses
import json
import os
import sqlite3

import pytest

from marl_cair.league.store.export import QUERIES, export_league
from marl_cair.league.store.schema import SCHEMA_VERSION, AgentRecord, PlayedGame
from marl_cair.league.store.store import LeagueStore, LeagueStoreError

SETTINGS = {
    "game": "line_wars",
    "game_version": "1",
    "scenario": {"size": [3, 4]},
    "seed": 5,
    "seating": "all",
    "team_of_seat": [0, 1],
}


def agent(name):
    return AgentRecord(f"print of {name}", name, "bot", "scripted", "1", "{}")


def played(block, number, points=(1.0, 0.0), **changes):
    game = PlayedGame(
        block=block,
        number=number,
        map_seed=2**64 - 1 - block,
        entries=(number, 1 - number),
        points=points,
        ranks=tuple(2.0 - point for point in points),
        winner=points.index(1.0) if 1.0 in points else -1,
        is_truncated=False,
        decisions=7,
        trajectory=f"{block} {number}",
        forfeited=(False, False),
        reason="",
    )
    return dataclasses.replace(game, **changes)


def execute(path, *statements):
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        return [database.execute(statement).fetchall() for statement in statements]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "league.sqlite"


@pytest.fixture
def store(path):
    opened = LeagueStore(path, SETTINGS)
    yield opened
    opened.close()


def add(store, names=("b", "a"), games=((0, 0), (0, 1))):
    ids = [store.add_agent(agent(name)) for name in names]
    store.add_games(ids, [played(*game) for game in games])
    return ids


def test_what_is_stored_comes_back(store):
    ids = add(store)
    games = store.read_games()
    assert games.agents.tolist() == [ids, ids[::-1]]
    assert games.points.tolist() == [[1.0, 0.0]] * 2
    assert games.ranks.tolist() == [[1.0, 2.0]] * 2
    assert (games.numbers.tolist(), games.blocks.tolist()) == ([0, 0], [0, 0])
    assert games.reasons == ("", "")
    assert store.read_blocks() == {tuple(ids): {0}}


def test_notes_are_kept_once_and_do_not_refuse_the_file(store, path):
    for text in ("league a b", "league a b", "league add c"):
        store.note("commands", text)
    assert store.settings["commands"] == ["league a b", "league add c"]
    again = LeagueStore(path, SETTINGS)
    again.close()
    assert again.settings["commands"] == ["league a b", "league add c"]


def test_a_block_is_stored_once(store):
    ids = add(store)
    store.add_games(ids, [played(0, 0, (0.0, 1.0)), played(1, 0), played(1, 1)])
    assert store.read_games().points[0].tolist() == [1.0, 0.0]
    assert store.read_games().numbers.tolist() == [0, 0, 1, 1]


def test_a_chunk_that_fails_half_way_leaves_nothing(store):
    ids = add(store)
    with pytest.raises(LeagueStoreError, match="is no league file, or is damaged"):
        store.add_games(ids, [played(1, 0), played(1, 0)])
    assert store.read_blocks() == {tuple(ids): {0}}
    assert len(store.read_games().agents) == 2


def test_the_order_of_games_does_not_depend_on_when_they_were_stored(tmp_path):
    read = []
    for number, (names, blocks) in enumerate(((("a", "b"), (0, 1)), (("b", "a"), (1, 0)))):
        store = LeagueStore(tmp_path / f"{number}.sqlite", SETTINGS)
        ids = {name: store.add_agent(agent(name)) for name in names}
        for block in blocks:
            store.add_games([ids["a"], ids["b"]], [played(block, 0), played(block, 1)])
        games = store.read_games()
        read.append((games.trajectories, (games.agents == ids["a"]).tolist()))
        store.close()
    assert read[0] == read[1]


def test_games_that_are_always_the_same_in_the_same_seats_are_repeats(store):
    ids = add(store, games=())
    same = [played(block, n, trajectory="t") for block in (0, 1) for n in (0, 1)]
    store.add_games(ids, same)
    assert store.read_games().is_repeat.tolist() == [False, False, True, True]
    store.add_games(ids, [played(2, 0, trajectory="t"), played(2, 1, trajectory="other")])
    assert not store.read_games().is_repeat.any()


def test_equal_forfeits_are_no_repeats(store):
    ids = add(store, games=())
    lost = {"forfeited": (False, True), "reason": "b crashed", "trajectory": "t"}
    store.add_games(ids, [played(block, n, **lost) for block in (0, 1) for n in (0, 1)])
    assert not store.read_games().is_repeat.any()


def test_forfeits_are_kept_with_their_reason(store):
    ids = add(store, games=())
    lost = {"forfeited": (False, True), "reason": "b crashed in act: KeyError: 3"}
    store.add_games(ids, [played(0, 0, **lost), played(0, 1)])
    games = store.read_games()
    assert games.reasons == ("b crashed in act: KeyError: 3", "")
    assert games.has_forfeited.tolist() == [[False, True], [False, False]]


def test_a_rating_run_is_kept_once(store):
    first, second = add(store)
    rows = [
        (first, 10.0, 0.0, 20.0, "", 0, 0.9, 2, 1.0),
        (second, 0.0, -9.0, 9.0, "", 0, 0.1, 2, 0),
    ]
    for _ in range(2):
        store.add_ratings({"prior": 3}, "abc", 2, rows)
    _, held = store.read_rows(QUERIES["ratings"])
    assert [row[5] for row in held] == ["b", "a"]


def test_a_league_of_other_settings_is_refused(store, path):
    store.close()
    for key, value in (("game_version", "2"), ("seed", 6), ("seating", "ring")):
        with pytest.raises(LeagueStoreError, match=f"a league with {key} = .*cannot be mixed"):
            LeagueStore(path, {**SETTINGS, key: value})
    LeagueStore(path).close()


@pytest.mark.parametrize("version", [3, 9])
def test_a_file_of_another_version_is_refused(store, path, version):
    store.close()
    execute(path, f"UPDATE meta SET value = '{version}' WHERE key = 'schema_version'")  # noqa: S608
    message = f"has schema version {version}, this marl_cair reads version {SCHEMA_VERSION}: take"
    with pytest.raises(LeagueStoreError, match=message):
        LeagueStore(path, SETTINGS)


def test_a_damaged_file_is_refused(store, path):
    ids = add(store)
    store.add_games(ids, [played(block, n) for block in range(1, 400) for n in (0, 1)])
    store.close()
    content = bytearray(path.read_bytes())
    assert len(content) > 40_000
    content[8_192:30_000] = bytes(30_000 - 8_192)
    path.write_bytes(content)
    with pytest.raises(LeagueStoreError, match="is no league file, or is damaged"):
        LeagueStore(path, SETTINGS)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        ("UPDATE meta SET value = '{seven' WHERE key = 'seed'", "JSONDecodeError: Expecting pro"),
        ("DELETE FROM meta WHERE key = 'team_of_seat'", "its team_of_seat is null, it must be of"),
        ("UPDATE meta SET value = '\"5\"' WHERE key = 'seed'", 'its seed is "5", it must be of t'),
        ("DELETE FROM team WHERE game = 2 AND team = 0", "game 2 has the teams .1., it must have"),
        ("DELETE FROM team WHERE game = 1", "game 1 has the teams .., it must have .0, 1."),
        ("UPDATE team SET team = 2 WHERE team = 1", "game 1 has the teams .0, 2., it must have"),
        ("UPDATE team SET agent = 9 WHERE team = 1", "games of agents .9., which are not there"),
        ("UPDATE team SET points = 'all'", "ValueError: could not convert string to float"),
        ("UPDATE block SET line_up = 'a b'", "ValueError: invalid literal for int"),
        ("UPDATE block SET line_up = '7 8'", "KeyError: 7"),
        ("UPDATE block SET map_seed = '-1'", "OverflowError: "),
        ("UPDATE agent SET configuration = 'none'", "JSONDecodeError: Expecting value"),
    ],
)
def test_a_file_with_inconsistent_contents_is_refused(store, path, damage, reason):
    add(store)
    store.close()
    execute(path, damage)
    message = rf"league.sqlite is no league file, or is damaged \({reason}.*\): give another folder"
    with (
        pytest.raises(LeagueStoreError, match=message),
        contextlib.closing(LeagueStore(path)) as again,
    ):
        again.read_games()


def test_tables_of_something_else_are_refused(path):
    execute(path, "CREATE TABLE notes (text)")
    with pytest.raises(LeagueStoreError, match="holds tables of something else .notes"):
        LeagueStore(path, SETTINGS)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(LeagueStoreError, match="is not there: give the folder of a league"):
        LeagueStore(tmp_path / "league.sqlite")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_place_of_the_file_is_refused(path):
    path.mkdir()
    with pytest.raises(LeagueStoreError, match="league.sqlite is no regular file"):
        LeagueStore(path, SETTINGS)


def test_a_file_that_may_not_be_written_is_read(store, path, tmp_path, monkeypatch):
    ids = add(store)
    store.close()
    before = path.read_bytes()
    monkeypatch.setattr(os, "access", lambda *_: False)
    with contextlib.closing(LeagueStore(path)) as again:
        assert again.read_games().agents.tolist() == [ids, ids[::-1]]
        assert list(tmp_path.iterdir()) == [path]
        with pytest.raises(LeagueStoreError, match="cannot be read or written .attempt to write a"):
            again.add_agent(agent("c"))
    assert path.read_bytes() == before


@pytest.mark.parametrize("file_format", ["csv", "json", "parquet"])
def test_all_tables_are_exported(store, tmp_path, file_format):
    if file_format == "parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
    add(store)
    paths = export_league(store, tmp_path / "out", file_format)
    assert [path.name for path in paths] == [f"{name}.{file_format}" for name in QUERIES]
    games = next(path for path in paths if path.stem == "games")
    if file_format == "json":
        rows = json.loads(games.read_text("utf-8"))
        assert [row["agent_name"] for row in rows] == ["b", "a", "a", "b"]
    elif file_format == "csv":
        assert len(games.read_text("utf-8").splitlines()) == 5
    else:
        assert parquet.read_table(games).column("points").to_pylist() == [1.0, 0.0, 1.0, 0.0]


def test_an_unknown_format_is_answered_with_the_nearest(store, tmp_path):
    with pytest.raises(ValueError, match="unknown export format 'parket': nearest are 'parquet'"):
        export_league(store, tmp_path, "parket")
