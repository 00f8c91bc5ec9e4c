"""Does a memory help where an observation does not show all that matters?

    python -m benchmarks.memory_matters [--frames 1500000] [--seeds 0 1 2] [--games 200]
        [--kinds none lstm] [--out runs/memory_matters]

Deep Maze 7x7 with line of sight, where what is out of sight is forgotten: without memory a network
does not know where it has been. Trains networks of about equal numbers of weights with `pqn`, then
plays new mazes, greedily and with random moves in a tenth of the steps (without memory only chance
leads out of a circle). Prints shares of solved mazes as a Markdown table; the intervals are 95 %,
of Student's t over the seeds. The same command resumes where it was stopped.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy import stats

from marl_cair.checkpoint import LATEST_FOLDER, count_weight_bytes
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.solo import play_alone
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.settings import config as settings
from marl_cair.training.settings.exploration import ExplorationSettings
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.trainer import train

NEVER = 10**9
UNSEEN_SEED = 1_000_000
OPTIONS = {"rows": 7, "columns": 7, "remembers": False}
GAME = settings.GameSettings("deep_maze", "9x9-line_of_sight", "vector", options=OPTIONS)
POLICIES = {
    "none": QNetworkConfig(body="mlp", norm="layer", hidden_width=176),
    "lstm": QNetworkConfig(body="mlp", norm="layer", hidden_width=64, memory="lstm"),
    "gru": QNetworkConfig(body="mlp", norm="layer", hidden_width=64, memory="gru"),
}
EPSILONS = (0.0, 0.1)


def make_config(kind: str, seed: int, frames: int, out: Path) -> settings.TrainConfig:
    """The settings of one run."""
    return settings.TrainConfig(
        out=str(out / f"{kind}-{seed}"),
        seed=seed,
        total_frames=frames,
        torch_threads=1,
        game=GAME,
        policy=POLICIES[kind],
        learner=LearnerSettings(
            algorithm="pqn", optimizer="radam", learning_rate=1e-3, learning_rate_end=0.0
        ),
        collector=settings.CollectorSettings(num_worlds=128, steps_per_batch=32),
        exploration=ExplorationSettings(
            epsilon_start=1.0, epsilon_end=0.05, anneal_frames=frames // 2
        ),
        generator=settings.GeneratorSettings(name="none"),
        synthetic_fraction=0.0,
        evaluation=settings.EvaluationSettings(every_frames=NEVER, bots=()),
        checkpoint=settings.CheckpointSettings(every_frames=NEVER),
    )


def measure(folder: Path, num_games: int) -> list[float]:
    """Share of new mazes that the agent of a run solves, for each of EPSILONS."""
    game, found = GAMES[GAME.name], []
    for epsilon in EPSILONS:
        agent = load_agent(folder / LATEST_FOLDER, epsilon=epsilon)
        result = play_alone(agent, game, GAME.rated_scenario, num_games, UNSEEN_SEED)
        found.append(result.ended / result.games)
    return found


def describe(shares: list[float]) -> str:
    """Mean of the seeds with its interval, and each of them."""
    mean, reach = float(np.mean(shares)), 0.0
    if len(shares) > 1:
        reach = float(stats.sem(shares) * stats.t.ppf(0.975, len(shares) - 1))
    each = ", ".join(f"{100 * share:.1f}" for share in shares)
    low, high = max(0.0, mean - reach), min(1.0, mean + reach)
    return f"{100 * mean:.1f} % [{100 * low:.1f}, {100 * high:.1f}] ({each})"


def main() -> None:
    """Train, play and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_500_000)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--games", type=int, default=200)
    parser.add_argument("--kinds", nargs="+", choices=POLICIES, default=["none", "lstm"])
    parser.add_argument("--out", type=Path, default=Path("runs/memory_matters"))
    given = parser.parse_args()
    shares: dict[str, list[list[float]]] = {kind: [] for kind in given.kinds}
    seconds = dict.fromkeys(given.kinds, 0.0)
    for seed in given.seeds:
        for kind in given.kinds:
            config = make_config(kind, seed, given.frames, given.out)
            before = time.process_time()
            train(config, resume=True, show_progress=False)
            seconds[kind] += time.process_time() - before
            shares[kind].append(measure(Path(config.out), given.games))
            print(kind, seed, shares[kind][-1], f"{seconds[kind]:.0f} s", flush=True)
    rates = " | ".join(f"solved, {100 * epsilon:.0f} % random moves" for epsilon in EPSILONS)
    print(f"| memory | weights | seconds of a run | {rates} |\n|{'---|' * (3 + len(EPSILONS))}")
    for kind, found in shares.items():
        weights = count_weight_bytes(POLICIES[kind], (25,), 5) // 4
        columns = [describe(list(each)) for each in zip(*found, strict=True)]
        spent = seconds[kind] / len(found)
        print(f"| {kind} | {weights:,} | {spent:.0f} | {' | '.join(columns)} |")


if __name__ == "__main__":
    main()
