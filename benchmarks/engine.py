"""Speed of the engine and of its doors, as ratios to the same rules in plain Python.

    python -m benchmarks.engine [--game deep_line_wars] [--scenario 10x15] [--seconds 1.0]
                                [--processor-time]

One thread. Best of 5, all in one run; a tick is one tick of one world, an agent-step one decision
of one seat with what the row names. Games of all ages are measured side by side, but for the rows
of one world. Uniform actions are drawn from all actions: most are illegal and boards stay nearly
empty. By kind: first a kind of action, then one of that kind. Legal: at each step uniformly from
the mask, with planes and mask of every seat observed. The rows of the engine say how many units
and towers, of both seats together, stand on a board on average. On a machine that others use too,
--processor-time counts the seconds that the process computed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import marl_cair
from benchmarks._legal_actions import make_draw_legal
from marl_cair.games.deep_rts.state import NUM_UNITS
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.randomness import episode_seeds

REPEATS = 5
ACTION_SETS = 64  # drawn before the clock starts


def draw_actions(engine: BatchedEngine, num_sets: int, by_kind: bool) -> NDArray[np.int32]:
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


class Boards:
    """Mean number of units and towers on the boards of an engine."""

    def __init__(self, engine: BatchedEngine) -> None:
        self._worlds = engine._worlds
        self._counts: list[tuple[float, ...]] = []
        self._names = {"deep_line_wars": ("units", "towers"), "deep_rts": ("units",)}.get(
            engine.game.name, ()
        )

    def count(self) -> None:
        """Count those of now."""
        worlds = self._worlds
        if "towers" in self._names:
            units = (worlds.unit_health > 0).sum((1, 2)).mean()
            self._counts.append((units, worlds.num_towers.sum(1).mean()))
        elif self._names:
            self._counts.append((worlds.players[:, :, NUM_UNITS].sum(1).mean(),))

    def describe(self) -> str:
        """Such as `3.1 units, 2.0 towers`; nothing of a game without them."""
        means = np.mean(self._counts, axis=0) if self._names else ()
        return ", ".join(
            f"{mean:.1f} {name}" for mean, name in zip(means, self._names, strict=True)
        )


def prepare_engine(
    game: str, scenario: str, num_worlds: int, draw: str
) -> tuple[Callable[[], int], Boards]:
    """A round of play that returns its ticks, resets included, and the boards.

    `draw` is "uniform", "by kind" or "legal".
    """
    engine = marl_cair.make_engine(game, scenario, num_worlds)
    actions = draw_actions(engine, ACTION_SETS, draw == "by kind")
    draws = np.random.default_rng(1).random(actions.shape, dtype=np.float32)
    indices, ticks = np.arange(num_worlds), engine.spec.ticks_per_step
    episodes = np.zeros(num_worlds, np.int64)
    engine.reset(episode_seeds(0, indices, episodes))
    mask, boards = engine.action_mask(), Boards(engine)
    draw_legal = make_draw_legal() if draw == "legal" else None

    def step(index: int, restarted: NDArray[np.bool_]) -> None:
        chosen = actions[index]
        if draw_legal:
            draw_legal(mask, draws[index], chosen)
        engine.step(chosen)
        ended = engine.terminated | engine.truncated | restarted
        if ended.any():
            episodes[ended] += 1
            engine.reset(episode_seeds(0, indices, episodes), ended)
        if draw_legal:
            engine.observe_in_place("planes")
            engine.action_mask(out=mask)

    # One world after the other is reset, so that games of all ages are measured at any time.
    num_steps = engine.spec.max_ticks // ticks if num_worlds > 1 else 0
    starts = indices * num_steps // num_worlds
    for number in range(num_steps):
        step(number % ACTION_SETS, starts == number)
    none = np.zeros(num_worlds, np.bool_)

    def play() -> int:
        for index in range(ACTION_SETS):
            step(index, none)
        boards.count()
        return ACTION_SETS * num_worlds * ticks

    return play, boards


def measure_pettingzoo(
    game: str, scenario: str, seconds: float, clock: Callable[[], float]
) -> float:
    """Steps per second of one parallel environment, observations and masks of all players."""
    env = GameParallelEnv(game, scenario)
    agents = env.possible_agents
    sets = draw_actions(env.engine, ACTION_SETS, False)[:, 0].tolist()
    env.reset(seed=0)

    def play() -> int:
        for chosen in sets:
            env.step(dict(zip(agents, chosen, strict=True)))
            if not env.agents:
                env.reset()
        return ACTION_SETS

    return measure(play, seconds, clock)


def measure_plain_python(game: str, scenario: str, clock_name: str) -> float:
    """Ticks per second of the rules without compiler."""
    return evaluate_plainly(
        "benchmarks.engine",
        f"measure(prepare_engine({game!r}, {scenario!r}, 1, 'uniform')[0], 1.0, time.{clock_name})",
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
    parser.add_argument(
        "--processor-time", action="store_true", help="seconds computed, not passed"
    )
    options = parser.parse_args()
    game, scenario, seconds = options.game, options.scenario, options.seconds
    clock_name = "process_time" if options.processor_time else "perf_counter"
    clock = getattr(time, clock_name)
    plain = measure_plain_python(game, scenario, clock_name)
    spec = marl_cair.make_engine(game, scenario).spec
    ticks = spec.ticks_per_step
    rows = [("plain Python rules, 1 world, uniform actions", plain, "ticks/s", "")]
    for draw, name in (
        ("uniform", "uniform actions"),
        ("by kind", "actions by kind"),
        ("legal", "legal actions, planes + mask"),
    ):
        play, boards = prepare_engine(game, scenario, 1024, draw)
        rate = measure(play, seconds, clock)
        rows.append((f"engine, 1,024 worlds, {name}", rate, "ticks/s", boards.describe()))
    rate = measure_pettingzoo(game, scenario, seconds, clock)
    rows.append(("PettingZoo environment, planes + mask", rate, "steps/s", "uniform actions"))
    print(f"{game} {scenario}, {ticks} ticks a step, one thread, best of {REPEATS}")
    for name, rate, unit, boards_of_row in rows:
        scale = {"ticks/s": 1, "steps/s": ticks}[unit]
        row = f"{name:50s} {rate:14,.0f} {unit:14s} {rate * scale / plain:9,.1f} x plain Python"
        print(f"{row}  {boards_of_row}".rstrip())


if __name__ == "__main__":
    main()
