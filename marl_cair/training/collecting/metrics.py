"""Metrics of a training run: episode statistics, running means and timers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from marl_cair import ranges
from marl_cair.games.game import NO_WINNER, GameSpec
from marl_cair.games.torchrl_env import LastStep
from marl_cair.league.play.standings import share_points
from marl_cair.ranges import COUNT, MOST, SCORE, Range
from marl_cair.replay.transition import NO_ACTION
from marl_cair.self_play.win_rates import OPPONENT
from marl_cair.training.collecting.opponents import Meeting

_VALUE = Range(-1e300, 1e300, float)
_RANGES = {  # of saved arrays
    "first_value": _VALUE,
    "return": _VALUE,
    "reward_sum": _VALUE,
    "discount": SCORE,
    "decisions": COUNT,
    "actions": COUNT,
}


class Decisions(NamedTuple):
    """One step of all seats of all worlds; the arrays are overwritten at the next step."""

    actions: NDArray[np.int64]  # [B, P], or [B, P, H, W] with NO_ACTION where no unit acts
    owned: NDArray[np.bool_]  # [B, P] seats of the learner
    shown: NDArray[np.bool_]  # [B, P] those of them that a demonstrator played
    assisted: NDArray[np.bool_]  # [B, P] those that a demonstrator has played in this game
    out: NDArray[np.bool_]  # [B, P] seats that were out by then
    team: NDArray[np.int64]  # [B] the learner's
    opponent: NDArray[np.int16]  # [B, P] number of the seat's policy; of the learner's LATEST_ID


def find_meetings(
    taken: Decisions, last: LastStep, team_of_seat: NDArray[np.int64], games: NDArray[np.int64]
) -> list[Meeting]:
    """The learner's result against each rival team of those of `games` [B] that have just ended.

    Teams that the learner plays too are no rivals, and games in which a demonstrator played for it
    do not count.
    """
    meetings = []
    ended = np.flatnonzero(last.ended & ~taken.assisted.any(1))
    points = share_points(last.winner[ended], taken.out[ended], team_of_seat)
    first_seats = np.unique(team_of_seat, return_index=True)[1].tolist()
    for world, of_teams in zip(ended.tolist(), points.tolist(), strict=True):
        own = of_teams[taken.team[world]]
        for team, seat in enumerate(first_seats):
            opponent = int(taken.opponent[world, seat])
            if not taken.owned[world, seat]:
                score = (1.0 + own - of_teams[team]) / 2.0
                meetings.append(Meeting(opponent, score, own, int(games[world])))
    return meetings


class EpisodeStatistics:
    """Outcomes of the learner's games since the last report, and its optimism.

    The overestimation of a game is the learner's highest legal value at the first decision less the
    discounted return that it then realised, exploration included, both in scaled rewards. The
    return that is reported is the plain sum of a seat's rewards. The win rate against an opponent
    is the mean of the points of the learner's team over the rival teams that it played:
    `standings.share_points`; fair is 1 / teams.

    Args:
        num_worlds: B.
        spec: of the game.
        gamma: discount per decision.
        reward_scale: of the learner's rewards.
    """

    def __init__(
        self, num_worlds: int, spec: GameSpec, gamma: float, reward_scale: float = 1.0
    ) -> None:
        seats = (num_worlds, spec.num_players)
        self._gamma, self._reward_scale, self._groups = gamma, reward_scale, spec.action_groups
        self._running: dict[str, NDArray[Any]] = {
            "first_value": np.zeros(seats),
            "return": np.zeros(seats),
            "reward_sum": np.zeros(seats),
            "discount": np.ones(seats),
            "decisions": np.zeros(num_worlds, np.int64),
            "actions": np.zeros(int(self._groups.max()) + 1, np.int64),
        }
        self._clear()

    def _clear(self) -> None:
        self._results: dict[int, list[float]] = {}
        self._excess: list[float] = []
        self._reward_sums: list[float] = []
        self._shown_sums: list[float] = []
        self._lengths: list[int] = []
        self._num_drawn = 0
        self._running["actions"][:] = 0

    def note_first_values(
        self, starting: NDArray[np.bool_], learned: NDArray[np.bool_], best: NDArray[np.float32]
    ) -> None:
        """Games [B] that begin: best legal values of the learned seats, in `learned` order."""
        values, running = np.zeros(learned.shape), self._running
        values[learned] = best
        running["first_value"][starting] = values[starting]
        for name in ("return", "reward_sum", "decisions"):
            running[name][starting] = 0
        running["discount"][starting] = 1.0

    def note_step(self, taken: Decisions, last: LastStep, meetings: Iterable[Meeting]) -> None:
        """Add one step of all worlds with its outcome; `meetings` from `find_meetings`."""
        running = self._running
        running["return"] += running["discount"] * self._reward_scale * last.rewards
        running["reward_sum"] += last.rewards
        running["discount"] *= self._gamma
        running["decisions"] += 1
        own = taken.owned & ~taken.shown
        chosen = taken.actions[own & ~taken.out]
        kinds = self._groups[chosen[chosen != NO_ACTION]]
        running["actions"] += np.bincount(kinds, minlength=len(running["actions"]))
        for met in meetings:
            self._results.setdefault(met.opponent, []).append(met.points)
        for world in np.flatnonzero(last.ended).tolist():
            assisted, sums = taken.assisted[world], running["reward_sum"][world]
            self._shown_sums += sums[assisted].tolist()
            seats = np.flatnonzero(taken.owned[world] & ~assisted)
            if not len(seats):
                continue
            excess = running["first_value"][world, seats] - running["return"][world, seats]
            self._excess += excess.tolist()
            self._reward_sums += sums[seats].tolist()
            self._lengths.append(int(running["decisions"][world]))
            self._num_drawn += int(last.winner[world] == NO_WINNER)

    def report(self, name: Callable[[int], str], group_names: tuple[str, ...]) -> dict[str, float]:
        """Means since the last report, by log name. `name`: from an opponent's number."""
        row: dict[str, float] = {"episodes/finished": len(self._lengths)}
        if self._lengths:
            row["episodes/decisions"] = float(np.mean(self._lengths))
            row["episodes/drawn"] = self._num_drawn / len(self._lengths)
            row["episodes/return"] = float(np.mean(self._reward_sums))
            row["q/overestimation"] = float(np.mean(self._excess))
        if self._shown_sums:
            row["demonstrations/return"] = float(np.mean(self._shown_sums))
        by_name: dict[str, list[float]] = {}
        for number, results in self._results.items():
            by_name.setdefault(name(number), []).extend(results)
        for opponent, results in by_name.items():
            row[f"collect_win_rate/{opponent}"] = float(np.mean(results))
        actions = self._running["actions"]
        total = max(1, int(actions.sum()))
        for kind, count in zip(group_names, actions.tolist(), strict=True):
            row[f"actions/{kind}"] = count / total
        self._clear()
        return row

    def export_state(self) -> dict[str, Any]:
        """Running games and unreported ones as tensors and plain data."""
        return {
            "arrays": {name: torch.tensor(value) for name, value in self._running.items()},
            "results": {number: list(values) for number, values in self._results.items()},
            "excess": list(self._excess),
            "reward_sums": list(self._reward_sums),
            "shown_sums": list(self._shown_sums),
            "lengths": list(self._lengths),
            "num_drawn": self._num_drawn,
        }

    def import_state(self, state: Mapping[str, Any]) -> None:
        """Continue from `export_state`."""
        self._running = ranges.take_arrays(state["arrays"], self._running, _RANGES)
        self._results = {
            ranges.check_number(number, "the number of an opponent", OPPONENT): ranges.read_numbers(
                points, "results", SCORE
            )
            for number, points in state["results"].items()
        }
        self._excess = ranges.read_numbers(state["excess"], "excess", _VALUE)
        self._lengths = ranges.read_numbers(state["lengths"], "lengths", COUNT)
        self._reward_sums = ranges.read_numbers(state["reward_sums"], "reward_sums", _VALUE)
        self._shown_sums = ranges.read_numbers(state["shown_sums"], "shown_sums", _VALUE)
        self._num_drawn = ranges.read_number(state, "num_drawn", COUNT)


class RunningMeans:
    """Means of scalars by name; tensors are read only when reported, to avoid waiting for them."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor | float] = {}
        self._counts: dict[str, int] = {}

    def add(self, values: Mapping[str, Tensor | float]) -> None:
        """Take one more value of each name."""
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0.0) + value
            self._counts[name] = self._counts.get(name, 0) + 1

    def report(self) -> dict[str, float]:
        """Means since the last report."""
        means = {name: float(total) / self._counts[name] for name, total in self._sums.items()}
        self._sums, self._counts = {}, {}
        return means

    def export_state(self) -> dict[str, Any]:
        """Sums and counts as plain data."""
        return {"sums": dict(self._sums), "counts": dict(self._counts)}

    def import_state(self, state: Mapping[str, Any]) -> None:
        """Continue from `export_state`."""
        least = Range(1, MOST)
        counts = {n: ranges.read_number(state["counts"], n, least) for n in state["sums"]}
        for name, total in state["sums"].items():
            if not isinstance(name, str) or not _is_single(total):
                raise ValueError(f"the sum {name!r:.80} is no number by name")
        self._sums, self._counts = dict(state["sums"]), counts


def _is_single(value: Any) -> bool:
    return isinstance(value, int | float) or (
        isinstance(value, Tensor) and value.numel() == 1 and not value.is_complex()
    )


class Timers:
    """Seconds spent in each part of the loop."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    @contextmanager
    def measure(self, part: str) -> Iterator[None]:
        """Add the duration of the block to `part`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self._seconds[part] = self._seconds.get(part, 0.0) + time.perf_counter() - start

    def report(self, frames: int) -> dict[str, float]:
        """Seconds by part and frames per second of the whole since the last report."""
        total = sum(self._seconds.values())
        row = {f"seconds/{part}": seconds for part, seconds in self._seconds.items()}
        row["frames_per_second"] = frames / total if total else 0.0
        self._seconds = {}
        return row
