"""Kuhn poker for the engine, by the rules and payments of OpenSpiel: hidden cards, known value.

Who is on turn passes (0) or bets (1); who is not can only pass, which does nothing. A seat sees its
information state, as one of a few numbers that is 1, on its turn and on the other's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import numpy as np
import pyspiel
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER, Representation
from tests.games import plain_games
from tests.games.plain_games import Stateless, make_plain_spec

NAME = "kuhn_poker"
PASS, BET = range(2)
ENDED = -4
_STAKE = 2.0  # most that is won


@dataclass(frozen=True)
class Scenario:
    """There is one."""

    reward: str = "sparse"
    shaping_discount: float = 0.99
    ticks_per_step: int = 1


class Tree(NamedTuple):
    """All S states after the cards are dealt; the first D are the deals, equally likely."""

    player: NDArray[np.int64]  # [S], ENDED where it is over
    child: NDArray[np.int64]  # [S, 2]
    returns: NDArray[np.float64]  # [S, 2]
    seen: NDArray[np.int64]  # [S, 2] what each seat sees, a number below the length of `names`
    names: tuple[str, ...]  # OpenSpiel's information states
    num_deals: int


class World(NamedTuple):
    """B worlds."""

    state: NDArray[np.int64]  # [B]
    illegal: NDArray[np.int32]  # [B, 2]


@cache
def read_tree() -> Tree:
    """The tree of OpenSpiel's game."""
    deals = [pyspiel.load_game("kuhn_poker").new_initial_state()]
    while deals[0].is_chance_node():
        deals = [deal.child(action) for deal in deals for action, _ in deal.chance_outcomes()]
    states, child, names = list(deals), [], {}
    for state in states:  # grows
        child.append([PASS, PASS])
        for action in state.legal_actions():
            child[-1][action] = len(states)
            states.append(state.child(action))
    seen = [
        [names.setdefault(one.information_state_string(player), len(names)) for player in (0, 1)]
        for one in states
    ]
    return Tree(
        np.array([one.current_player() for one in states]),
        np.array(child),
        np.array([one.returns() for one in states]),
        np.array(seen),
        tuple(names),
        len(deals),
    )


def make_rules(scenario):
    return read_tree()


def make_spec(scenario):
    size = len(read_tree().names)
    shown = Representation(
        "vector", (size,), np.float32, 1.0, tuple(f"is_{n}" for n in range(size)), observe
    )
    return make_plain_spec(
        ("pass", "bet"), shown, max_ticks=3, reward_bound=_STAKE, pays="what is won"
    )


def allocate(scenario, num_worlds):
    return World(np.zeros(num_worlds, np.int64), np.zeros((num_worlds, 2), np.int32))


def reset(worlds, rules, seeds, mask, first, last):
    for b in np.flatnonzero(mask[first:last]) + first:
        worlds.state[b] = np.random.default_rng(int(seeds[b])).integers(rules.num_deals)
        worlds.illegal[b] = 0


def step(worlds, rules, actions, outcome, first, last):
    worlds_here = np.arange(first, last)
    running = worlds_here[rules.player[worlds.state[first:last]] != ENDED]
    outcome.rewards[first:last] = 0.0
    state = worlds.state[running]
    player = rules.player[state]
    worlds.illegal[running, 1 - player] += actions[running, 1 - player] != PASS
    state = rules.child[state, actions[running, player]]
    worlds.state[running] = state
    ended = rules.player[state] == ENDED
    outcome.terminated[running[ended]] = True
    outcome.rewards[running[ended]] = rules.returns[state[ended]]
    won = rules.returns[state[ended], 0]
    outcome.winner[running[ended]] = np.select([won > 0, won < 0], [0, 1], NO_WINNER)


def legal_actions(worlds, rules, out, first, last):
    out[first:last, :, PASS] = True
    out[first:last, :, BET] = rules.player[worlds.state[first:last], None] == np.arange(2)


def observe(worlds, rules, out, first, last):
    out[first:last] = np.eye(len(rules.names))[rules.seen[worlds.state[first:last]]]


class Passer(Stateless):
    """Always passes."""

    name = "random"

    def act(self, observation, action_mask):
        return np.full(len(observation), PASS)


register = partial(plain_games.register, __name__)
GAME = plain_games.make_game(
    __name__,
    "Kuhn poker",
    scenarios={"two": Scenario()},
    rewards={"sparse": "what is won"},
    bots={"random": lambda scenario, spec: Passer()},
    hidden_fields=("state",),
)
