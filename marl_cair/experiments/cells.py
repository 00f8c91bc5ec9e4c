"""Composes the cells of a plan: what is trained or rated, and the words that each has."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from marl_cair.experiments.plan import BEST, Length, Plan, RatingSettings, TaskSettings
from marl_cair.files import write_json
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.lookup import check_name
from marl_cair.memory import NotEnoughMemoryError
from marl_cair.stored import read_json
from marl_cair.training.settings.checks import DeviceError, require, require_once
from marl_cair.training.settings.config import ENDLESS_FRAMES, TrainConfig
from marl_cair.training.settings.config_file import read_stored, to_plain

CELLS, RUN = "cells", "run"
CELL_FILE, DONE_FILE = "cell.json", "finished.txt"
# No games are recorded while training.
DEFAULTS = ("evaluation.record=false",)
# Options in frames that follow the budget of a plan that is scaled down.
_SCHEDULES = (
    *("exploration.anneal_frames", "evaluation.every_frames", "opponent.warmup_frames"),
    *("opponent.snapshot_every_frames", "replay.min_transitions", "demonstration.until_frames"),
    *("generator.evaluate_every_frames", "generator.warmup_frames"),
)
_SET_HERE = ("seed", "out", "max_minutes")
Compose = Callable[[Sequence[Sequence[str]]], TrainConfig]


@dataclass(frozen=True)
class Cell:
    """One training run with its looks; or an agent that is rated without training."""

    name: str
    task: str
    choices: dict[str, Any]  # texts by factor; "" where a cell has none of it
    seed: int
    config: TrainConfig
    rating: RatingSettings
    budget: Length
    looks: Length
    agent: str | None = None  # a bot or checkpoint that is rated without training
    trainer: str | None = None  # module:function that trains in place of `marl_cair`

    @property
    def key(self) -> tuple[str, ...]:
        """Task and choices, which seeds share."""
        return self.task, *self.choices.values()

    @property
    def threads(self) -> int:
        """Processor cores that it keeps busy."""
        return max(self.config.torch_threads or 1, self.config.collector.num_threads)

    def find_share(self, frames: int, seconds: float) -> float:
        """The share of the budget that is spent; 1 or more at its end."""
        return max(self.budget.count(frames, seconds), frames / self.config.total_frames)

    def save(self, folder: Path) -> None:
        """Write the cell to `<folder>/cell.json`, for `load_cell` in another process."""
        write_json(folder / CELL_FILE, to_plain(dataclasses.asdict(self)))


def load_cell(folder: Path) -> Cell:
    """The cell that `Cell.save` wrote. Raises ValueError with the file's name."""
    path = folder / CELL_FILE
    cell: Cell = read_stored(path, Cell, read_json(path))
    return cell


def make_cells(plan: Plan, compose: Compose, scale: float, out: Path) -> list[Cell]:
    """Cells in running order: all of the first seed, then of the next. Those that have been begun
    have the settings in `out`.

    compose: settings from lists of words, of which later ones override. scale: as of `scale_plan`.

    Raises ValueError for a cell that cannot be composed or rated, with its name.
    """
    cells, drafts = [], list(list_drafts(plan))
    require_once("names of cells (choices, others, agents)", [draft.name for draft in drafts])
    for draft in drafts:
        config: TrainConfig | None = None
        for seed in plan.seeds:
            folder = out / CELLS / f"{draft.name}-{seed}"
            if (folder / CELL_FILE).is_file():
                own = load_cell(folder).config  # all else is the plan's
                _check_rating(plan.tasks[draft.task], own)
            else:
                config = config or _compose(plan, draft, compose, scale)
                own = dataclasses.replace(config, seed=seed, out=str(folder / RUN))
            rating, how = plan.tasks[draft.task].rating, (draft.agent, draft.trainer)
            keys = folder.name, draft.task, draft.choices, seed
            cells.append(Cell(*keys, own, rating, plan.budget, plan.looks, *how))
    return sorted(cells, key=lambda cell: plan.seeds.index(cell.seed))


def _compose(plan: Plan, draft: Draft, compose: Compose, scale: float) -> TrainConfig:
    task = plan.tasks[draft.task]
    layers = [DEFAULTS, plan.words, task.words, *draft.words]
    try:
        for word in (word for words in layers for word in words):
            name = word.partition("=")[0].lstrip("+~")
            require(name not in _SET_HERE, "a word", word, f"left out: a plan sets {name} itself")
            is_option = not name.startswith("hydra")  # Hydra's own import modules
            require(is_option, "a word", word, "an option of `marl-cair train`")
        config = _set_length(compose(layers), plan.budget, scale)
        whole = "left out: each run trains for its whole budget"
        require(config.stop_score is None, "stop_score", config.stop_score, whole)
        _check_rating(task, config)
        _check_numbers(task.rating, config, plan.factors)
        if task.rating.agent == BEST and not (draft.agent or draft.trainer):
            require_best(config, config.total_frames)
    except ValueError as error:
        raise ValueError(f"the cell {draft.name} cannot be run: {error}") from error
    return config


class Draft(NamedTuple):
    """A cell of all seeds, before it is composed."""

    task: str
    choices: dict[str, str]
    words: Sequence[Sequence[str]]
    agent: str | None = None
    trainer: str | None = None

    @property
    def key(self) -> tuple[str, ...]:
        """Task and choices."""
        return self.task, *self.choices.values()

    @property
    def name(self) -> str:
        """The cell's name but for its seed."""
        return "-".join(part for part in self.key if part)


def list_drafts(plan: Plan) -> Iterator[Draft]:
    """All cells of one seed."""
    none = dict.fromkeys(plan.factors, "")
    first = next(iter(plan.factors), "agent")  # its column names agents and other trainers
    for task, about in plan.tasks.items():
        for chosen in product(*plan.factors.values()):
            if any(about.when.get(choice, ()) is None for choice in chosen):
                continue
            choices = dict(zip(plan.factors, chosen, strict=True))
            words = [plan.factors[factor][choice] for factor, choice in choices.items()]
            words += [about.when.get(choice) or () for choice in chosen]
            yield Draft(task, choices, words)
        for name, place in plan.others.items():
            if (own := about.when.get(name, ())) is not None:
                yield Draft(task, none | {first: name}, [own], trainer=place)
        for name in about.agents:
            yield Draft(task, none | {first: name_agent(name)}, [], agent=name)


def name_agent(agent: str) -> str:
    """The name of a bot, or of a checkpoint by the folder that no other has."""
    parts = [part for part in Path(agent).parts if part not in ("/", "latest", "best")]
    return parts[-1] if parts else Path(agent).name


def _set_length(config: TrainConfig, budget: Length, scale: float) -> TrainConfig:
    """The settings with the budget as `total_frames`, and schedules that are scaled with it. The
    frames of a recipe stay where the plan has none.
    """
    if budget.frames is not None:
        frames = budget.frames  # scaled already
    elif config.total_frames == TrainConfig.total_frames:
        frames = ENDLESS_FRAMES
    else:
        frames = max(1, int(config.total_frames * scale))
    config = dataclasses.replace(config, total_frames=frames)
    rate, whole = config.learner.learning_rate_end, "null without total_frames or budget.frames"
    require(rate is None or frames < ENDLESS_FRAMES, "learner.learning_rate_end", rate, whole)
    if scale < 1.0:
        for path in _SCHEDULES:
            group, name = path.split(".")
            value = attrgetter(path)(config)
            if value is not None and 0 < value < ENDLESS_FRAMES:
                scaled = {name: max(1, int(value * scale))}
                own = dataclasses.replace(getattr(config, group), **scaled)
                config = dataclasses.replace(config, **{group: own})
    return config


def make_scenario(config: TrainConfig, rating: RatingSettings) -> Any:
    """The scenario of a look, with the game's rated reward."""
    game = GAMES[config.game.name]
    changes = {**config.game.options, **rating.options, "reward": game.rated_reward}
    return game.scenario(config.game.scenario, **changes)


def _check_rating(task: TaskSettings, config: TrainConfig) -> None:
    """Raise ValueError where agents cannot be rated as the task says."""
    game, scenario = GAMES[config.game.name], make_scenario(config, task.rating)
    num_teams, bots = game.make_spec(scenario).num_teams, task.rating.bots
    if num_teams == 1:
        require(not bots, "rating.bots", list(bots), "left out: the game is played alone")
    else:
        require(len(bots) > 0, "rating.bots", [], f"one or more bots: {', '.join(game.bots)}")
        games, allowed = task.rating.games, f"a multiple of {num_teams}, the number of teams"
        require(games % num_teams == 0, "rating.games", games, allowed)
    for bot in bots:
        check_name(f"{game.name} bot", bot, game.bots)
        game.bot(bot, scenario)  # raises for one that cannot play there
    for agent in task.agents:
        if not Path(agent).is_dir():
            check_name(f"{game.name} bot or checkpoint folder", agent, game.bots)


def _check_numbers(rating: RatingSettings, config: TrainConfig, factors: Iterable[str]) -> None:
    """Raise ValueError for a number that looks do not have, and for a factor with the name of one.
    Numbers of Flash games are not checked: that would start a browser.
    """
    game, known = GAMES[config.game.name], [f"against {bot}" for bot in rating.bots]
    if rating.bots:
        only_alone = "left out: against bots the score is the lowest share of the points"
        for name in ("number", "statistic"):
            given, usual = getattr(rating, name), getattr(RatingSettings, name)
            require(given == usual, f"rating.{name}", given, only_alone)
    elif not game.has_snapshots:
        return
    else:
        engine = BatchedEngine(game, make_scenario(config, rating), 1)
        known = ["return", "ended", *engine.info()]
        check_name("number of the game (rating.number)", rating.number, known)
    for factor in factors:
        require(factor not in known, "factors", factor, "another name than a number's of the game")
    marks = [f" ({100 * epsilon:g} % random)" for epsilon in rating.epsilons[1:]]
    known += [f"{name}{mark}" for name in known for mark in marks]
    known += ["score", "mean", "updates", "generated_share", "overestimation"]
    for name in rating.show:
        check_name("number of a look (rating.show)", name, known)


def require_best(config: TrainConfig, frames: int) -> None:
    """Raise ValueError if no evaluation of a run of `frames` steps chooses a best agent."""
    every, bots = config.evaluation.every_frames, config.evaluation.bots
    last = frames + -frames % (config.collector.num_worlds * config.collector.steps_per_batch)
    chooses = every <= last and (bool(bots) or config.game.spec.num_teams == 1)
    fix = f"set evaluation.bots ({', '.join(bots)}) and evaluation.every_frames ({every:,})"
    require(chooses, "rating.agent", BEST, f"latest, or {fix} to evaluate in {frames:,} steps")


def list_shortages(cells: Sequence[Cell]) -> dict[str, str]:
    """Why this machine cannot run cells, by name."""
    return {cell.name: why for cell in cells if (why := find_shortage(cell))}


def find_shortage(cell: Cell) -> str:
    """Why this machine cannot run the cell; "" if it can."""
    if cell.agent is None and cell.trainer is None:
        from marl_cair.training.memory import require_memory_of_run

        try:
            require_memory_of_run(cell.config)
        except (NotEnoughMemoryError, DeviceError) as error:
            return str(error)
    if cell.config.game.name == "flash":
        from marl_cair.games.flash.browser.installing import diagnose

        missing = diagnose(needs_display=False)
        return "; ".join(f"{one.name} is missing: {one.command}" for one in missing)
    return ""
