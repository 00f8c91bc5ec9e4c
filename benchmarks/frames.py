"""How soon a network reads what moves from stacked frames, with and without `frame_differences`.

    python -m benchmarks.frames [--networks mlp conv capsule] [--updates 1000] [--seeds 0]

Flappy Bird's oracle says what to do in 14,400 stacks of four grey frames, most of which it would
not have come to by itself: for 50 decisions at a time it flies, or a worse bot that errs. Each
network learns to choose as the oracle does (cross-entropy, batches of 32) and is asked about the
games' last fifth; so does an mlp that reads the exact numbers (`features`). Prints a Markdown
table.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

import marl_cair
from benchmarks._networks import read_preset
from marl_cair.games import GAMES
from marl_cair.games.flappy_bird.tables import FLAP
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

NUM_WORLDS, NUM_DECISIONS, STRIDE = 64, 450, 2
TURN_DECISIONS, ERRORS = 50, 0.08
BATCH, LEARNING_RATE, MAX_GRAD_NORM = 32, 1e-3, 10.0


class Shown(NamedTuple):
    """What was seen, in the order of time, and what the oracle would do."""

    stacks: NDArray[np.uint8]  # [N, 4, 84, 84]
    features: NDArray[np.float32]  # [N, 12]
    choices: NDArray[np.int64]  # [N]


def collect(seed: int) -> Shown:
    """Fly NUM_WORLDS games for NUM_DECISIONS and keep every second stack."""
    engine = marl_cair.make_engine("flappy_bird", "classic", num_worlds=NUM_WORLDS, max_ticks=1_000)
    rng = np.random.default_rng(seed)
    engine.reset(_draw_seeds(rng))
    oracle, reflex = (
        GAMES["flappy_bird"].bots[name](engine.scenario, engine.spec)
        for name in ("oracle", "reflex")
    )
    stacks, numbers, choices = [], [], []
    for decision in range(NUM_DECISIONS):
        features = engine.observe("features")[:, 0]
        mask = engine.action_mask()[:, 0]
        shown = oracle.act(features, mask)
        if decision % STRIDE == 0:
            stacks.append(engine.observe("gray_stack")[:, 0].copy())
            numbers.append(features.copy())
            choices.append(shown.copy())
        if decision % TURN_DECISIONS == 0:
            oracle_flies = rng.random(NUM_WORLDS) < 0.5
        errs = rng.random(NUM_WORLDS) < ERRORS
        worse = reflex.act(features, mask) ^ errs
        actions = np.where(oracle_flies, shown, worse) & mask[:, FLAP]  # 0 is the no-op
        engine.step(actions[:, None])
        engine.reset(_draw_seeds(rng), engine.terminated | engine.truncated)
    return Shown(np.concatenate(stacks), np.concatenate(numbers), np.concatenate(choices))


def _draw_seeds(rng: np.random.Generator) -> NDArray[np.uint64]:
    return rng.integers(1 << 40, size=NUM_WORLDS).astype(np.uint64)


def imitate(shown: Shown, config: QNetworkConfig, updates: int, seed: int) -> tuple[float, float]:
    """Train to choose as the oracle does; return the shares of choices, and of flaps, missed."""
    seen: NDArray[Any] = shown.features if config.body == "mlp" else shown.stacks
    network = make_q_network(config, seen.shape[1:], 2, seed)
    optimiser = torch.optim.Adam(network.parameters(), LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.0, updates)
    num_learned = len(shown.choices) * 4 // 5
    rng = np.random.default_rng(seed)
    for _ in range(updates):
        rows = rng.choice(num_learned, BATCH)
        values = network(torch.from_numpy(seen[rows]))
        loss = functional.cross_entropy(values, torch.from_numpy(shown.choices[rows]))
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), MAX_GRAD_NORM)
        optimiser.step()
        schedule.step()
    chosen = _choose(network, seen[num_learned:])
    held = shown.choices[num_learned:]
    missed = chosen != held
    return float(missed.mean()), float(missed[held == FLAP].mean())


@torch.no_grad()
def _choose(network: Any, seen: NDArray[Any]) -> NDArray[np.int64]:
    parts = [network(torch.from_numpy(part)).argmax(1).numpy() for part in np.split(seen, 20)]
    return np.concatenate(parts)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--networks", nargs="+", default=["mlp", "conv", "capsule"])
    parser.add_argument("--updates", type=int, default=1_000)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    words = parser.parse_args()
    shown = collect(seed=7)
    print("| network | `frame_differences` | seed | choices missed | flaps missed |")
    print("|---|---|---|---|---|", flush=True)
    for body in words.networks:
        for differences in (False,) if body == "mlp" else (False, True):
            config = replace(read_preset(body), frame_differences=differences)
            for seed in words.seeds:
                missed, flaps = imitate(shown, config, words.updates, seed)
                title = f"| {body} | {str(differences).lower()} | {seed} "
                print(title + f"| {missed:.1%} | {flaps:.1%} |", flush=True)


if __name__ == "__main__":
    main()
