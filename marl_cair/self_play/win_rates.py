"""Win rates of a learner against each opponent; older games have less weight."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from marl_cair.ranges import COUNT, SCORE, WEIGHT, Range, check_number, read_number

OPPONENT = Range(-(2**15), 2**15 - 1)  # numbers of opponents: int16 in replay
_LOG_WEALTH = Range(-1e9, 1e9, float)
EVEN = 0.5  # score between equal agents: a win counts 1, a draw 1/2
MOST_STAKED = 0.75  # of a bettor's wealth, on one game
_PRIOR_GAMES = 2.0  # even ones, before the first that a bettor has seen


class Evidence(NamedTuple):
    """Weighted results of one pairing."""

    points: float = 0.0  # a win 1, a draw 1/2
    games: float = 0.0  # older games have less weight

    def estimate(self, prior_games: float) -> float:
        """Expected score in 0..1, with `prior_games` even games added."""
        total = self.games + prior_games
        return (self.points + EVEN * prior_games) / total if total else EVEN


class BettingTest:
    """Anytime-valid test whether scores against opponents are above a bar: it may be checked at any
    time, and its probability of ever being wrong about an opponent is at most `error`.

    A bettor stakes a part of its wealth on each game's score being above the bar. If the expected
    score is not, wealth is a supermartingale, which ever reaches 1 / error with a probability of at
    most `error` (Ville 1939; Waudby-Smith and Ramdas 2024, "Estimating means of bounded random
    variables by betting"). The stake is Kelly's for the score that was expected before the game.
    Games count in the order of their numbers, not of their ends: short ones, which end first, may
    be those that the learner wins.

    Args:
        bar, error: above 0 and below 1, else raises ValueError.
    """

    def __init__(self, bar: float, error: float) -> None:
        for name, value in (("bar", bar), ("error", error)):
            if not 0.0 < value < 1.0:
                raise ValueError(f"{name} is {value!r}, it must be above 0 and below 1")
        self._bar, self._limit = bar, -math.log(error)
        self._log_wealth: dict[int, float] = {}
        self._met: dict[int, Evidence] = {}
        self._waiting: list[tuple[int, int, float]] = []  # a heap: game, opponent, score

    def book(self, game: int, opponent: int, score: float) -> None:
        """Add the score in 0..1 of a game that has ended."""
        heapq.heappush(self._waiting, (game, opponent, score))

    def settle(self, running: int) -> None:
        """Bet on the games before `running`, the lowest number of a game that is still played."""
        while self._waiting and self._waiting[0][0] < running:
            _, opponent, score = heapq.heappop(self._waiting)
            bar, met = self._bar, self._met.get(opponent, Evidence())
            edge = (met.estimate(_PRIOR_GAMES) - bar) / (bar * (1.0 - bar))
            stake = min(max(0.0, edge), MOST_STAKED / bar)
            gain = math.log1p(stake * (score - bar))
            self._log_wealth[opponent] = self._log_wealth.get(opponent, 0.0) + gain
            self._met[opponent] = Evidence(met.points + score, met.games + 1.0)

    def is_above(self, opponent: int) -> bool:
        """Whether the score against `opponent` is significantly above the bar."""
        return self._log_wealth.get(opponent, 0.0) >= self._limit

    def clear(self) -> None:
        """Forget all bets; games that wait for earlier ones still count."""
        self._log_wealth, self._met = {}, {}

    def state_dict(self) -> dict[str, Any]:
        """As plain data."""
        held = {"log_wealth": dict(self._log_wealth), "waiting": list(self._waiting)}
        return {**held, "met": {number: tuple(one) for number, one in self._met.items()}}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore `state_dict`. Raises ValueError for impossible numbers."""
        held = {_read_opponent(number): wealth for number, wealth in state["log_wealth"].items()}
        for number in held:
            read_number(held, number, _LOG_WEALTH)
        self._met = {_read_opponent(n): one for n, one in read_evidence(state["met"]).items()}
        waiting = [
            (check_number(game, "game", COUNT), _read_opponent(n), check_number(s, "score", SCORE))
            for game, n, s in state["waiting"]
        ]
        heapq.heapify(waiting)
        self._log_wealth, self._waiting = held, waiting


class WinRecords:
    """Games of the learner by the number of the opponent that played them.

    A game's weight halves with every `half_life_frames` of training, so that estimates for
    opponents that were not played for long return to even, and samplers return to them.

    Args:
        half_life_frames: frames of training; above 0, else raises ValueError.
        prior_games: even games that are added to each estimate; above 0.
    """

    def __init__(self, half_life_frames: float, prior_games: float = 2.0) -> None:
        for name, value in (("half_life_frames", half_life_frames), ("prior_games", prior_games)):
            if not value > 0:
                raise ValueError(f"{name} is {value!r}, it must be above 0")
        self.half_life_frames, self.prior_games = half_life_frames, prior_games
        self._faded: dict[int, tuple[float, float, int]] = {}  # points, games, frames then
        self._counts: dict[int, int] = {}

    def book(self, number: int, score: float, frames: int) -> None:
        """Add a game against `number` that ended at `frames`: 1 won, 0 lost, 1/2 drawn. Raises
        ValueError for a score outside 0..1.
        """
        if not 0.0 <= score <= 1.0:
            raise ValueError(f"the score against opponent {number} is {score!r}, not in 0..1")
        points, games = self.evidence(number, frames)
        self._faded[number] = (points + score, games + 1.0, frames)
        self._counts[number] = self.count(number) + 1

    def evidence(self, number: int, frames: int) -> Evidence:
        """Points and games against `number`, as weighted at `frames`."""
        points, games, then = self._faded.get(number, (0.0, 0.0, frames))
        weight = 0.5 ** (max(0, frames - then) / self.half_life_frames)
        return Evidence(points * weight, games * weight)

    def estimate(self, number: int, frames: int) -> float:
        """Expected score against `number`, in 0..1."""
        return self.evidence(number, frames).estimate(self.prior_games)

    def count(self, number: int) -> int:
        """Number of all games against `number`."""
        return self._counts.get(number, 0)

    def clear(self) -> None:
        """Forget all games."""
        self._faded, self._counts = {}, {}

    def state_dict(self) -> dict[str, Any]:
        """All games, as plain data."""
        return {"faded": dict(self._faded), "counts": dict(self._counts)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Restore `state_dict`. Raises ValueError for impossible numbers."""
        faded, counts = {}, {}
        for number, (points, games, then) in state["faded"].items():
            kept = read_evidence({number: (points, games)})[number]
            faded[_read_opponent(number)] = (*kept, int(check_number(then, "frames", COUNT)))
        for number in state["counts"]:
            counts[_read_opponent(number)] = int(read_number(state["counts"], number, COUNT))
        self._faded, self._counts = faded, counts


def _read_opponent(number: Any) -> int:
    return int(check_number(number, "the number of an opponent", OPPONENT))


def read_evidence(met: Mapping[Any, Any]) -> dict[Any, Evidence]:
    """Evidence from plain data, by the same keys. Raises ValueError for impossible numbers."""
    found = {}
    for key, (points, games) in met.items():
        played = check_number(games, "games", WEIGHT)
        found[key] = Evidence(check_number(points, "points", Range(0.0, played, float)), played)
    return found
