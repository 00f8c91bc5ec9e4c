"""Trains a generator on a data set, and measures it on the held-out episodes while it trains."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import torch

from marl_cair import files
from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import GameSpec, Representation
from marl_cair.generative import quality
from marl_cair.generative.generator import CCDNGenerator, Generator
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from marl_cair.replay.dataset import (
    DatasetDescription,
    TransitionDataset,
    load_dataset,
    read_description,
)
from marl_cair.replay.transition import NEXT_OBSERVATION
from marl_cair.training.collecting.filling import complete_rows
from marl_cair.training.generating.generators import (
    GENERATOR_FILE,
    UNCHECKED,
    describe_task,
    make_for_game,
    move_generator,
    write_knowledge,
)
from marl_cair.training.generating.picture import draw_losses, draw_progress
from marl_cair.training.run_log import format_rows
from marl_cair.training.settings.checks import find_device
from marl_cair.training.settings.config_file import read_stored

KIND = "generator training"
LOSS_FILE, QUALITY_FILE, PICTURE_FILE = "losses.csv", "quality.csv", "predictions.png"
CURVE_FILE = "losses.png"
NUM_DRAWN = 5  # transitions
OPEN_LOOP_ROWS = 128
OBSERVED_ROWS = 1024  # at a time


@dataclass(frozen=True)
class GeneratorTraining:
    """What to train, for how long, and what to measure.

    Raises ValueError for a number out of range.
    """

    model: str = "ccdn"  # a name of `generative.GENERATORS`
    updates: int = 5_000  # of the network
    batch_size: int = 64  # transitions
    measurements: int = 5  # spread evenly over the updates
    measured_rows: int = 2_000  # held-out transitions
    seed: int = 0  # also of `config`, whatever it has
    config: GeneratorConfig = field(default_factory=GeneratorConfig)

    def __post_init__(self) -> None:
        least = {"updates": 1, "batch_size": 1, "measurements": 1, "measured_rows": 2}
        for name, lowest in least.items():
            if getattr(self, name) < lowest:
                raise ValueError(f"{name} is {getattr(self, name)}, it must be {lowest} or more")
        config = replace(self.config, seed=self.seed, heldout_share=0.0, heldout_ends=0.0)
        object.__setattr__(self, "config", config)  # the data set has held-out rows


def describe_game(about: DatasetDescription) -> tuple[GameSpec, Representation]:
    """The spec of a data set's game, and the representation that it shows.

    Raises UnknownNameError for an unknown game or scenario, ValueError where the data set is of
    another version of the game, or its shapes are not those of the game.
    """
    game = GAMES.get(about.game)
    if game is None:
        raise ValueError(
            f"the data set is of {about.game}, which is not installed: there are {', '.join(GAMES)}"
        )
    if about.game_version not in (game.version, *game.agents_of):
        raise ValueError(
            f"the data set is of {about.game} {about.game_version}, here is {game.version}: "
            "collect it again"
        )
    scenario = game.scenario(about.scenario, **restore_fields(about.scenario_options))
    spec = game.make_spec(scenario)
    seen = spec.representations[about.representation]
    held = about.observation_shape, about.num_actions, about.num_players
    if held != (tuple(seen.shape), spec.num_actions, spec.num_players):
        raise ValueError(
            f"the data set holds observations {list(held[0])}, {held[1]} actions and {held[2]} "
            f"players, {about.game} {about.scenario} has {list(seen.shape)}, {spec.num_actions} "
            f"and {spec.num_players}: collect it again"
        )
    return spec, seen


def train_generator(
    source: str | Path, out: str | Path, settings: GeneratorTraining, device: str = "cpu"
) -> Iterator[dict[str, float]]:
    """Train on the data set in `source`; yields the held-out numbers of each measurement.

    Writes to `out`: the weights (`generator.pt`, for `initial_generator`), losses and numbers as
    CSV, and pictures of predictions and losses.
    Raises as `load_dataset`, `describe_game` and `find_device`; ValueError for a generator that
    does not work on the data, FloatingPointError for a loss that is not finite.
    """
    where = find_device(device)
    data = load_dataset(source)
    spec, seen = describe_game(data.about)
    others = data.about.num_players - 1
    generator = make_for_game(
        settings.model, settings.config, seen, spec, spec.reward_bound, others
    )
    folder = Path(out)
    if not hasattr(generator, "imagine"):
        raise ValueError(
            f"{settings.model} has no method `imagine(rows) -> Imagined`, which predicts without a "
            "gate: it cannot be measured (see marl_cair.generative.quality)"
        )
    move_generator(generator, where)
    marked = {"dataset": str(source), **asdict(settings)}
    with files.claim_output_folder(folder, KIND, marked, resume=True):  # the same begins again
        yield from _Training(data, generator, seen, spec, settings, folder).run()


def read_training(folder: Path) -> tuple[DatasetDescription, GeneratorTraining]:
    """The data set and the settings that the generator in `folder` was trained with.

    Raises as `read_description`, and ValueError for settings that cannot be read.
    """
    _, marked = files.read_run_marker(folder / files.RUN_MARKER)
    about = read_description(marked.pop("dataset", ""))
    return about, read_stored(folder / files.RUN_MARKER, GeneratorTraining, marked)


class _Training:
    def __init__(
        self,
        data: TransitionDataset,
        generator: Generator,
        seen: Representation,
        spec: GameSpec,
        settings: GeneratorTraining,
        folder: Path,
    ) -> None:
        self.data, self.generator, self.seen, self.spec = data, generator, seen, spec
        self.settings, self.folder = settings, folder
        self.about: GeneratorSpec = cast(Any, generator).spec
        self.imagine: quality.Imagine = cast(Any, generator).imagine
        self.random = torch.Generator().manual_seed(settings.seed)
        chosen = torch.randperm(len(data.heldout), generator=self.random)
        self.heldout = data.heldout[chosen[: settings.measured_rows]]
        self.chains = torch.zeros(0, 1, dtype=torch.int64)
        for length in reversed(quality.HORIZONS):  # unique rows have gaps
            if not len(self.chains):
                self.chains = quality.find_chains(data.heldout, length, OPEN_LOOP_ROWS)
        changed = (self.heldout["observation"] != self.heldout[NEXT_OBSERVATION]).flatten(1).any(1)
        self.drawn = self.heldout[changed.nonzero()[:NUM_DRAWN, 0]]
        self.guesses: list[torch.Tensor] = []

    def run(self) -> Iterator[dict[str, float]]:
        settings, data = self.settings, self.data
        for first in range(0, len(data.train), OBSERVED_ROWS):
            places = torch.arange(first, min(first + OBSERVED_ROWS, len(data.train)))
            self.generator.observe(complete_rows(data.train, places))
        due = {
            math.ceil(settings.updates * (n + 1) / settings.measurements)
            for n in range(settings.measurements)
        }
        losses: list[dict[str, float]] = []
        numbers: list[dict[str, float]] = []
        start = time.process_time()
        for update in range(1, settings.updates + 1):
            places = torch.randint(len(data.train), (settings.batch_size,), generator=self.random)
            found = self.generator.update(complete_rows(data.train, places))
            checked = {name: loss for name, loss in found.items() if name != UNCHECKED}
            if broken := [name for name, loss in checked.items() if not math.isfinite(loss)]:
                raise FloatingPointError(
                    f"the loss {broken[0]} is {found[broken[0]]} at update {update}: take a "
                    "smaller learning rate (--set learning_rate=...)"
                )
            losses.append({"update": update, **found})
            if update in due:
                spent = time.process_time() - start
                numbers.append({"update": update, "processor_seconds": spent, **self.measure()})
                self.write(losses, numbers)
                start += time.process_time() - start - spent  # measuring does not count
                yield numbers[-1]

    def measure(self) -> dict[str, float]:
        """Numbers on held-out rows."""
        begin = time.process_time()
        made = self.imagine(self.heldout)
        spent = time.process_time() - begin
        numbers = quality.measure_rows(self.heldout, made, self.about)
        half = len(self.heldout) // 2
        least = made.surety[:half].quantile(self.settings.config.gate.tail)
        rest = made.select(slice(half, None))
        numbers |= quality.measure_acceptance(
            self.heldout[half:], rest, self.about, rest.surety >= least
        )
        if isinstance(self.generator, CCDNGenerator):  # training takes samples, not the likeliest
            sampled = self.generator.imagine(self.heldout, torch.Generator().manual_seed(0))
            found = quality.measure_rows(self.heldout, sampled, self.about)
            numbers |= {
                f"sampled/{name}": value
                for name, value in found.items()
                if name.startswith("cells/")
            }
        if rate := getattr(self.generator, "rate_masks", None):  # of those with a gate
            numbers |= rate(self.heldout)
        if len(self.chains):
            held, imagine = self.data.heldout, self.imagine
            numbers |= quality.measure_open_loop(held, self.chains, imagine, self.about)
        if "open_loop/1_changed_f1" in numbers:
            least_f1 = self.settings.config.gate.min_changed_f1
            numbers["open_loop/safe_steps"] = quality.find_safe_steps(numbers, least_f1)
        self.guesses.append(self.imagine(self.drawn).observation)
        return {**numbers, "speed/rows_per_processor_second": len(self.heldout) / max(spent, 1e-9)}

    def write(self, losses: list[dict[str, float]], numbers: list[dict[str, float]]) -> None:
        """Write weights, tables and pictures."""
        with files.atomic_path(self.folder / GENERATOR_FILE) as unfinished:
            about = self.data.about
            made_for = describe_task(GAMES[about.game], about.scenario_options, self.spec)
            write_knowledge(self.generator, unfinished, made_for)
        files.write_atomically(self.folder / LOSS_FILE, format_rows(losses))
        files.write_atomically(self.folder / QUALITY_FILE, format_rows(numbers))
        draw_losses(self.folder / CURVE_FILE, losses)
        if len(self.seen.shape) == 3:
            names = [f"{row['update']:.0f} updates" for row in numbers]
            draw_progress(
                self.folder / PICTURE_FILE,
                self.seen,
                self.spec.static_planes,
                self.drawn["observation"],
                self.drawn[NEXT_OBSERVATION],
                dict(zip(names, self.guesses, strict=True)),
            )
