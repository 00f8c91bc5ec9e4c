"""Processor time of an update and of acting, for each body beside `conv`, on the boards of games.

    python -m benchmarks.bodies [--bodies capsule thesis_conv] [--batch 128] [--repeats 8]

An update is that of double Q-learning on random numbers: values, the target network's values,
gradients, Adam. Acting is one pass over twice as many boards. One thread; the bodies take turns,
and the best of the repeats counts. Networks are those of a new training run. Prints a table.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import NamedTuple

import torch

from benchmarks._networks import read_preset
from benchmarks._timing import best_in_turns
from benchmarks.levers import Variant, make_update
from marl_cair.games import GAMES
from marl_cair.policies.q_network import make_q_network
from marl_cair.training.initial_network import fit_policy

BOARDS = (
    ("deep_line_wars", "10x15", "planes"),
    ("deep_rts", "1v1-15x15", "planes"),
    ("deep_rts", "1v1-31x31", "planes"),
    ("flappy_bird", "classic", "gray"),
)


PARTS = "update", "act"


class Work(NamedTuple):
    """What is timed of one body."""

    num_weights: int
    update: Callable[[], None]
    act: Callable[[], None]


def make_work(game: str, scenario: str, representation: str, body: str, batch: int) -> Work:
    """Networks of `body` for the game's observations, with random rows."""
    spec = GAMES[game].make_spec(GAMES[game].scenario(scenario))
    seen = spec.representations[representation]
    config = fit_policy(read_preset(body), seen, spec)
    network = make_q_network(config, seen.shape, spec.num_actions, seed=0)
    rows = torch.randint(0, 256, (2 * batch, *seen.shape), dtype=torch.uint8)

    @torch.no_grad()
    def act() -> None:
        network(rows)

    update = make_update(Variant(config, batch), seen.shape, spec.num_actions)
    return Work(sum(weight.numel() for weight in network.parameters()), update, act)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", default=["capsule"])
    parser.add_argument("--batch", type=int, default=128)
    parser.add_argument("--repeats", type=int, default=8)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print("| board | body | weights | update, ms | of conv | acting, ms | of conv |")
    print("|---|---|---|---|---|---|---|", flush=True)
    for board in BOARDS:
        work = {body: make_work(*board, body, options.batch) for body in ("conv", *options.bodies)}
        parts = {(body, part): getattr(one, part) for body, one in work.items() for part in PARTS}
        best = best_in_turns(parts, options.repeats)
        for body, one in work.items():
            update, act = (1e3 * best[body, part] for part in PARTS)
            ratios = [best[body, part] / best["conv", part] for part in PARTS]
            print(
                f"| {' '.join(board)} | `{body}` | {one.num_weights:,} | {update:.1f} | "
                f"{ratios[0]:.2f} | {act:.1f} | {ratios[1]:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
