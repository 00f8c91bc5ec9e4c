"""Stable-Baselines3's agents on our Gymnasium environments, as cells of experiment plans."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers import FlattenObservation
from sb3_contrib import MaskablePPO
from stable_baselines3 import DQN
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv

from marl_cair.experiments.cells import Cell
from marl_cair.games import GAMES
from marl_cair.games.registry import gymnasium_id

Look = Callable[[Any, float, int], bool]
NUM_ENVS = 16
PPO = "sb3_ppo"


class Player:
    """A model as an agent of the league. Boards are flat vectors to it, frames are not.

    No `ForeignAgent`: that forfeits at an illegal action, and DQN without masks plays them.
    """

    def __init__(self, model: Any, name: str, representation: str) -> None:
        self.model, self.name, self.representation = model, name, representation

    def seed(self, seed: int) -> None:
        pass

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        pass

    def act(self, observation: Any, action_mask: Any) -> Any:
        if not are_frames(self.representation):
            observation = observation.reshape(len(observation), -1)
        masks = {"action_masks": action_mask} if self.name == PPO else {}
        actions, _ = self.model.predict(observation, deterministic=True, **masks)
        return actions.astype(np.int64)


def are_frames(representation: str) -> bool:
    return representation == "gray_stack"


def train_ppo(cell: Cell, look: Look) -> None:
    """Train sb3-contrib's MaskablePPO, a trainer of a plan's `others`."""
    _train(PPO, cell, look)


def train_dqn(cell: Cell, look: Look) -> None:
    """Train Stable-Baselines3's DQN, a trainer of a plan's `others`."""
    _train("sb3_dqn", cell, look)


def _train(method: str, cell: Cell, look: Look) -> None:
    """Train at the library's own settings until `look` (agent, processor seconds without looks,
    steps) is False. Environments take the rated bots in turn.
    """
    torch.set_num_threads(1)
    game, bots = cell.config.game, cell.rating.bots
    shown, changes = game.representation, {**game.options, **cell.rating.options}
    name = gymnasium_id(GAMES[game.name].gymnasium_prefix, game.scenario)

    class Looks(BaseCallback):
        def _on_training_start(self) -> None:
            self.seconds = 0.0
            self._on_step()

        def _on_step(self) -> bool:
            now = time.process_time()
            self.seconds += now - getattr(self, "begun", now)
            goes_on = look(Player(self.model, method, shown), self.seconds, self.num_timesteps)
            self.begun = time.process_time()
            return goes_on

    def make_env(number: int) -> Any:
        options = {**changes, "opponent": bots[number % len(bots)]} if bots else changes
        env = gymnasium.make(name, representation=shown, **options)
        return env if are_frames(shown) else FlattenObservation(env)

    env = DummyVecEnv([partial(make_env, number) for number in range(NUM_ENVS)])
    env.seed(cell.seed)
    common: dict[str, Any] = {"seed": cell.seed, "device": "cpu"}
    if not are_frames(shown):
        common["policy_kwargs"] = {"net_arch": [256, 256]}
    policy = "CnnPolicy" if are_frames(shown) else "MlpPolicy"
    if method == PPO:
        model: Any = MaskablePPO(policy, env, **common)
    else:
        size = int(np.prod(env.observation_space.shape or ()))
        model = DQN(policy, env, buffer_size=min(100_000, 2_000_000_000 // (8 * size)), **common)
    model.learn(1_000_000_000, callback=Looks())
