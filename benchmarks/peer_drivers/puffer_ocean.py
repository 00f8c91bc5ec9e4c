"""Many-agent games of PufferLib, for benchmarks/peers.py: run by the interpreter that has it."""

from __future__ import annotations

import importlib
import sys

import numpy as np
from serve import serve

ACTION_SETS = 64  # drawn before the clock starts
# Name: (module, class, options, what it is). All of a game's agents are ours, none is scripted.
GAMES = {
    "moba": ("moba.moba", "Moba", {"num_envs": 16, "script_opponents": False}, "two teams of 5"),
    "nmmo3": ("nmmo3.nmmo3", "NMMO3", {"num_envs": 1}, "512x512"),
    "snake": ("snake.snake", "Snake", {"num_envs": 16}, "640x360, 256 snakes a board"),
}


def main() -> None:
    """Play the game that the first argument names."""
    module, kind, options, what = GAMES[sys.argv.pop(1)]
    env = getattr(importlib.import_module(f"pufferlib.ocean.{module}"), kind)(**options)
    env.reset()
    space = env.single_action_space
    choices = getattr(space, "nvec", getattr(space, "n", None))
    rng = np.random.default_rng(0)
    shape = (ACTION_SETS, *env.actions.shape)
    sets = rng.integers(choices, size=shape).astype(env.actions.dtype)

    def play() -> int:
        for actions in sets:
            env.step(actions)
        return len(sets) * env.num_agents

    observed = int(np.prod(env.single_observation_space.shape))
    serve(play, f"{what}, {env.num_agents} agents, {observed} bytes each, no masks")


if __name__ == "__main__":
    main()
