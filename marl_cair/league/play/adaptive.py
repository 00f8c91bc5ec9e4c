"""Adaptive schedule: plays the games that shrink the widest interval most, until a limit."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.play.schedule import Job, fill_line_up, schedule_meetings
from marl_cair.league.ratings.games import Games, count_points, split_pairs
from marl_cair.league.ratings.groups import ELO_PER_LOGIT, find_groups
from marl_cair.league.ratings.intervals import Z
from marl_cair.league.ratings.likelihood import Likelihood, Rankings
from marl_cair.league.ratings.rate import Rating

# Jobs of a round are chosen together, as ratings with intervals take longer than a game and several
# workers play: 8, or a share of the jobs so far. The number of workers has no influence.
JOBS_PER_ROUND, SHARE_PER_ROUND = 8, 0.125
ENOUGH_REPEATS = 24  # of a line-up, that no more of its games are played
LEAST_WIDTH = 1e-9  # in Elo
ENOUGH_SWEPT = 48  # games of an agent without an interval: it may yet win, or lose, one

# Plays jobs; returns the games so far, agents by number, and int64 [N] the number of each game's
# block within its line-up.
Play = Callable[[Sequence[Job]], tuple[Games, NDArray[np.int64]]]


@dataclass(frozen=True)
class AdaptivePlan:
    """Sizes and limits of an adaptive league."""

    num_agents: int
    num_teams: int  # of a game
    blocks_per_chunk: int
    games_per_chunk: int
    half_width_elo: float  # widest 95 % interval of a rating that is allowed; 0: no limit
    games_per_pair: int  # a pair that has met in so many games does not play on
    is_time_up: Callable[[], bool]  # called before each round; `play` may call it and omit jobs
    measure: Callable[[Games], NDArray[np.float64]]  # reported half-widths [n] in Elo; 0: none
    ladder: frozenset[int] = frozenset()  # agents that do not play each other


class Clock:
    """Time limit of `seconds` from `start` (0: none); `has_ended`: whether a check was too late."""

    def __init__(self, seconds: float) -> None:
        self.has_ended = False
        self._seconds = seconds or math.inf
        self._end = math.inf

    def start(self) -> None:
        """Start counting."""
        self._end = time.monotonic() + self._seconds

    def is_time_up(self) -> bool:
        """Whether the seconds have passed."""
        self.has_ended = self.has_ended or time.monotonic() > self._end
        return self.has_ended


def describe_ending(half_width_elo: float, ratings: Sequence[Rating], is_time_up: bool) -> str:
    """Whether all intervals are within `half_width_elo` (0: no limit), and whether time is up."""
    why = "the time of --time is up; the same command resumes it" if is_time_up else ""
    if half_width_elo <= 0.0:
        return f"Ended as {why}." if why else ""
    asked = f"within {half_width_elo:g} Elo either way (--ci)"
    limited = [r for r in ratings if not r.is_bound and r.low < r.high]
    bare = len(ratings) - len(limited)
    wide = sum((r.high - r.low) / 2.0 > half_width_elo for r in limited)
    if limited and not wide:
        but = f", but for {bare} of {len(ratings)} agents that have none" if bare else ""
        return f"All intervals are {asked}{but}."
    if not why:
        why = "all games are played that --games allows and that do not only repeat others"
        if not limited:
            why = f"no agent has both won and lost, and {why}, or {ENOUGH_SWEPT} of each agent"
    found = f"{wide} of {len(limited)} are wider" if limited else "there are none"
    return f"Not reached: intervals {asked}, {found}: {why}."


def play_adaptively(plan: AdaptivePlan, play: Play) -> list[Job]:
    """Call `play` with more and more jobs until a limit is reached; returns all jobs.

    `play` takes all jobs so far, the new ones last, and returns their games (of some jobs if time
    is up). The choice depends on these games alone: a killed league chooses the same jobs again.
    """
    jobs = schedule_meetings(plan.num_agents, plan.num_teams, 1, plan.games_per_chunk, plan.ladder)
    # Neighbours first: they connect all agents soonest, and time may be up before all have met.
    jobs.sort(key=lambda job: job.line_up[-1] - job.line_up[0])
    while True:
        played = play(jobs)
        if plan.is_time_up():
            return jobs
        chosen = _choose_round(plan, *played)
        if not chosen:
            return jobs
        jobs += chosen


def _choose_round(plan: AdaptivePlan, games: Games, blocks: NDArray[np.int64]) -> list[Job]:
    """The next jobs; none if the intervals are narrow enough, or no pair may play on.

    Each job is for the agent with the widest interval (agents that have never lost or never won
    have none: they come first, up to `ENOUGH_SWEPT` games) and for the opponent with the most
    informative games: variance of their difference times p (1 - p). The next job is chosen as if
    that one had been played. Only the reported intervals end the league; the curvature predicts how
    much games narrow them.
    """
    num_agents, line_ups = plan.num_agents, np.sort(games.agents, axis=1)
    chunks = _count_chunks(line_ups, blocks // plan.blocks_per_chunk)
    num_jobs = sum(n for line_up, n in chunks.items() if not set(line_up) <= plan.ladder)
    met = count_meetings(num_agents, line_ups)
    may_play = _find_open_pairs(plan, games, line_ups, met)
    counted = games.count_once()
    above, _ = count_points(num_agents, split_pairs(counted))
    model = Likelihood(num_agents, [Rankings(counted.agents, counted.ranks, counted.blocks)])
    point = model.fit(np.ones(model.num_blocks))
    curvature = model.find_curvature(point)
    rating = point[:num_agents]
    chance = 1.0 / (1.0 + np.exp(rating[None, :] - rating[:, None]))
    information = chance * (1.0 - chance)  # by a game of two, in 1 / logits squared
    groups = find_groups(above)
    scale = np.ones(num_agents)
    if plan.half_width_elo > 0.0:
        expected, _ = _predict_widths(curvature, num_agents, groups)
        scale = plan.measure(games) / np.maximum(expected, 1e-9)
    jobs: list[Job] = []
    while len(jobs) < max(JOBS_PER_ROUND, SHARE_PER_ROUND * num_jobs):
        half_widths, gaps = _predict_widths(curvature, num_agents, groups)
        widest = _find_widest(half_widths * scale, may_play, met, plan.half_width_elo)
        if widest is None:
            return jobs
        worth = np.where(may_play[widest], gaps[widest] * information[widest], -1.0)
        opponent = int(worth.argmax())
        pair = min(widest, opponent), max(widest, opponent)
        line_up = fill_line_up(pair, plan.num_teams, met)
        jobs.append(Job(line_up, chunks[line_up]))
        chunks[line_up] += 1
        members = sorted(set(line_up))
        num_games = plan.games_per_chunk * (1 - np.eye(len(members), dtype=int))
        met[np.ix_(members, members)] += num_games
        may_play &= met < plan.games_per_pair
        for one in members:
            for two in members:
                if one < two:
                    # A game of T teams informs about T - 1 choices, shared by its pairs.
                    share = 2.0 / plan.num_teams * plan.games_per_chunk * information[one, two]
                    curvature[[one, two], [one, two]] += share
                    curvature[[one, two], [two, one]] -= share
    return jobs


def _find_widest(
    half_widths: NDArray[np.float64],
    may_play: NDArray[np.bool_],
    met: NDArray[np.int64],
    enough: float,
) -> int | None:
    """The agent whose interval is to shrink; None: all are narrow `enough`, or may not play."""
    has_none = half_widths == 0.0
    widths = np.where(has_none, LEAST_WIDTH, half_widths)  # if only time ends, they play on at last
    widths[has_none & (met.sum(1) < ENOUGH_SWEPT)] = math.inf
    widths[~may_play.any(1)] = 0.0
    widest = int(widths.argmax())
    return None if widths[widest] <= enough else widest


def measure_ladder(
    ratings: Sequence[Rating], names: Sequence[str], zero: str = ""
) -> NDArray[np.float64]:
    """Half-widths of the intervals of `names` [n], 0 for those that have none. zero: the agent that
    is rated 0, surely.
    """
    widths = {rating.name: (rating.high - rating.low) / 2.0 for rating in ratings}
    if zero:
        widths[zero] = max(widths[zero], LEAST_WIDTH)
    return np.array([widths[name] for name in names])


def _predict_widths(
    curvature: NDArray[np.float64], num_agents: int, groups: Sequence[Sequence[int]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half-widths [n] in Elo against the mean of the group, and variances [n, n] of differences."""
    covariance = np.linalg.inv(curvature)[:num_agents, :num_agents]
    spread = covariance.diagonal()
    gaps = spread[:, None] + spread - 2.0 * covariance
    half_widths = np.zeros(num_agents)
    for group in groups:
        own = covariance[np.ix_(group, group)]
        # Centred: otherwise each rating has the variance of the mean, which no game reduces.
        centred = own.diagonal() - 2.0 * own.mean(1) + own.mean()
        half_widths[group] = ELO_PER_LOGIT * Z * np.sqrt(np.maximum(centred, 0.0))
    return half_widths, gaps


def _count_chunks(
    line_ups: NDArray[np.int64], chunks: NDArray[np.int64]
) -> Counter[tuple[int, ...]]:
    counted: Counter[tuple[int, ...]] = Counter()
    for line_up, chunk in zip(map(tuple, line_ups.tolist()), chunks.tolist(), strict=True):
        counted[line_up] = max(counted[line_up], chunk + 1)
    return counted


def count_meetings(num_agents: int, line_ups: NDArray[np.int64]) -> NDArray[np.int64]:
    """The number of games [n, n] in which each pair has met; line_ups [N, T] of sorted agents."""
    met = np.zeros((num_agents, num_agents), np.int64)
    unique, games = np.unique(line_ups, axis=0, return_counts=True)
    for line_up, number in zip(unique, games.tolist(), strict=True):
        members = np.unique(line_up)
        met[np.ix_(members, members)] += number
    np.fill_diagonal(met, 0)
    return met


def _find_open_pairs(
    plan: AdaptivePlan,
    games: Games,
    line_ups: NDArray[np.int64],
    met: NDArray[np.int64],
) -> NDArray[np.bool_]:
    """Pairs [n, n] below their number of games, without those that only repeat games."""
    may_play = met < plan.games_per_pair
    np.fill_diagonal(may_play, val=False)
    for one in plan.ladder:
        may_play[one, list(plan.ladder)] = False
    unique, numbers = np.unique(line_ups, axis=0, return_inverse=True)
    for number, line_up in enumerate(unique):
        own = numbers.ravel() == number
        if games.is_repeat[own].sum() >= ENOUGH_REPEATS:
            members = np.unique(line_up)
            may_play[np.ix_(members, members)] = False
    return may_play
