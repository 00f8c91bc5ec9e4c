"""Plays sequential matches: a sequential probability ratio test on blocks ends them.

Wald's test (1945) between two differences in Elo, on the scores of whole blocks (a map seed, once
with the first agent in each team), as games of one map seed are correlated. With two teams blocks
are the pairs of chess engine testing, whose five outcomes make the test "pentanomial". The
likelihood ratio is the generalised one: each hypothesis takes the best-fitting distribution of
block scores with its mean (Van den Bergh 2020, "A practical introduction to the GSPRT").
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.play import match
from marl_cair.league.play.match import BLOCKS_PER_CHUNK, GameResult, MatchResult
from marl_cair.league.play.playing import CHUNKS_AT_ONCE, size_chunk
from marl_cair.league.play.recording import Recording

ERROR_RATE = 0.05  # probability of deciding for the wrong difference, either way
PSEUDO_COUNT = 1e-3  # blocks of each outcome, so that no outcome is impossible
ELO_SCALE = 400.0
MOST_ELO = 4_000.0  # of a hypothesis: a score of 1 - 1e-10

Verdict = Literal["higher", "lower", "undecided", "repeats"]


@dataclass(frozen=True)
class SequentialTest:
    """A test whether A is `higher` or `lower` Elo above B.

    Raises ValueError if the two are not in rising order, or beyond MOST_ELO.
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
        """Log-likelihood ratio of `higher` to `lower`; outcomes: number of blocks by score, in 0..1
        (see `start_count`).
        """
        values = np.array(sorted(outcomes))
        counts = np.array([outcomes[value] for value in values.tolist()]) + PSEUDO_COUNT
        expected = [find_score(elo, num_teams) for elo in (self.lower, self.higher)]
        low, high = (_tilt(values, counts, mean) for mean in expected)
        return float(counts @ (low - high))


@dataclass(frozen=True)
class SequentialResult:
    """Result of a test."""

    verdict: Verdict  # "undecided" after the most games; "repeats" if agents only repeat games
    ratio: float  # the log-likelihood ratio at the end
    match: MatchResult  # up to the decision; one block if all are alike


def start_count(num_teams: int) -> Counter[float]:
    """Scores of a block without draws, each 0 times; with two teams also those with draws."""
    outcomes = Counter({share / num_teams: 0 for share in range(num_teams + 1)})
    if num_teams == 2:
        outcomes.update({0.25: 0, 0.75: 0})
    return outcomes


def find_score(elo: float, num_teams: int = 2) -> float:
    """Expected share of points, in 0..1, of an agent that is `elo` above all others."""
    odds = 10.0 ** (elo / ELO_SCALE)
    return float(odds / (odds + num_teams - 1))


def find_elo(score: float, num_teams: int = 2) -> float | None:
    """Inverse of `find_score`; None for 0 and 1."""
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
    record: Recording | None = None,
) -> SequentialResult:
    """Play the blocks of `play_match` in their order until the test decides.

    record: where to record all games that are played for it.

    Raises ValueError if there is only one team, or max_games is less than a block.
    """
    num_teams = match.require_rivals(game, scenario)
    num_blocks = max_games // num_teams
    if num_blocks < 1:
        raise ValueError(f"max_games is {max_games}, a block has {num_teams} games: give more")
    counted: list[GameResult] = []
    waiting: list[Sequence[GameResult]] = []  # blocks like the first, while no game differs
    outcomes = start_count(num_teams)
    seen: set[tuple[int, str]] = set()
    is_varied = False  # see `MatchResult.without_repeats`
    chunks = range(-(-num_blocks // size_chunk(game, BLOCKS_PER_CHUNK)))
    for start in chunks[::CHUNKS_AT_ONCE]:
        part = chunks[start : start + CHUNKS_AT_ONCE]
        played = match.play_chunks(*agents, game, scenario, seed, part, identities, record).results
        before = len(counted)
        for first in range(0, len(played), num_teams):
            block = played[first : first + num_teams]
            if block[0].block >= num_blocks:
                break
            waiting.append(block)
            seen |= {(result.first_seat, result.fingerprint) for result in block}
            is_varied |= len(seen) > num_teams or any(result.forfeit for result in block)
            if counted and not is_varied:
                continue
            for one in waiting:
                counted += one
                outcomes[round(float(np.mean([result.score for result in one])), 9)] += 1
            waiting.clear()
            ratio = test.ratio(outcomes, num_teams)
            if abs(ratio) >= test.limit:
                verdict: Verdict = "higher" if ratio > 0.0 else "lower"
                return SequentialResult(verdict, ratio, MatchResult(tuple(counted), num_teams))
        if len(counted) == before:
            return SequentialResult("repeats", ratio, MatchResult(tuple(counted), num_teams))
    ended: Verdict = "undecided" if is_varied or not waiting else "repeats"
    return SequentialResult(ended, ratio, MatchResult(tuple(counted), num_teams))


def _tilt(
    values: NDArray[np.float64], counts: NDArray[np.float64], mean: float
) -> NDArray[np.float64]:
    """Log of observed over fitted probability of each value, in the best fit with this mean."""
    shares, gaps = counts / counts.sum(), values - mean

    def surplus(tilt: float) -> float:
        return float(shares @ (gaps / (1.0 + tilt * gaps)))

    edges = -1.0 / gaps.max(), -1.0 / gaps.min()
    inside = 1e-12 * (edges[1] - edges[0])
    from scipy.optimize import brentq

    tilt = brentq(surplus, edges[0] + inside, edges[1] - inside, xtol=1e-14)
    return np.asarray(np.log1p(tilt * gaps), np.float64)
