"""Adds to a replay how agents value the actions of each step."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from marl_cair.games.players.recurrent import call_agent, find_state_size
from marl_cair.games.replays import Replay, replay_steps

ACTION_VALUES = "action values"


def add_values(replay: Replay, agents: Mapping[int, Any]) -> Replay:
    """The replay with `values` float16 [T, P, A] of agents by seat; NaN for other seats. The game
    is played again, and agents with memory are asked at each step, but where the recording has
    their values: it may have a step for each tick, and they decide after several.

    Agents without a method `values`, as bots, are left out. Raises ReplayError as `replay_steps`.
    """
    spec = replay.spec
    asked = {seat: agent for seat, agent in agents.items() if hasattr(agent, "values")}
    shape = len(replay.actions), spec.num_players, spec.num_actions
    held = (replay.values or {}).get(ACTION_VALUES)
    values = np.full(shape, np.nan, np.float16) if held is None else held.copy()
    for seat in [seat for seat, agent in asked.items() if getattr(agent, "state_size", 0)]:
        if not np.isnan(values[:, seat]).all():
            del asked[seat]
    if not asked or spec.action_shape:
        return replay
    states = np.zeros((spec.num_players, find_state_size(*asked.values())), np.float32)
    for step, engine in enumerate(replay_steps(replay)):
        if step == len(replay.actions):
            break
        mask = engine.action_mask()
        for seat, agent in asked.items():
            rows = engine.observe(agent.representation)[:, seat].copy(), mask[:, seat].copy()
            state = states[[seat], : getattr(agent, "state_size", 0)]
            with np.errstate(over="ignore"):
                values[step, seat] = agent.values(*rows, state)[0]
            call_agent(agent, states, ([seat],), *rows)
    return dataclasses.replace(replay, values={**(replay.values or {}), ACTION_VALUES: values})
