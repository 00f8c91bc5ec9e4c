"""Learning curves of one or more runs as one picture, from their logs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from marl_cair.files import atomic_path
from marl_cair.training.run_log import RunLog, read_log

Rows = Sequence[Mapping[str, float]]

# Okabe and Ito's palette, which colour-blind readers can distinguish.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
_KINDS = ("real", "generated")
STYLES = ("-", "--", ":", "-.")
PANEL_INCHES = (4.6, 3.6)


def draw_curves(runs: Mapping[str, str | os.PathLike[str]], path: str | os.PathLike[str]) -> None:
    """Write a PNG of up to five panels: win rates (returns in scenarios of one team), TD errors,
    overestimation, generator, actions. A panel without logged values is left out.

    runs: label -> run folder (with log.csv). Raises ValueError if no run has logged anything.
    """
    logs = {label: read_log(Path(folder) / RunLog.FILE) for label, folder in runs.items()}
    logs = {label: rows for label, rows in logs.items() if rows}
    if not logs:
        folders = ", ".join(map(str, runs.values()))
        raise ValueError(f"no log.csv with rows in {folders}: train first")
    logged = {name for rows in logs.values() for row in rows for name in row}
    drawn = [draw for draw, starts in _PANELS if any(name.startswith(starts) for name in logged)]
    num_columns = -(-len(drawn) // 2)
    width, height = PANEL_INCHES
    figure = Figure(figsize=(num_columns * width, 2 * height), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, num_columns, squeeze=False).flatten()
    for panel in panels[len(drawn) :]:
        panel.axis("off")
    for panel, draw in zip(panels, drawn, strict=False):
        draw(panel, logs)
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.25)
        panel.set_xlabel("environment steps (thousands)")
        panel.title.set_fontsize(11)  # the longest is as wide as its panel
        for line in panel.lines:
            if len(line.get_xdata()) == 1:  # one row makes no visible line
                line.set_marker(".")
    legend = panels[len(drawn) - 1].get_legend()
    if legend is not None and 1 < len(drawn) < len(panels):
        legend.set_in_layout(False)  # it lies in the empty place beside the last panel
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=130)


def read_series(rows: Rows, name: str) -> tuple[Any, Any]:
    """Thousands of steps and values float64 [K] of the rows that have `name`."""
    points = [(row["frames"] / 1_000, row[name]) for row in rows if name in row]
    return tuple(np.array(points).T) if points else (np.array([]), np.array([]))


def _names(logs: Mapping[str, Rows], prefix: str) -> list[str]:
    found = (name for rows in logs.values() for row in rows for name in row)
    return [n for n in dict.fromkeys(found) if n.startswith(prefix) and n.count("/") == 1]


def _color(logs: Mapping[str, Rows]) -> zip[tuple[str, tuple[str, Rows]]]:
    return zip(cycle(COLOURS), logs.items(), strict=False)


def _draw_win_rates(panel: Any, logs: Mapping[str, Rows]) -> None:
    kind, joint = ("win_rate", " v ") if _names(logs, "win_rate/") else ("return", ": ")
    rated = [name.partition("/")[2] for name in _names(logs, f"{kind}/")]
    for colour, (label, rows) in _color(logs):
        for style, player in zip(cycle(STYLES), rated, strict=False):
            name, shown = f"{kind}/{player}", f"{label}{joint}{player}"
            frames, rates = read_series(rows, name)
            low, high = read_series(rows, f"{name}/low")[1], read_series(rows, f"{name}/high")[1]
            panel.plot(frames, rates, style, color=colour, label=shown, marker=".")
            if len(low) == len(rates):
                panel.fill_between(frames, low, high, color=colour, alpha=0.12, linewidth=0)
    for name in _names(logs, "fair_share/"):
        share = next(row[name] for rows in logs.values() for row in rows if name in row)
        panel.axhline(share, color="black", linewidth=0.8, label="fair share")
    panel.set(title="Greedy play, rated reward", ylabel="return of a game")
    if kind == "win_rate":
        panel.set(ylabel="score (win 1, draws are shared)", ylim=(-0.03, 1.03))
    _add_legend(panel)


def _draw_td_errors(panel: Any, logs: Mapping[str, Rows]) -> None:
    _draw_pair(panel, logs, *((f"td_error/{kind}", f"{kind} rows") for kind in _KINDS))
    panel.set(title="TD error", ylabel="mean absolute TD error", yscale="log")


def _draw_overestimation(panel: Any, logs: Mapping[str, Rows]) -> None:
    for colour, (label, rows) in _color(logs):
        panel.plot(*read_series(rows, "q/overestimation"), color=colour, label=label)
    panel.axhline(0.0, color="black", linewidth=0.8)
    panel.set(title="Q overestimation", ylabel="first max Q less realised return")
    _add_legend(panel)


def _draw_generator(panel: Any, logs: Mapping[str, Rows]) -> None:
    lines = (
        ("gate/cells/changed_f1", "changed-cell F1"),
        ("batch/generated_share", "generated share"),
    )
    _draw_pair(panel, logs, *lines)
    panel.set(title="Generator (CCDN)", ylim=(-0.03, 1.03))


def _draw_pair(panel: Any, logs: Mapping[str, Rows], *lines: tuple[str, str]) -> None:
    """A solid and a dotted line, of two names in the log with their labels, for each run that has
    logged the first.
    """
    for colour, (label, rows) in _color(logs):
        if any(lines[0][0] in row for row in rows):
            for style, (name, meaning) in zip("-:", lines, strict=True):
                values = read_series(rows, name)
                if len(values[0]):
                    panel.plot(*values, style, color=colour, label=f"{label}, {meaning}")
    _add_legend(panel)


def _draw_actions(panel: Any, logs: Mapping[str, Rows]) -> None:
    label, rows = list(logs.items())[-1]
    if len(rows) == 1:  # the mean since the run began
        rows = [{**rows[0], "frames": 0.0}, rows[0]]
    names = _names(logs, "actions/")
    frames = np.array([row["frames"] / 1_000 for row in rows])
    shares = [[row.get(name, 0.0) for row in rows] for name in names]
    kinds = [name.partition("/")[2].replace("_", " ") for name in names]
    panel.stackplot(frames, shares, labels=kinds, colors=COLOURS, alpha=0.85, linewidth=0)
    panel.set(title=f"Actions of {label}", ylabel="share of steps", ylim=(0, 1))
    # Beside the panel: many entries would hide the plot.
    _add_legend(panel, loc="center left", bbox_to_anchor=(1.02, 0.5))


# Panels, and the beginnings of the names in the log that each shows.
_PANELS: tuple[tuple[Callable[[Any, Mapping[str, Rows]], None], tuple[str, ...]], ...] = (
    (_draw_win_rates, ("win_rate/", "return/")),
    (_draw_td_errors, ("td_error/",)),
    (_draw_overestimation, ("q/overestimation",)),
    (_draw_generator, ("gate/cells/changed_f1",)),
    (_draw_actions, ("actions/",)),
)


def _add_legend(panel: Any, **place: Any) -> None:
    if panel.get_legend_handles_labels()[0]:
        panel.legend(fontsize=8, framealpha=0.85, **place)
