"""Rates stored games of two or more teams: Plackett-Luce with bootstrap intervals."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.groups import ELO_PER_LOGIT, find_groups, require_comparison
from marl_cair.league.ratings.intervals import CONFIDENCE, Z
from marl_cair.league.ratings.likelihood import PRIOR_ELO, SEAT_PRIOR_ELO, Likelihood, Rankings
from marl_cair.league.ratings.placing import draw_places, find_home, place_groups
from marl_cair.league.ratings.resampling import Resampler, Resamples

# Resamples: LEAST, and as many up to MOST (and MOST_WORK, some seconds) as ends of intervals need
# to stay within MOVE of where another seed of the resampling would put them (95 % of the time).
LEAST_RESAMPLES, MOST_RESAMPLES, MOST_WORK, MOVE_ELO = 1_000, 20_000, 100_000_000, 2.0
TAIL = (1.0 - CONFIDENCE) / 2.0


@dataclass(frozen=True)
class Games:
    """N games of T teams, as `StoredGames` has them; agents by place in a list of names.

    Attributes:
        agents: int64 [N, T].
        points, ranks: float64 [N, T].
        blocks: int64 [N], equal for games on one map seed: what is resampled. A block is of one
            line-up, or of several that shared their map seeds.
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
        """Without repeats; blocks are renumbered without gaps."""
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
        low, high: 95 % interval against the zero of the scale, as `elo` is; both are equal to `elo`
            where `bound` is set, and of the agent that is the zero.
        open_low, open_high: that end is where the prior has put it: in more than 2.5 % of the
            resamples no point limits the rating on that side.
        games, score: number of games, and share of points in them.
        bound: "lower" where the agent's group lost no point to the largest group, which has the
            zero, neither itself nor through others: its ratings may all be larger by one unknown
            number. "upper" where it never took one: they may all be smaller. "" in the largest.
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
    """What ratings depend on beside the games, as plain data."""
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
    one of SEAT_PRIOR_ELO about 0. The bootstrap draws whole blocks (a map seed in all its
    seatings), never single games; `resampling` says what it adds to them. Repeats are not counted.

    Raises:
        ValueError: no games, or agents that no chain of games compares with the others; names them.
    """
    games = sort_games(games.count_once())
    if not len(games.agents):
        raise ValueError("there are no games to rate: play some first")
    above, meetings = count_pairs(len(names), games)
    groups = find_groups(above)
    home = find_home(groups)
    require_comparison(names, above, groups[home][0])
    rankings = [_restrict(games, group) for group in groups]
    model, rng = Likelihood(len(names), rankings), np.random.default_rng(seed)
    point = model.fit(np.ones(model.num_blocks))
    whole = Rankings(games.agents, games.ranks, games.blocks)
    resamples = _resample(Resampler(len(names), whole, rankings, point, groups), groups[home], rng)
    fitted = ELO_PER_LOGIT * point[: len(names)]
    elo = place_groups(groups, home, fitted, meetings)
    moved = draw_places(groups, home, fitted, meetings, len(resamples.ratings), rng)
    reference = [place for place in groups[home] if names[place] == zero] or groups[home]
    elo -= elo[reference].mean()
    samples = _Samples(point, resamples, groups, moved, reference)
    return samples.make_ladder(names, elo, groups, home, games)


def _resample(resampler: Resampler, group: Sequence[int], rng: np.random.Generator) -> Resamples:
    """As many resamples as `group` needs."""
    first = resampler.draw(LEAST_RESAMPLES, rng)
    needed = len(first.ratings) * (_find_move(first, group) / MOVE_ELO) ** 2
    most = min(MOST_RESAMPLES, MOST_WORK // resampler.work)
    more = min(math.ceil(needed), most) - LEAST_RESAMPLES
    return first if more <= 0 else first.join(resampler.draw(more, rng))


def _centre(ratings: NDArray[np.float64], group: Sequence[int]) -> NDArray[np.float64]:
    """Elo [S, group] against its mean, of ratings [S, n] in logits."""
    own = ELO_PER_LOGIT * ratings[:, group]
    return np.asarray(own - own.mean(1, keepdims=True), np.float64)


def _find_move(resamples: Resamples, group: Sequence[int]) -> float:
    """How far another seed puts the ends of the intervals of `group` at most, 95 % of the time.

    The standard error of a quantile is that of its probability over the density there, estimated
    from the quantiles on either side; two seeds differ by the square root of 2 of it.
    """
    samples = _centre(resamples.ratings, group)
    moves = [0.0]
    for end, is_open in ((TAIL, resamples.open_low), (1.0 - TAIL, resamples.open_high)):
        nearer, further = np.quantile(samples, (end - TAIL / 2.0, end + TAIL / 2.0), axis=0)
        is_held = is_open[group] <= TAIL * len(samples)
        moves += (further - nearer)[is_held].tolist()
    return Z * math.sqrt(2.0 * TAIL * (1.0 - TAIL) / len(samples)) * max(moves) / TAIL


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
    """Games and blocks sorted by their content, not by time."""
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


class _Samples:
    """The fit, and fits to resampled blocks: Elo [S, n] and [S, T], centred by group and team.

    reference: the agents whose mean is the zero of the scale.
    """

    def __init__(
        self,
        point: NDArray[np.float64],
        resamples: Resamples,
        groups: Sequence[list[int]],
        moved: NDArray[np.float64],
        reference: Sequence[int],
    ) -> None:
        """moved: Elo [S, n] of the mean of the agent's group."""
        self.point, self.moved, self.reference = point, moved, reference
        self.resamples = resamples
        self.fitted = ELO_PER_LOGIT * resamples.ratings
        for group in groups:
            self.fitted[:, group] = _centre(resamples.ratings, group)
        self.seats = ELO_PER_LOGIT * resamples.seats
        self.seats -= self.seats.mean(1, keepdims=True)

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
        about_zero = self.fitted - self.fitted[:, self.reference].mean(1, keepdims=True)
        least = TAIL * len(self.fitted)
        for place, group in enumerate(groups):
            for index in group:
                low = high = float(elo[index])
                if place == home:
                    low, high = _find_ends(about_zero[:, index], elo[index])
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
                        place == home and bool(self.resamples.open_low[index] > least),
                        place == home and bool(self.resamples.open_high[index] > least),
                    )
                )
        ratings.sort(key=lambda rating: (rating.group, -rating.elo, rating.name))
        order = [list(names).index(rating.name) for rating in ratings]
        return Ladder(
            tuple(ratings),
            self._compare(order, ratings, elo),
            self._rate_seats(),
            names[self.reference[0]] if len(self.reference) < len(groups[home]) else "",
            len(self.fitted),
            _find_move(self.resamples, groups[home]),
        )

    def _find_best(self) -> NDArray[np.float64]:
        """Share of the samples in which each agent is first; equal ones share the place."""
        placed = self.fitted + self.moved
        is_first = placed >= placed.max(1, keepdims=True) - 1e-6
        return np.asarray((is_first / is_first.sum(1, keepdims=True)).mean(0), np.float64)

    def _compare(
        self, order: Sequence[int], ratings: Sequence[Rating], elo: NDArray[np.float64]
    ) -> tuple[tuple[Estimate | None, ...], ...]:
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
