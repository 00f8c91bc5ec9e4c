"""`marl-cair replay`, `--record` and `league replay`: what they print, write and refuse."""

import json

import numpy as np
import pytest
from PIL import Image

from marl_cair.cli import main
from marl_cair.games import GAMES, make_engine
from marl_cair.games.replays import (
    ReplayWriter,
    count_games,
    read_replay,
    read_replays,
    replay_steps,
)
from marl_cair.stored import DamagedFileError
from marl_cair.viewer.page import read_game
from tests.league.players import save_network
from tests.refusals import assert_refused

SHORT = ("--scenario", "11x11", "--set", "max_ticks=100")  # 10 steps


@pytest.fixture(scope="module")
def games(tmp_path_factory):
    """A folder with a file of two games."""
    folder = tmp_path_factory.mktemp("games")
    words = ["match", "random", "turtle", *SHORT, "--games", "2", "--record", str(folder)]
    assert main(words) == 0
    return folder


@pytest.fixture
def file(games):
    """The first of its games."""
    (path,) = games.iterdir()
    return f"{path}#0"


def test_the_games_of_a_file_are_listed(games, tmp_path, capsys):
    (path,) = games.iterdir()
    assert main(["replay", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    played = ("random (seat 0) v turtle (seat 1)", "turtle (seat 0) v random (seat 1)")
    assert lines == [
        f"{path}#{number}: {players}: 10 steps, 10 s of the game; no winner"
        for number, players in enumerate(played)
    ]
    out = str(tmp_path / "a.gif")
    assert_refused(capsys, "holds 2 games: name one, ", "replay", str(path), "--to", out)
    assert_refused(capsys, "holds 2 games: name one, ", "replay", str(path), "--seat", "1")
    assert_refused(capsys, "has no game 2, only 0..1", "replay", f"{path}#2")
    assert_refused(capsys, "#x is no file: name a replay", "replay", f"{path}#x")


def test_a_replay_is_printed(file, capsys):
    assert main(["replay", file]) == 0
    lines = capsys.readouterr().out.splitlines()
    version = GAMES["deep_line_wars"].version
    assert lines[0].startswith(f"deep_line_wars 11x11 max_ticks=100, rules {version}, map seed ")
    assert lines[1] == "random (seat 0) v turtle (seat 1): 10 steps, 10 s of the game; no winner"
    assert lines[2:] == ["block: 0", "game: 0", "played again: it is the same (recorded states: 1)"]


def test_values_and_a_cut_are_printed(tmp_path, capsys):
    engine = make_engine("deep_line_wars")
    engine.reset(3)
    path = tmp_path / "a.replay"
    recorder = ReplayWriter(path, engine, map_seeds=[3], players=[["a", "b\x1b"]])
    engine.step(np.zeros((1, 2), np.int32))
    recorder.add(np.zeros((1, 2)), {"q": np.zeros((1, 2, 4))})
    recorder.flush()
    content = path.read_bytes()
    recorder.close()
    path.write_bytes(content)
    assert main(["replay", str(path)]) == 0
    text = capsys.readouterr().out
    assert r"a (seat 0) v b\x1b (seat 1): 1 steps" in text
    assert "cut off there" in text
    assert "values of q: float16 [1, 2, 4]" in text


@pytest.mark.parametrize(("words", "count"), [((), 11), (("--every", "4"), 4)])
def test_a_film_has_the_start_the_steps_and_the_end(file, tmp_path, capsys, words, count):
    path = tmp_path / "game.gif"
    assert main(["replay", file, "--to", str(path), *words]) == 0
    assert capsys.readouterr().out == f"{path}: {count} frames\n"
    engines = replay_steps(read_replay(file))
    frame = next(engines).render(0)
    with Image.open(path) as film:
        assert film.n_frames == count
        np.testing.assert_array_equal(np.array(film.convert("RGB")), frame)


def test_a_video_is_written(file, tmp_path, capsys):
    av = pytest.importorskip("av", reason="needs pip install 'marl_cair[video]'")
    path = tmp_path / "game.mp4"
    assert main(["replay", file, "--to", str(path), "--fps", "25"]) == 0
    with av.open(str(path)) as film:
        assert film.streams.video[0].average_rate == 25
        assert sum(1 for _ in film.decode(video=0)) == 11


def test_pictures_show_the_view_of_a_seat(tmp_path):
    engine = make_engine("deep_rts", "FFA-6-31x31-fog")
    engine.reset(3)
    path = tmp_path / "a.replay"
    with ReplayWriter(path, engine, map_seeds=[3], players=["abcdef"]):
        pass
    assert main(["replay", str(path), "--to", str(tmp_path / "new"), "--seat", "4"]) == 0
    with Image.open(tmp_path / "new" / "00000.png") as picture:
        np.testing.assert_array_equal(np.array(picture), engine.render(0, 4))


def test_states_are_those_of_the_game(file, tmp_path):
    path = tmp_path / "states.npz"
    assert main(["replay", file, "--to", str(path), "--every", "3"]) == 0
    with np.load(path, allow_pickle=False) as held:
        assert held["step"].tolist() == [0, 3, 6, 9, 10]
        replay = read_replay(file)
        np.testing.assert_array_equal(held["actions"], replay.actions)
        kept = dict(held)
    for step, engine in enumerate(replay_steps(replay)):
        if step in kept["step"]:
            for name, value in engine.state_dict().items():
                place = kept["step"].tolist().index(step)
                np.testing.assert_array_equal(kept[name][place], value[0], name)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--to", "a.avi"), "--to is 'a.avi': give a file that ends in .html, .gif, .mp4 or .npz"),
        (("--every", "0"), "--every is 0, it must be 1 or more"),
        (("--fps", "-1"), "--fps is -1, it must be 1 or more"),
        (("--seat", "2"), "--seat is 2, it must be in 0..1"),
    ],
)
def test_options_out_of_range_are_refused(file, capsys, words, message):
    assert_refused(capsys, message, "replay", file, *words)


def test_foreign_files_are_refused(tmp_path, capsys):
    path = tmp_path / "a.replay"
    path.write_bytes(b"\x89PNG\r\n\x1a\n")
    assert_refused(capsys, "a.replay is no replay of marl_cair", "replay", str(path))
    for other in (tmp_path, tmp_path / "none.replay"):
        assert_refused(capsys, f"{other} is no file: name a replay", "replay", str(other))
    assert_refused(capsys, "none.replay", "replay", str(tmp_path / "none.replay"))


def test_states_of_games_in_browsers_are_refused(file, tmp_path, capsys, monkeypatch):
    game = GAMES["deep_line_wars"]
    monkeypatch.setitem(vars(game), "has_snapshots", False)
    path = str(tmp_path / "a.npz")
    assert_refused(capsys, "has no states that can be saved", "replay", file, "--to", path)


def test_replays_are_verified(games, tmp_path, capsys):
    (path,) = games.iterdir()
    content = path.read_bytes()
    for number in range(2):
        (tmp_path / f"{number}.replay").write_bytes(content[: len(content) - number])
    assert main(["verify", str(tmp_path)]) == 1
    text = capsys.readouterr().out
    assert "was cut off before its end" in text
    assert "older version" not in text
    assert "1 files are sound, 1 are damaged" in text


def test_evaluations_are_recorded(tmp_path, capsys):
    words = ["evaluate", "turtle", "--against", "random", "rusher", *SHORT, "--games", "2"]
    assert main([*words, "--record", str(tmp_path)]) == 0
    names = sorted(path.name.split("-0000")[0] for path in tmp_path.iterdir())
    assert names == ["turtle-v-random", "turtle-v-rusher"]
    words = ["evaluate", "oracle", "--game", "deep_maze", "--scenario", "7x7-full_deterministic"]
    assert main([*words, "--games", "3", "--record", str(tmp_path / "maze")]) == 0
    assert sorted(map(count_games, (tmp_path / "maze").iterdir())) == [3, 3]  # of `random` too


def test_matches_for_one_and_sequential_tests_are_recorded(tmp_path):
    words = ["match", "oracle", "random", "--game", "deep_maze"]
    words += ["--scenario", "7x7-full_deterministic", "--games", "2"]
    assert main([*words, "--record", str(tmp_path / "maze")]) == 0
    assert sorted(map(count_games, (tmp_path / "maze").iterdir())) == [2, 2]
    words = ["match", "random", "turtle", *SHORT, "--sprt", "0,100", "--max-games", "4"]
    assert main([*words, "--record", str(tmp_path / "test")]) == 0
    assert sum(map(count_games, (tmp_path / "test").iterdir())) >= 4


@pytest.mark.slow
def test_stored_games_of_a_league_are_replayed(tmp_path, capsys):
    out, recorded = str(tmp_path / "league"), tmp_path / "recorded"
    words = ["league", "random", "turtle", "rusher", *SHORT, "--games", "8", "--no-replays"]
    assert main([*words, "--out", out, "--record", str(recorded)]) == 0
    capsys.readouterr()
    words = ["league", "replay", out, "--between", "turtle", "random", "--games", "3"]
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert all("turtle" in line and "random" in line for line in lines)
    all_games = [one for path in recorded.iterdir() for one in read_replays(path)]
    held = {(one.map_seed, one.players): one for one in all_games}
    files = sorted((tmp_path / "league" / "games").iterdir())
    assert len(files) == 3
    for path in files:
        replay = read_replay(path)
        other = held[replay.map_seed, replay.players]
        np.testing.assert_array_equal(replay.actions, other.actions)
        assert other.hashes.items() <= replay.hashes.items()
    assert_refused(
        capsys,
        "unknown agent of this league 'turtel'",
        "league",
        "replay",
        out,
        "--between",
        "turtel",
    )
    assert_refused(
        capsys, "--games is 0, it must be 1 or more", "league", "replay", out, "--games", "0"
    )


def test_a_page_plays_the_game(file, tmp_path, capsys):
    path = tmp_path / "a.html"
    assert main(["replay", file, "--to", str(path), "--every", "4", "--seat", "1"]) == 0
    assert capsys.readouterr().out == f"{path}: {path.stat().st_size:,} bytes\n"
    game = json.loads(read_game(path))
    assert (game["steps"], game["every"]) == (10, 4)
    assert [view["seat"] for view in game["views"]] == [1]


def test_a_page_shows_the_values_of_agents(file, tmp_path):
    path, agent = tmp_path / "a.html", str(save_network(tmp_path / "run" / "latest"))
    words = ["replay", file, "--to", str(path), "--fps", "5", "--agents", agent, "turtle"]
    assert main(words) == 0
    game = json.loads(read_game(path))
    assert game["fps"] == 5
    assert [kind["name"] for kind in game["values"]] == ["action values"]


def test_agents_are_given_for_each_seat(file, tmp_path, capsys):
    words = ["replay", file, "--to", str(tmp_path / "a.html"), "--agents", "turtle"]
    message = "--agents names 1, the game has 2 seats: give one agent for each seat"
    assert_refused(capsys, message, *words)


def test_a_page_of_something_else_is_refused(tmp_path):
    path = tmp_path / "a.html"
    path.write_text("<p>")
    with pytest.raises(DamagedFileError, match="is no page of a game"):
        read_game(path)
