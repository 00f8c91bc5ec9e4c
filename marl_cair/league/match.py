"""Matches between two agents: seat-balanced games on one batched engine, the same for a seed.

Games come in blocks: one map seed, played once in each seat. Blocks come in chunks of a fixed size,
which are always played whole: agents draw, and networks round, differently in batches of another
size, so that a chunk is the smallest unit whose games depend on nothing but the seed, the two
agents and its number.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import NO_WINNER, Agent, Game
from marl_cair.games.randomness import episode_seeds

GAMES_PER_BLOCK = 2  # one map seed, played once in each seat
BLOCKS_PER_CHUNK = 4
GAMES_PER_CHUNK = GAMES_PER_BLOCK * BLOCKS_PER_CHUNK
CHUNKS_AT_ONCE = 16  # on one engine, for speed alone: the worlds of an engine are independent


@dataclass(frozen=True)
class GameResult:
    """One game. A block is the two games of a map seed, with the seats swapped."""

    block: int
    first_seat: int  # of the match's first agent
    winner: int  # seat, or NO_WINNER for a draw or the time limit
    is_truncated: bool
    decisions: int
    fingerprint: str  # of all actions: equal games have equal ones

    @property
    def score(self) -> float:
        """Of the first agent: 1 win, 0.5 draw, 0 loss."""
        return 0.5 if self.winner == NO_WINNER else float(self.winner == self.first_seat)


@dataclass(frozen=True)
class MatchResult:
    """All games of a match, seen from its first agent."""

    results: tuple[GameResult, ...]

    @property
    def games(self) -> int:
        return len(self.results)

    @property
    def wins(self) -> int:
        return sum(result.score == 1.0 for result in self.results)

    @property
    def draws(self) -> int:
        return sum(result.score == 0.5 for result in self.results)

    @property
    def losses(self) -> int:
        return sum(result.score == 0.0 for result in self.results)

    @property
    def score(self) -> float:
        """Share of points: win 1, draw 0.5."""
        return sum(result.score for result in self.results) / len(self.results)

    @property
    def distinct_games(self) -> int:
        """Games that differ in an action: agents without randomness repeat themselves."""
        return len({result.fingerprint for result in self.results})


def play_match(
    first: Agent,
    second: Agent,
    game: Game,
    scenario: Any,
    num_games: int,
    seed: int,
    identities: tuple[str, str] | None = None,
) -> MatchResult:
    """Play `num_games` (even) games, half of them in each seat, with sparse reward.

    A longer match begins with the games of a shorter one, and the match of `second` against
    `first` holds the same games. `identities` as in `play_chunks`.

    Raises:
        ValueError: an odd number of games, or a game that is not for two players.
    """
    if num_games < GAMES_PER_BLOCK or num_games % GAMES_PER_BLOCK:
        raise ValueError(
            f"num_games is {num_games}, it must be even and 2 or more: every map seed is played "
            "once in each seat"
        )
    chunks = range(-(-num_games // GAMES_PER_CHUNK))
    results: list[GameResult] = []
    for start in chunks[::CHUNKS_AT_ONCE]:
        part = chunks[start : start + CHUNKS_AT_ONCE]
        results += play_chunks(first, second, game, scenario, seed, part, identities).results
    return MatchResult(tuple(results[:num_games]))


def play_chunks(
    first: Agent,
    second: Agent,
    game: Game,
    scenario: Any,
    seed: int,
    chunks: Sequence[int],
    identities: tuple[str, str] | None = None,
) -> MatchResult:
    """Play whole chunks, all on one engine; which of them are played together changes no game.

    Chunk c holds the blocks c * BLOCKS_PER_CHUNK onwards. Block k has the map seed of (seed, k),
    whoever plays: all pairs meet the same maps. Each agent has its own random stream in each chunk,
    from the seed, the chunk, its identity and the rival's; identities default to the agents' names.

    Raises:
        ValueError: no chunk, or a game that is not for two players.
    """
    num_players = game.make_spec(scenario).num_players
    if num_players != 2:
        raise ValueError(f"{game.name} has {num_players} players here, a match is between two")
    if not len(chunks):
        raise ValueError("no chunks are given: name at least one to play")
    offsets = np.arange(GAMES_PER_CHUNK) // GAMES_PER_BLOCK
    blocks = (np.asarray(chunks)[:, None] * BLOCKS_PER_CHUNK + offsets).ravel()
    engine = BatchedEngine(game, dataclasses.replace(scenario, reward="sparse"), len(blocks))
    engine.reset(map_seeds(seed, blocks))
    streams = _start_streams((first, second), identities, seed, chunks)
    digests = [hashlib.blake2b(digest_size=8) for _ in blocks]
    decisions = np.zeros(len(blocks), np.int64)
    for actions, running in _play(engine, (first, second), streams):
        decisions += running
        for world in np.flatnonzero(running).tolist():
            digests[world].update(actions[world].tobytes())
    return MatchResult(
        tuple(
            GameResult(
                block=int(blocks[world]),
                first_seat=world % GAMES_PER_BLOCK,
                winner=int(engine.winner[world]),
                is_truncated=bool(engine.truncated[world]),
                decisions=int(decisions[world]),
                fingerprint=digests[world].hexdigest(),
            )
            for world in range(len(blocks))
        )
    )


def map_seeds(seed: int, blocks: NDArray[np.int64]) -> NDArray[np.uint64]:
    """The engine's seeds uint64 [N] of blocks [N] of a match."""
    return episode_seeds(seed, blocks, np.zeros(len(blocks), np.int64))


def record_game(
    first: Agent, second: Agent, game: Game, scenario: Any, seed: int
) -> NDArray[np.int32]:
    """Actions [T, P, *action_shape] of the first game of `play_match`, `first` in seat 0.

    With the map seed of block 0 they are the whole game.
    """
    blocks = np.arange(GAMES_PER_CHUNK) // GAMES_PER_BLOCK
    engine = BatchedEngine(game, dataclasses.replace(scenario, reward="sparse"), len(blocks))
    engine.reset(map_seeds(seed, blocks))
    streams = _start_streams((first, second), None, seed, (0,))
    played = [
        actions[0].copy()
        for actions, running in _play(engine, (first, second), streams)
        if running[0]
    ]
    return np.array(played, np.int32)


def _start_streams(
    agents: tuple[Agent, Agent],
    identities: tuple[str, str] | None,
    seed: int,
    chunks: Sequence[int],
) -> list[list[dict[str, Any]]]:
    """The state of each agent's random generator at the start of each chunk."""
    own, rival = identities or (agents[0].name, agents[1].name)
    if own == rival:  # two copies of one agent do not share their draws
        own, rival = f"{own} (first)", f"{rival} (second)"
    streams: list[list[dict[str, Any]]] = [[], []]
    for number, names in enumerate(((own, rival), (rival, own))):
        for chunk in chunks:
            text = "\0".join((str(seed), str(chunk), *names))
            digest = hashlib.blake2b(text.encode(), digest_size=8).digest()
            agents[number].seed(int.from_bytes(digest, "big") >> 1)  # torch takes 63 bits
            streams[number].append(agents[number].state_dict())
    return streams


def _play(
    engine: BatchedEngine, agents: tuple[Agent, Agent], streams: list[list[dict[str, Any]]]
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.bool_]]]:
    """Step until all worlds have ended; yields actions [B, P] and who was still running [B].

    The first agent has seat 0 of the even worlds, the second of the odd ones. An agent is shown the
    running games of one chunk at a time, in the order of blocks and of its own seat.
    """
    worlds = np.arange(engine.num_worlds)
    seats = worlds % GAMES_PER_BLOCK
    while (running := ~(engine.terminated | engine.truncated)).any():
        masks = engine.action_mask()
        seen = {name: engine.observe(name) for name in {agent.representation for agent in agents}}
        shape = (engine.num_worlds, 2, *engine.spec.action_shape)
        actions = np.full(shape, engine.spec.noop_action, np.int32)
        for agent, own_worlds, states in zip(agents, (worlds, worlds ^ 1), streams, strict=True):
            for chunk, state in enumerate(states):
                games = slice(chunk * GAMES_PER_CHUNK, (chunk + 1) * GAMES_PER_CHUNK)
                goes_on = running[own_worlds[games]]
                if not goes_on.any():
                    continue
                places = own_worlds[games][goes_on], seats[games][goes_on]
                agent.load_state_dict(state)
                actions[places] = agent.act(seen[agent.representation][places], masks[places])
                states[chunk] = agent.state_dict()
        engine.step(actions)
        yield actions, running
