"""How parameters, memory and time of an update grow with the input and the number of actions.

    python -m benchmarks.capsule_scaling [--bodies conv ...] [--batch 16] [--out docs/images]

For the bodies `conv`, `capsule` and `thesis_capsule`: images of one plane of side 16 to 84 with 16
actions, and 2 to 300 actions at side 28. An update is that of double Q-learning on random numbers:
values of a batch, the target network's values, Huber loss, gradients, Adam, and the average of the
weights. Each case runs in a process of its own with one thread:

- parameters: of one network;
- memory, estimated: `marl_cair.training.memory.count_update_bytes`, without running anything;
- memory, measured: the largest resident memory (VmHWM, Linux) less what the process had before it
  made the networks;
- time: processor seconds of the fastest of a few updates, after one that is not counted.

A case that is estimated to need more than --max-gigabytes is not run. Prints a Markdown table, and
writes `capsule_scaling.csv` and `capsule_scaling.png` to --out; cases that are in the CSV file
already are not run again.
"""

from __future__ import annotations

import argparse
import copy
import csv
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator

from marl_cair.files import atomic_path

BODIES = "conv", "capsule", "thesis_capsule"
SIDES, FIXED_ACTIONS = (16, 28, 42, 63, 84), 16
ACTIONS, FIXED_SIDE = (2, 4, 16, 64, 300), 28
MAX_UPDATES, ENOUGH_SECONDS = 10, 3.0
COLOURS = {"conv": "#0072B2", "capsule": "#009E73", "thesis_capsule": "#D55E00"}
MARKERS = {"conv": "o", "capsule": "s", "thesis_capsule": "^"}


class Case(NamedTuple):
    """A network on images of one plane."""

    body: str
    side: int
    num_actions: int
    batch: int


class Cost(NamedTuple):
    """What an update costs; None where it was not run."""

    parameters: int
    estimated_mb: float
    measured_mb: float | None
    seconds: float | None


def list_cases(bodies: tuple[str, ...], batch: int) -> list[Case]:
    """All cases, the cheap ones first."""
    pairs = {(side, FIXED_ACTIONS) for side in SIDES} | {(FIXED_SIDE, count) for count in ACTIONS}
    return [Case(body, *pair, batch) for body in bodies for pair in sorted(pairs)]


def estimate(case: Case) -> Cost:
    """Parameters and estimated memory."""
    from benchmarks._networks import read_preset
    from marl_cair.checkpoint import count_weight_bytes
    from marl_cair.training.memory import count_update_bytes

    shape, config = (1, case.side, case.side), read_preset(case.body)
    parameters = count_weight_bytes(config, shape, case.num_actions) // 4
    num_bytes = count_update_bytes(config, shape, case.num_actions, case.batch)
    return Cost(parameters, num_bytes / 1e6, None, None)


def measure(case: Case) -> tuple[float, float]:
    """Megabytes and seconds of updates in this process."""
    import torch

    torch.set_num_threads(1)
    make_update(Case("conv", 8, 2, 1))()  # loads the libraries that every update needs
    before = read_status("VmRSS")
    Path("/proc/self/clear_refs").write_text("5", "ascii")  # forgets the largest memory so far
    update = make_update(case)
    update()
    seconds: list[float] = []
    while len(seconds) < MAX_UPDATES and sum(seconds) < ENOUGH_SECONDS:
        start = time.process_time()
        update()
        seconds.append(time.process_time() - start)
    return (read_status("VmHWM") - before) / 1e6, min(seconds)


def make_update(case: Case) -> Callable[[], None]:
    """Return a function that does one update."""
    import torch
    from torch.nn import functional

    from benchmarks._networks import read_preset
    from marl_cair.policies.q_network import make_q_network

    network = make_q_network(read_preset(case.body), (1, case.side, case.side), case.num_actions, 0)
    target, average = copy.deepcopy(network), copy.deepcopy(network)
    optimiser = torch.optim.Adam(network.parameters())
    shape = case.batch, 1, case.side, case.side
    seen, then = torch.randint(0, 256, (2, *shape), dtype=torch.uint8)
    actions = torch.randint(case.num_actions, (case.batch, 1))
    rewards = torch.rand(case.batch, 1)

    def update() -> None:
        with torch.no_grad():
            best = network(then).argmax(1, keepdim=True)
            wanted = rewards + 0.99 * target(then).gather(1, best)
        loss = functional.smooth_l1_loss(network(seen).gather(1, actions), wanted)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        with torch.no_grad():
            for mean, weight in zip(average.parameters(), network.parameters(), strict=True):
                mean.lerp_(weight, 0.01)

    return update


def read_status(name: str) -> int:
    """Bytes that Linux reports of this process."""
    for line in Path("/proc/self/status").read_text("ascii").splitlines():
        if line.startswith(f"{name}:"):
            return 1024 * int(line.split()[1])
    raise OSError(f"/proc/self/status has no {name}: measure on Linux")


def run(case: Case, max_gigabytes: float) -> Cost:
    """Cost of a case, measured in a process of its own."""
    cost = estimate(case)
    if cost.estimated_mb > 1e3 * max_gigabytes:
        return cost
    command = [sys.executable, "-m", "benchmarks.capsule_scaling", "--one", json.dumps(case)]
    root = Path(__file__).parents[1]
    done = subprocess.run(command, cwd=root, check=True, stdout=subprocess.PIPE, text=True)
    megabytes, seconds = json.loads(done.stdout)
    return cost._replace(measured_mb=megabytes, seconds=seconds)


def read_costs(path: Path) -> dict[Case, Cost]:
    """Costs of an earlier run."""
    if not path.exists():
        return {}
    costs = {}
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            case = Case(row["body"], *(int(row[name]) for name in Case._fields[1:]))
            numbers = [float(row[name]) if row[name] else None for name in Cost._fields[1:]]
            costs[case] = Cost(int(row["parameters"]), *numbers)  # type: ignore[arg-type]
    return costs


def write_costs(costs: dict[Case, Cost], path: Path) -> None:
    """Write what `read_costs` reads."""
    with (
        atomic_path(path) as unfinished,
        unfinished.open("w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*Case._fields, *Cost._fields])
        for case, cost in costs.items():
            rest = [None if value is None else f"{value:.4g}" for value in cost[1:]]
            writer.writerow([*case, cost.parameters, *rest])


def format_table(costs: dict[Case, Cost]) -> str:
    """Return a Markdown table."""
    lines = [
        "| body | image | actions | parameters | memory, estimated | measured | update |",
        "|---|---|---|---|---|---|---|",
    ]
    for case, cost in costs.items():
        size = f"| `{case.body}` | {case.side} x {case.side} | {case.num_actions} "
        memory = f"| {cost.estimated_mb:,.0f} MB | {_show(cost.measured_mb, 1, 'MB')} "
        time_of_one = _show(cost.seconds, 1e3, "ms")
        lines.append(f"{size}| {cost.parameters:,} {memory}| {time_of_one} |")
    return "\n".join(lines)


def _show(value: float | None, factor: float, unit: str) -> str:
    return "not run" if value is None else f"{factor * value:,.0f} {unit}"


def draw(costs: dict[Case, Cost], path: Path) -> None:
    """Write a picture: a column each for input and actions, a row each for three costs."""
    figure = Figure(figsize=(7.6, 8.4), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(3, 2, sharex="col", sharey="row")
    columns: list[tuple[str, tuple[int, ...], Callable[[Case], bool], str]] = [
        (
            "side",
            SIDES,
            lambda case: case.num_actions == FIXED_ACTIONS,
            "side of the image, pixels",
        ),
        ("num_actions", ACTIONS, lambda case: case.side == FIXED_SIDE, "actions"),
    ]
    titles = f"{FIXED_ACTIONS} actions", f"images of {FIXED_SIDE} x {FIXED_SIDE}"
    for column, (axis, ticks, belongs, label) in enumerate(columns):
        for body in dict.fromkeys(case.body for case in costs):
            rows = sorted(
                (getattr(case, axis), cost)
                for case, cost in costs.items()
                if case.body == body and belongs(case)
            )
            _draw_body(panels[:, column], body, rows)
        panels[0, column].set_title(titles[column], fontsize=11)
        panels[2, column].set(xlabel=label, xscale="log")
        panels[2, column].xaxis.set_major_locator(FixedLocator(ticks))
        panels[2, column].xaxis.set_minor_locator(NullLocator())
        panels[2, column].xaxis.set_minor_formatter(NullFormatter())
        panels[2, column].set_xticklabels(map(str, ticks))
    for panel, label in zip(
        panels[:, 0], ("parameters", "memory of an update, MB", "processor time, s"), strict=True
    ):
        panel.set_ylabel(label)
    for panel in panels.flat:
        panel.set_yscale("log")
        panel.grid(alpha=0.25)
        panel.spines[["top", "right"]].set_visible(False)
    panels[0, 0].legend(frameon=False, fontsize=9)
    panels[1, 0].plot([], [], "k--", linewidth=1, label="estimated")
    panels[1, 0].plot([], [], "k-", marker="o", markersize=5, linewidth=1.5, label="measured")
    handles = [line for line in panels[1, 0].lines if not line.get_label().startswith("_")]
    panels[1, 0].legend(handles=handles, frameon=False, fontsize=9)
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished)


def _draw_body(panels: Any, body: str, rows: list[tuple[int, Cost]]) -> None:
    places = [place for place, _ in rows]
    style: dict[str, Any] = {"color": COLOURS[body], "marker": MARKERS[body], "markersize": 5}
    panels[0].plot(places, [cost.parameters for _, cost in rows], label=body, **style)
    panels[1].plot(
        places, [c.estimated_mb for _, c in rows], "--", linewidth=1, color=COLOURS[body]
    )
    for panel, name in zip(panels[1:], ("measured_mb", "seconds"), strict=True):
        known = [(place, getattr(c, name)) for place, c in rows if getattr(c, name) is not None]
        panel.plot(*zip(*known, strict=True), **style)


def main() -> None:
    """Print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--bodies", nargs="+", choices=BODIES, default=BODIES)
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--max-gigabytes", type=float, default=8.0)
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    parser.add_argument("--one", help=argparse.SUPPRESS)  # a process of its own
    words = parser.parse_args()
    if words.one:
        print(json.dumps(measure(Case(*json.loads(words.one)))))
        return
    path = words.out / "capsule_scaling.csv"
    known, costs = read_costs(path), {}
    for case in list_cases(tuple(words.bodies), words.batch):
        costs[case] = known.get(case) or run(case, words.max_gigabytes)
        write_costs(costs | {old: known[old] for old in known if old not in costs}, path)
        print(*case, *costs[case], file=sys.stderr, flush=True)
    print(format_table(costs))
    draw(costs, words.out / "capsule_scaling.png")


if __name__ == "__main__":
    main()
