"""How far from their true places a generator of frames draws what moves.

    marl-cair generator train data/frames --out runs/frames     # of gray_stack
    python -m benchmarks.positions runs/frames [--player oracle@0.8] [--steps 2000] [--most 1]

Plays games with new seeds, predicts each step from the real frames before it, and looks for each
thing in the predicted frame: the shift, of 5 pixels at most, at which the true frame's pixels
around the thing's true place differ least (in squares) from the predicted ones. The true place is
known from the game's numbers. Prints the share of shifts of at most --most pixels in each
direction, beside that of a copy of the frame before, in all steps and in those in which the thing
has moved by more than --most pixels, in Markdown with 95 % bootstrap intervals over games.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from contextlib import closing
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import bootstrap
from tensordict import TensorDict
from torch.nn import functional

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.flappy_bird import tables
from marl_cair.league.agents.load import load_agent
from marl_cair.replay.dataset import EPISODE
from marl_cair.training.collecting.dataset import Play
from marl_cair.training.offline.watching import load_watched

SIDE, REACH = 84, 5  # pixels of a frame, and of the largest shift
WORLDS = 4
BAR_AND_HALF_PANEL = 24 + 84  # of Multitask: rows above the first panel's centre
Numbers = Mapping[str, float]


class Thing(NamedTuple):
    """What is looked for; pixels are those of the game."""

    centre: Callable[[Numbers], tuple[float, float]]  # numbers of the game -> x, y
    half: tuple[float, float]  # half of the width and height that are compared


def find_pipe(numbers: Numbers) -> tuple[float, float]:
    """The right end of the next pipe, at the gap's upper edge."""
    x = tables.BIRD_X + numbers["distance to the end of the next pipe"]
    return x, numbers["upper edge of the next gap"]


def find_bird(numbers: Numbers) -> tuple[float, float]:
    """The bird's centre."""
    return tables.BIRD_X + tables.BIRD_WIDTH / 2, numbers["bird y"] + tables.BIRD_HEIGHT / 2


def turn(numbers: Numbers, x: float, y: float) -> tuple[float, float]:
    """A point of Multitask's paddle, which turns around (120, BAR_AND_HALF_PANEL + 26)."""
    cosine, sine = np.cos(numbers["balance.angle"]), np.sin(numbers["balance.angle"])
    return 120 + x * cosine - y * sine, BAR_AND_HALF_PANEL + 26 + x * sine + y * cosine


def find_ball(numbers: Numbers) -> tuple[float, float]:
    """The centre of the ball, 24 above the paddle's middle line."""
    return turn(numbers, numbers["balance.position"], -24.0)


def find_paddle(numbers: Numbers) -> tuple[float, float]:
    """The paddle's right end."""
    return turn(numbers, numbers["balance.half_length"], 0.0)


THINGS = {
    "flappy_bird": {"bird": Thing(find_bird, (20, 20)), "pipe": Thing(find_pipe, (24, 36))},
    "flash": {"ball": Thing(find_ball, (24, 24)), "paddle": Thing(find_paddle, (24, 24))},
}
SIZES = {"flappy_bird": (tables.SCREEN_WIDTH, tables.SCREEN_HEIGHT), "flash": (480, 360)}


def find_shift(true: torch.Tensor, drawn: torch.Tensor, box: tuple[slice, slice]) -> int:
    """The larger of the two distances, in pixels, at which `drawn` looks most like the `box` of
    `true`; of equal ones the smallest. Frames float32 [SIDE, SIDE].
    """
    wanted = true[box]
    padded = functional.pad(drawn[None], (REACH,) * 4, mode="replicate")[0]
    rows, columns = (slice(part.start, part.stop + 2 * REACH) for part in box)
    near = padded[rows, columns].unfold(0, wanted.shape[0], 1).unfold(1, wanted.shape[1], 1)
    differences = (near - wanted).square().sum((2, 3))
    away = torch.arange(-REACH, REACH + 1).abs()
    distance = torch.maximum(away[:, None], away)
    return int(distance[differences <= differences.min()].min())


def choose_box(thing: Thing, numbers: Numbers, size: tuple[int, int]) -> tuple[slice, slice] | None:
    """Rows and columns around the thing; None where it is not wholly in the frame."""
    spans = []
    for middle, half, length in zip(thing.centre(numbers), thing.half, size, strict=True):
        first, last = (round((middle + side * half) * SIDE / length) for side in (-1, 1))
        if first < 0 or last > SIDE:
            return None
        spans.append(slice(first, last))
    return spans[1], spans[0]


def measure(
    folder: str, player: str, num_steps: int, seed: int
) -> dict[str, list[tuple[int, int, int]]]:
    """Shifts of the predicted frame and of a copy, of each thing that is seen."""
    watched = load_watched(folder)
    game, imagine = watched.game, watched.generator.imagine  # type: ignore[attr-defined]
    names = watched.spec.representations["vector"].plane_names
    found: dict[str, list[tuple[int, int, int]]] = {name: [] for name in THINGS[game.name]}
    agent = load_agent(player, game.name, watched.scenario)
    with closing(BatchedEngine(game, watched.scenario, WORLDS)) as engine:
        play = Play(engine, watched.seen.name, [agent], seed)
        for _ in range(num_steps // WORLDS):
            columns = play.step()
            after = engine.observe("vector")[:, 0]
            keys = ("observation", "action_mask", "action")
            rows = TensorDict({key: torch.from_numpy(columns[key]) for key in keys}, [WORLDS])
            drawn = imagine(rows).observation[:, -1].float()
            before = rows["observation"][:, -1].float()
            true = torch.from_numpy(columns["next", "observation"][:, -1]).float()
            for world in np.flatnonzero(~columns["next", "done"][:, 0]):
                numbers = dict(zip(names, after[world].tolist(), strict=True))
                frames = drawn[world], before[world]
                game_number = int(columns[EPISODE][world])
                seen = numbers, SIZES[game.name], true[world], frames
                note(found, game_number, THINGS[game.name], *seen)
    return found


def note(
    found: dict[str, list[tuple[int, int, int]]],
    game_number: int,
    things: Mapping[str, Thing],
    numbers: Numbers,
    size: tuple[int, int],
    true: torch.Tensor,
    frames: tuple[torch.Tensor, torch.Tensor],
) -> None:
    """Add the shifts of one step."""
    for name, thing in things.items():
        box = choose_box(thing, numbers, size)
        if box is not None:
            drawn, before = (find_shift(true, frame, box) for frame in frames)
            found[name].append((game_number, drawn, before))


def share(hits: NDArray[np.bool_], games: NDArray[np.int64]) -> str:
    """The share of `hits` with its interval over `games`, the number of each hit's game."""
    if not len(hits):
        return "-"
    _, place = np.unique(games, return_inverse=True)
    of_game = np.bincount(place, hits), np.bincount(place)
    text = f"{hits.mean():.1%}"
    if len(of_game[1]) > 1:
        drawn = bootstrap(
            of_game,
            lambda right, steps, axis=-1: right.sum(axis) / steps.sum(axis),
            paired=True,
            method="percentile",
            rng=np.random.default_rng(0),
        ).confidence_interval
        text += f" [{drawn.low:.1%}, {drawn.high:.1%}]"
    return f"{text} of {len(hits):,} in {len(of_game[1])} games"


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("generator", help="folder of `marl-cair generator train`, or of a run")
    parser.add_argument("--player", default="random", help="who plays")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--most", type=int, default=1, help="pixels of a shift that counts")
    parser.add_argument("--seed", type=int, default=1_000_000)
    options = parser.parse_args()
    found = measure(options.generator, options.player, options.steps, options.seed)
    print(f"| thing | within {options.most} pixels | a copy | where it moved further |")
    print("|---|---|---|---|")
    for name, pairs in found.items():
        games, *shifts = np.array(pairs, np.int64).reshape(-1, 3).T
        drawn, before = (shift <= options.most for shift in shifts)
        moved = share(drawn[~before], games[~before])
        print(f"| {name} | {share(drawn, games)} | {share(before, games)} | {moved} |")


if __name__ == "__main__":
    main()
