"""Settings of an experiment plan: tasks, factors, seeds, budget, looks; and its YAML file."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from marl_cair.outside import is_place
from marl_cair.training.settings.checks import (
    Allowed,
    Count,
    Natural,
    Positive,
    check_fields,
    require,
    require_once,
)
from marl_cair.training.settings.config_file import build_value, read_yaml

STATISTICS = ("mean", "median")
LATEST, BEST = AGENTS = ("latest", "best")
_Statistic = Annotated[str, Allowed(STATISTICS.__contains__, " or ".join(STATISTICS))]
_Agent = Annotated[str, Allowed(AGENTS.__contains__, " or ".join(AGENTS))]
_NAME = re.compile(r"[\w.+]+")
# Of the results; a factor is a column too.
_COLUMNS = (
    *("task", "unit", "runs", "seed", "look", "seconds", "frames", "steps", "score", "mean"),
    *("updates", "generated_share", "normalised", "overestimation", "return", "ended"),
    *("level", "untrained"),
)


@dataclass(frozen=True)
class RatingSettings:
    """What is measured in a look: games against bots, or alone."""

    games: Count = 100  # new games, against each bot
    bots: tuple[str, ...] = ()  # opponents; the score is the lowest against one of them
    number: str = "return"  # alone: "return", "ended" (share), or a number of the game
    statistic: _Statistic = "mean"  # of that number over the games: mean or median
    times: float = 1.0  # of score and mean, for their unit
    unit: str | None = None  # of the score, in table and figure
    options: dict[str, Any] = field(default_factory=dict)  # changes to the scenario, in looks only
    show: tuple[str, ...] = ()  # further numbers, as columns of the table
    epsilons: tuple[float, ...] = (0.0,)  # shares of random moves; the score is of the first
    agent: _Agent = "latest"  # of a run that ends: its last agent, or its best by its evaluations

    def __post_init__(self) -> None:
        check_fields(self, "rating.")
        require(len(self.epsilons) > 0, "rating.epsilons", [], "one or more")
        for epsilon in self.epsilons:
            require(0 <= epsilon <= 1, "rating.epsilons", epsilon, "in 0..1")


@dataclass(frozen=True)
class TaskSettings:
    """A game, how agents are rated there, and what they are compared with."""

    words: tuple[str, ...] = ()  # of `marl-cair train`
    # Further words by choice; null: no cell.
    when: dict[str, tuple[str, ...] | None] = field(default_factory=dict)
    agents: tuple[str, ...] = ()  # bots and checkpoints that are rated without training
    rating: RatingSettings = field(default_factory=RatingSettings)
    levels: tuple[float, ...] = ()  # scores that runs are to reach and hold
    scale: tuple[Any, ...] = ()  # scores that count as 0 and 1: numbers, or names of `agents`
    published: dict[str, float] = field(default_factory=dict)  # scores of others, by choice

    def __post_init__(self) -> None:
        require(len(self.scale) in (0, 2), "scale", list(self.scale), "two scores, or left out")
        for end in self.scale:
            known = isinstance(end, int | float) or end in self.agents
            require(known, "scale", end, f"a number, or one of agents: {list(self.agents)}")


@dataclass(frozen=True)
class Length:
    """A length of training; of two limits the one that is reached first counts."""

    frames: Count | None = None  # environment steps; null: no limit
    seconds: Positive | None = None  # of processor time, looks not counted; null: no limit

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def is_given(self) -> bool:
        """Whether there is a limit."""
        return self != Length()

    def scale(self, factor: float) -> Length:
        """The same, shorter."""
        frames = None if self.frames is None else max(1, int(self.frames * factor))
        return Length(frames, None if self.seconds is None else self.seconds * factor)

    def count(self, frames: float, seconds: float) -> float:
        """How many times it is over."""
        by_frames = frames / self.frames if self.frames else 0.0
        return max(by_frames, seconds / self.seconds if self.seconds else 0.0)


@dataclass(frozen=True)
class Plan:
    """Cells: the product of all tasks, the choices of all factors, and seeds."""

    about: str | None = None  # what is asked, for the table
    words: tuple[str, ...] = ()  # of `marl-cair train`, of all cells; later ones override
    tasks: dict[str, TaskSettings] = field(default_factory=dict)  # by name
    factors: dict[str, dict[str, tuple[str, ...]]] = field(default_factory=dict)  # words by choice
    others: dict[str, str] = field(default_factory=dict)  # module:function that trains, by name
    seeds: tuple[int, ...] = (0, 1, 2)  # of training and of the games in looks
    budget: Length = field(default_factory=Length)  # of each cell's training
    looks: Length = field(default_factory=Length)  # between two; null: at start and end alone
    games_per_pair: Natural = 0  # even; of a league of all agents in each task; 0: no league
    source: str = "published"  # of the tasks' published scores, in the table

    def __post_init__(self) -> None:
        check_fields(self)
        require(len(self.tasks) > 0, "tasks", {}, "one or more by name")
        require(len(self.seeds) > 0, "seeds", [], "one or more")
        require(
            self.games_per_pair % 2 == 0, "games_per_pair", self.games_per_pair, "an even number"
        )
        require_once("seeds", self.seeds)
        for seed in self.seeds:
            require(0 <= seed < 2**63, "seeds", seed, "0 or more")
        require(self.budget.is_given, "budget", None, "frames, seconds, or both")
        require(len(self.factors) > 0, "factors", {}, "one or more by name")
        choices = [*self.others]
        for factor, own in self.factors.items():
            require(len(own) > 0, f"factors.{factor}", own, "one or more choices by name")
            is_free = factor not in (*_COLUMNS, self.source)
            require(is_free, "factors", factor, "another name than a column's")
            choices += own
        require_once("factors and others", choices)
        for name in (*self.tasks, *self.factors, *choices):
            is_plain = isinstance(name, str) and _NAME.fullmatch(name) is not None
            require(is_plain, "a name", name, "a text of letters, digits, _, . and +")
        for name, place in self.others.items():
            require(is_place(place), f"others.{name}", place, "module:function")
        for name, task in self.tasks.items():
            self._check_choices(f"tasks.{name}.when", task.when, choices)
            self._check_choices(f"tasks.{name}.published", task.published, [*choices, *task.agents])

    def _check_choices(self, place: str, given: Iterable[str], known: list[str]) -> None:
        for name in given:
            require(name in known, place, name, f"one of {', '.join(known)}")

    def list_code(self) -> list[str]:
        """The names `module:attribute` of code in its words and `others`."""
        tasks = self.tasks.values()
        own: list[Mapping[str, tuple[str, ...] | None]] = [task.when for task in tasks]
        own += self.factors.values()
        lists = [
            self.words,
            *(task.words for task in tasks),
            *(x for by in own for x in by.values()),
        ]
        values = [word.partition("=")[2] for words in lists for word in words or ()]
        return [*self.others.values(), *filter(is_place, values)]

    @property
    def fixed(self) -> dict[str, Any]:
        """The settings that a results folder belongs to: what cells do. Seeds may be added, and
        what `find_begun` leaves out. The league at the end may change, and what only tables and
        figures show.
        """
        values = dataclasses.asdict(self)
        del values["seeds"], values["games_per_pair"], values["about"], values["source"]
        values["order"] = list(self.factors)  # cells are named in it
        for task in values["tasks"].values():
            del task["levels"], task["scale"], task["published"]
            del task["rating"]["unit"], task["rating"]["show"]
        return values


def find_begun(fixed: dict[str, Any], held: Mapping[str, Any]) -> dict[str, Any]:
    """Of `Plan.fixed`, what a folder of the plan `held` has: tasks, choices, other trainers and
    agents may be added to it.
    """
    before = {"tasks": {}, "factors": {}, "others": {}, **held}
    known = {*before["others"], *(name for own in before["factors"].values() for name in own)}

    def keep(values: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if name in names}

    begun = {**fixed, "others": keep(fixed["others"], known)}
    begun["factors"] = {name: keep(own, known) for name, own in fixed["factors"].items()}
    begun["tasks"] = {
        name: {
            **task,
            "when": keep(task["when"], known),
            "agents": [
                one for one in task["agents"] if one in before["tasks"][name].get("agents", ())
            ],
        }
        for name, task in keep(fixed["tasks"], before["tasks"]).items()
    }
    return begun


def read_plan(path: str | Path) -> Plan:
    """The plan that a YAML file describes; missing options have their defaults.

    Raises ValueError: no such file, no YAML, an unknown option, or a value that is not allowed.
    """
    if not Path(path).is_file():
        raise ValueError(f"there is no plan {str(path)!r}: give a YAML file")
    values = read_yaml(path)
    require(isinstance(values, Mapping), str(path), values, "options by name, as the guide shows")
    try:
        plan: Plan = build_value(Plan, values)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    return plan


def scale_plan(plan: Plan, factor: float) -> Plan:
    """The plan with `factor` of its budget, of the interval between looks, and of the games of a
    look (24 at the least); schedules follow in `cells.make_cells`.
    """

    def rate(task: TaskSettings) -> TaskSettings:
        # A multiple of 2, 3, 4, 6 and 12 teams.
        games = min(task.rating.games, max(24, 12 * int(task.rating.games * factor / 12)))
        return dataclasses.replace(task, rating=dataclasses.replace(task.rating, games=games))

    tasks = {name: rate(task) for name, task in plan.tasks.items()}
    lengths = plan.budget.scale(factor), plan.looks.scale(factor)
    return dataclasses.replace(plan, tasks=tasks, budget=lengths[0], looks=lengths[1])
