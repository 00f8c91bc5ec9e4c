"""Films of a generator: a real game beside what the generator imagines from it, step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict
from torch import Tensor

from marl_cair.files import RUN_MARKER, read_run_marker
from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Game, GameSpec, Representation
from marl_cair.generative.generator import Generator
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.arena import Load
from marl_cair.league.play.film import WRITERS
from marl_cair.training.collecting.dataset import Play
from marl_cair.training.generating.generators import (
    GENERATOR_FILE,
    describe_task,
    load_knowledge,
    make_for_game,
    make_generator,
)
from marl_cair.training.generating.picture import paint, paint_difference, save_rows
from marl_cair.training.offline.generator_training import KIND, describe_game, read_training
from marl_cair.training.settings.config_file import learned_fields, load_config

STRIP, MOST_COLUMNS = ".png", 17  # steps that a strip shows
STRIP_ROWS = "real", "imagined", "different"
SIDE = 300  # pixels of a board's longer side, about
_MARGIN, _LINE = 10, 18
_BACKGROUND, _INK, _FAINT = (24, 24, 28), (240, 240, 240), (150, 150, 160)
Frame = NDArray[np.uint8]


class Watched(NamedTuple):
    """A generator with the game that it has learned."""

    generator: Generator  # with `imagine`
    game: Game
    scenario: Any
    spec: GameSpec
    seen: Representation
    players: tuple[str, ...]  # of the real games: agents, as `load_agent` takes them
    reward_scale: float = 1.0  # of the rewards that the generator has learned


class Moment(NamedTuple):
    """A real step and the imagined one beside it; observations uint8 [1, C, H, W] after it."""

    step: int
    num_imagined: int  # steps since both were the same
    real: Tensor
    imagined: Tensor
    real_reward: float
    imagined_reward: float
    end: float  # probability that the episode ends, as imagined


def load_watched(folder: str | Path) -> Watched:
    """The generator of a training run, or of `marl-cair generator train`.

    Raises ValueError for a folder without a generator, one that cannot be drawn or that only
    predicts behind a gate (without `imagine`), and for code of others that `folder` names.
    """
    place = Path(folder)
    if not (place / GENERATOR_FILE).is_file():
        raise ValueError(
            f"{folder} holds no generator ({GENERATOR_FILE} is missing): give the folder of a run "
            "with a generator that has saved its state, or of `marl-cair generator train`"
        )
    is_trained_alone = read_run_marker(place / RUN_MARKER)[0] == KIND
    watched = (_load_from_data if is_trained_alone else _load_from_run)(place)
    if not hasattr(watched.generator, "imagine"):
        raise ValueError(
            f"the generator of {folder} has no method `imagine(rows) -> Imagined`, which predicts "
            "without a gate: it cannot be watched"
        )
    if len(watched.seen.shape) != 3:
        raise ValueError(
            f"the generator of {folder} works on {watched.seen.name!r}, vectors of "
            f"{watched.seen.shape[0]} numbers, which have no picture: watch one of `planes`, "
            "`gray` or `gray_stack`"
        )
    return watched


def _load_from_run(place: Path) -> Watched:
    config = load_config(place)
    game = GAMES[config.game.name]
    scenario = game.scenario(config.game.scenario, **learned_fields(config))
    spec = game.make_spec(scenario)
    seen = spec.representations[config.game.representation]
    trusted = replace(config, generator=replace(config.generator, transfer=True))  # its own folder
    generator = cast(Generator, make_generator(trusted, seen, spec, 0, str(place)))
    players, scale = (str(place),), config.learner.reward_scale
    return Watched(generator, game, scenario, spec, seen, players, scale)


def _load_from_data(place: Path) -> Watched:
    about, settings = read_training(place)
    spec, seen = describe_game(about)
    game = GAMES[about.game]
    scenario = game.scenario(about.scenario, **restore_fields(about.scenario_options))
    model, config, others = settings.model, settings.config, about.num_players - 1
    generator = make_for_game(model, config, seen, spec, spec.reward_bound, others)
    made_for = describe_task(game, about.scenario_options, spec)
    load_knowledge(generator, str(place), made_for, is_transfer=True)  # settings beside it
    return Watched(generator, game, scenario, spec, seen, about.players)


def watch_steps(
    watched: Watched, agents: Sequence[Any], num_open: int = 8, seed: int = 0
) -> Iterator[Moment]:
    """Play without end as the first seat sees it, and imagine the same steps: from a real state on
    `num_open` steps from imagined states, with the real actions of all players, and then again.

    Raises ValueError for `num_open` below 1.
    """
    if num_open < 1:
        raise ValueError(f"num_open is {num_open}, it must be 1 or more")
    imagine = cast(Any, watched.generator).imagine
    engine = BatchedEngine(watched.game, watched.scenario, 1)
    play = Play(engine, watched.seen.name, agents, seed)
    seen, num_imagined, step = None, 0, 0
    while True:
        row = _find_row(play.step())
        if row is None:  # the seat is out until the game ends
            seen = None
            continue
        if seen is None or num_imagined == num_open:
            seen, num_imagined = row["observation"], 0
        asked = row.clone()
        asked["observation"] = seen
        made = imagine(asked)
        seen, num_imagined, step = made.observation, num_imagined + 1, step + 1
        following = row["next"]
        rewards = float(following["reward"]), float(made.reward) / watched.reward_scale
        real = following["observation"]
        yield Moment(step, num_imagined, real, seen, *rewards, float(made.end))
        if following["done"].any():
            seen = None


def _find_row(columns: dict[Any, NDArray[Any]]) -> TensorDict | None:
    """The first seat's transition [1]; None if it does not play."""
    chosen = np.flatnonzero(columns["seat"] == 0)[:1]
    if not len(chosen):
        return None
    row = TensorDict({}, [1])
    for key, values in columns.items():
        row[key] = torch.from_numpy(np.ascontiguousarray(values[chosen]))
    return row


def draw_moment(watched: Watched, moment: Moment) -> Frame:
    """The real state, the imagined one, and where they differ, side by side."""
    from PIL import Image, ImageDraw

    boards = [board[0] for board in _paint_boards(watched, [moment])]
    height, width = boards[0].shape[:2]
    scale = -(-SIDE // max(height, width))
    height, width = scale * height, scale * width
    top = _MARGIN + _LINE
    size = 3 * (width + _MARGIN) + _MARGIN, top + height + 2 * _LINE + _MARGIN
    picture = Image.new("RGB", size, _BACKGROUND)
    pen = ImageDraw.Draw(picture)
    unit = "step" if moment.num_imagined == 1 else "steps"
    titles = ("real", f"imagined, {moment.num_imagined} {unit} on", "difference")
    notes = (
        f"step {moment.step}, reward {moment.real_reward:+.3f}",
        f"reward {moment.imagined_reward:+.3f}, P(end) {moment.end:.2f}",
        f"{int((boards[2] > 8).any(-1).sum())} of {boards[2][..., 0].size} cells",
    )
    for number, (board, title, note) in enumerate(zip(boards, titles, notes, strict=True)):
        left = _MARGIN + number * (width + _MARGIN)
        large = Image.fromarray(board).resize((width, height), Image.Resampling.NEAREST)
        picture.paste(large, (left, top))
        pen.text((left, _MARGIN), title, _INK)
        pen.text((left, top + height + 5), note, _FAINT)
    return np.asarray(picture)


def _paint_boards(watched: Watched, moments: Sequence[Moment]) -> list[Frame]:
    """Real, imagined and different, each uint8 [N, H, W, 3]."""
    seen, static = watched.seen, watched.spec.static_planes
    shown = slice(seen.shape[0] - seen.num_uniform)
    if seen.num_frames > 1:  # the newest frame alone
        shown = slice(-1, None)
    planes = [
        torch.cat(observations)[:, shown].numpy()
        for observations in zip(*((one.real, one.imagined) for one in moments), strict=True)
    ]
    return [*(paint(seen, static, values) for values in planes), paint_difference(*planes)]


def film_generator(
    folder: str | Path,
    to: str | Path,
    num_steps: int = 200,
    num_open: int = 8,
    players: Sequence[str] = (),
    seed: int = 0,
    fps: int = 4,
    load: Load = load_agent,
) -> int:
    """Write a film of `num_steps` steps as .gif, .mp4 or a new folder of pictures; or as .png one
    roll-out of `num_open` steps, a column for each. Returns the number of frames.

    players: of the real games, one for all seats or one for each; default: the agent of the run, or
    the players of the data set. Raises as `load_watched` and `watch_steps`, and ValueError for
    another suffix or number of players.
    """
    suffix = Path(to).suffix
    if suffix not in (*WRITERS, STRIP):
        raise ValueError(
            f"the film's name is {str(to)!r}: give one that ends in .gif, .mp4 or {STRIP}, or a "
            "new folder for pictures"
        )
    watched = load_watched(folder)
    names, num_seats = list(players or watched.players), watched.spec.num_players
    if len(names) not in (1, num_seats):
        raise ValueError(
            f"there are {len(names)} players, {watched.game.name} has {num_seats} seats: name one "
            "for all seats, or one for each"
        )
    names = names * num_seats if len(names) == 1 else names
    # Each seat has an agent of its own: two seats of one object would share random draws.
    agents = [load(name, watched.game.name, watched.scenario) for name in names]
    moments = watch_steps(watched, agents, num_open, seed)
    if suffix == STRIP:
        shown = list(islice(moments, min(num_open, MOST_COLUMNS)))
        save_rows(to, STRIP_ROWS, _paint_boards(watched, shown))
        return len(shown)
    frames = (draw_moment(watched, moment) for moment in islice(moments, num_steps))
    return WRITERS[suffix](to, frames, fps)
