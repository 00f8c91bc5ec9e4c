"""What makes an update cheaper: each change alone, beside the update without it.

    python -m benchmarks.levers [--batch 128] [--repeats 15]

The update is that of double Q-learning with `conv` on Deep Line Wars 10x15: values of the next
observations by the online and the target network, of the present ones by the online network with
gradient, Huber loss, Adam, on random rows. One thread, processor time; all variants take turns, and
the best of the repeats counts. `torch.compile` needs a C++ compiler. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from benchmarks._networks import read_preset
from benchmarks._timing import best_in_turns
from marl_cair.games import GAMES
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

SMALL = read_preset("small_conv")


@dataclass(frozen=True)
class Variant:
    """An update; the defaults are the one that others are compared with."""

    network: QNetworkConfig = field(default_factory=QNetworkConfig)
    batch: int = 128
    bfloat16: bool = False
    fused: bool = False  # Adam as one kernel
    has_target: bool = True  # else the online network rates the next observations
    joined: bool = False  # the online network reads both observations in one pass
    is_double: bool = True  # else the target network chooses the next action
    compiled: bool = False


BASE = Variant()
VARIANTS = {
    "the update": BASE,
    "a small normalised network (`policy=small_conv`)": replace(BASE, network=SMALL),
    "bfloat16 (`learner.autocast=true`)": replace(BASE, bfloat16=True),
    "no target network, as in `pqn`": replace(BASE, has_target=False),
    "the target network chooses (`learner.double=false`)": replace(BASE, is_double=False),
    "both observations in one pass": replace(BASE, joined=True),
    "fused Adam": replace(BASE, fused=True),
    "`torch.compile`": replace(BASE, compiled=True),
    "four times as many rows, a quarter of the updates": replace(BASE, batch=512),
    "a small network, bfloat16, no target network": replace(
        BASE, network=SMALL, bfloat16=True, has_target=False
    ),
}


def make_update(variant: Variant, shape: tuple[int, ...], num_actions: int) -> Callable[[], None]:
    """A function that does one update of random rows, uint8 of `shape`."""
    batch = variant.batch
    network, target = (
        make_q_network(variant.network, shape, num_actions, seed) for seed in range(2)
    )
    optimizer = torch.optim.Adam(network.parameters(), fused=variant.fused or None)
    rows = torch.randint(0, 256, (2 * batch, *shape), dtype=torch.uint8)
    action = torch.randint(num_actions, (batch, 1))

    def find_loss(rows: Tensor) -> Tensor:
        now, following = rows.chunk(2)
        if variant.joined:
            values, chooser = network(rows).chunk(2)
        else:
            values = network(now)
        with torch.no_grad():
            if not variant.joined and (variant.is_double or not variant.has_target):
                chooser = network(following)
            rated = target(following) if variant.has_target else chooser
            best = (chooser if variant.is_double else rated).argmax(-1, keepdim=True)
            wanted = 0.99 * rated.gather(-1, best)
        return functional.smooth_l1_loss(values.gather(-1, action), wanted)

    find: Any = torch.compile(find_loss) if variant.compiled else find_loss

    def update() -> None:
        with torch.autocast("cpu", torch.bfloat16, enabled=variant.bfloat16):
            loss = find(rows)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()

    return update


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batch", type=int, default=BASE.batch)
    parser.add_argument("--repeats", type=int, default=15)
    options = parser.parse_args()
    torch.set_num_threads(1)
    factor = options.batch / BASE.batch
    variants = {
        name: replace(one, batch=round(one.batch * factor)) for name, one in VARIANTS.items()
    }
    spec = GAMES["deep_line_wars"].make_spec(GAMES["deep_line_wars"].scenario("10x15"))
    seen = spec.representations["planes"].shape, spec.num_actions
    updates = {name: make_update(one, *seen) for name, one in variants.items()}
    best = best_in_turns(updates, options.repeats, warm_up=2)  # the first ones compile
    print(f"| change | ms for {options.batch} rows | times as fast |")
    print("|---|---|---|")
    each = {name: best[name] * options.batch / one.batch for name, one in variants.items()}
    for name, seconds in each.items():
        print(f"| {name} | {1e3 * seconds:.1f} | {each['the update'] / seconds:.2f} |")


if __name__ == "__main__":
    main()
