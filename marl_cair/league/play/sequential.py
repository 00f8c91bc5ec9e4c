"""Sequential matches: they stop once a sequential probability ratio test on blocks decides.

Wald's test (1945) between two differences in Elo, on the scores of whole blocks (a map seed, once
with the first agent in each team): between two teams these are the pairs of chess engine testing,
whose five outcomes make it "pentanomial". Games of one map seed are alike, so that counting them
singly would be wrong. The likelihood ratio is the generalised one: each hypothesis takes the
distribution of block scores that fits best among those with its mean (Van den Bergh 2020, "A
practical introduction to the GSPRT").
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.play.match import (
    BLOCKS_PER_CHUNK,
    GameResult,
    MatchResult,
    play_chunks,
    require_rivals,
    shows_new,
)
from marl_cair.league.play.playing import CHUNKS_AT_ONCE

ERROR_RATE = 0.05  # of deciding for the wrong one of the two differences, either way
PSEUDO_COUNT = 1e-3  # blocks of each outcome, so that none is impossible before it was seen
ELO_SCALE = 400.0
MOST_ELO = 4_000.0  # of a hypothesis: a score of 1 - 1e-10

Verdict = Literal["higher", "lower", "undecided", "repeats"]


@dataclass(frozen=True)
class SequentialTest:
    """Whether A is `higher` or `lower` Elo above B, whichever is likelier.

    Raises:
        ValueError: the two are not in rising order, or beyond MOST_ELO.
    """

    lower: float
    higher: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and math.isfinite(self.higher)):
            raise ValueError(f"{self.lower} and {self.higher} Elo must be finite numbers")
        if max(abs(self.lower), abs(self.higher)) > MOST_ELO:
            raise ValueError(
                f"the test is between {self.lower:g} and {self.higher:g} Elo: give numbers in "
                f"{-MOST_ELO:g}..{MOST_ELO:g}, beyond which every game is won"
            )
        if self.lower >= self.higher:
            raise ValueError(
                f"the test is between {self.lower:g} and {self.higher:g} Elo: give the smaller "
                "first, for example 0,20"
            )

    @property
    def limit(self) -> float:
        """The log-likelihood ratio that decides for `higher`; its negative for `lower`."""
        return math.log((1.0 - ERROR_RATE) / ERROR_RATE)

    def ratio(self, outcomes: Counter[float], num_teams: int = 2) -> float:
        """Log-likelihood ratio of `higher` to `lower`, from how often each block score, in 0..1,
        has occurred (see `start_count`).
        """
        values = np.array(sorted(outcomes))
        counts = np.array([outcomes[value] for value in values.tolist()]) + PSEUDO_COUNT
        expected = [find_score(elo, num_teams) for elo in (self.lower, self.higher)]
        low, high = (_tilt(values, counts, mean) for mean in expected)
        return float(counts @ (low - high))


@dataclass(frozen=True)
class SequentialResult:
    """What a test has found.

    Attributes:
        verdict: which difference is likelier; "undecided" where the games ran out; "repeats" where
            the agents have nothing new to show.
        ratio: the log-likelihood ratio at the end.
        match: the games up to the decision, without blocks that repeat others move by move.
    """

    verdict: Verdict
    ratio: float
    match: MatchResult


def start_count(num_teams: int) -> Counter[float]:
    """Scores that a block of games without draws may have, each 0 times; of two also with draws."""
    outcomes = Counter({share / num_teams: 0 for share in range(num_teams + 1)})
    if num_teams == 2:
        outcomes.update({0.25: 0, 0.75: 0})
    return outcomes


def _round(score: float) -> float:
    return round(score, 9)


def find_score(elo: float, num_teams: int = 2) -> float:
    """The expected share of points of an agent `elo` above all others, in 0..1."""
    odds = 10.0 ** (elo / ELO_SCALE)
    return float(odds / (odds + num_teams - 1))


def find_elo(score: float, num_teams: int = 2) -> float | None:
    """The Elo above all others that has this expected share of points; None for 0 and 1."""
    if not 0.0 < score < 1.0:
        return None
    return ELO_SCALE * math.log10(score * (num_teams - 1) / (1.0 - score))


def play_sequentially(
    agents: tuple[Agent, Agent],
    game: Game,
    scenario: Any,
    test: SequentialTest,
    max_games: int,
    seed: int,
    identities: tuple[str, str] | None = None,
    listen: Callable[[float, int], None] | None = None,
) -> SequentialResult:
    """Play blocks of `play_match` in their order until the test is decided.

    listen: called with the ratio and the number of games after each round.

    Raises:
        ValueError: a scenario with but one team, or max_games is less than a block.
    """
    num_teams = require_rivals(game, scenario)
    num_blocks = max_games // num_teams
    if num_blocks < 1:
        raise ValueError(f"max_games is {max_games}, a block has {num_teams} games: give more")
    counted: list[GameResult] = []
    outcomes = start_count(num_teams)
    seen: set[tuple[int, str]] = set()
    chunks = range(-(-num_blocks // BLOCKS_PER_CHUNK))
    for start in chunks[::CHUNKS_AT_ONCE]:
        part = chunks[start : start + CHUNKS_AT_ONCE]
        played = play_chunks(*agents, game, scenario, seed, part, identities).results
        before = len(counted)
        for first in range(0, len(played), num_teams):
            block = played[first : first + num_teams]
            if block[0].block >= num_blocks:
                break
            if not shows_new(block, seen):
                continue
            counted += block
            outcomes[_round(float(np.mean([result.score for result in block])))] += 1
            ratio = test.ratio(outcomes, num_teams)
            if abs(ratio) >= test.limit:
                verdict: Verdict = "higher" if ratio > 0.0 else "lower"
                return SequentialResult(verdict, ratio, MatchResult(tuple(counted), num_teams))
        if len(counted) == before:
            return SequentialResult("repeats", ratio, MatchResult(tuple(counted), num_teams))
        if listen is not None:
            listen(ratio, len(counted))
    return SequentialResult("undecided", ratio, MatchResult(tuple(counted), num_teams))


def _tilt(
    values: NDArray[np.float64], counts: NDArray[np.float64], mean: float
) -> NDArray[np.float64]:
    """Log of how much less likely each value is than seen, in the best fit with this mean."""
    shares, gaps = counts / counts.sum(), values - mean

    def surplus(tilt: float) -> float:
        return float(shares @ (gaps / (1.0 + tilt * gaps)))

    edges = -1.0 / gaps.max(), -1.0 / gaps.min()
    inside = 1e-12 * (edges[1] - edges[0])
    from scipy.optimize import brentq

    tilt = brentq(surplus, edges[0] + inside, edges[1] - inside, xtol=1e-14)
    return np.asarray(np.log1p(tilt * gaps), np.float64)
