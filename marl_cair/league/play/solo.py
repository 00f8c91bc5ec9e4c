"""Compares agents on scenarios without opponents by their scores on the same map seeds.

The score of a game is its return: the sum of the rated reward (`Game.rated_reward`), the mean over
its seats.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.league.play import playing
from marl_cair.league.play.playing import Chunk, Places, Seating
from marl_cair.league.play.recording import Recording, recording
from marl_cair.league.ratings.intervals import mean_interval

GAMES_PER_CHUNK = 8


@dataclass(frozen=True)
class SoloGame:
    """One game of one agent; the block has the map seed."""

    block: int
    score: float  # sum of its rewards
    is_truncated: bool
    decisions: int
    fingerprint: str  # of boards and actions
    numbers: Mapping[str, float]  # `Game.info` at its end, the mean over the seats


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
        """float64 [games]."""
        return np.array([result.score for result in self.results])

    @property
    def estimate(self) -> Estimate:
        """The mean score."""
        return _estimate(self.scores)

    @property
    def ended(self) -> int:
        """Number of games that ended before the time limit."""
        return sum(not result.is_truncated for result in self.results)

    @property
    def numbers(self) -> dict[str, NDArray[np.float64]]:
        """The game's own numbers at the end of each game, float64 [games] by name."""
        names = self.results[0].numbers
        return {name: np.array([result.numbers[name] for result in self.results]) for name in names}

    @property
    def distinct_games(self) -> int:
        """Games that differ in a board or an action; deterministic agents repeat games."""
        return len({result.fingerprint for result in self.results})

    def without_repeats(self) -> SoloResult:
        """The first game if all others repeat it, else all: as `MatchResult.without_repeats`."""
        return self if self.distinct_games > 1 else SoloResult(self.results[:1])


def play_alone(
    agent: Agent,
    game: Game,
    scenario: Any,
    num_games: int,
    seed: int,
    identity: str | None = None,
    record: Recording | None = None,
) -> SoloResult:
    """Play `num_games` games with the agent in all seats, with the rated reward.

    Game k has the map seed of (seed, k) for every agent. A longer series begins with the games of a
    shorter one. The agent's draws are seeded by the seed and its identity (default: its name).
    `record`: where to record the games.

    Raises ValueError for less than one game, or a scenario with opponents.
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
    size = playing.size_chunk(game, GAMES_PER_CHUNK)
    numbers = range(-(-num_games // size))
    results: list[SoloGame] = []
    record = record and record.limit(num_games)
    at_once = playing.count_chunks(game)
    for start in numbers[::at_once]:
        part = [
            _make_chunk(number, spec.num_players, size)
            for number in numbers[start : start + at_once]
        ]
        engine = playing.start_engine(game, scenario, seed, part)
        blocks = np.concatenate([chunk.blocks for chunk in part])
        seeds = playing.map_seeds(seed, blocks)
        with recording(record, engine, part, seeds) as watch:
            ended = playing.play_out(engine, part, seatings, seed, watch)
        if reason := next(filter(None, ended.reasons), ""):
            raise ValueError(f"{reason}: a solo game cannot be forfeited; fix the agent")
        info = {name: values.mean(1).tolist() for name, values in engine.info().items()}
        engine.close()
        rows = zip(
            blocks.tolist(),
            ended.returns.mean(1).tolist(),
            ended.truncated.tolist(),
            ended.decisions.tolist(),
            ended.trajectories,
            strict=True,
        )
        results += [
            SoloGame(*row, {name: values[world] for name, values in info.items()})
            for world, row in enumerate(rows)
        ]
    return SoloResult(tuple(results[:num_games]))


def compare(first: SoloResult, second: SoloResult) -> Estimate:
    """The score of `first` minus that of `second`, from the differences on each map seed.

    Raises ValueError if the numbers of games differ.
    """
    if first.games != second.games:
        raise ValueError(
            f"{first.games} games cannot be paired with {second.games}: play the same map seeds"
        )
    return _estimate(first.scores - second.scores)


def _estimate(values: NDArray[np.float64]) -> Estimate:
    return Estimate(float(values.mean()), *mean_interval(values))


def _make_chunk(number: int, num_players: int, size: int) -> Chunk:
    games = np.arange(size)
    seats = np.tile(np.arange(num_players), size)
    blocks = number * size + games
    return Chunk(number, blocks, (Places(np.repeat(games, num_players), seats),))
