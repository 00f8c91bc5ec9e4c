"""A game in which seats score, leave or end it at once, so that a test says what happens.

Any number of seats and teams. `leave` takes a seat out; a team is out (and paid -1) when all its
seats have left, the last one left wins (+1). `finish` wins for the seat's team at once, two teams
that finish together draw. `score` pays what the map seed has given to the seat. Time ends a game
without a winner.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER, Representation
from tests.games import plain_games
from tests.games.plain_games import make_plain_spec

NAME = "last_standing"
SIDE, NUM_PLANES, NUM_UNIFORM = 8, 4, 2
ACTIONS = NOOP, SCORE, LEAVE, FINISH = range(4)


@dataclass(frozen=True)
class Scenario:
    """The seats, their teams and the time; the rest is what every scenario has."""

    num_players: int = 3
    teams: tuple[int, ...] = ()
    max_ticks: int = 12
    gain: int = 9  # most that `score` pays, in hundredths
    reward: str = "sparse"
    shaping_discount: float = 0.99
    ticks_per_step: int = 1


class World(NamedTuple):
    """B worlds."""

    tick: NDArray[np.int32]  # [B]
    left: NDArray[np.bool_]  # [B, P]
    is_over: NDArray[np.bool_]  # [B]
    gain: NDArray[np.int16]  # [B, P] hundredths
    illegal: NDArray[np.int32]  # [B, P]


class Rules(NamedTuple):
    team: NDArray[np.int64]  # [P]
    max_ticks: int
    gain: int


def make_rules(scenario):
    return Rules(make_spec(scenario).team_of_seat, scenario.max_ticks, scenario.gain)


def make_spec(scenario):
    return make_plain_spec(
        ("noop", "score", "leave", "finish"),
        Representation(
            "planes",
            (NUM_PLANES, SIDE, SIDE),
            np.uint8,
            255,
            ("seat", "left", "tick", "gain"),
            observe,
            num_uniform=NUM_UNIFORM,
        ),
        Representation(
            "vector", (NUM_PLANES,), np.float32, 255.0, ("s", "l", "t", "g"), observe_vector
        ),
        num_players=scenario.num_players,
        max_ticks=scenario.max_ticks,
        pays="+1 win, -1 loss, and what is scored",
        teams=scenario.teams,
        reward_bound=1.0 + scenario.gain / 100,
    )


def allocate(scenario, num_worlds):
    seats = (num_worlds, scenario.num_players)
    return World(
        np.zeros(num_worlds, np.int32),
        np.zeros(seats, np.bool_),
        np.zeros(num_worlds, np.bool_),
        np.zeros(seats, np.int16),
        np.zeros(seats, np.int32),
    )


def reset(worlds, rules, seeds, mask, first, last):
    for b in range(first, last):
        if mask[b]:
            worlds.tick[b], worlds.left[b], worlds.is_over[b] = 0, False, False
            worlds.illegal[b] = 0
            luck = np.random.default_rng(int(seeds[b]))
            worlds.gain[b] = luck.integers(0, rules.gain + 1, len(rules.team))


def step(worlds, rules, actions, outcome, first, last):
    for b in range(first, last):
        outcome.rewards[b] = 0.0
        if not worlds.is_over[b]:
            worlds.tick[b] += 1
            _step_world(worlds, rules, actions[b], outcome, b)


def _step_world(worlds, rules, actions, outcome, b):
    left = worlds.left[b]
    was_out = outcome.eliminated[b].copy()
    legal = np.where(left, actions == NOOP, True)
    worlds.illegal[b] += ~legal
    actions = np.where(legal, actions, NOOP)
    outcome.rewards[b] += np.where(actions == SCORE, worlds.gain[b] / 100.0, 0.0)
    finishers = np.unique(rules.team[actions == FINISH])
    left |= actions == LEAVE
    alive = np.unique(rules.team[~left])
    has_rivals = rules.team.max() > 0
    winners = finishers if len(finishers) else alive
    if len(finishers) or len(alive) <= int(has_rivals):
        worlds.is_over[b] = outcome.terminated[b] = True
        if len(winners) == 1:
            outcome.winner[b] = np.flatnonzero(rules.team == winners[0])[0]
    elif worlds.tick[b] >= rules.max_ticks:
        worlds.is_over[b] = outcome.truncated[b] = True
    if not has_rivals:
        return
    is_out = ~np.isin(rules.team, alive)
    outcome.eliminated[b] = is_out
    if outcome.winner[b] != NO_WINNER:
        has_won = rules.team == rules.team[outcome.winner[b]]
        outcome.rewards[b] += np.where(has_won, 1.0, np.where(was_out, 0.0, -1.0))
    elif not outcome.terminated[b]:
        outcome.rewards[b] -= is_out & ~was_out


def legal_actions(worlds, rules, out, first, last):
    for b in range(first, last):
        out[b] = ~worlds.left[b][:, None] | (np.arange(4) == NOOP)


def observe_vector(worlds, rules, out, first, last):
    for b in range(first, last):
        out[b, :, 0] = 1 + np.arange(len(rules.team))
        out[b, :, 1] = worlds.left[b]
        out[b, :, 2] = worlds.tick[b]
        out[b, :, 3] = worlds.gain[b]


def observe(worlds, rules, out, first, last):
    numbers = np.zeros((*out.shape[:2], NUM_PLANES), np.float32)
    observe_vector(worlds, rules, numbers, first, last)
    out[first:last] = numbers[first:last, :, :, None, None].astype(np.uint8)


def draw(worlds, rules, world, player):
    return np.full((4, 4, 3), worlds.tick[world], np.uint8)


class Bot:
    """Plays one action wherever it is legal; `random` any legal one, from its own generator."""

    representation = "planes"

    def __init__(self, name, action=None):
        self.name, self.action = name, action
        self.luck = np.random.default_rng(0)
        self.rows = []  # what it was shown: (seat, has it left, tick) of each row

    def seed(self, seed):
        self.luck = np.random.default_rng(seed)

    def act(self, observation, action_mask):
        self.rows += observation[:, :3, 0, 0].tolist()
        if self.action is None:
            return np.argmax(self.luck.random(action_mask.shape) * action_mask, axis=1)
        return np.where(action_mask[:, self.action], self.action, NOOP)

    def state_dict(self):
        return {"state": json.dumps(self.luck.bit_generator.state)}

    def load_state_dict(self, state):
        self.luck.bit_generator.state = json.loads(state["state"])


def _make_bot(name: str, action: int | None) -> Any:
    return lambda scenario, spec: Bot(name, action)


register = partial(plain_games.register, __name__)
GAME = plain_games.make_game(
    __name__,
    "Last standing",
    player_range=(1, 8),
    draw=draw,
    scenarios={
        "ffa-3": Scenario(),
        "ffa-4": Scenario(num_players=4),
        "duel": Scenario(num_players=2),
        "ffa-8": Scenario(num_players=8),
        "teams": Scenario(num_players=4, teams=(0, 1, 1, 0)),
        "uneven": Scenario(num_players=6, teams=(7, 3, 3, 7, 5, 3)),
        "alone": Scenario(num_players=1),
        "together": Scenario(num_players=2, teams=(4, 4)),
    },
    rewards={"sparse": "+1 win, -1 loss, and what is scored"},
    bots={
        "random": _make_bot("random", None),
        "idle": _make_bot("idle", NOOP),
        "scorer": _make_bot("scorer", SCORE),
        "quitter": _make_bot("quitter", LEAVE),
        "finisher": _make_bot("finisher", FINISH),
    },
)
