"""Adaptive schedule: plays the games that shrink the widest interval most."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.play.schedule import Job, fill_line_up, schedule_meetings
from marl_cair.league.ratings.games import Games, count_points, split_pairs
from marl_cair.league.ratings.groups import ELO_PER_LOGIT, find_groups
from marl_cair.league.ratings.intervals import Z
from marl_cair.league.ratings.likelihood import Likelihood, Rankings
from marl_cair.league.ratings.rate import Rating

# Jobs are chosen together, for the speed of several workers, and as ratings with intervals take
# longer than a game: 8, or a share of those so far. Never by the number of workers.
JOBS_PER_ROUND, SHARE_PER_ROUND = 8, 0.125


class Played(NamedTuple):
    """What the jobs of a league have given so far."""

    games: Games  # agents by number
    line_ups: NDArray[np.int64]  # [N, T], sorted numbers of the agents of each game
    blocks: NDArray[np.int64]  # [N], number of the block within its line-up


@dataclass(frozen=True)
class Target:
    """When to stop.

    Attributes:
        half_width_elo: of the widest 95 % interval of a rating; 0: play on for ever.
        games_per_pair: no pair meets in more games than these.
        is_time_up: asked before each round; `play` may ask it too and leave jobs out.
        measure: half-widths [n] in Elo of the intervals that are reported of games, 0 for agents
            that have none; agents by number.
    """

    half_width_elo: float
    games_per_pair: int
    is_time_up: Callable[[], bool]
    measure: Callable[[Games], NDArray[np.float64]]


def play_adaptively(
    num_agents: int,
    num_teams: int,
    blocks_per_chunk: int,
    games_per_chunk: int,
    target: Target,
    play: Callable[[Sequence[Job]], Played],
    ladder: frozenset[int] = frozenset(),
) -> list[Job]:
    """Call `play` with ever more jobs until the target is reached; returns all jobs.

    `play` is given all jobs so far, the new ones last, and returns their games (where time is up,
    those of some). What is chosen depends on these games alone: a league that was killed chooses
    again what it had chosen.
    """
    jobs = schedule_meetings(num_agents, num_teams, 1, games_per_chunk, ladder)
    # Neighbours first, who link everybody soonest: time may be up before all pairs have met.
    jobs.sort(key=lambda job: job.line_up[-1] - job.line_up[0])
    while True:
        played = play(jobs)
        if target.is_time_up():
            return jobs
        chosen = choose_round(
            num_agents, num_teams, blocks_per_chunk, games_per_chunk, target, played, ladder
        )
        if not chosen:
            return jobs
        jobs += chosen


def choose_round(
    num_agents: int,
    num_teams: int,
    blocks_per_chunk: int,
    games_per_chunk: int,
    target: Target,
    played: Played,
    ladder: frozenset[int] = frozenset(),
) -> list[Job]:
    """The next jobs, none where the target is reached or no pair may play on.

    Each job is for the agent with the widest interval among those that have one (who has never lost
    or never won has none), and for the opponent with the most informative games
    (variance of their difference times p (1 - p)). Then the next one is chosen as if that job had
    been played. Only the reported intervals end it; the curvature predicts how games narrow them.
    """
    chunks = _count_chunks(played, blocks_per_chunk)
    num_jobs = sum(chunks.values())
    met = count_meetings(num_agents, played.line_ups)
    may_play = _find_open_pairs(num_agents, target, played, met, ladder)
    games = played.games.count_once()
    above, _ = count_points(num_agents, split_pairs(games))
    model = Likelihood(num_agents, [Rankings(games.agents, games.ranks, games.blocks)])
    point = model.fit(np.ones(model.num_blocks))
    curvature = model.find_curvature(point)
    rating = point[:num_agents]
    chance = 1.0 / (1.0 + np.exp(rating[None, :] - rating[:, None]))
    information = chance * (1.0 - chance)  # by a game of two, in 1 / logits squared
    groups = find_groups(above)
    scale = np.ones(num_agents)
    if target.half_width_elo > 0.0:
        expected, _ = _measure(curvature, num_agents, groups)
        scale = target.measure(played.games) / np.maximum(expected, 1e-9)
    jobs: list[Job] = []
    while len(jobs) < max(JOBS_PER_ROUND, SHARE_PER_ROUND * num_jobs):
        half_widths, gaps = _measure(curvature, num_agents, groups)
        half_widths *= scale
        half_widths[~may_play.any(1)] = 0.0
        widest = int(half_widths.argmax())
        if half_widths[widest] <= target.half_width_elo:
            return jobs
        worth = np.where(may_play[widest], gaps[widest] * information[widest], -1.0)
        rival = int(worth.argmax())
        line_up = fill_line_up((min(widest, rival), max(widest, rival)), num_teams, met)
        jobs.append(Job(line_up, chunks[line_up]))
        chunks[line_up] += 1
        members = sorted(set(line_up))
        met[np.ix_(members, members)] += games_per_chunk * (1 - np.eye(len(members), dtype=int))
        may_play &= met < target.games_per_pair
        for one in members:
            for two in members:
                if one < two:
                    # A game of T teams informs about T - 1 choices, shared by its pairs.
                    share = 2.0 / num_teams * games_per_chunk * information[one, two]
                    curvature[[one, two], [one, two]] += share
                    curvature[[one, two], [two, one]] -= share
    return jobs


def measure_ladder(ratings: Sequence[Rating], names: Sequence[str]) -> NDArray[np.float64]:
    """Half-widths of the intervals of `names` [n], 0 for those that have none."""
    widths = {rating.name: (rating.high - rating.low) / 2.0 for rating in ratings}
    return np.array([widths[name] for name in names])


def _measure(
    curvature: NDArray[np.float64], num_agents: int, groups: Sequence[Sequence[int]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half-widths [n] in Elo against the mean of the group, and variances [n, n] of differences."""
    covariance = np.linalg.inv(curvature)[:num_agents, :num_agents]
    spread = covariance.diagonal()
    gaps = spread[:, None] + spread - 2.0 * covariance
    half_widths = np.zeros(num_agents)
    for group in groups:
        own = covariance[np.ix_(group, group)]
        # Centred: else the spread of the mean, that no game limits, would be in every rating.
        centred = own.diagonal() - 2.0 * own.mean(1) + own.mean()
        half_widths[group] = ELO_PER_LOGIT * Z * np.sqrt(np.maximum(centred, 0.0))
    return half_widths, gaps


def _count_chunks(played: Played, blocks_per_chunk: int) -> Counter[tuple[int, ...]]:
    counted: Counter[tuple[int, ...]] = Counter()
    for line_up, block in zip(
        map(tuple, played.line_ups.tolist()), played.blocks.tolist(), strict=True
    ):
        counted[line_up] = max(counted[line_up], block // blocks_per_chunk + 1)
    return counted


def count_meetings(num_agents: int, line_ups: NDArray[np.int64]) -> NDArray[np.int64]:
    """In how many games of line_ups [N, T] (sorted agents) each pair has met, [n, n]."""
    met = np.zeros((num_agents, num_agents), np.int64)
    unique, games = np.unique(line_ups, axis=0, return_counts=True)
    for line_up, number in zip(unique, games.tolist(), strict=True):
        members = np.unique(line_up)
        met[np.ix_(members, members)] += number
    np.fill_diagonal(met, 0)
    return met


def _find_open_pairs(
    num_agents: int,
    target: Target,
    played: Played,
    met: NDArray[np.int64],
    ladder: frozenset[int],
) -> NDArray[np.bool_]:
    """Pairs [n, n] below their number of games whose last block was not all repeats."""
    may_play = met < target.games_per_pair
    np.fill_diagonal(may_play, val=False)
    for one in ladder:
        may_play[one, list(ladder)] = False
    line_ups, numbers = np.unique(played.line_ups, axis=0, return_inverse=True)
    for number, line_up in enumerate(line_ups):
        own = numbers.ravel() == number
        last = own & (played.blocks == played.blocks[own].max())
        if played.games.is_repeat[last].all():
            members = np.unique(line_up)
            may_play[np.ix_(members, members)] = False
    return may_play
