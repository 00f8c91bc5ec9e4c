"""Evaluates the learner in greedy games with the rated reward, against bots or alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from marl_cair.games.game import Agent, Game
from marl_cair.league.play.match import play_match
from marl_cair.league.play.recording import Recording
from marl_cair.league.play.solo import compare, play_alone
from marl_cair.training.settings.config import TrainConfig

LEARNER = "learner"  # in the log, beside the names of bots


def evaluate(
    agent: Agent, game: Game, config: TrainConfig, seed: int, record: Path | None = None
) -> tuple[list[float], dict[str, float]]:
    """Rate `agent` on the training scenario, as changed by `evaluation.options`, and on each of
    `evaluation.scenarios`.

    Returns the scores on the former, which select the best agent (held-out scenarios must not), and
    values by log name, those of other scenarios with "@" and their name. `record` as in `rate_on`.
    """
    settings = config.evaluation
    own, *heldout = config.evaluated_scenarios().values()
    played = settings.bots, settings.games, seed, record
    scores, row = rate_on(agent, game, own, *played)
    for name, other in zip(settings.scenarios, heldout, strict=True):
        _, values = rate_on(agent, game, other, *played)
        for key, value in values.items():
            kind, player, *end = key.split("/")
            row["/".join((kind, f"{player}@{name}", *end))] = value
    return scores, row


def rate_on(
    agent: Agent,
    game: Game,
    scenario: Any,
    bots: tuple[str, ...],
    num_games: int,
    seed: int,
    record: Path | None = None,
) -> tuple[list[float], dict[str, float]]:
    """Rate `agent` on one scenario, with 95 % intervals; returns scores, and values by log name.

    With rivals: the score (win 1, a draw is shared) against each bot. With more than two teams the
    values hold "fair_share/learner" too, the win rate of an equal of the bot. Every map seed is
    played once in each seat, so `num_games` is rounded up.

    Alone: the mean return of the agent, that of each bot on the same map seeds, and their
    difference; of the agent also the share of games that ended before the time limit, and the means
    of the game's own numbers.

    record: a folder for replays of the games on the first map seed.
    """

    def keep(*names: str) -> Recording | None:
        return Recording(record, names, num_blocks=1) if record else None

    row: dict[str, float] = {}

    def add(name: str, mean: float, low: float, high: float) -> None:
        row.update({name: mean, f"{name}/low": low, f"{name}/high": high})

    num_teams = game.make_spec(scenario).num_teams
    if num_teams == 1:
        own = play_alone(agent, game, scenario, num_games, seed, record=keep(LEARNER))
        add(f"return/{LEARNER}", *own.estimate)
        row[f"ended/{LEARNER}"] = own.ended / own.games
        row |= {f"{name}/{LEARNER}": float(values.mean()) for name, values in own.numbers.items()}
        for name in bots:
            other = play_alone(game.bot(name, scenario), game, scenario, num_games, seed)
            add(f"return/{name}", *other.estimate)
            add(f"return_gain/{name}", *compare(own, other))
        return [own.estimate.mean], row
    scores = []
    num_games = -(-num_games // num_teams) * num_teams
    for name in bots:
        bot, kept = game.bot(name, scenario), keep(LEARNER, name)
        result = play_match(agent, bot, game, scenario, num_games, seed, record=kept)
        scores.append(result.score)
        add(f"win_rate/{name}", result.score, *result.interval())
    if num_teams > 2:
        row[f"fair_share/{LEARNER}"] = 1.0 / num_teams
    return scores, row
