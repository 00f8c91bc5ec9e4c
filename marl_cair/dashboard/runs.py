"""Reads the log and the pictures of training runs, as JSON for the page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from marl_cair.games.replays import REPLAY_SUFFIX
from marl_cair.training.run_log import RunLog, read_log
from marl_cair.training.settings.config import GAMES_FOLDER
from marl_cair.training.settings.config_file import CONFIG_FILE, read_yaml

PICTURES = ".png", ".gif"


class Chart(NamedTuple):
    """A chart of all metrics that begin with one of `starts`, for all runs."""

    section: str
    title: str
    starts: tuple[str, ...]
    unit: str  # of the vertical axis
    is_log: bool = False  # scale of the vertical axis


CHARTS = (
    Chart("Strength", "Greedy games against each bot", ("win_rate/", "fair_share/"), "score"),
    Chart("Strength", "Greedy games", ("return/", "return_gain/"), "return of a game"),
    Chart("Strength", "Games of training", ("collect_win_rate/",), "score"),
    Chart("Learning", "TD error", ("td_error/",), "mean absolute TD error", is_log=True),
    Chart("Learning", "Loss", ("loss/",), "loss", is_log=True),
    Chart("Learning", "Overestimation", ("q/",), "first max Q less realised return"),
    Chart("Learning", "Exploration", ("epsilon",), "share of random actions"),
    Chart("Learning", "Actions", ("actions/",), "share of steps"),
    Chart("Generator", "Open gate, generated share", ("gate/passed", "batch/"), "share"),
    Chart(
        "Generator",
        "Cells of held-out transitions",
        ("gate/cells/error", "gate/cells/copy_error", "gate/cells/exact", "gate/cells/changed_f1"),
        "share",
    ),
    Chart(
        "Generator",
        "Rewards of held-out transitions",
        ("gate/reward/mae", "gate/reward/constant_mae"),
        "mean absolute error",
    ),
    Chart(
        "Generator",
        "Ends of held-out transitions",
        ("gate/terminal/recall", "gate/terminal/auc", "gate/terminal/false_alarms"),
        "share",
    ),
    Chart("Generator", "Loss of the generator", ("generator/",), "loss", is_log=True),
    Chart("Speed", "Environment steps per second", ("frames_per_second",), "steps per second"),
    Chart("Speed", "Where the time goes", ("seconds/",), "seconds per row of the log"),
)


def read_runs(runs: Mapping[str, Path]) -> dict[str, Any]:
    """What the page shows: charts, and of each run its metrics, pictures and games.

    Metrics are {name: [environment steps, values]}; `low` and `high` of a metric are the ends of
    its 95 % interval. Raises DamagedFileError for a file that cannot be read.
    """
    return {
        "charts": [chart._asdict() for chart in CHARTS],
        "runs": [read_run(label, folder) for label, folder in runs.items()],
    }


def read_run(label: str, folder: Path) -> dict[str, Any]:
    """One run: label, steps so far and in all, metrics, pictures and games."""
    metrics: dict[str, tuple[list[float], list[float]]] = {}
    rows = read_log(folder / RunLog.FILE)
    for row in rows:
        for name, value in row.items():
            steps, values = metrics.setdefault(name, ([], []))
            steps.append(row["frames"])
            values.append(value)
    settings = read_yaml(folder / CONFIG_FILE)
    return {
        "label": label,
        "steps": rows[-1]["frames"] if rows else 0,
        "total_steps": settings["total_frames"],
        "about": describe(settings),
        "metrics": metrics,
        "pictures": list_pictures(folder),
        "games": list_games(folder),
    }


def describe(settings: Mapping[str, Any]) -> str:
    """A run in one line, for example "deep_line_wars 10x15, conv, seed 0"."""
    game, policy = settings["game"], settings["policy"]
    return f"{game['name']} {game['scenario']}, {policy['body']}, seed {settings['seed']}"


def list_pictures(folder: Path) -> dict[str, float]:
    """Pictures directly in the run's folder, with their times of change, so that the page asks
    again for one that was replaced.
    """
    paths = [path for path in sorted(folder.iterdir()) if path.suffix in PICTURES]
    return {path.name: path.stat().st_mtime for path in paths if not path.is_symlink()}


def list_games(folder: Path) -> dict[str, float]:
    """Recorded games of the last evaluation, with their times of change."""
    paths = sorted((folder / GAMES_FOLDER).glob(f"*{REPLAY_SUFFIX}"))
    return {path.name: path.stat().st_mtime for path in paths if not path.is_symlink()}
