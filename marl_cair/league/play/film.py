"""Films of recorded games: animated GIF, MP4 video, and pictures as PNG files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from marl_cair.files import atomic_path
from marl_cair.games.replays import Replay, replay_steps

LAST_FRAME_MILLISECONDS = 2_500  # of a GIF, before it begins again
MOST_GIF_FPS = 50  # programs show faster GIFs slowly
NUM_COLOURS, MOST_GIF_BYTES = 256, 1 << 30
SMALL_FILM_FRAMES, SMALL_FILM_FPS = 300, 12
_SAMPLED_PIXELS = 1 << 16  # from which the palette of a GIF is made

Frame = NDArray[np.uint8]  # [height, width, 3], RGB


def render_frames(replay: Replay, every: int = 1, player: int | None = None) -> Iterator[Frame]:
    """Pictures of the start, each `every`-th step and the end; `player`: in that seat's view.

    Raises ReplayError as `replay_steps`.
    """
    for step, engine in enumerate(replay_steps(replay)):
        if step % every == 0 or step == len(replay.actions):
            yield engine.render(0, player)


def save_film(
    path: str | os.PathLike[str], replay: Replay, max_frames: int = SMALL_FILM_FRAMES
) -> int:
    """Write a GIF of a game; returns the number of frames. Longer games keep every second, third,
    ... step, and the last. Raises as `render_frames` and `write_gif`.
    """
    every = -(-(len(replay.actions) + 1) // max_frames)
    return write_gif(path, render_frames(replay, every), SMALL_FILM_FPS)


# --- each writes all frames in their full size and returns their number -------------------------


def write_gif(path: str | os.PathLike[str], frames: Iterable[Frame], fps: int) -> int:
    """A GIF that loops; up to 256 colours in all are exact, of more the frequent ones.

    Raises ValueError for more frames per second than programs show, or more frames than fit into
    memory.
    """
    if fps > MOST_GIF_FPS:
        raise ValueError(
            f"{fps} frames per second are too many for a GIF, programs show {MOST_GIF_FPS}: give "
            "fewer, leave frames out, or write an .mp4"
        )
    places = np.zeros(1 << 24, np.uint16)  # of each colour among `colours`, from 1; 0: not seen
    colours: list[int] = []
    pictures: list[NDArray[np.uint16]] = []
    room = MOST_GIF_BYTES
    for frame in frames:
        pixels = frame.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        new = np.unique(pixels[places[pixels] == 0])
        places[new] = np.arange(len(colours) + 1, len(colours) + len(new) + 1)
        colours += new.tolist()
        pictures.append((places[pixels] - 1).astype(np.min_scalar_type(len(colours) - 1)))
        room -= pictures[-1].nbytes
        if room < 0:
            raise ValueError(
                f"the game has more pictures than a GIF can hold ({len(pictures)} have "
                f"{MOST_GIF_BYTES >> 20} MiB): leave frames out, or write an .mp4"
            )
    listed = np.array(colours, ">u4").view(np.uint8).reshape(1, -1, 4)[..., 1:]
    counts = sum(np.bincount(picture.ravel(), minlength=len(colours)) for picture in pictures)
    weights = np.ceil(counts / np.sum(counts) * _SAMPLED_PIXELS).astype(np.int64)
    palette = Image.fromarray(np.repeat(listed, weights, axis=1)).quantize(NUM_COLOURS)
    shown = np.asarray(palette)[0][np.cumsum(weights) - 1]
    films = [Image.fromarray(shown[picture]) for picture in pictures]
    for film in films:
        film.putpalette(palette.getpalette() or [])
    durations = [round(1000 / fps)] * (len(films) - 1) + [LAST_FRAME_MILLISECONDS]
    with atomic_path(path) as unfinished:
        films[0].save(
            unfinished,
            format="GIF",
            save_all=True,
            append_images=films[1:],
            duration=durations,
            loop=0,
            optimize=True,  # unchanged pixels are written once: a third of the size
        )
    return len(films)


def write_mp4(path: str | os.PathLike[str], frames: Iterable[Frame], fps: int) -> int:
    """A video (H.264) that every browser plays; odd sizes get one more line of pixels.

    Raises ValueError without PyAV.
    """
    try:
        import av
    except ModuleNotFoundError as error:
        raise ValueError(
            "an .mp4 needs PyAV: pip install 'marl_cair[video]', or write a .gif"
        ) from error
    with atomic_path(path) as unfinished, av.open(str(unfinished), "w") as file:
        stream = file.add_stream("libx264", rate=fps, options={"crf": "18"})
        stream.pix_fmt = "yuv420p"  # needs even sizes
        for number, frame in enumerate(frames):
            height, width = frame.shape[:2]
            padded = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
            if number == 0:
                stream.height, stream.width = padded.shape[:2]
            file.mux(stream.encode(av.VideoFrame.from_ndarray(padded, format="rgb24")))
        file.mux(stream.encode())
        return int(stream.frames)


def write_pngs(path: str | os.PathLike[str], frames: Iterable[Frame], fps: int) -> int:
    """A new folder of pictures, 00000.png and so on; `fps` has no effect.

    Raises ValueError where the folder holds files.
    """
    folder = Path(path)
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise ValueError(f"{folder} is not empty: give a new folder for the pictures")
    count = 0
    for count, frame in enumerate(frames, start=1):
        Image.fromarray(frame).save(folder / f"{count - 1:05}.png")
    return count


# By the suffix of the file.
WRITERS: dict[str, Callable[[str | os.PathLike[str], Iterable[Frame], int], int]] = {
    ".gif": write_gif,
    ".mp4": write_mp4,
    "": write_pngs,
}
