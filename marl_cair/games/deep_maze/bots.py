"""Scripted players of Deep Maze. They see what an agent sees: planes and action mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze.bot_plans import (
    Scratch,
    find_self,
    make_scratch,
    plan_oracle,
    plan_wall_follower,
)
from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.deep_maze.tables import NOOP
from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.scripted import ScriptedPlayer, choose_by_kind

PLANS = ("random", "wall_follower", "oracle")
RANDOM, WALL_FOLLOWER, ORACLE = range(len(PLANS))


@compiled
def decide(plan: int, planes: Any, mask: Any, groups: Any, scratch: Scratch, random: Any) -> int:
    """The action that a plan takes in one player's position; an illegal one becomes the no-op."""
    if plan == RANDOM:
        return choose_by_kind(mask, groups, random)
    rows, columns = planes.shape[1], planes.shape[2]
    flat = planes.reshape((planes.shape[0], rows * columns))
    cell = find_self(flat)
    if plan == WALL_FOLLOWER:
        action = plan_wall_follower(flat, columns, cell)
    else:
        action = plan_oracle(flat, columns, cell, scratch)
    return action if mask[action] else NOOP


@compiled
def decide_all(
    plan: int, groups: Any, scratch: Any, planes: Any, mask: Any, random: Any, out: Any
) -> None:
    """Decide for each of N rows: planes [N, C, H, W], mask [N, A], out [N]."""
    for index in range(planes.shape[0]):
        out[index] = decide(plan, planes[index], mask[index], groups, scratch, random)


def make_bot(name: str, scenario: Scenario, spec: GameSpec) -> ScriptedPlayer:
    """The bot of one of PLANS for a scenario and its spec."""
    plan, scratch = PLANS.index(name), make_scratch(scenario)
    return ScriptedPlayer(name, partial(decide_all, plan, spec.action_groups, scratch))


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    name: partial(make_bot, name) for name in PLANS
}
