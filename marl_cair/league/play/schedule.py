"""Round-robin schedules of line-ups: all pairs of agents meet equally often.

Agents are numbered by fingerprint, so that schedules do not depend on names or on their order.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Job(NamedTuple):
    """A chunk of a line-up: the numbers of its agents in rising order, one for each team."""

    line_up: tuple[int, ...]
    chunk: int


def schedule_meetings(
    num_agents: int,
    num_teams: int,
    meetings: int,
    games_per_chunk: int,
    ladder: frozenset[int] = frozenset(),
) -> list[Job]:
    """Jobs after which all pairs have met in `meetings` games or more; a longer list starts with
    the shorter one.

    With two teams this is a round-robin. With more, each job starts from the pair that has met
    least and adds the agents that have met those in it least. With fewer agents than teams, the
    agents that have played least are in a line-up twice.

    ladder: agents that need not meet each other (a gauntlet: only the others' pairs are counted).
    Raises ValueError if no two agents need to meet.
    """
    pairs = [
        pair for pair in itertools.combinations(range(num_agents), 2) if not ladder.issuperset(pair)
    ]
    if not pairs:
        raise ValueError(
            "all agents are on the ladder, which is not played again: name an agent that is not"
        )
    if num_teams == 2:
        rounds = range(-(-meetings // games_per_chunk))
        return [Job(pair, chunk) for chunk in rounds for pair in pairs]
    met = np.zeros((num_agents, num_agents), np.int64)
    chunks: Counter[tuple[int, ...]] = Counter()
    jobs: list[Job] = []
    waiting = [(0, place) for place in range(len(pairs))]  # a heap: games when last checked
    while True:
        seen, place = waiting[0]
        pair = pairs[place]
        if seen < met[pair]:  # numbers only grow, so that the other pairs stay in order
            heapq.heapreplace(waiting, (int(met[pair]), place))
            continue
        if seen >= meetings:
            return jobs
        line_up = fill_line_up(pair, num_teams, met)
        for one, two in itertools.permutations(sorted(set(line_up)), 2):
            met[one, two] += games_per_chunk
        jobs.append(Job(line_up, chunks[line_up]))
        chunks[line_up] += 1


def fill_line_up(pair: tuple[int, int], num_teams: int, met: NDArray[np.int64]) -> tuple[int, ...]:
    """The pair, then repeatedly the agent that has met the chosen ones least; met int [n, n]."""
    chosen = list(pair)
    while len(chosen) < num_teams:
        copies = np.bincount(chosen, minlength=len(met))
        chosen.append(int(np.lexsort((met.sum(1), met[:, chosen].sum(1), copies))[0]))
    return tuple(sorted(chosen))
