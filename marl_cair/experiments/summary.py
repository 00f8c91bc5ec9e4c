"""Summaries over seeds: interquartile means with intervals, equal time and steps, levels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean

from marl_cair.experiments.cells import name_agent
from marl_cair.experiments.looks import Row
from marl_cair.experiments.plan import Plan, TaskSettings

Values = NDArray[np.float64]
_LAST_PART = 1 / 3  # of the time or the steps: strength is the mean over it
_PLACES = 20  # in that part, between looks
SCORE, NORMALISED = "score", "normalised"
EQUAL_TIME, EQUAL_STEPS = "at equal time", "at equal steps"
START = "at the start"  # before the first step: what the network's first weights are worth


class Run(NamedTuple):
    """The looks of one cell."""

    task: str
    kind: tuple[str, ...]  # its choices
    seed: int
    rows: list[Row]


class Estimate(NamedTuple):
    """A value with its 95 % interval; NaN where there is none."""

    value: float
    low: float = float("nan")
    high: float = float("nan")


class Entry(NamedTuple):
    """A line of the table: runs of one task (or "all") and kind."""

    task: str
    kind: tuple[str, ...]
    num_runs: int
    values: dict[str, Estimate]


class Reached(NamedTuple):
    """A line of the table of levels, of one run."""

    run: Run
    level: float
    first: Row | None  # the first of two looks in a row at or above the level
    lowest: float  # score from then on; the best, where the level is never reached


def trim(values: Values, axis: int = -1) -> Any:
    """Interquartile mean along `axis`; of less than four values: mean."""
    return trim_mean(values, 0.25, axis)


def find_iqm(strata: Sequence[Values]) -> Estimate:
    """Interquartile mean of all values (of less than four: mean), and its interval by the
    stratified bootstrap: each stratum is drawn from apart (Agarwal et al. 2021, "Deep reinforcement
    learning at the edge of the statistical precipice").
    """

    def iqm(*parts: Any, axis: int = -1) -> Any:
        return trim(np.concatenate(parts, axis), axis)

    value = float(iqm(*strata))
    if min(map(len, strata)) < 2 or not np.isfinite(value):
        return Estimate(value)
    if all(np.ptp(part) == 0 for part in strata):
        return Estimate(value, value, value)
    drawn = bootstrap(strata, iqm, method="percentile", rng=np.random.default_rng(0))
    return Estimate(value, *map(float, drawn.confidence_interval))


def summarise(plan: Plan, runs: Sequence[Run]) -> list[Entry]:
    """An entry for each task and kind, then one over all tasks that have a scale for each kind that
    is in all of them.
    """
    entries: list[Entry] = []
    scaled: set[str] = set()
    of_all: dict[tuple[str, ...], list[Values]] = {}
    for task, about in plan.tasks.items():
        of_task = [run for run in runs if run.task == task]
        for kind in dict.fromkeys(run.kind for run in of_task):
            own = [run for run in of_task if run.kind == kind]
            columns = dict(_list_columns(plan, about, own, of_task))
            if NORMALISED in columns:
                scaled.add(task)
                of_all.setdefault(kind, []).append(columns[NORMALISED])
            values = {name: find_iqm([column]) for name, column in columns.items()}
            entries.append(Entry(task, kind, len(own), values))
    for kind, strata in of_all.items():
        if len(strata) == len(scaled) > 1:
            values = {NORMALISED: find_iqm(strata)}
            entries.append(Entry("all", kind, sum(map(len, strata)), values))
    return entries


def _list_columns(
    plan: Plan, task: TaskSettings, runs: Sequence[Run], of_task: Sequence[Run]
) -> Iterator[tuple[str, Values]]:
    """Values of the runs of one kind, float64 [runs], by column."""
    last = [run.rows[-1] for run in runs]
    score = np.array([row["score"] for row in last])
    strength = np.array([row["mean"] for row in last])
    yield "steps", np.array([row["frames"] for row in last])
    yield "seconds", np.array([row["seconds"] for row in last])
    for name in ("updates", "generated_share"):
        values = np.array([row.get(name, np.nan) for row in last])
        if np.isfinite(values).all():
            yield name, values
    if all(len(run.rows) > 1 and not run.rows[0]["frames"] for run in runs):
        yield START, np.array([run.rows[0]["score"] for run in runs])
    yield SCORE, score
    if plan.looks.is_given and all(len(run.rows) > 1 for run in runs):
        for column, axis in ((EQUAL_TIME, "seconds"), (EQUAL_STEPS, "frames")):
            trained = [run for run in of_task if len(run.rows) > 1]
            end = min(run.rows[-1][axis] for run in trained)
            yield column, np.array([find_strength(run.rows, axis, end) for run in runs])
        strength = np.array([find_strength(run.rows, "seconds", end_of(run)) for run in runs])
    if scale := _find_scale(task, of_task):
        yield NORMALISED, (strength - scale[0]) / (scale[1] - scale[0])
    for name in task.rating.show:
        yield name, np.array([row.get(name, np.nan) for row in last])
    excess = [_read_last(run, "overestimation") for run in runs]
    if all(excess):
        yield "overestimation", np.array([np.mean(values) for values in excess])


def _read_last(run: Run, name: str) -> list[float]:
    """The numbers of a run's looks in the last third of its time."""
    begin = end_of(run) - end_of(run) * _LAST_PART
    return [row[name] for row in run.rows if name in row and row["seconds"] >= begin]


def end_of(run: Run) -> float:
    """Processor seconds at the last look."""
    return run.rows[-1]["seconds"]


def find_strength(rows: Sequence[Row], axis: str, end: float) -> float:
    """Mean of a run's mean scores over the last third before `end`, straight between looks."""
    places = np.linspace(end * (1 - _LAST_PART), end, _PLACES)
    known = [row[axis] for row in rows], [row["mean"] for row in rows]
    return float(np.mean(np.interp(places, *known)))


def _find_scale(task: TaskSettings, of_task: Sequence[Run]) -> tuple[float, float] | None:
    """The scores that count as 0 and 1; None where an agent of the scale is not rated yet."""
    ends = []
    for end in task.scale:
        if isinstance(end, str):
            name = name_agent(end)
            scores = [r.rows[-1]["mean"] for r in of_task if name in r.kind and not end_of(r)]
            ends.append(float(np.mean(scores)) if scores else np.nan)
        else:
            ends.append(float(end))
    low, high = ends or (np.nan, np.nan)
    return (low, high) if np.isfinite(high - low) and high != low else None


def find_levels(plan: Plan, runs: Sequence[Run]) -> list[Reached]:
    """Whether each run reaches each level of its task, and holds it at all later looks."""
    kinds = list(dict.fromkeys((run.task, run.kind) for run in runs))
    return [
        find_level(run, level)
        for run in sorted(runs, key=lambda run: kinds.index((run.task, run.kind)))
        if run.rows[-1]["frames"]
        for level in plan.tasks[run.task].levels
    ]


def find_level(run: Run, level: float, number: str = "score") -> Reached:
    """When a run's `number` is at or above `level` in two looks in a row for the first time, not
    counting the untrained network.
    """
    trained = [row for row in run.rows if row["frames"]]
    first = next((a for a, b in pairwise(trained) if min(a[number], b[number]) >= level), None)
    if first is None:
        return Reached(run, level, None, max(row[number] for row in trained))
    later = [row[number] for row in trained if row["seconds"] >= first["seconds"]]
    return Reached(run, level, first, min(later))
