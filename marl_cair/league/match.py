"""Matches between two agents: seat-balanced games on one batched engine, the same for a seed."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import NO_WINNER, Agent, Game
from marl_cair.games.randomness import episode_seeds

GAMES_PER_BLOCK = 2  # one seed, played once in each seat


@dataclass(frozen=True)
class GameResult:
    """One game. A block is the two games of a seed, with the seats swapped."""

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
    first_block: int = 0,
) -> MatchResult:
    """Play `num_games` (even) games, half of them in each seat; rewards are irrelevant here.

    Block k is played on the game seed of (seed, k), whoever plays: all pairs meet the same games.
    The agents are seeded from `seed` and `first_block`, so the same call gives the same result.

    Raises:
        ValueError: an odd number of games, or a game that is not for two players.
    """
    if num_games < GAMES_PER_BLOCK or num_games % GAMES_PER_BLOCK:
        raise ValueError(f"num_games is {num_games}, it must be even: every seed is played twice")
    if game.num_players != 2:
        raise ValueError(f"{game.name} has {game.num_players} players, a match is between two")
    blocks = first_block + np.arange(num_games) // GAMES_PER_BLOCK
    seats = np.arange(num_games) % GAMES_PER_BLOCK
    engine = BatchedEngine(game, dataclasses.replace(scenario, reward="sparse"), num_games)
    engine.reset(episode_seeds(seed, blocks, np.zeros(num_games, np.int64)))
    for number, agent in enumerate((first, second)):
        agent.seed(_agent_seed(seed, first_block, number))
    digests = [hashlib.blake2b(digest_size=8) for _ in range(num_games)]
    decisions = np.zeros(num_games, np.int64)
    for actions, running in _play(engine, (first, second), seats):
        decisions += running
        for world in np.flatnonzero(running).tolist():
            digests[world].update(actions[world].tobytes())
    return MatchResult(
        tuple(
            GameResult(
                block=int(blocks[world]),
                first_seat=int(seats[world]),
                winner=int(engine.winner[world]),
                is_truncated=bool(engine.truncated[world]),
                decisions=int(decisions[world]),
                fingerprint=digests[world].hexdigest(),
            )
            for world in range(num_games)
        )
    )


def record_game(
    first: Agent, second: Agent, game: Game, scenario: Any, seed: int
) -> NDArray[np.int32]:
    """Actions [T, P] of one game, `first` in seat 0: with the seed they are the whole game."""
    engine = BatchedEngine(game, dataclasses.replace(scenario, reward="sparse"))
    engine.reset(seed)
    for number, agent in enumerate((first, second)):
        agent.seed(_agent_seed(seed, 0, number))
    played = [actions[0].copy() for actions, _ in _play(engine, (first, second), np.zeros(1, int))]
    return np.array(played, np.int32)


def _agent_seed(seed: int, first_block: int, number: int) -> int:
    state = np.random.SeedSequence([seed, first_block, number]).generate_state(1, np.uint64)
    return int(state[0]) >> 1  # torch's generators take 63 bits


def _play(
    engine: BatchedEngine, agents: tuple[Agent, Agent], first_seats: NDArray[Any]
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.bool_]]]:
    """Step until all worlds have ended; yields actions [B, P] and who was still running [B].

    Only rows of running worlds are shown to the agents.
    """
    worlds = np.arange(engine.num_worlds)
    while not (ended := engine.terminated | engine.truncated).all():
        running = ~ended
        rows = worlds[running]
        masks = engine.action_mask()
        actions = np.full((engine.num_worlds, 2), engine.spec.noop_action, np.int32)
        for number, agent in enumerate(agents):
            seats = first_seats[rows] if number == 0 else 1 - first_seats[rows]
            seen = engine.observe(agent.representation)
            actions[rows, seats] = agent.act(seen[rows, seats], masks[rows, seats])
        engine.step(actions)
        yield actions, running
