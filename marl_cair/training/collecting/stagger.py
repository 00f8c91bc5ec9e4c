"""Spreads the first games of a run over time, so that a batch holds openings and endings."""

from __future__ import annotations

import numpy as np

from marl_cair.games.players.random_player import draw_legal
from marl_cair.games.torchrl_env import BatchedGameEnv


def stagger_starts(env: BatchedGameEnv, num_steps: int, seed: int) -> None:
    """Play `num_steps` random legal steps in all worlds, and begin a new game in each at a random
    one of them. Where a seat leaves its game, a new one begins too: every seat is in at the end.

    Worlds that begin together stay in phase for many games of about equal length. Batches are then
    all openings or all endings, and a network that learns from the newest steps alone forgets the
    other.
    """
    engine, rng = env.engine, np.random.default_rng(seed)
    restart = rng.integers(0, num_steps, engine.num_worlds)
    for step in range(num_steps):
        engine.step(draw_legal(engine.action_mask(), rng))
        ended = engine.terminated | engine.truncated | engine.eliminated.any(1) | (restart == step)
        if ended.any():
            engine.reset(env.seeds.next(ended), ended)
