"""Rock, paper, scissors for the engine: one decision, hidden from each other. Biased on request.

Each throw beats the one that it beats only with a chance of its own, else the game is drawn; the
only equilibrium then plays each throw as often as the one that beats it wins by.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER, Representation
from tests.games.plain_games import Stateless, make_game, make_plain_spec

NAME = "rock_paper_scissors"
ROCK, PAPER, SCISSORS = range(3)


@dataclass(frozen=True)
class Scenario:
    """Chances in hundredths that rock beats scissors, paper rock, and scissors paper."""

    chances: tuple[int, ...] = (100, 100, 100)
    reward: str = "sparse"
    shaping_discount: float = 0.99
    ticks_per_step: int = 1


class World(NamedTuple):
    """B worlds."""

    luck: NDArray[np.float64]  # [B] in [0, 1)
    is_over: NDArray[np.bool_]  # [B]
    illegal: NDArray[np.int32]  # [B, 2]


class Rules(NamedTuple):
    wins: NDArray[np.float64]  # [3, 3] the chance that row beats column


def make_rules(scenario):
    wins = np.zeros((3, 3))
    for throw, chance in enumerate(scenario.chances):
        wins[throw, throw - 1] = chance / 100.0
    return Rules(wins)


def payoff(scenario):
    """What row gains against column on the mean: float64 [3, 3]."""
    wins = make_rules(scenario).wins
    return wins - wins.T


def make_spec(scenario):
    shown = Representation("vector", (1,), np.float32, 1.0, ("one",), observe)
    return make_plain_spec(("rock", "paper", "scissors"), shown, max_ticks=1)


def allocate(scenario, num_worlds):
    return World(
        np.zeros(num_worlds), np.zeros(num_worlds, np.bool_), np.zeros((num_worlds, 2), np.int32)
    )


def reset(worlds, rules, seeds, mask, first, last):
    for b in range(first, last):
        if mask[b]:
            worlds.luck[b] = np.random.default_rng(int(seeds[b])).random()
            worlds.is_over[b] = False
            worlds.illegal[b] = 0


def step(worlds, rules, actions, outcome, first, last):
    for b in range(first, last):
        outcome.rewards[b] = 0.0
        if not worlds.is_over[b]:
            worlds.is_over[b] = outcome.terminated[b] = True
            own, other = actions[b]
            outcome.winner[b] = NO_WINNER
            if worlds.luck[b] < rules.wins[own, other]:
                outcome.winner[b], outcome.rewards[b] = 0, (1.0, -1.0)
            elif worlds.luck[b] < rules.wins[other, own]:
                outcome.winner[b], outcome.rewards[b] = 1, (-1.0, 1.0)


def legal_actions(worlds, rules, out, first, last):
    out[first:last] = True


def observe(worlds, rules, out, first, last):
    out[first:last] = 1.0


class Thrower(Stateless):
    """Throws always the same."""

    def __init__(self, name: str, throw: int) -> None:
        self.name, self.throw = name, throw

    def act(self, observation, action_mask):
        return np.full(len(observation), self.throw)


def _make_bot(name: str, throw: int) -> Any:
    return lambda scenario, spec: Thrower(name, throw)


GAME = make_game(
    __name__,
    "Rock, paper, scissors",
    scenarios={"fair": Scenario(), "biased": Scenario(chances=(100, 25, 100))},
    bots={
        "random": _make_bot("random", ROCK),
        "rock": _make_bot("rock", ROCK),
        "paper": _make_bot("paper", PAPER),
        "scissors": _make_bot("scissors", SCISSORS),
    },
    hidden_fields=("luck",),
)
