"""A game as an animated GIF, played again from its seed and actions."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from marl_cair.files import atomic_path
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent, Game
from marl_cair.league.match import record_game
from marl_cair.league.playing import map_seeds

FRAME_MILLISECONDS = 80
LAST_FRAME_MILLISECONDS = 2_500
MAX_FRAMES = 300
WIDTH = 480  # pixels
NUM_COLOURS = 160


def replay_frames(
    game: Game, scenario: Any, seed: int, actions: NDArray[np.int32]
) -> Iterator[NDArray[np.uint8]]:
    """Pictures uint8 [h, w, 3] of the start and of each decision of a `record_game`."""
    engine = BatchedEngine(game, scenario)
    engine.reset(map_seeds(seed, np.zeros(1, np.int64)))
    yield engine.render(0)
    for chosen in actions:
        engine.step(chosen[None])
        yield engine.render(0)


def save_film(
    first: Agent,
    second: Agent,
    game: Game,
    scenario: Any,
    seed: int,
    path: str | os.PathLike[str],
) -> int:
    """Play the first game of `play_match`, `first` in seat 0, and write it as a GIF.

    Returns the number of frames; of a long game only every second, third, ... is kept.
    """
    actions = record_game(first, second, game, scenario, seed)
    every = -(-(len(actions) + 1) // MAX_FRAMES)
    kept = [
        frame
        for index, frame in enumerate(replay_frames(game, scenario, seed, actions))
        if index % every == 0 or index == len(actions)
    ]
    images = [_shrink(frame) for frame in kept]
    # One palette for all frames, from the busiest: colours then do not flicker.
    palette = images[len(images) * 3 // 4].quantize(NUM_COLOURS)
    frames = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [FRAME_MILLISECONDS] * (len(frames) - 1) + [LAST_FRAME_MILLISECONDS]
    with atomic_path(path) as unfinished:
        frames[0].save(
            unfinished,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=durations,
            loop=0,
            optimize=False,
        )
    return len(frames)


def _shrink(frame: NDArray[np.uint8]) -> Image.Image:
    image = Image.fromarray(frame)
    height = round(image.height * WIDTH / image.width)
    return image.resize((WIDTH, height), Image.Resampling.LANCZOS)
