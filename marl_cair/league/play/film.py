"""Renders a game as an animated GIF, replayed from its seed and actions."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from marl_cair.files import atomic_path
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent, Game
from marl_cair.league.play.match import record_game
from marl_cair.league.play.playing import map_seeds

LAST_FRAME_MILLISECONDS = 2_500
MOST_HIGH = 2  # times the width of a film: a higher board is shown narrower


class Size(NamedTuple):
    """Limits of a film; longer games keep every second, third, ... frame."""

    max_frames: int
    width: int  # pixels
    num_colours: int
    frame_milliseconds: int


FULL = Size(300, 480, 160, 80)
SMALL = Size(120, 320, 96, 100)  # some hundred KiB: a report holds several


def film_game(
    game: Game, scenario: Any, map_seed: int, actions: NDArray[np.int32], size: Size
) -> list[Image.Image]:
    """Pictures of the start, the steps (actions [T, P, ...]) that `size` keeps, and the end."""
    engine = BatchedEngine(game, scenario)
    engine.reset(np.array([map_seed], np.uint64))
    every = -(-(len(actions) + 1) // size.max_frames)
    images = [shrink(engine.render(0), size.width)]
    for number, chosen in enumerate(actions, start=1):
        engine.step(chosen[None])
        if number % every == 0 or number == len(actions):
            images.append(shrink(engine.render(0), size.width))
    return images


def save_film(
    first: Agent, second: Agent, game: Game, scenario: Any, seed: int, path: str | os.PathLike[str]
) -> int:
    """Play the first game of `play_match`, `first` in seat 0, and write it as a GIF.

    Returns the number of frames.
    """
    actions = record_game(first, second, game, scenario, seed)
    map_seed = int(map_seeds(seed, np.zeros(1, np.int64))[0])
    images = film_game(game, scenario, map_seed, actions, FULL)
    write_film(path, images, FULL)
    return len(images)


def write_film(path: str | os.PathLike[str], images: Sequence[Image.Image], size: Size) -> None:
    """Write pictures as a GIF that loops, with the colours and pace of `size`."""
    # One palette for all frames, so that colours do not flicker, from some of them.
    some = np.concatenate([np.asarray(image) for image in images[:: len(images) // 4 or 1]])
    palette = Image.fromarray(some).quantize(size.num_colours)
    films = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [size.frame_milliseconds] * (len(films) - 1) + [LAST_FRAME_MILLISECONDS]
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


def shrink(frame: NDArray[np.uint8], width: int) -> Image.Image:
    """Scale a picture uint8 [h, w, 3] to `width` pixels; to fewer if it would be too high."""
    image = Image.fromarray(frame)
    width = min(width, max(1, round(MOST_HIGH * width * image.width / image.height)))
    height = max(1, round(image.height * width / image.width))
    return image.resize((width, height), Image.Resampling.LANCZOS, reducing_gap=2.0)
