"""All numbers of a league's report, best agent first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from marl_cair.league.ratings.averages import ALPHA_RANK, AVERAGES, Averages, average
from marl_cair.league.ratings.cycles import find_cycles
from marl_cair.league.ratings.fit import FitTest, check_fit
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.payoffs import Payoffs, Share, find_payoffs, find_team_shares
from marl_cair.league.ratings.rate import Ladder, Rating, is_stronger, rate


@dataclass(frozen=True)
class LeagueTable:
    """Numbers of n agents and T teams, best first; without a ladder in the given order."""

    names: tuple[str, ...]
    ladder: Ladder | None  # None: the games do not connect all agents
    why_unrated: str  # "" with a ladder
    payoffs: Payoffs
    fit: FitTest | None  # None: too few pairs have met to show a cycle
    cycles: tuple[tuple[str, str, str, float], ...]  # as `find_cycles`, by name
    averages: Mapping[str, Averages]  # by title, of agents as in `names`
    team_shares: Mapping[tuple[str, int], Share]  # by name and team, where it has played
    num_games: int  # that are counted
    forfeits: tuple[tuple[str, str, int], ...]  # agents, reasons, and in how many games
    num_teams: int

    @property
    def ratings(self) -> tuple[Rating, ...]:
        """Best first; none without a ladder."""
        return () if self.ladder is None else self.ladder.ratings

    @property
    def zero(self) -> str:
        """The zero of the ratings, in words."""
        if self.ladder is not None and self.ladder.zero:
            return f"{self.ladder.zero} = 0"
        is_whole = not any(rating.is_bound for rating in self.ratings)
        return "mean = 0" if is_whole else "mean without bounds = 0"

    def differs(self, above: int, below: int) -> bool:
        """Whether the agent `above`, which has the higher rating, is significantly stronger."""
        if self.ladder is None:
            return False
        gap = self.ladder.differences[above][below]
        return is_stronger(self.ratings[above], self.ratings[below], gap)


def make_table(
    names: Sequence[str],
    games: Games,
    forfeits: Sequence[tuple[str, str, int]] = (),
    seed: int = 0,
    with_alpha_rank: bool = False,
    zero: str = "",
) -> LeagueTable:
    """Rate games as `rate` does, with agents by index in `names`, and compute all other numbers.

    Where `rate` raises ValueError, there is no ladder, and `why_unrated` is its message.

    Raises:
        ValueError: `with_alpha_rank`, and OpenSpiel is not installed.
    """
    num_games = int((~games.is_repeat).sum())
    titles = [title for title in AVERAGES if title != ALPHA_RANK or with_alpha_rank]
    with ThreadPoolExecutor(2) as pool:  # compiled code does most of it: seconds of large leagues
        rated = pool.submit(rate, names, games, seed, zero)
        fit = pool.submit(check_fit, len(names), games, seed)
        cycles = find_cycles(len(names), games)
        payoffs = find_payoffs(len(names), games, seed)
        averages = {title: average(payoffs, AVERAGES[title]) for title in titles if num_games}
        try:
            ladder, why_unrated = rated.result(), ""
        except ValueError as error:
            ladder, why_unrated = None, str(error)
    ranked = [rating.name for rating in ladder.ratings] if ladder else list(names)
    order = [list(names).index(name) for name in ranked]
    return LeagueTable(
        tuple(ranked),
        ladder,
        why_unrated,
        payoffs.reorder(order),
        fit.result(),
        tuple((names[a], names[b], names[c], share) for (a, b, c), share in cycles),
        {title: found.reorder(order) for title, found in averages.items()},
        {(names[agent], team): share for (agent, team), share in find_team_shares(games).items()},
        num_games,
        tuple(forfeits),
        games.agents.shape[1],
    )
