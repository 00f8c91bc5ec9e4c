"""Processor time of an update and of acting, for each body beside `conv`, on the boards of games.

    python -m benchmarks.bodies [--bodies capsule thesis_conv] [--batch 128] [--repeats 8]

An update is that of double Q-learning on random numbers: values, the target network's values,
gradients, Adam. Acting is one pass over twice as many boards. One thread; the bodies take turns,
and the best of the repeats counts. Networks are those of a new training run. Prints a table.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from marl_cair.games import GAMES
from marl_cair.policies.q_network import QNetwork, QNetworkConfig, make_q_network
from marl_cair.training.initial_network import fit_policy

BOARDS = (
    ("deep_line_wars", "10x15", "planes"),
    ("deep_rts", "1v1-15x15", "planes"),
    ("deep_rts", "1v1-31x31", "planes"),
    ("flappy_bird", "classic", "gray"),
)


class Work(NamedTuple):
    """What is timed of one body."""

    num_weights: int
    update: Callable[[], None]
    act: Callable[[], None]


def make_work(game: str, scenario: str, representation: str, body: str, batch: int) -> Work:
    """Networks of `body` for the game's observations, with random rows."""
    spec = GAMES[game].make_spec(GAMES[game].scenario(scenario))
    seen = spec.representations[representation]
    config = fit_policy(QNetworkConfig(body=body), seen, spec)
    network, target = (
        make_q_network(config, seen.shape, spec.num_actions, seed) for seed in range(2)
    )
    optimizer = torch.optim.Adam(network.parameters())
    rows = torch.randint(0, 256, (2 * batch, *seen.shape), dtype=torch.uint8)
    action = torch.randint(spec.num_actions, (batch, 1))
    weights = sum(weight.numel() for weight in network.parameters())

    def update() -> None:
        learn(network, target, optimizer, rows, action)

    @torch.no_grad()
    def act() -> None:
        network(rows)

    return Work(weights, update, act)


def learn(
    network: QNetwork,
    target: QNetwork,
    optimizer: torch.optim.Optimizer,
    rows: Tensor,
    action: Tensor,
) -> None:
    """One update; the second half of `rows` follows the first."""
    now, following = rows.chunk(2)
    with torch.no_grad():
        best = network(following).argmax(-1, keepdim=True)
        wanted = 0.99 * target(following).gather(-1, best)
    loss = functional.smooth_l1_loss(network(now).gather(-1, action), wanted)
    optimizer.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    optimizer.step()


def time_best(work: dict[str, Work], repeats: int) -> dict[str, list[float]]:
    """Milliseconds of an update and of acting by body, the best of `repeats`."""
    best = {body: [math.inf, math.inf] for body in work}
    for number in range(repeats + 1):
        for body, parts in work.items():
            for place, part in enumerate((parts.update, parts.act)):
                start = time.process_time()
                part()
                taken = 1e3 * (time.process_time() - start)
                if number:  # the first makes what later ones use again
                    best[body][place] = min(best[body][place], taken)
    return best


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
        best = time_best(work, options.repeats)
        for body, (update, act) in best.items():
            ratios = [each / of for each, of in zip((update, act), best["conv"], strict=True)]
            print(
                f"| {' '.join(board)} | `{body}` | {work[body].num_weights:,} | {update:.1f} | "
                f"{ratios[0]:.2f} | {act:.1f} | {ratios[1]:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
