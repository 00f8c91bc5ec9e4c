"""Ratings from stored games: one likelihood for pairs and free-for-alls, intervals by bootstrap."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from marl_cair.league.groups import (
    ELO_PER_LOGIT,
    find_gap,
    find_groups,
    require_comparison,
    split_core,
)
from marl_cair.league.intervals import CONFIDENCE
from marl_cair.league.likelihood import (
    MAX_NUMBERS,
    PRIOR_ELO,
    SEAT_PRIOR_ELO,
    Likelihood,
    Rankings,
)

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
        probability_first: share of the resamples in which it is the best of all.
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


def describe_method(seed: int) -> dict[str, Any]:
    """What ratings depend on beside the games, as plain data."""
    return {
        "method": "Plackett-Luce, maximum posterior; of two teams Bradley-Terry, draws as halves",
        "prior_elo": PRIOR_ELO,
        "seat_prior_elo": SEAT_PRIOR_ELO,
        "bootstraps": NUM_BOOTSTRAPS,
        "confidence": CONFIDENCE,
        "seed": seed,
    }


def rate(names: Sequence[str], games: Games, seed: int = 0) -> Ladder:
    """Ratings of all agents: a function of the games alone, whatever their order.

    `random` is 0 where it takes part, else the mean of the largest group. Ratings have a normal
    prior of standard deviation PRIOR_ELO about the mean of their group, seat advantages one of
    SEAT_PRIOR_ELO about 0. The bootstrap draws whole blocks (a map seed in all its seatings), never
    single games. Repeats are not counted.

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
    model = Likelihood(len(names), [_restrict(games, group) for group in groups])
    samples = _Samples(model, games, groups, above, np.random.default_rng(seed))
    elo = _place_groups(groups, home, ELO_PER_LOGIT * samples.point[: len(names)], meetings)
    if ANCHOR in names:
        elo -= elo[names.index(ANCHOR)]
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
) -> NDArray[np.float64]:
    """Elo [agents]: the home group's mean is 0, the others lie as far away as is sure."""
    elo = fitted.copy()
    for group in groups:
        elo[group] -= elo[group].mean()
    placed = list(groups[home])
    for group in groups[home + 1 :]:
        elo[group] += find_gap(elo[group], elo[placed], meetings[np.ix_(group, placed)])
        placed += group
    for group in reversed(groups[:home]):
        elo[group] -= find_gap(elo[placed], elo[group], meetings[np.ix_(placed, group)])
        placed += group
    return elo


class _Samples:
    """The fit, and fits to resampled blocks: Elo [S, n] and [S, T], centred by group and team."""

    def __init__(
        self,
        model: Likelihood,
        games: Games,
        groups: Sequence[list[int]],
        above: NDArray[np.float64],
        rng: np.random.Generator,
    ) -> None:
        num_agents, num_blocks = len(above), model.num_blocks
        self.point = model.fit(np.ones(num_blocks))
        factor = model.factorise(self.point)
        pairs = _pair_blocks(num_agents, games)
        points = np.empty((NUM_BOOTSTRAPS, model.num_parameters))
        counted = np.empty((NUM_BOOTSTRAPS, num_agents**2))
        size = max(1, MAX_NUMBERS // num_blocks)
        for first in range(0, NUM_BOOTSTRAPS, size):
            part = slice(first, min(first + size, NUM_BOOTSTRAPS))
            drawn = rng.integers(num_blocks, size=(part.stop - first, num_blocks))
            weights = np.stack([np.bincount(row, minlength=num_blocks) for row in drawn])
            points[part] = model.refit(self.point, weights.astype(np.float64), factor)
            counted[part] = weights @ pairs
        points *= ELO_PER_LOGIT
        self.fitted, self.seats = points[:, :num_agents], points[:, num_agents:]
        for group in groups:
            self.fitted[:, group] -= self.fitted[:, group].mean(1, keepdims=True)
        self.seats -= self.seats.mean(1, keepdims=True)
        self.open_high, self.open_low = np.zeros((2, num_agents))
        self._note_open(groups, above, counted)

    def _note_open(
        self,
        groups: Sequence[list[int]],
        above: NDArray[np.float64],
        samples: NDArray[np.float64],
    ) -> None:
        """Count who has left the largest part of its group upwards, and who downwards.

        samples [S, n * n]: `above` of each resample.
        """
        # Where every arrow between two agents is still there, no group has fallen apart.
        has_lost = (samples <= 0.0)[:, above.ravel() > 0.0].any(axis=1)
        for sample in samples[has_lost]:
            pairs = sample.reshape(above.shape)
            parts = connected_components(pairs > 0.0, directed=True, connection="strong")[0]
            if parts == len(groups):
                continue
            for group in groups:
                core, is_above = split_core(pairs[np.ix_(group, group)])
                self.open_high[group] += ~core & is_above
                self.open_low[group] += ~core & ~is_above

    def make_ladder(
        self,
        names: Sequence[str],
        elo: NDArray[np.float64],
        groups: Sequence[list[int]],
        home: int,
        games: Games,
    ) -> Ladder:
        """The ladder with the ratings `elo` [n], 0 at the zero of the scale."""
        best = self._find_best(groups[-1], len(names))
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

    def _find_best(self, top: Sequence[int], num_agents: int) -> NDArray[np.float64]:
        """Share of the samples in which each agent is first; equal ones share the place."""
        is_first = np.zeros((NUM_BOOTSTRAPS, num_agents))
        inside = self.fitted[:, top]
        is_first[:, top] = inside >= inside.max(1, keepdims=True) - 1e-6
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


def _pair_blocks(num_agents: int, games: Games) -> csr_array:
    """Whether the pair's first came in above its second, or level, [blocks, n * n]."""
    num_teams = games.agents.shape[1]
    rows, columns = [], []
    for one in range(num_teams):
        for two in range(num_teams):
            own, other = games.agents[:, one], games.agents[:, two]
            took = np.flatnonzero((own != other) & (games.ranks[:, one] <= games.ranks[:, two]))
            rows.append(games.blocks[took])
            columns.append(own[took] * num_agents + other[took])
    row, column = np.concatenate(rows), np.concatenate(columns)
    shape = int(games.blocks.max()) + 1, num_agents**2
    return csr_array((np.ones(len(row)), (row, column)), shape=shape)
