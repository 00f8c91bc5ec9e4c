"""Reads the log and the pictures of training runs, as JSON for the page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from marl_cair.games.replays import REPLAY_SUFFIX, count_games
from marl_cair.stored import LOG, DamagedFileError, read_text
from marl_cair.training.run_log import RunLog, parse_log
from marl_cair.training.settings.config import GAMES_FOLDER
from marl_cair.training.settings.config_file import CONFIG_FILE, read_yaml

FILES = {  # kind: folder inside of the run's, and ends of names
    "settings": ("", (".yaml",)),  # change when a run is resumed
    "log": ("", (".csv",)),
    "pictures": ("", (".png", ".gif")),
    "games": (GAMES_FOLDER, (REPLAY_SUFFIX,)),  # of the last evaluation
}


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
        ("gate/cells/exact", "gate/cells/changed_f1", "gate/cells/change_explained"),
        "share",
    ),
    Chart(
        "Generator",
        "Rewards of held-out transitions",
        ("gate/reward/mae", "gate/reward/std"),
        "mean absolute error, and spread",
    ),
    Chart(
        "Generator",
        "Ends of held-out transitions",
        ("gate/end/recall", "gate/rare/end_auc", "gate/end/false_alarms"),
        "share",
    ),
    Chart("Generator", "Loss of the generator", ("generator/",), "loss", is_log=True),
    Chart("Speed", "Environment steps per second", ("frames_per_second",), "steps per second"),
    Chart("Speed", "Where the time goes", ("seconds/",), "seconds per row of the log"),
)


class RunReader:
    """Reads one run again and again; of its log only what is new is parsed."""

    def __init__(self, label: str, folder: Path) -> None:
        self._label, self._folder, self._text = label, folder, ""  # the text of the log
        self._metrics: dict[str, tuple[list[float], list[float]]] = {}

    def read(self) -> dict[str, Any]:
        """Label, steps so far and in all, metrics, and files as `list_files`.

        Metrics are {name: [environment steps, values]}; `low` and `high` of a metric are the ends
        of its 95 % interval. Raises DamagedFileError for a file that cannot be read.
        """
        self._read_rows()
        settings = read_yaml(self._folder / CONFIG_FILE)
        game, body = settings["game"], settings["policy"]["body"]
        steps, _ = self._metrics.get("frames", ([0], []))
        return {
            "label": self._label,
            "steps": steps[-1],
            "total_steps": settings["total_frames"],
            "about": f"{game['name']} {game['scenario']}, {body}, seed {settings['seed']}",
            "metrics": self._metrics,
            **list_files(self._folder),
        }

    def _read_rows(self) -> None:
        """Add the new rows to the metrics; a log with other columns or rows is read as a whole."""
        path, header = self._folder / RunLog.FILE, self._text.partition("\n")[0]
        text = read_text(path, LOG) if path.is_file() else ""
        is_longer = self._text.endswith("\n") and text.startswith(self._text)
        new = f"{header}\n{text[len(self._text) :]}" if is_longer else text
        if not is_longer:
            self._text, self._metrics = "", {}
        for row in parse_log(new, path):
            for name, value in row.items():
                if not math.isfinite(value):
                    continue  # JSON has no such numbers
                steps, values = self._metrics.setdefault(name, ([], []))
                steps.append(row["frames"])
                values.append(value)
        self._text = text


def read_runs(readers: Iterable[RunReader]) -> dict[str, Any]:
    """What the page shows: charts and runs. Raises DamagedFileError as `RunReader.read`."""
    charts = [chart._asdict() for chart in CHARTS]
    return {"charts": charts, "runs": [reader.read() for reader in readers]}


def list_files(folder: Path) -> dict[str, dict[str, float]]:
    """The files of a run by their kind in FILES, with their times of change, so that the page asks
    again for one that was replaced. Each game of a file with several has a name, as FILE#0.
    """

    def list_kind(place: str, suffixes: Sequence[str]) -> dict[str, float]:
        paths = [path for path in sorted((folder / place).glob("*")) if path.suffix in suffixes]
        return {path.name: path.stat().st_mtime for path in paths if not path.is_symlink()}

    files = {kind: list_kind(*where) for kind, where in FILES.items()}
    files["games"] = {
        name: changed
        for file, changed in files["games"].items()
        for name in _name_games(folder / GAMES_FOLDER / file)
    }
    return files


def _name_games(path: Path) -> list[str]:
    """Names of the games of a file, for `read_replay`. A damaged file has one: opening it gives the
    error.
    """
    with suppress(DamagedFileError, OSError):
        if (num_games := count_games(path)) > 1:
            return [f"{path.name}#{number}" for number in range(num_games)]
    return [path.name]
