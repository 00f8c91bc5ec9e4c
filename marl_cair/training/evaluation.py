"""Greedy games of the learner, with sparse reward, while it trains: against bots, or alone."""

from __future__ import annotations

from typing import Any

from marl_cair.games.game import Agent, Game
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import Estimate, compare, play_alone
from marl_cair.training.settings.config import TrainConfig

LEARNER = "learner"  # in the log, beside the names of bots


def evaluate(
    agent: Agent, game: Game, config: TrainConfig, seed: int
) -> tuple[list[float], dict[str, float]]:
    """Rate `agent` on the training scenario, as `evaluation.options` changes it, and on each of
    `evaluation.scenarios`.

    Returns the scores on the former, by which the best agent is kept (what is held out must not
    choose), and values by log name, those of other scenarios with "@" and their name.
    """
    settings = config.evaluation
    own, *heldout = config.evaluated_scenarios().values()
    scores, row = rate_on(agent, game, own, settings.bots, settings.games, seed)
    for name, other in zip(settings.scenarios, heldout, strict=True):
        _, values = rate_on(agent, game, other, settings.bots, settings.games, seed)
        for key, value in values.items():
            kind, who, *end = key.split("/")
            row["/".join((kind, f"{who}@{name}", *end))] = value
    return scores, row


def rate_on(
    agent: Agent, game: Game, scenario: Any, bots: tuple[str, ...], num_games: int, seed: int
) -> tuple[list[float], dict[str, float]]:
    """As `evaluate_against_bots` where there are rivals, as `evaluate_alone` where there are none.

    Where there are more than two teams, the row tells "fair_share/learner" too: the win rate of who
    is as strong as the bot.
    """
    num_teams = game.make_spec(scenario).num_teams
    if num_teams == 1:
        return evaluate_alone(agent, game, scenario, bots, num_games, seed)
    # Whole blocks: every map seed is played once in each seat.
    num_games = -(-num_games // num_teams) * num_teams
    scores, row = evaluate_against_bots(agent, game, scenario, bots, num_games, seed)
    if num_teams > 2:
        row[f"fair_share/{LEARNER}"] = 1.0 / num_teams
    return scores, row


def evaluate_against_bots(
    agent: Agent, game: Game, scenario: Any, bots: tuple[str, ...], num_games: int, seed: int
) -> tuple[list[float], dict[str, float]]:
    """Score (win 1, a draw is shared) against each bot, and the same by log name with 95 %
    intervals.
    """
    scores: list[float] = []
    row: dict[str, float] = {}
    for bot in bots:
        result = play_match(agent, game.bot(bot, scenario), game, scenario, num_games, seed)
        low, high = result.interval()
        scores.append(result.score)
        row |= _tell(f"win_rate/{bot}", Estimate(result.score, low, high))
    return scores, row


def evaluate_alone(
    agent: Agent, game: Game, scenario: Any, bots: tuple[str, ...], num_games: int, seed: int
) -> tuple[list[float], dict[str, float]]:
    """The mean return of the agent, that of each bot on the same map seeds, and by how much the
    agent's is larger, by log name with 95 % intervals; of the agent also the share of games that
    ended before their time, and the means of the game's own numbers.
    """
    own = play_alone(agent, game, scenario, num_games, seed)
    row = _tell(f"return/{LEARNER}", own.estimate)
    row[f"ended/{LEARNER}"] = own.ended / own.games
    row |= {f"{name}/{LEARNER}": float(values.mean()) for name, values in own.numbers.items()}
    for name in bots:
        other = play_alone(game.bot(name, scenario), game, scenario, num_games, seed)
        row |= _tell(f"return/{name}", other.estimate)
        row |= _tell(f"return_gain/{name}", compare(own, other))
    return [own.estimate.mean], row


def _tell(name: str, estimate: Estimate) -> dict[str, float]:
    return {name: estimate.mean, f"{name}/low": estimate.low, f"{name}/high": estimate.high}
