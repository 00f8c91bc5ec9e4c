"""Rates stored games of two or more teams: Plackett-Luce with bootstrap intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.bootstrap import Resampler, Resamples
from marl_cair.league.ratings.games import Games, count_points, sort_games, split_pairs
from marl_cair.league.ratings.groups import (
    ELO_PER_LOGIT,
    draw_places,
    find_groups,
    find_home,
    place_groups,
    require_comparison,
)
from marl_cair.league.ratings.intervals import CONFIDENCE, TAIL, Z, find_ends
from marl_cair.league.ratings.likelihood import PRIOR_ELO, SEAT_PRIOR_ELO, Likelihood, Rankings

# Resamples: LEAST, and as many up to MOST (and MOST_WORK, some seconds) as ends of intervals need
# to stay within MOVE of where another seed of the resampling would put them (95 % of the time).
LEAST_RESAMPLES, MOST_RESAMPLES, MOST_WORK, MOVE_ELO = 1_000, 20_000, 100_000_000, 2.0


@dataclass(frozen=True)
class Rating:
    """One agent's place.

    Attributes:
        name: of the agent.
        elo: maximum-posterior rating; where `bound` is set, the bound.
        low, high: 95 % interval against the zero of the scale, as `elo` is; both are equal to `elo`
            where `bound` is set, and of the agent that is the zero.
        games, score: number of games, and share of points in them.
        bound: "lower" where the agent's group lost no point to the largest group, which has the
            zero, neither itself nor through others: its ratings may all be larger by one unknown
            number. "upper" where it never took one: they may all be smaller. "" in the largest.
        group: of agents that took points off each other, directly or through others; 0 is the best.
        probability_first: share of the resamples in which it is the best of all; between groups
            the distance is drawn from those that the clean sweep leaves possible.
        open_low, open_high: only the prior limits that end: in more than 2.5 % of the resamples no
            point limits the rating on that side.
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
    """Ratings of n agents, best first, and other results of the same fit.

    Attributes:
        ratings: n.
        differences: [n][n], the row's agent less the column's, None where they are of different
            groups; the interval is of the difference itself, narrower than two ratings' suggest.
        seats: the advantage of each team's seats in Elo, against the mean of all teams.
        zero: the agent that is rated 0; "": the mean of the largest group is.
        num_resamples: that intervals are from.
        move: Elo by which another seed of the resampling moves the ends of ratings' intervals at
            most, 95 % of the time; of those that are not open.
    """

    ratings: tuple[Rating, ...]
    differences: tuple[tuple[Estimate | None, ...], ...]
    seats: tuple[Estimate, ...]
    zero: str
    num_resamples: int
    move: float


def is_stronger(above: Rating, below: Rating, gap: Estimate | None) -> bool:
    """Whether the first is surely stronger; gap: their difference, None between groups, where a
    clean sweep of a few games shows nothing.
    """
    return (above.elo - below.elo if gap is None else gap.low) > 0.0


def describe_method(seed: int) -> dict[str, Any]:
    """The parameters of the ratings, as plain data."""
    return {
        "method": "Plackett-Luce, maximum posterior; of two teams Bradley-Terry, draws as halves",
        "prior_elo": PRIOR_ELO,
        "seat_prior_elo": SEAT_PRIOR_ELO,
        "bootstraps": [LEAST_RESAMPLES, MOST_RESAMPLES, MOVE_ELO],
        "blocks": "map seeds",
        "pseudo_blocks": "one for each rating, by leverage",
        "confidence": CONFIDENCE,
        "seed": seed,
    }


def rate(names: Sequence[str], games: Games, seed: int = 0, zero: str = "") -> Ladder:
    """Ratings of all agents: a function of the games alone, whatever their order and the names.

    The mean of the largest group is 0, or the agent `zero` where it is in that group. Ratings have
    a normal prior of standard deviation PRIOR_ELO about the mean of their group, seat advantages
    one of SEAT_PRIOR_ELO about 0. Intervals are from the block bootstrap. Repeats are not counted.

    Raises:
        ValueError: no games, or agents that no chain of games compares with the others.
    """
    games = sort_games(games.count_once())
    if not len(games.agents):
        raise ValueError("there are no games to rate: play some first")
    num_agents, num_teams = len(names), games.agents.shape[1]
    above, counts = count_points(num_agents, split_pairs(games))
    # A game of more than two is one for all its pairs together.
    meetings = counts * (2.0 / (num_teams * (num_teams - 1)))
    groups = find_groups(above)
    home = find_home(groups)
    require_comparison(names, above, groups[home][0])
    rankings = [_restrict(games, group) for group in groups]
    model, rng = Likelihood(num_agents, rankings), np.random.default_rng(seed)
    point = model.fit(np.ones(model.num_blocks))
    resamples = _resample(Resampler(num_agents, games, rankings, point, groups), groups[home], rng)
    samples = ELO_PER_LOGIT * resamples.ratings
    for group in groups:
        samples[:, group] = _centre(resamples.ratings, group)
    fitted = ELO_PER_LOGIT * point[:num_agents]
    elo = place_groups(groups, home, fitted, meetings)
    moved = draw_places(groups, home, fitted, meetings, len(samples), rng)
    reference = [place for place in groups[home] if names[place] == zero] or groups[home]
    elo -= elo[reference].mean()
    about_zero = samples - samples[:, reference].mean(1, keepdims=True)
    ratings = _list_ratings(names, games, groups, elo, about_zero, samples + moved, resamples)
    order = sorted(range(num_agents), key=lambda n: (ratings[n].group, -ratings[n].elo, names[n]))
    seats, seat_samples = (ELO_PER_LOGIT * found for found in (point[num_agents:], resamples.seats))
    seats, seat_samples = seats - seats.mean(), seat_samples - seat_samples.mean(1, keepdims=True)
    return Ladder(
        tuple(ratings[n] for n in order),
        _compare(ratings, order, samples),
        _estimate(seats, seat_samples),
        names[reference[0]] if len(reference) < len(groups[home]) else "",
        len(samples),
        _find_move(resamples, groups[home]),
    )


def _list_ratings(
    names: Sequence[str],
    games: Games,
    groups: Sequence[Sequence[int]],
    elo: NDArray[np.float64],
    about_zero: NDArray[np.float64],
    placed: NDArray[np.float64],
    resamples: Resamples,
) -> list[Rating]:
    """Ratings in the order of `names`, by samples [S, n] against the zero and on the one scale of
    all groups.
    """
    low, high = find_ends(about_zero, elo)
    is_first = placed >= placed.max(1, keepdims=True) - 1e-6  # equal agents share the first place
    first = (is_first / is_first.sum(1, keepdims=True)).mean(0)
    entries = np.bincount(games.agents.ravel(), minlength=len(names))
    points = np.bincount(games.agents.ravel(), games.points.ravel(), len(names))
    home, ratings = find_home(groups), []
    place_of = {n: place for place, group in enumerate(groups) for n in group}
    for n, name in enumerate(names):
        place = place_of[n]
        is_home = place == home
        ratings.append(
            Rating(
                name,
                float(elo[n]),
                float(low[n] if is_home else elo[n]),
                float(high[n] if is_home else elo[n]),
                int((games.agents == n).any(axis=1).sum()),
                float(points[n] / entries[n]),
                "lower" if place > home else "upper" if place < home else "",
                len(groups) - 1 - place,
                float(first[n]),
                *(bool(is_home and share > TAIL) for share in resamples.is_open[:, n]),
            )
        )
    return ratings


def _estimate(values: NDArray[np.float64], samples: NDArray[np.float64]) -> tuple[Estimate, ...]:
    """Values [n] with their intervals, by their samples [S, n]."""
    columns = values, *find_ends(samples, values)
    return tuple(Estimate(*map(float, row)) for row in zip(*columns, strict=True))


def _compare(
    ratings: Sequence[Rating], order: Sequence[int], samples: NDArray[np.float64]
) -> tuple[tuple[Estimate | None, ...], ...]:
    """Differences in Elo between agents in `order`, by samples [S, n] of each group."""
    rows = []
    elo = np.array([ratings[n].elo for n in order])
    for n in order:
        gaps = _estimate(ratings[n].elo - elo, samples[:, [n]] - samples[:, order])
        rows.append(
            tuple(
                gap if ratings[n].group == ratings[other].group else None
                for gap, other in zip(gaps, order, strict=True)
            )
        )
    return tuple(rows)


def _resample(resampler: Resampler, group: Sequence[int], rng: np.random.Generator) -> Resamples:
    """As many resamples as `group` needs."""
    first = resampler.draw(LEAST_RESAMPLES, rng)
    needed = len(first.ratings) * (_find_move(first, group) / MOVE_ELO) ** 2
    most = min(MOST_RESAMPLES, MOST_WORK // resampler.work)
    more = min(math.ceil(needed), most) - LEAST_RESAMPLES
    return first if more <= 0 else resampler.draw(more, rng)


def _centre(ratings: NDArray[np.float64], group: Sequence[int]) -> NDArray[np.float64]:
    """Elo [S, group] against its mean, of ratings [S, n] in logits."""
    own = ELO_PER_LOGIT * ratings[:, group]
    return np.asarray(own - own.mean(1, keepdims=True), np.float64)


def _find_move(resamples: Resamples, group: Sequence[int]) -> float:
    """The Elo by which another seed moves the ends of the intervals of `group` at most, 95 % of the
    time.

    The standard error of a quantile is that of its probability over the density there, estimated
    from the quantiles on either side; two seeds differ by the square root of 2 of it.
    """
    samples = _centre(resamples.ratings, group)
    moves = [0.0]
    for end, is_open in zip((TAIL, 1.0 - TAIL), resamples.is_open[:, group] > TAIL, strict=True):
        nearer, further = np.quantile(samples, (end - TAIL / 2.0, end + TAIL / 2.0), axis=0)
        moves += (further - nearer)[~is_open].tolist()
    return Z * math.sqrt(2.0 * TAIL * (1.0 - TAIL) / len(samples)) * max(moves) / TAIL


def _restrict(games: Games, group: Sequence[int]) -> Rankings:
    """The finishing orders within a group: Plackett-Luce holds for the rest of a ranking too."""
    is_inside = np.isin(games.agents, group)
    is_inside &= is_inside.sum(axis=1, keepdims=True) > 1
    above = is_inside[:, None, :] & (games.ranks[:, None, :] < games.ranks[:, :, None])
    level = is_inside[:, None, :] & (games.ranks[:, None, :] == games.ranks[:, :, None])
    ranks = np.where(is_inside, above.sum(2) + (level.sum(2) + 1.0) / 2.0, 0.0)
    return Rankings(games.agents, ranks, games.blocks)
