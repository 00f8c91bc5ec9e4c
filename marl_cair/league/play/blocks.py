"""Plays seat blocks: games on one map seed, with the same agents in every seat.

A line-up has one agent for each team; in a free-for-all each seat is a team.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.play import playing
from marl_cair.league.play.playing import Chunk, Places, Seating
from marl_cair.league.play.recording import Recording, recording
from marl_cair.league.store.schema import PlayedGame

GAMES_PER_CHUNK = 8  # at least, in whole blocks
SEATINGS = ("ring", "all")
MAX_TEAMS_FOR_ALL = 4  # 24 orders; five teams would have 120

# Maps the number of a block to the entry of each team, int64 [games of a block, teams].
Design = Callable[[int], NDArray[np.int64]]


class Plan(NamedTuple):
    """The games of a chunk."""

    design: Design
    blocks_per_chunk: int


class Entrant(NamedTuple):
    """An agent of a line-up."""

    name: str
    fingerprint: str  # of its weights, or a bot's rules version
    agent: Agent
    source: str = ""  # for `load_agent`


def make_design(num_teams: int, seating: str, seed: int) -> Design:
    """The entry of each team in each game of a block.

    "all": every order of the line-up, teams! games. "ring": the rotations of a ring that is drawn
    for each block from (seed, block), one game for each team: every entry has every team once, and
    over many blocks every entry has every neighbour. With two teams both are the same.

    Raises ValueError: unknown seating, or "all" with more than MAX_TEAMS_FOR_ALL teams.
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


def seat_line_up(line_up: Sequence[Entrant]) -> tuple[Seating, ...]:
    """Each entry with the names that seed its draws; copies of an agent draw differently."""
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
    plan: Plan,
    map_seed: int | None = None,
    record: Recording | None = None,
) -> list[PlayedGame]:
    """Play whole chunks; the games, sorted by block and number, do not depend on which chunks are
    played together.

    Chunk c holds the blocks c * plan.blocks_per_chunk onwards. Each entry has its own random stream
    in each chunk, from the seed, the chunk and the names of its seating. Block k has the map seed
    of (map_seed, k); default: of (seed, k). `record`: where to record the games.

    Raises ValueError if there is no chunk.
    """
    if not len(chunks):
        raise ValueError("no chunks are given: name at least one to play")
    teams = game.make_spec(scenario).team_of_seat
    map_seed = seed if map_seed is None else map_seed
    played: list[PlayedGame] = []
    at_once = playing.count_chunks(game)
    for start in range(0, len(chunks), at_once):
        numbers = chunks[start : start + at_once]
        part = [make_chunk(number, plan, teams) for number in numbers]
        engine = playing.start_engine(game, scenario, map_seed, part)
        blocks = np.concatenate([chunk.blocks for chunk in part])
        seeds = playing.map_seeds(map_seed, blocks)
        with recording(record, engine, part, seeds) as watch:
            ended = playing.play_out(engine, part, seatings, seed, watch)
        engine.close()
        for world, block in enumerate(blocks.tolist()):
            number = played[-1].number + 1 if played and played[-1].block == block else 0
            winner = int(ended.winner[world])
            played.append(
                PlayedGame(
                    block=block,
                    number=number,
                    map_seed=int(seeds[world]),
                    entries=tuple(plan.design(block)[number].tolist()),
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


def make_chunk(number: int, plan: Plan, teams: NDArray[np.int64]) -> Chunk:
    """The chunk of this number; teams int64 [P] of the seats.

    Each entry observes its seats sorted by block and own team, so that a match between two teams is
    the same from both sides.
    """
    first = number * plan.blocks_per_chunk
    designs = [plan.design(block) for block in range(first, first + plan.blocks_per_chunk)]
    entries = np.concatenate(designs)
    blocks = first + np.repeat(np.arange(plan.blocks_per_chunk), [len(one) for one in designs])
    grid = np.meshgrid(np.arange(len(entries)), np.arange(len(teams)), indexing="ij")
    game, seat = (axis.ravel() for axis in grid)
    order = np.lexsort((seat, game, teams[seat], blocks[game]))
    game, seat = game[order], seat[order]
    entry = entries[game, teams[seat]]
    places = tuple(
        Places(game[entry == place], seat[entry == place]) for place in range(entries.max() + 1)
    )
    return Chunk(number, blocks, places)
