"""Rates an agent in a look, and keeps the looks of a cell as CSV rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.experiments.cells import Cell, make_scenario
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import play_alone
from marl_cair.lookup import find_by_name
from marl_cair.training.run_log import format_rows, read_log

Row = dict[str, float]
LOOKS_FILE = "looks.csv"
FRESH_SEED = 2_000_000  # no training or evaluation has these games
OVERESTIMATION = "q/overestimation"


def measure(agent: Any, cell: Cell, look: int) -> Row:
    """Score, mean and all numbers of `agent`, in games that no other look of its seed has.

    The agent plays greedily, but with each of `rating.epsilons` as its share of random moves, if it
    can: numbers of all but the first have "(10 % random)" after their names.
    """
    rating, game = cell.rating, GAMES[cell.config.game.name]
    scenario = make_scenario(cell.config, rating)
    seed = FRESH_SEED + 1_000 * cell.seed + look
    row: Row = {}
    usual = getattr(agent, "epsilon", 0.0)
    for epsilon in rating.epsilons:
        mark = f" ({100 * epsilon:g} % random)" if row else ""
        agent.epsilon = epsilon
        if rating.bots:
            bots = [game.bot(name, scenario) for name in rating.bots]
            scores = [
                play_match(agent, bot, game, scenario, rating.games, seed).score for bot in bots
            ]
            values = dict(zip((f"against {name}" for name in rating.bots), scores, strict=True))
            first = min(scores), float(np.mean(scores))
        else:
            played = play_alone(agent, game, scenario, rating.games, seed)
            numbers = {"return": played.scores, **played.numbers}
            summarise = np.mean if rating.statistic == "mean" else np.median
            values = {name: float(summarise(each)) for name, each in numbers.items()}
            values = {"ended": played.ended / played.games, **values}
            first = (find_by_name("number of the game (rating.number)", rating.number, values),) * 2
        row = row or {"score": first[0] * rating.times, "mean": first[1] * rating.times}
        row |= {f"{name}{mark}": value for name, value in values.items()}
    agent.epsilon = usual
    return row


def read_looks(path: Path) -> list[Row]:
    """The rows of a `looks.csv`; none without a file."""
    return [
        {name: int(v) if name in ("look", "frames", "updates") else v for name, v in row.items()}
        for row in read_log(path)
    ]


class Looks:
    """The looks of one cell, kept in `looks.csv` of its folder.

    Args:
        cell: what is rated.
        folder: of the cell.
    """

    def __init__(self, cell: Cell, folder: Path) -> None:
        self.cell, self._path = cell, folder / LOOKS_FILE
        self.rows = read_looks(self._path)

    def drop_after(self, frames: int) -> None:
        """Forget looks that a resumed run has not reached yet."""
        self.rows = [row for row in self.rows if row["frames"] <= frames]

    def is_due(self, frames: int, seconds: float) -> bool:
        """Whether an interval is over since the last look, or none was made yet."""
        every = self.cell.looks
        return not self.rows or (every.is_given and every.count(frames, seconds) >= self._last + 1)

    @property
    def last_frames(self) -> float:
        """Frames at the last look; -1 before the first."""
        return self.rows[-1]["frames"] if self.rows else -1

    @property
    def _last(self) -> int:
        return int(self.rows[-1]["look"]) if self.rows else -1

    def add(
        self, agent: Any, frames: int, seconds: float, learning: Mapping[str, float] | None = None
    ) -> None:
        """Rate the agent and write the row, with further numbers of its learning, less those that
        are not finite. Looks are numbered by the interval that has ended.
        """
        number = max(self._last + 1, int(self.cell.looks.count(frames, seconds)))
        row: Row = {"look": number, "seconds": round(seconds, 2), "frames": frames}
        row |= measure(agent, self.cell, number)
        row |= {name: value for name, value in (learning or {}).items() if math.isfinite(value)}
        self.rows.append(row)
        write_atomically(self._path, format_rows(self.rows))


def read_overestimation(log: Path, since: float) -> float:
    """Mean of a run's overestimation over the rows of its log after frame `since`, of the last
    third at the most; NaN of none.
    """
    rows: Sequence[Row] = read_log(log)
    since = max(since, rows[-1]["frames"] * 2 / 3) if rows else since
    values = [row[OVERESTIMATION] for row in rows
              if OVERESTIMATION in row and row["frames"] > since]  # fmt: skip
    return float(np.mean(values)) if values else math.nan
