"""Griddly's own RTS, for benchmarks/peers.py: run by the interpreter that has `griddly`."""

from __future__ import annotations

import numpy as np
from griddly import GymWrapper, gd
from serve import serve

ACTION_SETS = 256  # drawn before the clock starts


def main() -> None:
    """Play one world through the wrapper, which is how Griddly is used; it has no batches."""
    env = GymWrapper("RTS/GriddlyRTS.yaml", level=0, global_observer_type=gd.ObserverType.NONE)
    env.reset()
    env.action_space.seed(0)
    sets = [env.action_space.sample() for _ in range(ACTION_SETS)]

    def play() -> int:
        for actions in sets:
            _, _, done, _ = env.step(actions)
            if done:
                env.reset()
        return len(sets) * env.player_count

    size = f"{env.grid_width}x{env.grid_height}"
    planes = " x ".join(str(length) for length in np.shape(env.observation_space[0]))
    serve(play, f"{size}, {env.player_count} players, vector observation {planes}, no mask")


if __name__ == "__main__":
    main()
