"""Films have one frame for each step, of the board's size and colours."""

import dataclasses
import sys

import numpy as np
import pytest
from PIL import Image, ImageSequence

from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.league.play.film import (
    LAST_FRAME_MILLISECONDS,
    save_film,
    write_gif,
    write_mp4,
    write_pngs,
)
from marl_cair.league.play.match import record_game


def make_frames(count=7, height=31, width=40, num_colours=9):
    """Pictures of random colours, none like the one before."""
    rng = np.random.default_rng(0)
    colours = rng.integers(0, 256, (num_colours, 3), np.uint8)
    return [colours[rng.integers(0, num_colours, (height, width))] for _ in range(count)]


def read_gif(path):
    """All frames, and how long each is shown."""
    with Image.open(path) as film:
        frames = ImageSequence.Iterator(film)
        shown = [(np.array(frame.convert("RGB")), frame.info["duration"]) for frame in frames]
    return tuple(zip(*shown, strict=True))


def test_a_gif_with_too_many_colours_keeps_the_frequent_ones(tmp_path):
    frame = np.full((64, 64, 3), (64, 108, 72), np.uint8)  # a board, and a text of many colours
    frame[:20, :50] = np.random.default_rng(0).integers(0, 256, (20, 50, 3), np.uint8)
    write_gif(tmp_path / "a.gif", [frame, 255 - frame], 10)
    frames, _ = read_gif(tmp_path / "a.gif")
    assert (frames[0][20:] == frame[20:]).all()


def test_a_gif_has_all_frames_in_their_exact_colours(tmp_path):
    frames = make_frames()
    assert write_gif(tmp_path / "a.gif", iter(frames), 20) == 7
    shown, milliseconds = read_gif(tmp_path / "a.gif")
    np.testing.assert_array_equal(shown, frames)
    assert milliseconds == (*[50] * 6, LAST_FRAME_MILLISECONDS)


def test_a_gif_of_more_colours_than_it_can_hold_has_the_nearest(tmp_path):
    ramp = np.arange(40 * 25 * 3).reshape(25, 40, 3) // 12  # 250 grey levels
    frames = [np.uint8(ramp), np.uint8(255 - ramp) // 2, np.uint8(ramp) * np.uint8([1, 0, 1])]
    write_gif(tmp_path / "a.gif", frames, 10)
    shown, _ = read_gif(tmp_path / "a.gif")
    assert np.abs(np.array(shown, int) - np.array(frames, int)).mean() < 4


def test_a_gif_faster_than_it_is_shown_is_refused(tmp_path):
    with pytest.raises(ValueError, match="60 frames per second are too many for a GIF"):
        write_gif(tmp_path / "a.gif", make_frames(), 60)


def test_a_gif_larger_than_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("marl_cair.league.play.film.MOST_GIF_BYTES", 3_000)
    with pytest.raises(ValueError, match="more pictures than a GIF can hold"):
        write_gif(tmp_path / "a.gif", make_frames(), 10)
    assert list(tmp_path.iterdir()) == []


def test_a_video_has_all_frames_with_even_sides(tmp_path):
    av = pytest.importorskip("av", reason="needs pip install 'marl_cair[video]'")
    frames = [np.full((31, 41, 3), 30 * number, np.uint8) for number in range(7)]
    assert write_mp4(tmp_path / "a.mp4", iter(frames), 30) == 7
    with av.open(str(tmp_path / "a.mp4")) as film:
        (stream,) = film.streams.video
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 30)
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(stream)]
    assert [frame.shape for frame in shown] == [(32, 42, 3)] * 7
    means = [frame.mean() for frame in shown]
    np.testing.assert_allclose(means, [30 * number for number in range(7)], atol=3)


def test_a_video_without_its_library_is_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ValueError, match=r"pip install 'marl_cair\[video\]', or write a \.gif"):
        write_mp4(tmp_path / "a.mp4", make_frames(), 30)
    assert list(tmp_path.iterdir()) == []


def test_pictures_are_numbered_in_a_new_folder(tmp_path):
    frames = make_frames()
    assert write_pngs(tmp_path / "a", frames, 30) == 7
    paths = sorted((tmp_path / "a").iterdir())
    assert [path.name for path in paths] == [f"{number:05}.png" for number in range(7)]
    np.testing.assert_array_equal(np.array(Image.open(paths[6])), frames[6])
    with pytest.raises(ValueError, match="is not empty: give a new folder"):
        write_pngs(tmp_path / "a", frames, 30)


@pytest.mark.parametrize("max_frames", [10, 300])
def test_a_film_shows_the_engines_own_pictures_at_the_kept_steps(tmp_path, max_frames):
    game = GAMES["deep_line_wars"]
    scenario = game.scenario("11x11")
    players = [game.bot(name, scenario) for name in ("random", "turtle")]
    whole = record_game(*players, game, scenario, 0)
    replay = dataclasses.replace(whole, map_seed=3, actions=whole.actions[:100])
    engine = BatchedEngine(game, scenario)
    engine.reset(np.array([3], np.uint64))
    states = [engine.render(0)]
    for chosen in replay.actions:
        engine.step(chosen[None])
        states.append(engine.render(0))
    kept = [*range(0, 100, 11), 100] if max_frames == 10 else range(101)
    assert save_film(tmp_path / "a.gif", replay, max_frames) == len(kept)
    shown, _ = read_gif(tmp_path / "a.gif")
    np.testing.assert_array_equal(shown, [states[number] for number in kept])
