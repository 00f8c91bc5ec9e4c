"""Tournament of single-minded players: is any unit or tower of Deep Line Wars too strong?

python benchmarks/balance.py [--games 1000] [--seed 0] [--preset balanced] [--csv FOLDER]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import marl_cair
from marl_cair.games.deep_line_wars.bot_sight import chord_table, placement_order
from marl_cair.games.deep_line_wars.observation import OWN_LUMBER
from marl_cair.games.deep_line_wars.tables import (
    NUM_TOWER_KINDS,
    NUM_UNIT_KINDS,
    PRESETS,
    TOWER_NAMES,
    UNIT_NAMES,
)
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent
from marl_cair.games.randomness import episode_seeds

ITEMS = UNIT_NAMES + TOWER_NAMES
NO_ITEM = -1


class ItemPlayer:
    """Draws an item, saves until it is legal, buys it, draws anew.

    Towers go to the cells that cover the rows best. A drawn tower for which lumber is missing is
    drawn again (lumber comes with time only), unless the player wants nothing else.
    """

    representation = "planes"

    def __init__(self, name: str, engine: BatchedEngine, weights: NDArray[np.float64]) -> None:
        scenario = engine.scenario
        preset = PRESETS[scenario.preset]
        self.name = name
        self.weights = weights / weights.sum()
        self.lumber = np.array([0] * NUM_UNIT_KINDS + list(preset.tower_cost_lumber))
        cells = scenario.rows * scenario.build_columns
        first = 1 + NUM_UNIT_KINDS
        board = (scenario.rows, scenario.build_columns, scenario.columns)
        self.actions = [np.array([1 + kind]) for kind in range(NUM_UNIT_KINDS)] + [
            first + kind * cells + placement_order(chord_table(*board, preset.tower_range_tiles[kind]))
            for kind in range(NUM_TOWER_KINDS)
        ]
        self.seed(0)

    def seed(self, seed: int) -> None:
        self.generator = np.random.default_rng(seed)
        self.wanted = np.zeros(0, np.int64)

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        """One action for each row; rows must be the same games in the same order at each call."""
        num_rows = len(observation)
        if len(self.wanted) != num_rows:
            self.wanted = np.full(num_rows, NO_ITEM)
        self.wanted[self.wanted == NO_ITEM] = self.draw(int((self.wanted == NO_ITEM).sum()))
        lumber = observation[:, OWN_LUMBER, 0, 0]
        for _ in range(20):
            lacking = self.lumber[self.wanted] > lumber
            if not lacking.any() or self.weights[:NUM_UNIT_KINDS].sum() == 0:
                break
            self.wanted[lacking] = self.draw(int(lacking.sum()))
        actions = np.zeros(num_rows, np.int64)
        for item, candidates in enumerate(self.actions):
            rows = np.flatnonzero(self.wanted == item)
            if not len(rows):
                continue
            legal = action_mask[rows[:, None], candidates]
            choice = legal.argmax(1)
            bought = legal[np.arange(len(rows)), choice]
            actions[rows[bought]] = candidates[choice[bought]]
            self.wanted[rows[bought]] = NO_ITEM
        return actions

    def draw(self, count: int) -> NDArray[np.int64]:
        return self.generator.choice(len(ITEMS), count, p=self.weights)

    def state_dict(self) -> dict[str, Any]:
        return {"generator": self.generator.bit_generator.state, "wanted": self.wanted.copy()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self.generator.bit_generator.state = state["generator"]
        self.wanted = state["wanted"].copy()


@dataclass(frozen=True)
class MatchResult:
    """Outcomes of games from the first agent's side, and how long they took."""

    wins: int
    losses: int
    draws: int  # both lost their last health in one tick
    truncations: int
    mean_ticks: float

    @property
    def games(self) -> int:
        return self.wins + self.losses + self.draws + self.truncations


def play_match(engine: BatchedEngine, first: Agent, second: Agent, seed: int) -> MatchResult:
    """One game in each world of `engine`; `first` has seat 0 in one half of them."""
    num_worlds = engine.num_worlds
    half = num_worlds // 2
    worlds = np.arange(num_worlds)
    seats = (worlds >= half).astype(np.int64)  # of `first`
    engine.reset(episode_seeds(seed, worlds, np.zeros(num_worlds, np.int64)))
    first.seed(seed)
    second.seed(seed + 1)
    observation = engine.observe("planes")
    mask = engine.action_mask()
    actions = np.zeros((num_worlds, 2), np.int64)
    steps = np.zeros(num_worlds)
    while True:
        running = ~(engine.terminated | engine.truncated)
        if not running.any():
            break
        engine.observe("planes", observation)
        engine.action_mask(mask)
        for agent, seat in ((first, seats), (second, 1 - seats)):
            actions[worlds, seat] = agent.act(observation[worlds, seat], mask[worlds, seat])
        engine.step(actions)
        steps += running
    wins = int((engine.winner == seats).sum())
    losses = int((engine.winner == 1 - seats).sum())
    truncations = int(engine.truncated.sum())
    return MatchResult(
        wins,
        losses,
        num_worlds - wins - losses - truncations,
        truncations,
        float(steps.mean()) * engine.spec.ticks_per_step,
    )


def pure(engine, item):
    return ItemPlayer(ITEMS[item], engine, np.eye(len(ITEMS))[item])


def mix(engine, without=None):
    weights = np.ones(len(ITEMS))
    if without is not None:
        weights[without] = 0
    return ItemPlayer("mix" if without is None else f"mix without {ITEMS[without]}", engine, weights)
