"""MicroRTS in self-play, for benchmarks/peers.py: run by the interpreter that has it."""

from __future__ import annotations

import numpy as np
from gym_microrts.envs.vec_env import MicroRTSGridModeVecEnv
from serve import serve

SEATS = 8  # of four games: each is an environment of its own
TICKS = 32  # of a round


def main() -> None:
    """Masks are fetched at each tick, and each unit gets a random legal action of its cell."""
    env = MicroRTSGridModeVecEnv(
        num_selfplay_envs=SEATS, num_bot_envs=0, map_paths=["maps/16x16/basesWorkers16x16.xml"]
    )
    env.reset()
    rng = np.random.default_rng(0)
    ends = np.cumsum(env.action_space_dims)
    parts = [slice(end - size, end) for end, size in zip(ends, env.action_space_dims)]  # noqa: B905  # Python 3.9

    def play() -> int:
        for _ in range(TICKS):
            mask = env.get_action_mask()
            actions = np.zeros((SEATS, env.height * env.width, len(parts)), np.int64)
            cells = np.nonzero(env.source_unit_mask)  # the others' actions are not read
            legal = mask[cells]
            draws = rng.random(legal.shape) * legal
            for part, entries in enumerate(parts):
                actions[(*cells, part)] = draws[:, entries].argmax(1)
            env.step(actions)
        return TICKS * SEATS

    planes = env.observation_space.shape[-1]
    serve(
        play, f"{env.width}x{env.height}, 2 players, {planes} planes, masks, random legal actions"
    )


if __name__ == "__main__":
    main()
