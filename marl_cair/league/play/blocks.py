"""Seat blocks: one map seed, played with the same agents in every seat.

A line-up is one agent for each team (one for each seat, where everybody plays for itself).
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.play.playing import (
    CHUNKS_AT_ONCE,
    Chunk,
    Places,
    Seating,
    map_seeds,
    play_out,
    start_engine,
)
from marl_cair.league.store.records import PlayedGame

if TYPE_CHECKING:  # which imports the compiler
    from marl_cair.games.engine import BatchedEngine

GAMES_PER_CHUNK = 8  # at least, in whole blocks
SEATINGS = ("ring", "all")
MAX_TEAMS_FOR_ALL = 4  # 24 orders; five teams would have 120

# Block -> which entry of the line-up plays each team, int64 [games of a block, teams].
Design = Callable[[int], NDArray[np.int64]]


class Entrant(NamedTuple):
    """An agent of a line-up; `fingerprint` identifies its weights (a bot's rules version)."""

    name: str
    fingerprint: str
    agent: Agent
    source: str = ""  # what `load_agent` takes


def make_design(num_teams: int, seating: str, seed: int) -> Design:
    """Who plays which team in each game of a block.

    "all": every order of the line-up, teams! games. "ring": the rotations of a ring that is drawn
    again for each block from (seed, block), one game for each team: every entry has every team
    once, and over many blocks every entry has every neighbour. Of two teams both are the same.

    Raises:
        ValueError: no such seating, or "all" of more than MAX_TEAMS_FOR_ALL teams.
    """
    if seating not in SEATINGS:
        raise ValueError(f"seating is {seating!r}, it must be one of {', '.join(SEATINGS)}")
    if seating == "all" and num_teams > MAX_TEAMS_FOR_ALL:
        raise ValueError(
            f"seating is 'all', but {num_teams} teams have {math.factorial(num_teams):,} orders: "
            "take 'ring'"
        )
    if seating == "all" or num_teams == 2:
        orders = np.array(list(itertools.permutations(range(num_teams))), np.int64)
        return lambda block: orders

    def rotate_ring(block: int) -> NDArray[np.int64]:
        digest = hashlib.blake2b(f"{seed} ring {block}".encode(), digest_size=8).digest()
        ring = np.random.default_rng(int.from_bytes(digest, "big")).permutation(num_teams)
        steps = np.arange(num_teams)
        return np.asarray(ring[(steps[:, None] + steps) % num_teams], np.int64)

    return rotate_ring


def count_blocks_per_chunk(games_per_block: int) -> int:
    """So many that a chunk is a batch worth playing."""
    return max(1, GAMES_PER_CHUNK // games_per_block)


def seat_line_up(line_up: Sequence[Entrant]) -> tuple[Seating, ...]:
    """Each entry with the names that its draws depend on; copies of an agent draw apart."""
    prints = [entrant.fingerprint for entrant in line_up]
    names = [
        f"{own} (copy {prints[:place].count(own)})" if own in prints[:place] else own
        for place, own in enumerate(prints)
    ]
    return tuple(
        Seating(entrant.agent, (names[place], *names[:place], *names[place + 1 :]))
        for place, entrant in enumerate(line_up)
    )


def play_blocks(
    seatings: Sequence[Seating],
    game: Game,
    scenario: Any,
    seed: int,
    chunks: Sequence[int],
    design: Design,
    blocks_per_chunk: int,
    map_seed: int | None = None,
) -> list[PlayedGame]:
    """Play whole chunks, by block and game; which chunks are named together changes no game.

    Chunk c holds the blocks c * blocks_per_chunk onwards. Each entry has its own random stream in
    each chunk, from the seed, the chunk and the names of its seating. Block k has the map seed of
    (map_seed, k); None: of (seed, k).

    Raises:
        ValueError: no chunk.
    """
    if not len(chunks):
        raise ValueError("no chunks are given: name at least one to play")
    played: list[PlayedGame] = []
    of_maps = seed if map_seed is None else map_seed
    for start in range(0, len(chunks), CHUNKS_AT_ONCE):
        part = [
            make_chunk(number, design, blocks_per_chunk, game.make_spec(scenario).team_of_seat)
            for number in chunks[start : start + CHUNKS_AT_ONCE]
        ]
        engine = start_engine(game, scenario, of_maps, part)
        played += _play_part(engine, seatings, seed, part, design, of_maps)
    return played


def make_chunk(
    number: int, design: Design, blocks_per_chunk: int, teams: NDArray[np.int64]
) -> Chunk:
    """The chunk of this number; teams int64 [P] of the seats.

    Each entry is shown its seats by block and own team: so a match between two teams is the same
    from both sides.
    """
    first = number * blocks_per_chunk
    designs = [design(block) for block in range(first, first + blocks_per_chunk)]
    entries = np.concatenate(designs)
    blocks = first + np.repeat(np.arange(blocks_per_chunk), [len(one) for one in designs])
    grid = np.meshgrid(np.arange(len(entries)), np.arange(len(teams)), indexing="ij")
    game, seat = (axis.ravel() for axis in grid)
    order = np.lexsort((seat, game, teams[seat], blocks[game]))
    game, seat = game[order], seat[order]
    entry = entries[game, teams[seat]]
    places = tuple(
        Places(game[entry == place], seat[entry == place]) for place in range(entries.max() + 1)
    )
    return Chunk(number, blocks, places)


def _play_part(
    engine: BatchedEngine,
    seatings: Sequence[Seating],
    seed: int,
    chunks: Sequence[Chunk],
    design: Design,
    map_seed: int,
) -> list[PlayedGame]:
    ended = play_out(engine, chunks, seatings, seed)
    teams = engine.spec.team_of_seat
    blocks = np.concatenate([chunk.blocks for chunk in chunks])
    seeds = map_seeds(map_seed, blocks)
    played: list[PlayedGame] = []
    for world, block in enumerate(blocks.tolist()):
        number = played[-1].number + 1 if played and played[-1].block == block else 0
        winner = int(ended.winner[world])
        played.append(
            PlayedGame(
                block=block,
                number=number,
                map_seed=int(seeds[world]),
                entries=tuple(design(block)[number].tolist()),
                points=tuple(ended.points[world].tolist()),
                ranks=tuple(ended.ranks[world].tolist()),
                winner=winner if winner < 0 else int(teams[winner]),
                is_truncated=bool(ended.truncated[world]),
                decisions=int(ended.decisions[world]),
                trajectory=ended.trajectories[world],
                forfeited=tuple(ended.forfeited[world].tolist()),
                reason=ended.reasons[world],
            )
        )
    return played
