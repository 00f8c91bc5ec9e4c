"""Win rates of a learner against each opponent, with older games weighing less."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from marl_cair.ranges import COUNT, WEIGHT, Range, check_number, read_number

OPPONENT = Range(-(2**15), 2**15 - 1)  # numbers of opponents: int16 in replay
_LOG_WEALTH = Range(-1e9, 1e9, float)
EVEN = 0.5  # score of equals: a win counts 1, a draw 1/2
MOST_STAKED = 0.75  # of a bettor's wealth, on one game


class Evidence(NamedTuple):
    """What is known of one pairing.

    Attributes:
        points: of the games, a win 1, a draw 1/2; faded, as the games are.
        games: played, each weighing less the older it is.
    """

    points: float = 0.0
    games: float = 0.0

    def estimate(self, prior_games: float) -> float:
        """The score to expect, in 0..1: `prior_games` even games are added to those played."""
        total = self.games + prior_games
        return (self.points + EVEN * prior_games) / total if total else EVEN


class BettingTest:
    """Whether scores against opponents are above a bar, looked at after any game and as often as
    wanted: with a chance of `error` at most it is ever said of one whose expected score is not.

    A bettor stakes a part of its wealth on each game's score being above the bar. While the
    expected score is not, wealth is a supermartingale, which ever reaches 1 / error with the chance
    `error` at most (Ville 1939; Waudby-Smith and Ramdas 2024, "Estimating means of bounded random
    variables by betting"). The stake is Kelly's for the score that was expected before the game.

    Args:
        bar: in 0..1, both excluded.
        error: of saying so wrongly.

    Raises:
        ValueError: a bar or an error outside 0..1.
    """

    def __init__(self, bar: float, error: float) -> None:
        for name, value in (("bar", bar), ("error", error)):
            if not 0.0 < value < 1.0:
                raise ValueError(f"{name} is {value!r}, it must be above 0 and below 1")
        self._bar, self._limit = bar, -math.log(error)
        self._log_wealth: dict[int, float] = {}

    def book(self, number: int, score: float, expected: float) -> None:
        """A game against `number` had this score in 0..1; `expected` was known before it."""
        bar = self._bar
        stake = min(max(0.0, (expected - bar) / (bar * (1.0 - bar))), MOST_STAKED / bar)
        gain = math.log1p(stake * (score - bar))
        self._log_wealth[number] = self._log_wealth.get(number, 0.0) + gain

    def is_above(self, number: int) -> bool:
        """Whether the score against `number` is surely above the bar."""
        return self._log_wealth.get(number, 0.0) >= self._limit

    def clear(self) -> None:
        """Forget all results."""
        self._log_wealth = {}

    def state_dict(self) -> dict[str, Any]:
        """As plain data."""
        return {"log_wealth": dict(self._log_wealth)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers that no games bring."""
        held = {_read_opponent(number): wealth for number, wealth in state["log_wealth"].items()}
        for number in held:
            read_number(held, number, _LOG_WEALTH)
        self._log_wealth = held


class WinRecords:
    """Games of the learner by the number of the opponent that played them.

    A game's weight halves with every `half_life_frames` that the learner has trained since: an
    opponent that has not been met for long is known no better than a new one, so that sampling by
    win rate comes back to it.

    Args:
        half_life_frames: frames of training.
        prior_games: even games that every estimate starts from.

    Raises:
        ValueError: a half-life or prior that is not above 0.
    """

    def __init__(self, half_life_frames: float, prior_games: float = 2.0) -> None:
        for name, value in (("half_life_frames", half_life_frames), ("prior_games", prior_games)):
            if not value > 0:
                raise ValueError(f"{name} is {value!r}, it must be above 0")
        self.half_life_frames, self.prior_games = half_life_frames, prior_games
        self._faded: dict[int, tuple[float, float, int]] = {}  # points, games, frames then
        self._counts: dict[int, int] = {}

    def book(self, number: int, score: float, frames: int) -> None:
        """One more game against `number`, which ended at `frames`: 1 won, 0 lost, 1/2 drawn.

        Raises:
            ValueError: a score outside 0..1.
        """
        if not 0.0 <= score <= 1.0:
            raise ValueError(f"the score against opponent {number} is {score!r}, not in 0..1")
        points, games = self.evidence(number, frames)
        self._faded[number] = (points + score, games + 1.0, frames)
        self._counts[number] = self.count(number) + 1

    def evidence(self, number: int, frames: int) -> Evidence:
        """Points and games against `number` as they weigh at `frames`; none for who was not met."""
        points, games, then = self._faded.get(number, (0.0, 0.0, frames))
        weight = 0.5 ** (max(0, frames - then) / self.half_life_frames)
        return Evidence(points * weight, games * weight)

    def estimate(self, number: int, frames: int) -> float:
        """The score to expect against `number`, in 0..1."""
        return self.evidence(number, frames).estimate(self.prior_games)

    def count(self, number: int) -> int:
        """Games against `number` in all, none faded."""
        return self._counts.get(number, 0)

    def clear(self) -> None:
        """Forget everything booked."""
        self._faded, self._counts = {}, {}

    def state_dict(self) -> dict[str, Any]:
        """Everything booked, as plain data."""
        return {"faded": dict(self._faded), "counts": dict(self._counts)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers that no games bring."""
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
    """Evidence from plain data, by the same keys. Raises ValueError for what no games bring."""
    found = {}
    for key, (points, games) in met.items():
        played = check_number(games, "games", WEIGHT)
        found[key] = Evidence(check_number(points, "points", Range(0.0, played, float)), played)
    return found
