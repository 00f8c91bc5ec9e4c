"""`marl-cair play` and `marl-cair watch`: options, refusals, films, and a window that opens."""

import builtins
import sys
from pathlib import Path

import pygame
import pytest
from PIL import Image

from marl_cair.cli import main
from marl_cair.cli.viewing.play import make_parser, make_session, name_files, seat_players
from marl_cair.cli.viewing.watch import make_parser as make_watch_parser
from marl_cair.games.replays import read_replay
from marl_cair.window.session import View
from tests.games.flash.browser.flash_files import need_flash


def refused(capsys, *words):
    """What the command prints when it refuses."""
    assert main(words) == 2
    return capsys.readouterr().err


def test_a_window_opens_plays_records_and_closes(tmp_path, monkeypatch):
    pygame.display.init()
    events = [
        [pygame.event.Event(pygame.KEYDOWN, key=pygame.K_1, mod=0)],
        *[[]] * 20,
        [pygame.event.Event(pygame.VIDEORESIZE, w=1, h=1, size=(1, 1))],
        [pygame.event.Event(pygame.KEYDOWN, key=pygame.K_F12, mod=0)],
        [pygame.event.Event(pygame.QUIT)],
    ]
    monkeypatch.setattr(pygame.event, "get", lambda: events.pop(0))
    record = tmp_path / "game.replay"
    words = ("play", "deep_line_wars", "--opponent", "counter", "--speed", "8", "--size", "640x480")
    assert main([*words, "--record", str(record), "--folder", str(tmp_path / "saved")]) == 0
    replay = read_replay(record)
    assert replay.players == ("person", "counter")
    assert replay.actions[0, 0] == replay.spec.action_names.index("buy_militia")
    assert (tmp_path / "saved" / "screenshot.png").is_file()
    assert (tmp_path / "game.csv").is_file()
    assert (tmp_path / "game.json").is_file()


def test_each_game_is_recorded_once_it_has_begun(tmp_path, monkeypatch):
    pygame.display.init()
    keys = [
        [pygame.event.Event(pygame.KEYDOWN, key=key, mod=0)] for key in (pygame.K_SPACE, pygame.K_n)
    ]
    events = [keys[0], *[[]] * 100, keys[1], *[[]] * 5, [pygame.event.Event(pygame.QUIT)]]
    monkeypatch.setattr(pygame.event, "get", lambda: events.pop(0))
    assert main(["play", "flappy_bird", "--size", "320x240", "--folder", str(tmp_path)]) == 0
    (path,) = tmp_path.glob("*.replay")  # the second game waited for a key
    assert len(read_replay(path).actions) >= 1
    assert path.with_suffix(".json").is_file()


def test_watch_writes_a_film_without_a_display(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SDL_VIDEODRIVER", "none of these")
    film = tmp_path / "game.gif"
    words = ["watch", "deep_maze/random", "--seed", "3", "--set", "max_ticks=40", "--to", str(film)]
    assert main([*words, "--size", "320x240", "--every", "10", "--folder", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    with Image.open(film) as image:
        assert image.size == (320, 240)
        assert f"{image.n_frames} frames, 10 in a second" in printed
        assert image.n_frames == 5  # at the start, after 10, 20, 30 and 40 moves
    assert printed.startswith("0 random: out of time after 40 steps")
    kinds = [path.suffix for path in tmp_path.glob("deep_maze-*")]
    assert sorted(kinds) == [".csv", ".json"]  # statistics


@pytest.mark.parametrize(
    ("words", "replay", "statistics"),
    [
        ((), "runs/play/deep_maze-*.replay", "runs/play/deep_maze-*"),
        (("--folder", "a"), "a/deep_maze-*.replay", "a/deep_maze-*"),
        (("--folder", "a", "--no-record"), None, "a/deep_maze-*"),
        (("--folder", "a", "--record", "b/c.replay"), "b/c.replay", "b/c"),
        (("--record", "b/c.replay", "--statistics", "d"), "b/c.replay", "d/deep_maze-*"),
        (("--statistics", "d"), "runs/play/deep_maze-*.replay", "d/deep_maze-*"),
    ],
)
def test_games_are_recorded_by_default_beside_their_statistics(words, replay, statistics):
    options = make_parser().parse_args(["deep_maze", *words])
    record, path = name_files(options, "deep_maze")
    assert path.match(statistics)
    assert record.match(replay) if replay else record is None
    assert "--statistics" in words or record is None or record.with_suffix("") == path


def test_two_commands_in_the_same_second_have_files_of_their_own():
    options = make_parser().parse_args(["deep_maze"])
    assert len({name_files(options, "deep_maze") for _ in range(5)}) == 5


def test_watched_games_are_recorded_where_asked():
    for words, record in (((), None), (("--record", "b/c.replay"), Path("b/c.replay"))):
        options = make_watch_parser().parse_args(["deep_maze/random", *words])
        assert name_files(options, "deep_maze")[0] == record


def test_a_folder_that_cannot_be_written_is_refused(capsys, tmp_path):
    (tmp_path / "file").touch()
    message = refused(capsys, "play", "deep_maze", "--folder", str(tmp_path / "file"))
    assert "games cannot be recorded in" in message
    assert "give another --folder, or --no-record" in message


def test_watch_films_a_flash_game(tmp_path, capsys):
    need_flash()
    film, words = tmp_path / "duel.gif", ("--game", "flash", "--scenario", "duel", "--every", "20")
    limits = ("--set", "max_ticks=120", "--folder", str(tmp_path))
    assert main(["watch", "agents/flash_duel", "duelist", *words, *limits, "--to", str(film)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("0 flash_duel, 1 duelist: out of time after 60 steps")
    with Image.open(film) as image:
        assert image.n_frames == 4  # at the start, after 20, 40 and 60 steps


def test_an_unknown_game_is_named_with_its_nearest(capsys):
    message = refused(capsys, "play", "deep_line_war")
    assert "unknown game 'deep_line_war': nearest are 'deep_line_wars'" in message


def test_without_pygame_the_extra_is_named(capsys, monkeypatch):
    real = builtins.__import__

    def refuse(name, *rest):
        if name == "pygame":
            raise ModuleNotFoundError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    monkeypatch.delitem(sys.modules, "pygame")
    assert 'pip install "marl_cair[play]"' in refused(capsys, "play", "deep_maze")


def test_without_a_display_the_message_says_how_to_watch(capsys, monkeypatch):
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "x11")
    monkeypatch.setenv("DISPLAY", ":4999")
    message = refused(capsys, "play", "deep_maze", "--no-record")
    assert "no window can be opened" in message
    assert "--to game.mp4" in message


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have a display")
def test_a_driver_without_windows_is_refused_unless_it_was_asked_for(capsys, monkeypatch):
    pygame.display.quit()
    for name in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert "no window can be opened" in refused(capsys, "play", "deep_maze", "--no-record")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--size", "big"), "--size is 'big', it must be width x height in pixels, 160..8192"),
        (("--size", "10x10"), "--size is '10x10', it must be"),
        (("--speed", "0"), "--speed is 0.0, it must be in 0.01..1000"),
        (("--speed", "nan"), "--speed is nan, it must be in 0.01..1000"),
        (("--seat", "2"), "--seat is 2, deep_line_wars 10x15 has the seats 0..1"),
        (("--humans", "3"), "--humans is 3, deep_line_wars 10x15 has 2 seats"),
        (("--opponent", "random", "counter"), "2 agents for 1 seats of deep_line_wars 10x15"),
        (("--opponent", "nobot"), "unknown deep_line_wars bot or checkpoint folder 'nobot'"),
        (("--scenario", "10x16"), "unknown deep_line_wars scenario '10x16': nearest are '10x15'"),
    ],
)
def test_wrong_options_are_refused_before_a_window_opens(capsys, words, message):
    assert message in refused(capsys, "play", "deep_line_wars", *words)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--to", "a.avi"), "unknown kind of film '.avi'"),
        (("--to", "a.gif", "--every", "-1"), "--every is -1, it must be 1 or more"),
        (("--to", "a.gif", "--fps", "-1"), "--fps is -1, it must be 1 or more"),
    ],
)
def test_wrong_films_are_refused(capsys, words, message):
    assert message in refused(capsys, "watch", "deep_maze/random", *words)


def test_persons_take_seats_and_the_last_agent_the_rest():
    assert seat_players(["a", "b"], 6, 2, 5, "a game") == [None, "a", "b", "b", "b", None]
    assert seat_players(["random"], 2, 2, 0, "a game") == [None, None]
    assert seat_players(["a"], 3, 0, 0, "a game") == ["a", "a", "a"]


def test_a_trained_agent_plays_in_the_scenario_it_was_trained_on():
    options = make_parser().parse_args(
        ["deep_line_wars", "--no-record", "--opponent", "agents/deep_line_wars_10x15", "--seat=1"]
    )
    options.game = options.game_name
    session = make_session(options, options.opponent, 1)
    assert session.names[1] == "person"
    session.advance()
    moment = session.look(View(0))
    assert moment.values[0].shape == (session.spec.num_actions,)


def test_the_helps_list_the_options(capsys):
    for parser in (make_parser(), make_watch_parser()):
        text = parser.format_help()
        assert "--record FILE" in text
        assert "--statistics FOLDER" in text
