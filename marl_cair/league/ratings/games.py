"""Games of a league as arrays, and the pairs of agents that met in them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

MAX_NUMBERS = 2_000_000  # in an array of resamples that are computed at once


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
        return Games(**{name: array[which] for name, array in vars(self).items()})

    def count_once(self) -> Games:
        """Without repeats; blocks are renumbered without gaps."""
        kept = self.select(~self.is_repeat)
        _, blocks = np.unique(kept.blocks, return_inverse=True)
        return replace(kept, blocks=blocks.ravel().astype(np.int64))

    def digest(self, names: Sequence[str]) -> str:
        """A hash of everything that ratings depend on."""
        digest = hashlib.blake2b("\0".join(names).encode(), digest_size=16)
        for array in (self.agents, self.ranks, self.blocks):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


class PairGames(NamedTuple):
    """One row for each two teams of each game, of different agents; N rows.

    Attributes:
        first, second: int64 [N] agents, first < second.
        teams: int64 [N, 2] that the two played.
        games, blocks: int64 [N].
        scores: float64 [N] of the first: 1 it came in above the second, 0 below, 0.5 level.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    teams: NDArray[np.int64]
    games: NDArray[np.int64]
    blocks: NDArray[np.int64]
    scores: NDArray[np.float64]


def split_work(num_parts: int, numbers_each: int, most: int = MAX_NUMBERS) -> Iterator[slice]:
    """Slices of `num_parts`, so that arrays of some numbers for each hold no more than `most`."""
    step = max(1, most // max(1, numbers_each))
    for start in range(0, num_parts, step):
        yield slice(start, min(start + step, num_parts))


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


def split_pairs(games: Games) -> PairGames:
    """All pairs of teams of all games, repeats too, in the order of the games."""
    pairs = np.array(list(combinations(range(games.agents.shape[1]), 2)))
    agents, ranks = games.agents[:, pairs], games.ranks[:, pairs]  # [games, pairs, 2]
    is_turned = agents[..., 0] > agents[..., 1]
    score = (1.0 + np.sign(ranks[..., 1] - ranks[..., 0])) / 2.0
    met = agents[..., 0] != agents[..., 1]
    numbers = np.nonzero(met)[0]
    return PairGames(
        agents.min(-1)[met],
        agents.max(-1)[met],
        np.where(is_turned[..., None], pairs[:, ::-1], pairs)[met],
        numbers,
        games.blocks[numbers],
        np.where(is_turned, 1.0 - score, score)[met],
    )


def count_points(
    num_agents: int, pairs: PairGames
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """How often the row's agent came in above the column's, ties half, and games of both: [n, n]
    each.
    """
    points = np.zeros((num_agents, num_agents))
    counts = np.zeros((num_agents, num_agents), np.int64)
    for own, other, scores in (
        (pairs.first, pairs.second, pairs.scores),
        (pairs.second, pairs.first, 1.0 - pairs.scores),
    ):
        np.add.at(points, (own, other), scores)
        np.add.at(counts, (own, other), 1)
    return points, counts


def find_shares(points: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Float64 [n, n] points / counts; 0.5 where nothing was played."""
    return np.where(counts > 0, points / np.maximum(counts, 1), 0.5)
