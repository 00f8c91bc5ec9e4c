"""Processor time until an agent is strong and stays so, for our learners and Stable-Baselines3.

    python -m benchmarks.time_to_strength [--tasks deep_line_wars ...] [--methods pqn dqn ...]
        [--networks small_conv capsule] [--seeds 0 1 2] [--seconds 360] [--every 10] [--games 500]
        [--out runs/time_to_strength] [--picture docs/images/time_to_strength.png]

A run trains in a process of its own, on one thread. Each `--every` seconds of processor time (not
counting what follows) its greedy agent plays `--games` new games, and once before it has learned
anything: some untrained networks beat a weak opponent. A level is reached at the first
of two looks in a row at or above it; it is held if all later looks are. Methods: `pqn` (recipe),
`dqn` (20 % generated transitions), `dqn_real` (none), and of Stable-Baselines3, if it is installed
(pip install stable-baselines3 sb3-contrib), `sb3_ppo` (with action masks) and `sb3_dqn` (without:
it has none) on the same Gymnasium id. Runs that are finished are not repeated. Writes
<out>/looks.csv, prints the table as Markdown and draws all looks.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from marl_cair.files import atomic_path, write_atomically
from marl_cair.games import GAMES
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import play_alone
from marl_cair.training.curves import COLOURS

FRESH_SEED = 2_000_000  # of the first look's games; no training has them
NETWORKS_OF_OTHERS = "their own"


class Task(NamedTuple):
    """A game, and the levels of its measure."""

    game: str
    scenario: str
    levels: tuple[float, ...]
    measure: str  # points against the bot `random`, or a number of the game (`Game.info`)
    options: tuple[str, ...] = ()  # of all our runs
    environment_id: str = ""


TASKS = {
    "deep_line_wars": Task(
        "deep_line_wars",
        "10x15",
        (0.95, 0.99),
        "random",
        environment_id="marl_cair/DeepLineWars-10x15-v0",
    ),
    "deep_rts": Task(
        "deep_rts",
        "1v1-15x15",
        (0.98,),
        "random",
        ("learner.gamma=0.997", "collector.stagger_steps=1000"),
        "marl_cair/DeepRTS-1v1-15x15-v0",
    ),
    "deep_maze": Task(
        "deep_maze",
        "9x9-stochastic",
        (0.99,),
        "reached_goal",
        ("policy.distances=true", "policy.obstacle_planes=[0]", "learner.gamma=0.96"),
        "marl_cair/DeepMaze-9x9-stochastic-v0",
    ),
}
OURS = {
    "pqn": ("recipe=pqn",),
    "dqn": (),
    "dqn_real": ("generator=none", "synthetic_fraction=0"),
}
OTHERS = ("sb3_ppo", "sb3_dqn")


class Look(NamedTuple):
    """One look at a run."""

    task: str
    method: str
    network: str
    seed: int
    seconds: float  # of processor time in training
    frames: int  # environment steps
    score: float


def measure(agent: Any, task: Task, games: int, look: int) -> float:
    """The task's measure of `agent` in games that no other look has."""
    game = GAMES[task.game]
    scenario, seed = game.scenario(task.scenario), FRESH_SEED + look * games
    if task.measure in game.bots and game.make_spec(scenario).num_teams > 1:
        bot = game.bot(task.measure, scenario)
        return play_match(agent, bot, game, scenario, games, seed).score
    result = play_alone(agent, game, scenario, games, seed)
    if task.measure == "reached_goal":
        return result.ended / result.games
    return float(np.median(result.numbers[task.measure]))


def train_ours(
    words: list[str], look: Callable[[Any, int], bool], every: float, folder: str
) -> None:
    """Train until `look` (agent, frames) returns False; it is called each `every` seconds."""
    from marl_cair.cli.compose import compose_config
    from marl_cair.training.collecting.metrics import Timers
    from marl_cair.training.run import TrainingRun
    from marl_cair.training.trainer import iterate

    fixed = ["torch_threads=1", "opponent=random", f"out={folder}"]
    run = TrainingRun(compose_config([*words, *fixed]))
    steps = iterate(run, Timers())
    clock = Clock(every)
    goes_on = look(run.rated, 0)
    while goes_on:
        with clock:
            next(steps)
        if clock.is_due():
            goes_on = look(run.rated, run.frames)
    run.close()


def train_others(
    method: str, task: Task, seed: int, look: Callable[[Any, int], bool], every: float
) -> None:
    """As `train_ours`, with Stable-Baselines3 at its own settings, 16 environments."""
    import gymnasium
    import torch
    from gymnasium.wrappers import FlattenObservation
    from sb3_contrib import MaskablePPO
    from stable_baselines3 import DQN
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env

    torch.set_num_threads(1)
    game = GAMES[task.game]
    spec = game.make_spec(game.scenario(task.scenario))
    shape = spec.representations["planes"].shape

    class Player:
        name, representation = method, "planes"

        def __init__(self, model: Any) -> None:
            self.model = model

        def seed(self, seed: int) -> None:
            pass

        def state_dict(self) -> dict[str, Any]:
            return {}

        def load_state_dict(self, state: dict[str, Any]) -> None:
            pass

        def act(self, observation: Any, action_mask: Any) -> Any:
            flat = observation.reshape(len(observation), -1).astype(np.float32)
            masks = {"action_masks": action_mask} if method == "sb3_ppo" else {}
            actions, _ = self.model.predict(flat, deterministic=True, **masks)
            return actions.astype(np.int64)

    class Looks(BaseCallback):
        def _on_training_start(self) -> None:
            look(Player(self.model), 0)
            self.clock = Clock(every)
            self.clock.__enter__()

        def _on_step(self) -> bool:
            self.clock.__exit__()
            goes_on = True
            if self.clock.is_due():
                goes_on = look(Player(self.model), self.num_timesteps)
            self.clock.__enter__()
            return goes_on

    def make_env() -> Any:
        return FlattenObservation(gymnasium.make(task.environment_id))

    env = make_vec_env(make_env, 16, seed=seed)
    wide = {"net_arch": [256, 256]}
    if method == "sb3_ppo":
        model: Any = MaskablePPO("MlpPolicy", env, seed=seed, policy_kwargs=wide, device="cpu")
    else:
        rows = min(100_000, 2_000_000_000 // (8 * int(np.prod(shape))))
        model = DQN("MlpPolicy", env, seed=seed, policy_kwargs=wide, buffer_size=rows, device="cpu")
    model.learn(1_000_000_000, callback=Looks())


class Clock:
    """Processor seconds of this process inside `with`, and whether a look is due."""

    def __init__(self, every: float) -> None:
        self.every, self.seconds, self._looked, self._begun = every, 0.0, 0, 0.0

    def __enter__(self) -> None:
        self._begun = time.process_time()

    def __exit__(self, *error: object) -> None:
        self.seconds += time.process_time() - self._begun

    def is_due(self) -> bool:
        """Whether another `every` seconds are over since this last said so."""
        looks = int(self.seconds // self.every)
        is_due, self._looked = looks > self._looked, looks
        return is_due


def run_one(case: dict[str, Any]) -> None:
    """Train one case and write its looks, in this process."""
    task, path = TASKS[case["task"]], Path(case["path"])
    looks: list[Look] = []

    def look(agent: Any, frames: int) -> bool:
        seconds = len(looks) * case["every"]
        score = measure(agent, task, case["games"], len(looks))
        names = (case["task"], case["method"], case["network"], case["seed"])
        looks.append(Look(*names, seconds, frames, score))
        print(*looks[-1], flush=True)
        return bool(seconds < case["seconds"])

    if case["method"] in OTHERS:
        train_others(case["method"], task, case["seed"], look, case["every"])
    else:
        words = [f"game={task.game}", f"scenario={task.scenario}", f"policy={case['network']}"]
        words += [f"seed={case['seed']}", *OURS[case["method"]], *task.options, *case["words"]]
        folder = str(path.with_suffix(""))
        train_ours(words, look, case["every"], folder)
    write_atomically(path, _write_csv(looks))


def _write_csv(looks: list[Look]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([Look._fields, *looks])
    return text.getvalue()


def read_looks(path: Path) -> Iterator[Look]:
    """The looks that `run_one` wrote."""
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            numbers = float(row["seconds"]), int(row["frames"]), float(row["score"])
            yield Look(row["task"], row["method"], row["network"], int(row["seed"]), *numbers)


def find_reached(looks: list[Look], level: float) -> Look | None:
    """The first of two looks in a row at or above `level`."""
    reached = (first for first, then in pairwise(looks) if min(first.score, then.score) >= level)
    return next(reached, None)


def print_table(runs: list[list[Look]]) -> None:
    """One row for each run and level."""
    columns = ("task", "method", "network", "seed", "untrained", "level", "reached after", "steps")
    print(f"| {' | '.join(columns)} | lowest later look |")
    print(f"|{'---|' * (len(columns) + 1)}")
    for looks in runs:
        about = looks[0]
        for level in TASKS[about.task].levels:
            found = find_reached(looks, level)
            when = ("never", "-", f"best {max(one.score for one in looks):.1%}")
            if found is not None:
                later = min(one.score for one in looks if one.seconds >= found.seconds)
                when = (f"{found.seconds:.0f} s", f"{found.frames:,}", f"{later:.1%}")
            names = (about.task, about.method, about.network, about.seed, f"{about.score:.0%}")
            print("|", " | ".join(map(str, (*names, f"{level:.0%}", *when))), "|")


def draw(runs: list[list[Look]], path: Path) -> None:
    """All looks: a panel for each task, a colour for each method and network."""
    tasks = list(dict.fromkeys(looks[0].task for looks in runs))
    figure = Figure(figsize=(5.0 * len(tasks), 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    kinds = list(dict.fromkeys((looks[0].method, looks[0].network) for looks in runs))
    panels = figure.subplots(1, len(tasks), squeeze=False)[0]
    for panel, task in zip(panels, tasks, strict=True):
        shown = set()
        for looks in (looks for looks in runs if looks[0].task == task):
            kind = looks[0].method, looks[0].network
            label = None if kind in shown else ", ".join(kind)
            shown.add(kind)
            colour = COLOURS[kinds.index(kind) % len(COLOURS)]
            seconds = [one.seconds for one in looks]
            panel.plot(seconds, [one.score for one in looks], color=colour, lw=1.2, label=label)
        for level in TASKS[task].levels:
            panel.axhline(level, color="0.6", lw=0.8, ls=":")
        panel.set(title=task.replace("_", " "), xlabel="processor seconds of training")
        panel.legend(fontsize=7, frameon=False, loc="lower right")
    panels[0].set_ylabel("points against random, or share of goals")
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=150, format="png")


def main() -> None:
    """Run all cases, one after another; print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--methods", nargs="+", choices=(*OURS, *OTHERS), default=list(OURS))
    parser.add_argument("--networks", nargs="+", default=["small_conv", "capsule"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--seconds", type=float, default=360.0, help="of training of each run")
    parser.add_argument("--every", type=float, default=10.0, help="seconds between two looks")
    parser.add_argument("--games", type=int, default=500, help="of each look")
    parser.add_argument("--out", type=Path, default=Path("runs/time_to_strength"))
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options, words = parser.parse_known_args()
    if options.one:
        run_one(json.loads(options.one))
        return
    runs = []
    for task in options.tasks:
        for method in options.methods:
            networks = [NETWORKS_OF_OTHERS] if method in OTHERS else options.networks
            for network in networks:
                for seed in options.seeds:
                    name = "-".join((task, method, network.replace(" ", "_"), str(seed)))
                    path = options.out / f"{name}.csv"
                    case = {"task": task, "method": method, "network": network, "seed": seed}
                    case |= {"path": str(path), "every": options.every, "games": options.games}
                    case |= {"seconds": options.seconds, "words": words}
                    if not path.exists():
                        path.parent.mkdir(parents=True, exist_ok=True)
                        one = [sys.executable, "-m", "benchmarks.time_to_strength"]
                        subprocess.run([*one, "--one", json.dumps(case)], check=True)
                    runs.append(list(read_looks(path)))
    looks = [look for run in runs for look in run]
    write_atomically(options.out / "looks.csv", _write_csv(looks))
    print_table(runs)
    if options.picture:
        draw(runs, options.picture)


if __name__ == "__main__":
    main()
