"""Seat-balanced matches of two players, many games at a time, and how sure their results are."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TextIO

import numpy as np

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent
from marl_cair.games.randomness import episode_seeds


@dataclass(frozen=True)
class MatchResult:
    """Outcomes of games from the first player's side, and how long they took."""

    wins: int
    losses: int
    draws: int  # both lost their last health in one tick
    truncations: int
    mean_ticks: float

    @property
    def games(self) -> int:
        """How many were played."""
        return self.wins + self.losses + self.draws + self.truncations


def play_match(engine: BatchedEngine, first: Agent, second: Agent, seed: int) -> MatchResult:
    """One game in each world of `engine`; `first` has seat 0 in one half of them."""
    num_worlds = engine.num_worlds
    worlds = np.arange(num_worlds)
    seats = (worlds >= num_worlds // 2).astype(np.int64)  # of `first`
    engine.reset(episode_seeds(seed, worlds, np.zeros(num_worlds, np.int64)))
    first.seed(2 * seed)
    second.seed(2 * seed + 1)
    observation, mask = engine.observe("planes"), engine.action_mask()
    actions = np.zeros((num_worlds, 2), np.int64)
    steps = np.zeros(num_worlds)
    while (running := ~(engine.terminated | engine.truncated)).any():
        engine.observe("planes", observation)
        engine.action_mask(mask)
        for agent, seat in ((first, seats), (second, 1 - seats)):
            actions[worlds, seat] = agent.act(observation[worlds, seat], mask[worlds, seat])
        engine.step(actions)
        steps += running
    is_decided = ~engine.truncated  # Deep RTS names who leads when the time is over: no win
    wins = int((is_decided & (engine.winner == seats)).sum())
    losses = int((is_decided & (engine.winner == 1 - seats)).sum())
    truncations = int(engine.truncated.sum())
    return MatchResult(
        wins=wins,
        losses=losses,
        draws=num_worlds - wins - losses - truncations,
        truncations=truncations,
        mean_ticks=float(steps.mean()) * engine.spec.ticks_per_step,
    )


def win_interval(wins: int, games: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a win probability."""
    z = 1.96
    share = wins / games
    centre = share + z * z / (2 * games)
    spread = z * np.sqrt(share * (1 - share) / games + z * z / (4 * games * games))
    scale = 1 + z * z / games
    return float(max(0.0, (centre - spread) / scale)), float(min(1.0, (centre + spread) / scale))


def play_round_robin(
    engine: BatchedEngine, players: Sequence[Agent], seed: int
) -> dict[tuple[int, int], MatchResult]:
    """Every player against every other; results by (first, second) in both orders."""
    results = {}
    for i, j in itertools.combinations(range(len(players)), 2):
        result = play_match(engine, players[i], players[j], seed + i * len(players) + j)
        results[i, j] = result
        results[j, i] = MatchResult(
            result.losses, result.wins, result.draws, result.truncations, result.mean_ticks
        )
    return results


def write_results(
    file: TextIO,
    table: str,
    names: Sequence[str],
    results: Mapping[tuple[int, int], MatchResult],
) -> None:
    """Append one table as CSV rows."""
    writer = csv.writer(file)
    for (i, j), result in results.items():
        if i < j:
            outcome = (result.wins, result.losses, result.draws, result.truncations)
            writer.writerow([table, names[i], names[j], *outcome, f"{result.mean_ticks:.1f}"])
