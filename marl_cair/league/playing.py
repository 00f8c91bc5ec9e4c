"""Agents at the seats of many games on one engine: who acts where, from which random stream.

Games come in blocks (one map seed) and blocks in chunks of a fixed size, which are always played
whole: agents draw, and networks round, differently in batches of another size, so that a chunk is
the smallest unit whose games depend on nothing but the seed, the agents and its number.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent, Game
from marl_cair.games.randomness import episode_seeds

CHUNKS_AT_ONCE = 16  # on one engine, for speed alone: the worlds of an engine are independent


class Places(NamedTuple):
    """Seats of an agent within a chunk, in the order in which it is shown them; int64 [N] both."""

    game: NDArray[np.int64]  # of the chunk
    seat: NDArray[np.int64]


@dataclass(frozen=True)
class Table:
    """Who plays where in each chunk of a match.

    Attributes:
        blocks: int64 [G], the block within the chunk that each of its G games belongs to.
        places: of each agent.
    """

    blocks: NDArray[np.int64]
    places: tuple[Places, ...]

    @property
    def num_games(self) -> int:
        """G."""
        return len(self.blocks)

    @property
    def num_blocks(self) -> int:
        """Blocks of a chunk."""
        return int(self.blocks[-1]) + 1

    def number_blocks(self, chunks: Sequence[int]) -> NDArray[np.int64]:
        """The block of each game of `chunks`, int64 [len(chunks) * G]."""
        return (np.asarray(chunks)[:, None] * self.num_blocks + self.blocks).ravel()


class Seating(NamedTuple):
    """An agent, and the names that its draws depend on: its own first."""

    agent: Agent
    names: tuple[str, ...]


class Ended(NamedTuple):
    """How G games ended."""

    winner: NDArray[np.int8]  # [G] seat, or NO_WINNER
    truncated: NDArray[np.bool_]  # [G]
    was_out: NDArray[np.bool_]  # [G, P] seats that were out before the last decision
    returns: NDArray[np.float64]  # [G, P] sums of rewards
    decisions: NDArray[np.int64]  # [G]
    fingerprints: tuple[str, ...]  # of all actions: equal games have equal ones


class Step(NamedTuple):
    """One decision of G games; `actions` and `out` are not changed later."""

    actions: NDArray[np.int32]  # [G, P]
    running: NDArray[np.bool_]  # [G], before the decision
    out: NDArray[np.bool_]  # [G, P], before the decision


def map_seeds(seed: int, blocks: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The engine's seeds uint64 [N] of blocks [N] of a match."""
    return episode_seeds(seed, blocks, np.zeros(len(blocks), np.int64))


def start_engine(
    game: Game, scenario: Any, seed: int, table: Table, chunks: Sequence[int]
) -> BatchedEngine:
    """The games of `chunks`, with the rated reward, at their start."""
    blocks = table.number_blocks(chunks)
    rated = dataclasses.replace(scenario, reward=game.rated_reward)
    engine = BatchedEngine(game, rated, len(blocks))
    engine.reset(map_seeds(seed, blocks))
    return engine


def play_out(
    engine: BatchedEngine,
    table: Table,
    seatings: Sequence[Seating],
    seed: int,
    chunks: Sequence[int],
) -> Ended:
    """Play all games of `chunks` to their ends, on the engine of `start_engine`."""
    digests = [hashlib.blake2b(digest_size=8) for _ in range(engine.num_worlds)]
    decisions = np.zeros(engine.num_worlds, np.int64)
    returns = np.zeros((engine.num_worlds, engine.num_players))
    was_out = np.zeros((engine.num_worlds, engine.num_players), np.bool_)
    for actions, running, out in play(engine, table, seatings, seed, chunks):
        decisions += running
        returns[running] += engine.rewards[running]
        was_out[running] = out[running]
        for world in np.flatnonzero(running).tolist():
            digests[world].update(actions[world].tobytes())
    return Ended(
        engine.winner.copy(),
        engine.truncated.copy(),
        was_out,
        returns,
        decisions,
        tuple(digest.hexdigest() for digest in digests),
    )


def play(
    engine: BatchedEngine,
    table: Table,
    seatings: Sequence[Seating],
    seed: int,
    chunks: Sequence[int],
) -> Iterator[Step]:
    """Step until all games have ended; yields after each step.

    An agent is shown the running games of one chunk at a time, the seats that are still in, in the
    order of its places.
    """
    streams = [_start_streams(seating, seed, chunks) for seating in seatings]
    names = {seating.agent.representation for seating in seatings}
    size = table.num_games
    while (running := ~(engine.terminated | engine.truncated)).any():
        masks = engine.action_mask()
        seen = {name: engine.observe(name) for name in names}
        out = engine.eliminated.copy()
        shape = (engine.num_worlds, engine.num_players, *engine.spec.action_shape)
        actions = np.full(shape, engine.spec.noop_action, np.int32)
        for (agent, _), places, states in zip(seatings, table.places, streams, strict=True):
            for chunk, state in enumerate(states):
                worlds = chunk * size + places.game
                acts = running[worlds] & ~out[worlds, places.seat]
                if not acts.any():
                    continue
                at = worlds[acts], places.seat[acts]
                agent.load_state_dict(state)
                actions[at] = agent.act(seen[agent.representation][at], masks[at])
                states[chunk] = agent.state_dict()
        engine.step(actions)
        yield Step(actions, running, out)


def _start_streams(seating: Seating, seed: int, chunks: Sequence[int]) -> list[dict[str, Any]]:
    """The state of an agent's random generator at the start of each chunk."""
    streams = []
    for chunk in chunks:
        text = "\0".join((str(seed), str(chunk), *seating.names))
        digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
        seating.agent.seed(int.from_bytes(digest, "big") >> 1)  # torch takes 63 bits
        streams.append(seating.agent.state_dict())
    return streams
