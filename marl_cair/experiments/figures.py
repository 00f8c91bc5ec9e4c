"""Draws scores over time and steps, or at the end; and the thesis's panels of training logs."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from marl_cair.experiments.cells import name_agent
from marl_cair.experiments.plan import Plan
from marl_cair.experiments.summary import SCORE, START, Entry, Run, trim
from marl_cair.files import atomic_path
from marl_cair.games import GAMES
from marl_cair.training.curves import COLOURS, STYLES, read_series
from marl_cair.training.run_log import read_log

_PANEL = (4.6, 3.3)  # inches
_PLACES = 60  # of a mean curve
_MOST_LINES, _RESAMPLES = 5, 500
Kind = tuple[str, ...]


def draw_results(plan: Plan, runs: Sequence[Run], entries: Sequence[Entry], path: Path) -> None:
    """With looks while training a column for each task: scores over processor seconds and over
    steps, the interquartile mean with its 95 % bootstrap interval; up to five runs are thin lines.
    Else scores at the end, two tasks in a row: a colour for each choice of the first factor.
    """
    tasks = [task for task in plan.tasks if any(run.task == task for run in runs)]
    kinds = list(dict.fromkeys(run.kind for run in runs))
    has_curves = plan.looks.is_given
    shape = (2, len(tasks)) if has_curves else (-(-len(tasks) // 2), min(2, len(tasks)))
    figure = _make_figure(shape[1], shape[0])
    panels = figure.subplots(*shape, squeeze=False)
    columns = panels.T if has_curves else panels.reshape(-1, 1)
    for column in columns[len(tasks) :]:
        column[0].set_axis_off()
    for column, task in zip(columns, tasks, strict=False):
        about, own = plan.tasks[task], [run for run in runs if run.task == task]
        label = textwrap.fill(about.rating.unit or _name_score(plan, task), 40)
        if has_curves:
            for panel, axis in zip(column, ("seconds", "frames"), strict=True):
                _draw_curves(panel, own, kinds, axis, plan)
                panel.set_ylabel(label)
                for level in about.levels:
                    panel.axhline(level, color="0.6", linewidth=0.8, linestyle=":")
            column[0].set_xlabel("processor seconds of training")
            column[1].set_xlabel("environment steps (thousands)")
        else:
            _draw_ends(column[0], [one for one in entries if one.task == task], plan)
            column[0].set_xlabel(label)
        column[0].set_title(name_task(task), fontsize=10)
    for panel in panels.flat:
        _tidy(panel)
    legend: dict[str, Any] = {}
    for panel in panels.flat:
        handles, labels = panel.get_legend_handles_labels()
        legend |= dict(zip(labels, handles, strict=True))
    if legend:
        num_columns = min(6, 2 * panels.shape[1], len(legend))
        style: dict[str, Any] = {"fontsize": 8, "frameon": False, "ncols": num_columns}
        figure.legend(legend.values(), legend, loc="outside lower center", **style)
    _save(figure, path)


def name_task(task: str) -> str:
    """The title of the game that the task is called after, or the task's name in words."""
    return GAMES[task].title if task in GAMES else task.replace("_", " ").capitalize()


def _name_score(plan: Plan, task: str) -> str:
    rating = plan.tasks[task].rating
    if not rating.bots:
        if rating.number == "ended":
            return "share of games ended in time"
        return f"{rating.statistic} {rating.number}".replace("_", " ")
    bot = rating.bots[0] if len(rating.bots) == 1 else "the hardest bot"
    return f"score against {bot}"


def _style(kinds: Sequence[Kind], kind: Kind) -> dict[str, Any]:
    place = kinds.index(kind)
    style = STYLES[place // len(COLOURS) % len(STYLES)]
    return {"color": COLOURS[place % len(COLOURS)], "linestyle": style}


def _label(plan: Plan, kind: Kind) -> str:
    """The choices, with the names of all factors but the first."""
    first, *others = zip(plan.factors, kind, strict=False)  # of some factors only
    parts = [first[1], *(f"{factor} {choice}" for factor, choice in others if choice)]
    return ", ".join(parts).replace("_", " ")


def _draw_curves(
    panel: Any, runs: Sequence[Run], kinds: Sequence[Kind], axis: str, plan: Plan
) -> None:
    for kind in kinds:
        own, label = [run for run in runs if run.kind == kind], _label(plan, kind)
        if not own:
            panel.plot([], [], **_style(kinds, kind), label=label)  # for the legend
            continue
        unit = 1_000 if axis == "frames" else 1
        trained = [run for run in own if len(run.rows) > 1]
        if not trained:  # rated without training
            score = trim(np.array([run.rows[-1]["score"] for run in own]))
            panel.axhline(score, **_style(kinds, kind), linewidth=1.2, label=label)
            continue
        curves = [([row[axis] / unit for row in run.rows], [row["score"] for row in run.rows])
                  for run in trained]  # fmt: skip
        for places, scores in curves if len(curves) <= _MOST_LINES else ():
            panel.plot(places, scores, **_style(kinds, kind), linewidth=0.6, alpha=0.35)
        grid = np.linspace(0, min(places[-1] for places, _ in curves), _PLACES)
        known = np.array([np.interp(grid, *curve) for curve in curves])
        if len(curves) > 1:
            drawn = np.random.default_rng(0).integers(len(curves), size=(_RESAMPLES, len(curves)))
            low, high = np.percentile(trim(known[drawn], 1), (2.5, 97.5), axis=0)
            panel.fill_between(
                grid, low, high, color=_style(kinds, kind)["color"], alpha=0.13, lw=0
            )
        panel.plot(grid, trim(known, 0), **_style(kinds, kind), linewidth=2, label=label)


def _draw_ends(panel: Any, entries: Sequence[Entry], plan: Plan) -> None:
    if not entries:
        return
    colours = dict(zip(next(iter(plan.factors.values())), COLOURS * len(entries), strict=False))
    known = {
        name_agent(name): score for name, score in plan.tasks[entries[0].task].published.items()
    }
    for place, entry in zip(reversed(range(len(entries))), entries, strict=True):
        one, colour = entry.values[SCORE], colours.get(entry.kind[0], "0.35")  # grey: not trained
        if np.isfinite(one.low):
            panel.plot([one.low, one.high], [place, place], color=colour, linewidth=2)
        panel.plot(one.value, place, "o", color=colour)
        if START in entry.values:
            panel.plot(entry.values[START].value, place, "|", color=colour)
            panel.plot([], [], "|", color="0.35", label=START)  # for the legend
        for choice in entry.kind:
            if (score := known.pop(choice, None)) is not None:  # once: at its first line
                panel.plot(score, place, "D", color="0.35", mfc="none", label=plan.source)
    panel.set_yticks(range(len(entries)), [_label(plan, one.kind) for one in reversed(entries)])


def draw_panels(title: str, logs: Mapping[str, Sequence[Path]], path: Path) -> None:
    """The thesis's three panels for each network: loss, win rate or return of training games, and
    shares of actions (of the first run).

    logs: log.csv of each run by network. Networks whose runs have logged nothing are left out.
    """
    rows = {name: [read_log(log) for log in files] for name, files in logs.items()}
    rows = {name: read for name, of_runs in rows.items() if (read := [r for r in of_runs if r])}
    if not rows:
        return
    figure = _make_figure(3, len(rows))
    panels = figure.subplots(len(rows), 3, squeeze=False)
    for line, (name, of_runs) in zip(panels, rows.items(), strict=True):
        for number, log in enumerate(of_runs):
            colour = {"color": COLOURS[number % len(COLOURS)], "linewidth": 1.2, "marker": "."}
            line[0].plot(*read_series(log, "loss/all"), **colour)
            line[1].plot(*read_series(log, _find_success(log)), **colour)
        success = _find_success(of_runs[0])
        line[0].set(ylabel=f"{name}\nloss", title="Loss", yscale="log")
        line[1].set(ylabel=_SUCCESS[success.partition("/")[0]], title="Win rate or return")
        shares = [key for key in of_runs[0][-1] if key.startswith("actions/")]
        steps = [row["frames"] / 1_000 for row in of_runs[0]]
        names = [key.removeprefix("actions/").replace("_", " ") for key in shares]
        stacked = [[100 * row.get(key, 0.0) for row in of_runs[0]] for key in shares]
        if len(steps) == 1:  # the mean since the run began
            steps, stacked = [0.0, *steps], [values * 2 for values in stacked]
        colours = [COLOURS[place % len(COLOURS)] for place in range(len(names))]
        line[2].stackplot(steps, stacked, labels=names, colors=colours, alpha=0.85, linewidth=0)
        line[2].set(ylabel="% of steps", title="Action frequency", ylim=(0, 100))
        line[2].legend(fontsize=6, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
        for panel in line:
            _tidy(panel)
            panel.set_xlabel("environment steps (thousands)")
            panel.set_xlim(left=0)
            panel.title.set_fontsize(9)
    figure.suptitle(title)
    _save(figure, path)


_SUCCESS = {"collect_win_rate": "win rate in training", "episodes": "return of a game in training"}


def _find_success(log: Sequence[Mapping[str, float]]) -> str:
    names = [name for row in log for name in row if name.startswith("collect_win_rate/")]
    return names[0] if names else "episodes/return"


def _make_figure(num_columns: int, num_rows: int) -> Figure:
    width, height = _PANEL
    figure = Figure(figsize=(width * num_columns, height * num_rows), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _tidy(panel: Any) -> None:
    panel.spines[["top", "right"]].set_visible(False)
    panel.grid(alpha=0.25)
    panel.set_axisbelow(True)
    panel.tick_params(labelsize=8)


def _save(figure: Figure, path: Path) -> None:
    """Write the picture, and the same as PDF beside it."""
    for one in (path, path.with_suffix(".pdf")):
        with atomic_path(one) as unfinished:
            figure.savefig(unfinished, dpi=130)
