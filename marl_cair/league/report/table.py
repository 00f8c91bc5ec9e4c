"""All numbers of a league's report, best agent first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.diagnostics import Diagnostics, diagnose
from marl_cair.league.ratings.payoffs import find_payoffs
from marl_cair.league.ratings.rate import Games, Ladder, Rating, is_stronger, rate
from marl_cair.league.ratings.shares import Share, find_team_shares


@dataclass(frozen=True)
class LeagueTable:
    """Numbers of n agents and T teams, best first; without a ladder as they were given."""

    names: tuple[str, ...]
    ladder: Ladder | None  # None: the games do not connect all agents
    why_unrated: str  # "" with a ladder
    points: NDArray[np.float64]  # [n, n], how often the row came in above the column, ties half
    counts: NDArray[np.int64]  # [n, n] games of both
    draws: NDArray[np.int64]  # [n, n] games of both in which they came in level
    repeats: NDArray[np.int64]  # [n, n] games of both that are not counted: the same as another
    low: NDArray[np.float64]  # [n, n] 95 % interval of points / counts, wide without games
    high: NDArray[np.float64]
    diagnostics: Diagnostics | None  # agents by their place in `numbered_names`; None: no games
    numbered_names: tuple[str, ...]  # in the order in which `make_table` was given them
    team_shares: Mapping[tuple[str, int], Share]  # by name and team, where it has played
    num_games: int  # that are counted
    forfeits: tuple[tuple[str, int], ...]  # reasons, and in how many games
    num_teams: int

    @property
    def ratings(self) -> tuple[Rating, ...]:
        """Best first; none without a ladder."""
        return () if self.ladder is None else self.ladder.ratings

    @property
    def zero(self) -> str:
        """What has the rating 0, in words."""
        if self.ladder is not None and self.ladder.zero:
            return f"{self.ladder.zero} = 0"
        is_whole = not any(rating.is_bound for rating in self.ratings)
        return "mean = 0" if is_whole else "mean without bounds = 0"

    @property
    def shares(self) -> NDArray[np.float64]:
        """Float64 [n, n] points / counts; not a number where nothing was played."""
        shares = self.points / np.maximum(self.counts, 1)
        return np.where(self.counts > 0, shares, np.nan)

    def differs(self, above: int, below: int) -> bool:
        """Whether the agent `above`, which has the higher rating, is significantly stronger."""
        if self.ladder is None:
            return False
        gap = self.ladder.differences[above][below]
        return is_stronger(self.ratings[above], self.ratings[below], gap)

    def pair(self, row: int, column: int) -> Share | None:
        """Score of the row against the column; None without games."""
        games = int(self.counts[row, column])
        if not games:
            return None
        share = float(self.points[row, column]) / games
        return Share(share, float(self.low[row, column]), float(self.high[row, column]), games)


def find_elo_range(ratings: Sequence[Rating]) -> tuple[float, float]:
    """The ends of an axis that holds all intervals, but for ends that only the prior holds."""
    ends = [
        elo
        for r in ratings
        for elo, is_open in ((r.low, r.open_low), (r.elo, False), (r.high, r.open_high))
        if not is_open
    ]
    low, high = min(ends, default=0.0), max(ends, default=0.0)
    margin = 0.1 * (high - low) or 1.0
    return low - margin, high + margin


def make_table(
    names: Sequence[str],
    games: Games,
    forfeits: Sequence[tuple[str, int]] = (),
    seed: int = 0,
    with_alpha_rank: bool = False,
    zero: str = "",
) -> LeagueTable:
    """Rate games as `rate` does, with agents by index in `names`, and compute all other numbers.

    Where `rate` raises ValueError, there is no ladder, and `why_unrated` is its message.

    Raises:
        ValueError: `with_alpha_rank`, and OpenSpiel is not installed.
    """
    with ThreadPoolExecutor(1) as pool:  # compiled code does most of it: seconds of large leagues
        rated = pool.submit(_try_to_rate, names, games, seed, zero)
        payoffs = find_payoffs(len(names), games, seed)
        num_games = int((~games.is_repeat).sum())
        diagnostics = diagnose(games, payoffs, seed, with_alpha_rank) if num_games else None
        ladder, why_unrated = rated.result()
    ranked = [rating.name for rating in ladder.ratings] if ladder else list(names)
    place = {name: number for number, name in enumerate(names)}
    order = np.array([place[name] for name in ranked], np.int64)
    shown = payoffs.reorder(order)
    shares = find_team_shares(len(names), games)
    return LeagueTable(
        tuple(ranked),
        ladder,
        why_unrated,
        shown.points,
        shown.counts,
        shown.draws,
        shown.repeats,
        shown.low,
        shown.high,
        diagnostics,
        tuple(names),
        {(names[agent], team): share for (agent, team), share in shares.items()},
        num_games,
        tuple(forfeits),
        games.agents.shape[1],
    )


def _try_to_rate(
    names: Sequence[str], games: Games, seed: int, zero: str
) -> tuple[Ladder | None, str]:
    """The ladder, or why there is none."""
    try:
        return rate(names, games, seed, zero), ""
    except ValueError as error:
        return None, str(error)
