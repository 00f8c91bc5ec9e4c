"""Ratings from stored games: one likelihood for pairs and free-for-alls, intervals by bootstrap."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.groups import (
    ELO_PER_LOGIT,
    SWEEP_PROBABILITY,
    draw_gaps,
    find_gap,
    find_groups,
    require_comparison,
)
from marl_cair.league.intervals import CONFIDENCE
from marl_cair.league.likelihood import PRIOR_ELO, SEAT_PRIOR_ELO, Likelihood, Rankings
from marl_cair.league.resampling import Resamples, resample

NUM_BOOTSTRAPS = 500
ANCHOR = "random"  # rated 0 where it takes part
TAIL = (1.0 - CONFIDENCE) / 2.0


@dataclass(frozen=True)
class Games:
    """N games of T teams, as `StoredGames` has them; agents by place in a list of names.

    Attributes:
        agents: int64 [N, T].
        points, ranks: float64 [N, T].
        blocks: int64 [N], equal for the games of a block: what is resampled.
        is_repeat: bool [N], games that are the same as another and are not counted.
    """

    agents: NDArray[np.int64]
    points: NDArray[np.float64]
    ranks: NDArray[np.float64]
    blocks: NDArray[np.int64]
    is_repeat: NDArray[np.bool_]

    def select(self, which: NDArray[Any]) -> Games:
        """The games of an index or a mask [N]; a repeat stays one."""
        return Games(
            self.agents[which],
            self.points[which],
            self.ranks[which],
            self.blocks[which],
            self.is_repeat[which],
        )

    def count_once(self) -> Games:
        """Without repeats; blocks are numbered anew, without gaps."""
        kept = self.select(~self.is_repeat)
        _, blocks = np.unique(kept.blocks, return_inverse=True)
        return replace(kept, blocks=blocks.ravel().astype(np.int64))

    def digest(self, names: Sequence[str]) -> str:
        """A hash of all that ratings depend on."""
        digest = hashlib.blake2b("\0".join(names).encode(), digest_size=16)
        for array in (self.agents, self.ranks, self.blocks):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


@dataclass(frozen=True)
class Rating:
    """One agent's place.

    Attributes:
        name: of the agent.
        elo: maximum-posterior rating; where `bound` is set, the bound.
        low, high: 95 % interval against the mean of the agent's group, both equal to `elo` in a
            group of one.
        open_low, open_high: that end is where the prior has put it: in more than 2.5 % of the
            resamples no point limits the rating on that side.
        games, score: number of games, and share of points in them.
        bound: "lower" where the agent's group lost no point to the group of the zero of the scale,
            neither itself nor through others: its ratings may all be larger by one unknown number.
            "upper" where it never took one: they may all be smaller. "" in the group of the zero.
        group: of agents that took points off each other, directly or through others; 0 is the best.
        probability_first: share of the resamples in which it is the best of all; between groups
            the distance is drawn from those that the clean sweep leaves possible.
    """

    name: str
    elo: float
    low: float
    high: float
    games: int
    score: float
    bound: Literal["", "lower", "upper"]
    group: int
    probability_first: float = 0.0
    open_low: bool = False
    open_high: bool = False

    @property
    def is_bound(self) -> bool:
        """Whether `elo` is a bound and no estimate."""
        return self.bound != ""


@dataclass(frozen=True)
class Estimate:
    """A number of Elo with its 95 % interval."""

    elo: float
    low: float
    high: float


@dataclass(frozen=True)
class Ladder:
    """Ratings of n agents, best first, and what else the same games show.

    Attributes:
        ratings: n.
        differences: [n][n], the row's agent less the column's, None where they are of different
            groups; the interval is of the difference itself, narrower than two ratings' suggest.
        seats: what each team's seats add to a rating, against the mean of all teams.
    """

    ratings: tuple[Rating, ...]
    differences: tuple[tuple[Estimate | None, ...], ...]
    seats: tuple[Estimate, ...]


def is_stronger(above: Rating, below: Rating, gap: Estimate | None) -> bool:
    """Whether the first is surely stronger; gap: their difference, None between groups, where a
    clean sweep of a few games shows nothing.
    """
    return (above.elo - below.elo if gap is None else gap.low) > 0.0


def describe_method(seed: int) -> dict[str, Any]:
    """What ratings depend on beside the games, as plain data."""
    return {
        "method": "Plackett-Luce, maximum posterior; of two teams Bradley-Terry, draws as halves",
        "prior_elo": PRIOR_ELO,
        "seat_prior_elo": SEAT_PRIOR_ELO,
        "bootstraps": NUM_BOOTSTRAPS,
        "pseudo_blocks": "one for each rating, by leverage",
        "confidence": CONFIDENCE,
        "seed": seed,
    }


def rate(names: Sequence[str], games: Games, seed: int = 0) -> Ladder:
    """Ratings of all agents: a function of the games alone, whatever their order.

    `random` is 0 where it takes part, else the mean of the largest group. Ratings have a normal
    prior of standard deviation PRIOR_ELO about the mean of their group, seat advantages one of
    SEAT_PRIOR_ELO about 0. The bootstrap draws whole blocks (a map seed in all its seatings), never
    single games; `resampling` says what it adds to them. Repeats are not counted.

    Raises:
        ValueError: no games, or agents that no chain of games compares with the others; names them.
    """
    games = sort_games(games.count_once())
    if not len(games.agents):
        raise ValueError("there are no games to rate: play some first")
    above, meetings = count_pairs(len(names), games)
    groups = find_groups(above)
    home = _find_home(names, groups)
    require_comparison(names, above, groups[home][0])
    rankings = [_restrict(games, group) for group in groups]
    model, rng = Likelihood(len(names), rankings), np.random.default_rng(seed)
    point = model.fit(np.ones(model.num_blocks))
    whole = Rankings(games.agents, games.ranks, games.blocks)
    resamples = resample(len(names), whole, rankings, point, groups, NUM_BOOTSTRAPS, rng)
    fitted = ELO_PER_LOGIT * point[: len(names)]
    elo = _place_groups(groups, home, fitted, meetings)
    if ANCHOR in names:
        elo -= elo[names.index(ANCHOR)]
    moved = _draw_places(groups, home, fitted, meetings, rng)
    samples = _Samples(point, resamples, groups, moved)
    return samples.make_ladder(names, elo, groups, home, games)


def count_pairs(num_agents: int, games: Games) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How often the row's agent came in above the column's, a tie as half; and games of both.

    A game of more than two counts in `meetings` as one for all its pairs together.
    """
    above, meetings = np.zeros((2, num_agents, num_agents))
    num_teams = games.agents.shape[1]
    share = 2.0 / (num_teams * (num_teams - 1))
    for one in range(num_teams):
        for two in range(num_teams):
            own, other = games.agents[:, one], games.agents[:, two]
            rivals = own != other
            wins = (1.0 + np.sign(games.ranks[:, two] - games.ranks[:, one])) / 2.0
            np.add.at(above, (own[rivals], other[rivals]), wins[rivals])
            np.add.at(meetings, (own[rivals], other[rivals]), share)
    return above, meetings


def sort_games(games: Games) -> Games:
    """Games and blocks in the order of what was played in them: nothing tells when it was."""
    rows = np.column_stack((games.agents, games.ranks))
    order = np.lexsort((*rows.T[::-1], games.blocks))
    keys: dict[int, list[bytes]] = {}
    for place in order.tolist():
        keys.setdefault(int(games.blocks[place]), []).append(rows[place].tobytes())
    number = {block: n for n, block in enumerate(sorted(keys, key=lambda block: keys[block]))}
    blocks = np.array([number[block] for block in games.blocks[order].tolist()], np.int64)
    order = order[np.argsort(blocks, kind="stable")]
    return replace(games.select(order), blocks=np.sort(blocks))


def _restrict(games: Games, group: Sequence[int]) -> Rankings:
    """The finishing orders within a group: Plackett-Luce holds for the rest of a ranking too."""
    is_inside = np.isin(games.agents, group)
    is_inside &= is_inside.sum(axis=1, keepdims=True) > 1
    above = is_inside[:, None, :] & (games.ranks[:, None, :] < games.ranks[:, :, None])
    level = is_inside[:, None, :] & (games.ranks[:, None, :] == games.ranks[:, :, None])
    ranks = np.where(is_inside, above.sum(2) + (level.sum(2) + 1.0) / 2.0, 0.0)
    return Rankings(games.agents, ranks, games.blocks)


def _find_home(names: Sequence[str], groups: Sequence[Sequence[int]]) -> int:
    """The group of the zero of the scale: the anchor's, else the largest, the best among equals."""
    if ANCHOR in names:
        anchor = names.index(ANCHOR)
        return next(place for place, group in enumerate(groups) if anchor in group)
    return max(range(len(groups)), key=lambda place: (len(groups[place]), place))


def _place_groups(
    groups: Sequence[list[int]],
    home: int,
    fitted: NDArray[np.float64],
    meetings: NDArray[np.float64],
    probability: float = SWEEP_PROBABILITY,
) -> NDArray[np.float64]:
    """Elo [agents]: the home group's mean is 0, the others lie as far away as is sure, or as a
    sweep of another probability says.
    """
    elo = fitted.copy()
    for group in groups:
        elo[group] -= elo[group].mean()
    placed = list(groups[home])
    for group in groups[home + 1 :]:
        elo[group] += find_gap(
            elo[group], elo[placed], meetings[np.ix_(group, placed)], probability
        )
        placed += group
    for group in reversed(groups[:home]):
        elo[group] -= find_gap(
            elo[placed], elo[group], meetings[np.ix_(placed, group)], probability
        )
        placed += group
    return elo


def _draw_places(
    groups: Sequence[list[int]],
    home: int,
    fitted: NDArray[np.float64],
    meetings: NDArray[np.float64],
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Where the mean of each agent's group may lie, Elo [samples, agents]: a group that has won a
    few games only may as well be below the next.
    """
    elo = _place_groups(groups, home, fitted, meetings, 0.5)
    moved = np.zeros((NUM_BOOTSTRAPS, len(elo)))
    placed = list(groups[home])
    for nearer, further in ((groups[home + 1 :], 1.0), (groups[:home][::-1], -1.0)):
        total = np.zeros(NUM_BOOTSTRAPS)
        for group in nearer:
            upper, lower = (group, placed) if further > 0.0 else (placed, group)
            counts, chances = meetings[np.ix_(upper, lower)], rng.random(NUM_BOOTSTRAPS)
            total = total + further * draw_gaps(elo[upper], elo[lower], counts, chances)
            moved[:, group] = total[:, None]
            placed += group
    for group in groups:
        moved[:, group] += elo[group].mean()
    return moved


class _Samples:
    """The fit, and fits to resampled blocks: Elo [S, n] and [S, T], centred by group and team."""

    def __init__(
        self,
        point: NDArray[np.float64],
        resamples: Resamples,
        groups: Sequence[list[int]],
        moved: NDArray[np.float64],
    ) -> None:
        """moved: Elo [S, n] of the mean of the agent's group."""
        self.point, self.moved = point, moved
        self.fitted = ELO_PER_LOGIT * resamples.ratings
        for group in groups:
            self.fitted[:, group] -= self.fitted[:, group].mean(1, keepdims=True)
        self.seats = ELO_PER_LOGIT * resamples.seats
        self.seats -= self.seats.mean(1, keepdims=True)
        self.open_low, self.open_high = resamples.open_low, resamples.open_high

    def make_ladder(
        self,
        names: Sequence[str],
        elo: NDArray[np.float64],
        groups: Sequence[list[int]],
        home: int,
        games: Games,
    ) -> Ladder:
        """The ladder with the ratings `elo` [n], 0 at the zero of the scale."""
        best = self._find_best()
        ratings = []
        for place, group in enumerate(groups):
            mean = elo[group].mean()
            for index in group:
                low, high = _find_ends(mean + self.fitted[:, index], elo[index])
                played = games.agents == index
                num = int(played.any(axis=1).sum())
                entries = int(played.sum())
                ratings.append(
                    Rating(
                        names[index],
                        float(elo[index]),
                        low,
                        high,
                        num,
                        float(games.points[played].sum() / entries) if entries else math.nan,
                        "lower" if place > home else "upper" if place < home else "",
                        len(groups) - 1 - place,
                        float(best[index]),
                        bool(self.open_low[index] > TAIL * NUM_BOOTSTRAPS),
                        bool(self.open_high[index] > TAIL * NUM_BOOTSTRAPS),
                    )
                )
        ratings.sort(key=lambda rating: (rating.group, -rating.elo, rating.name))
        return Ladder(tuple(ratings), self._compare(names, ratings, elo), self._rate_seats())

    def _find_best(self) -> NDArray[np.float64]:
        """Share of the samples in which each agent is first; equal ones share the place."""
        placed = self.fitted + self.moved
        is_first = placed >= placed.max(1, keepdims=True) - 1e-6
        return np.asarray((is_first / is_first.sum(1, keepdims=True)).mean(0), np.float64)

    def _compare(
        self, names: Sequence[str], ratings: Sequence[Rating], elo: NDArray[np.float64]
    ) -> tuple[tuple[Estimate | None, ...], ...]:
        order = [list(names).index(rating.name) for rating in ratings]
        rows = []
        for own, one in zip(ratings, order, strict=True):
            gaps = self.fitted[:, [one]] - self.fitted[:, order]
            ends = np.quantile(gaps, (TAIL, 1.0 - TAIL), axis=0)
            row: list[Estimate | None] = []
            for at, (other, two) in enumerate(zip(ratings, order, strict=True)):
                gap = float(elo[one] - elo[two])
                low, high = min(float(ends[0, at]), gap), max(float(ends[1, at]), gap)
                row.append(Estimate(gap, low, high) if own.group == other.group else None)
            rows.append(tuple(row))
        return tuple(rows)

    def _rate_seats(self) -> tuple[Estimate, ...]:
        point = ELO_PER_LOGIT * self.point[self.fitted.shape[1] :]
        point = point - point.mean()
        return tuple(
            Estimate(float(value), *_find_ends(self.seats[:, team], float(value)))
            for team, value in enumerate(point)
        )


def _find_ends(samples: NDArray[np.float64], value: float) -> tuple[float, float]:
    low, high = np.quantile(samples, (TAIL, 1.0 - TAIL))
    return min(float(low), float(value)), max(float(high), float(value))
