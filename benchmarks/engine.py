"""Speed of the engine and of its doors, as ratios to the same rules in plain Python.

    python benchmarks/engine.py [--game deep_line_wars] [--scenario 10x15] [--seconds 1.0]

One thread. Best of 5, all in one run; a tick is one tick of one world, an agent-step one decision
of one seat with what the row names.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import torch

import marl_cair
from marl_cair.games.parallel_env import make_parallel_env
from marl_cair.games.randomness import episode_seeds

REPEATS = 5
ACTION_SETS = 64  # drawn before the clock starts


def draw_actions(engine: object, num_sets: int, by_kind: bool) -> np.ndarray:
    """Random actions [num_sets, B, P]: uniform over all, or over kinds and then over a kind's."""
    spec, shape = engine.spec, (num_sets, engine.num_worlds, engine.num_players)
    rng = np.random.default_rng(0)
    if not by_kind:
        return rng.integers(engine.num_actions, size=shape, dtype=np.int32)
    kinds = len(spec.action_group_names)
    members = [np.flatnonzero(spec.action_groups == kind) for kind in range(kinds)]
    chosen, place = rng.integers(kinds, size=shape), rng.random(shape)
    actions = np.zeros(shape, np.int32)
    for kind, actions_of_kind in enumerate(members):
        picked = actions_of_kind[(place * len(actions_of_kind)).astype(int)]
        actions = np.where(chosen == kind, picked, actions).astype(np.int32)
    return actions


def measure(
    play: Callable[[], int], seconds: float, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Best rate of REPEATS: `play` does a round of work and returns how many units it was."""
    play()
    return max(measure_once(play, seconds, clock) for _ in range(REPEATS))


def measure_once(play: Callable[[], int], seconds: float, clock: Callable[[], float]) -> float:
    """Units of work per second of so many seconds."""
    units, start = 0, clock()
    while clock() - start < seconds:
        units += play()
    return units / (clock() - start)


def measure_engine(game: str, scenario: str, worlds: int, seconds: float, by_kind: bool) -> float:
    """Ticks per second over whole games, resets included."""
    engine = marl_cair.make_engine(game, scenario, worlds)
    actions = draw_actions(engine, ACTION_SETS, by_kind)
    indices, ticks = np.arange(worlds), engine.spec.ticks_per_step
    episodes = np.zeros(worlds, np.int64)
    engine.reset(episode_seeds(0, indices, episodes))

    def play() -> int:
        for chosen in actions:
            engine.step(chosen)
            ended = engine.terminated | engine.truncated
            if ended.any():
                episodes[ended] += 1
                engine.reset(episode_seeds(0, indices, episodes), ended)
        return ACTION_SETS * worlds * ticks

    return measure(play, seconds)


def measure_torchrl(game: str, scenario: str, worlds: int, seconds: float) -> float:
    """Agent-steps per second of `step_and_maybe_reset` with planes and mask of every seat."""
    torch.set_num_threads(1)
    env = marl_cair.make_torchrl_env(game, scenario, num_worlds=worlds, seed=0)
    sets = torch.from_numpy(draw_actions(env.engine, ACTION_SETS, False).astype(np.int64))
    state = env.reset()

    def play() -> int:
        nonlocal state
        for chosen in sets:
            state["player", "action"] = chosen
            _, state = env.step_and_maybe_reset(state)
        return ACTION_SETS * worlds * env.engine.num_players

    return measure(play, seconds)


def measure_pettingzoo(game: str, scenario: str, seconds: float) -> float:
    """Steps per second of one parallel environment, observations and masks of all players."""
    env = make_parallel_env(game, scenario)
    agents = env.possible_agents
    sets = draw_actions(env.engine, ACTION_SETS, False)[:, 0].tolist()
    env.reset(seed=0)

    def play() -> int:
        for chosen in sets:
            env.step(dict(zip(agents, chosen, strict=True)))
            if not env.agents:
                env.reset()
        return ACTION_SETS

    return measure(play, seconds)


def measure_plain_python(game: str, scenario: str) -> float:
    """Ticks per second of the rules without compiler."""
    return evaluate_plainly(
        "benchmarks.engine", f"measure_engine({game!r}, {scenario!r}, 1, 1.0, False)"
    )


def evaluate_plainly(module: str, expression: str) -> float:
    """The number that an expression of a module's names gives without the compiler, in a process
    of its own.
    """
    code = f"from {module} import *; print({expression})"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    return float(done.stdout)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", default="deep_line_wars")
    parser.add_argument("--scenario", default="10x15")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each repeat")
    options = parser.parse_args()
    game, scenario, seconds = options.game, options.scenario, options.seconds
    plain = measure_plain_python(game, scenario)
    spec = marl_cair.make_engine(game, scenario).spec
    ticks = spec.ticks_per_step
    rows = [
        ("plain Python rules, 1 world", plain, "ticks/s"),
        (
            "engine, 1,024 worlds, uniform actions",
            measure_engine(game, scenario, 1024, seconds, False),
            "ticks/s",
        ),
        (
            "engine, 1,024 worlds, actions by kind",
            measure_engine(game, scenario, 1024, seconds, True),
            "ticks/s",
        ),
        (
            "TorchRL environment, 1,024 worlds, planes + mask",
            measure_torchrl(game, scenario, 1024, seconds),
            "agent-steps/s",
        ),
        (
            "PettingZoo environment, planes + mask",
            measure_pettingzoo(game, scenario, seconds),
            "steps/s",
        ),
    ]
    print(f"{game} {scenario}, {ticks} ticks a step, one thread, best of {REPEATS}")
    for name, rate, unit in rows:
        scale = {"ticks/s": 1, "agent-steps/s": ticks / spec.num_players, "steps/s": ticks}[unit]
        print(f"{name:50s} {rate:14,.0f} {unit:14s} {rate * scale / plain:9,.0f} x plain Python")


if __name__ == "__main__":
    main()
