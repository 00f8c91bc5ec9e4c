"""Stable-Baselines3's agents on our Gymnasium environments, for benchmarks/time_to_strength.py."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

from benchmarks._timing import Clock

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


def train_others(
    method: str,
    environment: str,
    shown: str,
    settings: Sequence[dict[str, Any]],
    seed: int,
    look: Callable[[Any, float, int], bool],
    every: float,
) -> None:
    """Train at the library's own settings until `look` (agent, seconds, frames) is False; it is
    called when `every` seconds of processor time are over.

    environment: Gymnasium id. shown: representation. settings: of environments, which take them
    in turn.
    """
    torch.set_num_threads(1)

    class Looks(BaseCallback):
        def _on_training_start(self) -> None:
            look(Player(self.model, method, shown), 0.0, 0)
            self.clock = Clock(every)
            self.clock.start()

        def _on_step(self) -> bool:
            self.clock.stop()
            goes_on = True
            if self.clock.is_due():
                player = Player(self.model, method, shown)
                goes_on = look(player, self.clock.seconds, self.num_timesteps)
            self.clock.start()
            return goes_on

    def make_env(number: int) -> Any:
        chosen = settings[number % len(settings)]
        env = gymnasium.make(environment, representation=shown, **chosen)
        return env if are_frames(shown) else FlattenObservation(env)

    env = DummyVecEnv([partial(make_env, number) for number in range(NUM_ENVS)])
    env.seed(seed)
    common: dict[str, Any] = {"seed": seed, "device": "cpu"}
    if not are_frames(shown):
        common["policy_kwargs"] = {"net_arch": [256, 256]}
    policy = "CnnPolicy" if are_frames(shown) else "MlpPolicy"
    if method == PPO:
        model: Any = MaskablePPO(policy, env, **common)
    else:
        size = int(np.prod(env.observation_space.shape or ()))
        model = DQN(policy, env, buffer_size=min(100_000, 2_000_000_000 // (8 * size)), **common)
    model.learn(1_000_000_000, callback=Looks())
