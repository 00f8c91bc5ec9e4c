"""Draws the parts of the Q-networks, with their sizes: `python docs/network_diagrams.py`.

Writes one picture for each part into docs/images/networks.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib

matplotlib.use("svg")
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from marl_cair.policies.conv import SMALL_BOARD

FOLDER = Path(__file__).parent / "images" / "networks"
WIDTH, HEIGHT, GAP = 1.75, 0.85, 0.4  # of a box and between two, in inches
INPUT, LEARNED, ROUTED, OUTPUT = "#eceff1", "#bbdefb", "#ffe0b2", "#c8e6c9"


class Box(NamedTuple):
    """A step of a network, and what leaves it."""

    name: str
    leaves: str
    colour: str = LEARNED


PLANES = Box("planes", "C x H x W", INPUT)
FEATURES = Box("features", "F", INPUT)
CONVOLUTIONS = tuple(
    Box(
        f"convolution {layer.kernel}x{layer.kernel}, stride {layer.stride}",
        f"{layer.channels} planes",
    )
    for layer in SMALL_BOARD
)
DENSE = Box("dense", "F features", OUTPUT)
BOARD = Box("planes, features", "C x H x W, F", INPUT)
PARTS: dict[str, tuple[Box, ...]] = {
    "conv": (PLANES, *CONVOLUTIONS, DENSE),
    "capsule": (
        PLANES,
        Box("two convolutions", "32 planes"),
        Box("part capsules", "8 types x 8 numbers\nin each cell"),
        Box("mean by presence", "on a grid of 5 x 5", ROUTED),
        Box("routing, 2 passes", "8 entities x 16 numbers", ROUTED),
        Box("dense", "F features from\nposes and presences", OUTPUT),
    ),
    "mlp": (Box("vector", "V numbers", INPUT), Box("dense", "F"), Box("dense", "F", OUTPUT)),
    "residual": (
        PLANES,
        Box("convolution 3x3,\nmax-pooling", "16, 32, 32 planes"),
        Box("2 x (x + two\nconvolutions)", "same planes\n(3 such stages)"),
        DENSE,
    ),
    "thesis_capsule": (
        PLANES,
        Box("convolution 9x9", "256 planes"),
        Box("primary capsules\n9x9, stride 2", "32 types x 8 numbers\nin each cell"),
        Box("dynamic routing,\n3 passes", "A capsules x 16", ROUTED),
        Box("length", "A values", OUTPUT),
    ),
    "thesis_conv": (
        PLANES,
        Box("three convolutions\n1x1", "32 planes"),
        Box("dense", "512 features", OUTPUT),
    ),
    "lstm": (
        FEATURES,
        Box("LSTM cell", "h and c, W numbers\neach: the state", ROUTED),
        Box("h", "W features", OUTPUT),
    ),
    "gru": (
        FEATURES,
        Box("GRU cell", "h, W numbers:\nthe state", ROUTED),
        Box("h", "W features", OUTPUT),
    ),
    "distances": (
        PLANES,
        Box("convolution 1x1, exp", "cost of each cell"),
        Box("cheapest paths", "C planes of nearness,\nfor the body too", ROUTED),
        Box("attention, dense", "F features, added\nto the body's", OUTPUT),
    ),
    "plain": (FEATURES, Box("dense", "A values", OUTPUT)),
    "length": (
        Box("primary capsules", "I x 8 numbers", INPUT),
        Box("dynamic routing,\n3 passes", "A capsules x 16", ROUTED),
        Box("length", "A values", OUTPUT),
    ),
    "quantile": (
        FEATURES,
        Box("dense, dueling", "A x K quantiles"),
        Box("mean over K", "A values", OUTPUT),
    ),
}
# Two branches between the first and the last box.
BRANCHES: dict[str, tuple[Box, Box, Box, Box]] = {
    "dueling": (
        FEATURES,
        Box("dense", "V, one number"),
        Box("dense (of rank r)", "A advantages"),
        Box("V + A - mean A", "A values", OUTPUT),
    ),
    "naf": (
        FEATURES,
        Box("dense", "V, one number"),
        Box("dense", "mu, 3 numbers\nL, 6 numbers"),
        Box("$V - |L^T (u - \\mu)|^2 / 2$", "A values", OUTPUT),
    ),
    "grid": (
        BOARD,
        Box("dense (features)", "V, one number"),
        Box("two convolutions 3x3,\ndense, 1x1", "A advantages in each cell"),
        Box("V + A - mean A", "A values in each cell", OUTPUT),
    ),
    "cell_values": (
        BOARD,
        Box("head (features)", "A values"),
        Box("two convolutions 3x3,\ndense, 1x1", "K values in each cell,\none of each kind"),
        Box("sum", "A values", OUTPUT),
    ),
    "noisy": (
        Box("inputs", "x", INPUT),
        Box("dense", "W x + b"),
        Box("dense, times noise", "of learned size: S, s", ROUTED),
        Box("sum", "y", OUTPUT),
    ),
}


def draw_box(axes: Any, box: Box, x: float, y: float) -> None:
    """Draw a box with its lower left corner at (x, y)."""
    axes.add_patch(
        FancyBboxPatch(
            (x, y),
            WIDTH,
            HEIGHT,
            "round,pad=0,rounding_size=0.08",
            fc=box.colour,
            ec="0.35",
            lw=0.9,
        )
    )
    axes.text(x + WIDTH / 2, y + 0.61 * HEIGHT, box.name, ha="center", va="center", fontsize=8.5)
    axes.text(
        x + WIDTH / 2,
        y + 0.22 * HEIGHT,
        box.leaves,
        ha="center",
        va="center",
        fontsize=7,
        color="0.3",
    )


def draw_arrow(axes: Any, start: tuple[float, float], end: tuple[float, float]) -> None:
    """Draw an arrow between two points."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "0.35", "lw": 1.0})


def open_figure(columns: int, rows: int) -> tuple[Figure, Any]:
    """A figure for so many boxes, and its axes in inches."""
    width, height = columns * (WIDTH + GAP) - GAP + 0.2, rows * (HEIGHT + 0.3) - 0.3 + 0.2
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-0.1, width - 0.1), ylim=(-0.1, height - 0.1))
    axes.axis("off")
    return figure, axes


def main() -> None:
    """Draw all parts."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    step, middle = WIDTH + GAP, HEIGHT / 2
    figures = {}
    for name, boxes in PARTS.items():
        figures[name], axes = open_figure(len(boxes), 1)
        for place, box in enumerate(boxes):
            draw_box(axes, box, place * step, 0.0)
            if place:
                draw_arrow(axes, (place * step - GAP, middle), (place * step, middle))
    for name, (first, upper, lower, last) in BRANCHES.items():
        figures[name], axes = open_figure(3, 2)
        between = (HEIGHT + 0.3) / 2
        draw_box(axes, first, 0.0, between)
        draw_box(axes, last, 2 * step, between)
        for box, y in ((upper, 2 * between), (lower, 0.0)):
            draw_box(axes, box, step, y)
            draw_arrow(axes, (WIDTH, between + middle), (step, y + middle))
            draw_arrow(axes, (step + WIDTH, y + middle), (2 * step, between + middle))
    matplotlib.rcParams["svg.hashsalt"] = "marl_cair"  # the same bits at each run
    for name, figure in figures.items():
        figure.savefig(FOLDER / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
