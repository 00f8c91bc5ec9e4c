"""Greedy games of the learner against bots, with sparse reward, while it trains."""

from __future__ import annotations

from typing import Any

from marl_cair.games.game import Agent, Game
from marl_cair.league.match import play_match
from marl_cair.league.ratings import win_rate_interval


def evaluate_against_bots(
    agent: Agent, game: Game, scenario: Any, bots: tuple[str, ...], num_games: int, seed: int
) -> tuple[list[float], dict[str, float]]:
    """Score (win 1, draw 0.5) against each bot, and the same by log name with 95 % intervals."""
    scores: list[float] = []
    row: dict[str, float] = {}
    for bot in bots:
        result = play_match(agent, game.bot(bot, scenario), game, scenario, num_games, seed)
        low, high = win_rate_interval(result.wins, result.draws, result.games)
        scores.append(result.score)
        row[f"win_rate/{bot}"] = result.score
        row[f"win_rate/{bot}/low"], row[f"win_rate/{bot}/high"] = low, high
    return scores, row
