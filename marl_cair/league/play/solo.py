"""Compares agents on scenarios without opponents by their scores on the same map seeds.

The score of a game is its return: the sum of the rated reward (`Game.rated_reward`), which pays
for the game's own goal (of several seats that play together, their mean).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.play.playing import (
    CHUNKS_AT_ONCE,
    Chunk,
    Places,
    Seating,
    play_out,
    start_engine,
)
from marl_cair.league.ratings.intervals import mean_interval

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

GAMES_PER_CHUNK = 8


@dataclass(frozen=True)
class SoloGame:
    """One game of one agent; its map seed is that of the block of this number."""

    block: int
    score: float  # sum of its rewards
    is_truncated: bool
    decisions: int
    fingerprint: str  # of boards and actions: games that are the same have equal ones
    numbers: Mapping[str, float] = field(
        default_factory=dict
    )  # `Game.info` at its end, seats' mean


class Estimate(NamedTuple):
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class SoloResult:
    """All games of one agent."""

    results: tuple[SoloGame, ...]

    @property
    def games(self) -> int:
        return len(self.results)

    @property
    def scores(self) -> NDArray[np.float64]:
        """Float64 [games]."""
        return np.array([result.score for result in self.results])

    @property
    def estimate(self) -> Estimate:
        """The mean score."""
        return _estimate(self.scores)

    @property
    def ended(self) -> int:
        """Games that ended before their time."""
        return sum(not result.is_truncated for result in self.results)

    @property
    def numbers(self) -> dict[str, NDArray[np.float64]]:
        """The game's own numbers at the end of each game, float64 [games] by name."""
        names = self.results[0].numbers
        return {name: np.array([result.numbers[name] for result in self.results]) for name in names}

    @property
    def distinct_games(self) -> int:
        """Games that differ in a board or an action: agents without randomness repeat theirs."""
        return len({result.fingerprint for result in self.results})


def play_alone(
    agent: Agent, game: Game, scenario: Any, num_games: int, seed: int, identity: str | None = None
) -> SoloResult:
    """Play `num_games` games with the agent in all seats, with the rated reward.

    Game k has the map seed of (seed, k), whoever plays. A longer series begins with the games of a
    shorter one. The agent draws by the seed and its identity (default: its name).

    Raises:
        ValueError: fewer games than one, or a scenario with rivals.
    """
    spec = game.make_spec(scenario)
    if spec.num_teams != 1:
        raise ValueError(
            f"{game.name}: this scenario has {spec.num_teams} teams, it is no solo game; play a "
            "match (league.match)"
        )
    if num_games < 1:
        raise ValueError(f"num_games is {num_games}, it must be 1 or more")
    seatings = (Seating(agent, (identity or agent.name,)),)
    numbers = range(-(-num_games // GAMES_PER_CHUNK))
    results: list[SoloGame] = []
    for start in numbers[::CHUNKS_AT_ONCE]:
        part = [
            _make_chunk(number, spec.num_players)
            for number in numbers[start : start + CHUNKS_AT_ONCE]
        ]
        engine = start_engine(game, scenario, seed, part)
        ended = play_out(engine, part, seatings, seed)
        if any(ended.reasons):
            raise ValueError(
                f"{next(filter(None, ended.reasons))}: a solo game cannot be forfeited; "
                "fix the agent"
            )
        rows = zip(
            np.concatenate([chunk.blocks for chunk in part]).tolist(),
            ended.returns.mean(1).tolist(),
            ended.truncated.tolist(),
            ended.decisions.tolist(),
            ended.trajectories,
            _read_numbers(engine),
            strict=True,
        )
        results += [SoloGame(*row) for row in rows]
    return SoloResult(tuple(results[:num_games]))


def _read_numbers(engine: BatchedEngine) -> list[dict[str, float]]:
    """The game's own numbers of each world, means over its seats."""
    means = {name: values.mean(1).tolist() for name, values in engine.info().items()}
    return [
        {name: values[world] for name, values in means.items()}
        for world in range(engine.num_worlds)
    ]


def compare(first: SoloResult, second: SoloResult) -> Estimate:
    """By how much `first` scores more, from the differences on each map seed.

    Raises:
        ValueError: the two did not play the same number of games.
    """
    if first.games != second.games:
        raise ValueError(
            f"{first.games} games cannot be paired with {second.games}: play the same map seeds"
        )
    return _estimate(first.scores - second.scores)


def _estimate(values: NDArray[np.float64]) -> Estimate:
    return Estimate(float(values.mean()), *mean_interval(values))


def _make_chunk(number: int, num_players: int) -> Chunk:
    games = np.arange(GAMES_PER_CHUNK)
    seats = np.tile(np.arange(num_players), GAMES_PER_CHUNK)
    blocks = number * GAMES_PER_CHUNK + games
    return Chunk(number, blocks, (Places(np.repeat(games, num_players), seats),))
