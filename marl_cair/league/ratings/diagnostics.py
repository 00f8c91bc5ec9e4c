"""Diagnostics beyond ratings: goodness of fit, non-transitive cycles, other averages."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from marl_cair.league.ratings.averages import ALPHA_RANK, AVERAGES, Averages, average
from marl_cair.league.ratings.cycles import Cycle, find_cycles
from marl_cair.league.ratings.fit import FitTest, check_fit
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.payoffs import Payoffs


@dataclass(frozen=True)
class Diagnostics:
    """Diagnostics of n agents, by number."""

    fit: FitTest | None  # None: too few pairs have met to show a cycle
    cycles: tuple[Cycle, ...]
    averages: dict[str, Averages]  # by title


def diagnose(
    games: Games, payoffs: Payoffs, seed: int = 0, with_alpha_rank: bool = False
) -> Diagnostics:
    """Compute all diagnostics; games and payoffs number the agents alike.

    Raises:
        ValueError: alpha-Rank is asked for, and OpenSpiel is not installed.
    """
    num_agents = len(payoffs.counts)
    with ThreadPoolExecutor(1) as pool:
        fit = pool.submit(check_fit, num_agents, games, seed)
        cycles = find_cycles(num_agents, games)
        averages = {
            title: average(payoffs, find)
            for title, find in AVERAGES.items()
            if title != ALPHA_RANK or with_alpha_rank
        }
        return Diagnostics(fit.result(), cycles, averages)
