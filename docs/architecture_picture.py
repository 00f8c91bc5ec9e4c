"""Draws the rooms of the package and their imports: `python docs/architecture_picture.py`.

Reads the imports of every file with `ast`. Writes docs/images/architecture.svg.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import matplotlib

matplotlib.use("svg")
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "marl_cair"
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
# Rooms from the top layer to the bottom one; files beside the rooms are left out.
LAYERS = (
    ("cli",),
    ("training.population", "experiments", "dashboard"),
    ("training",),
    ("training.collecting", "league"),
    ("training.settings", "league.report", "window"),
    ("self_play", "league.play"),
    ("league.agents", "league.ratings", "browser"),
    ("league.store", "generative", "viewer"),
    ("games", "policies", "replay"),
)
ROOMS = tuple(room for layer in LAYERS for room in layer)
WIDTH, HEIGHT, GAP = 2.6, 0.5, 0.5


class Room(NamedTuple):
    """One room: its number of files and the rooms that it imports."""

    num_files: int
    imports: frozenset[str]


def room_of(module: str) -> str | None:
    """The room of a module of marl_cair, or None for a file beside the rooms."""
    parts = module.split(".")[1:]
    return next((r for n in (2, 1) if (r := ".".join(parts[:n])) in ROOMS), None)


def read_rooms() -> dict[str, Room]:
    """All rooms, read from the files."""
    files: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        room = room_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
        if room is not None:
            files[room].append(path)
    rooms = {}
    for room in ROOMS:
        texts = [path.read_text("utf-8") for path in files[room]]
        imported = {target for text in texts for target in find_imports(ast.parse(text))}
        rooms[room] = Room(len(texts), frozenset(imported - {room}))
    return rooms


def find_imports(tree: ast.Module) -> set[str]:
    """Rooms that a file imports, also inside functions and for types."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    mine = {name for name in names if name.startswith("marl_cair.")}
    return {room for name in mine if (room := room_of(name)) is not None}


def reduce_edges(rooms: dict[str, Room]) -> list[tuple[str, str]]:
    """Imports that no chain of other imports implies: what the picture draws."""

    def reach(start: str, without: str) -> set[str]:
        found: set[str] = set()
        waiting = [room for room in rooms[start].imports if room != without]
        while waiting:
            room = waiting.pop()
            if room not in found:
                found.add(room)
                waiting += rooms[room].imports
        return found

    return [
        (room, target)
        for room in ROOMS
        for target in sorted(rooms[room].imports)
        if target not in reach(room, target)
    ]


def describe(rooms: dict[str, Room]) -> str:
    """The arrows in words; the picture holds them, so that a test can compare."""
    return "; ".join(f"{room} imports {target}" for room, target in reduce_edges(rooms))


def place(layer: int, column: int) -> tuple[float, float]:
    """The middle of a box."""
    size = len(LAYERS[layer])
    x = (column - (size - 1) / 2) * (WIDTH + 0.7)
    return x, -layer * (HEIGHT + GAP)


def draw(rooms: dict[str, Room]) -> None:
    """Write the picture."""
    middles = {
        room: place(layer, column)
        for layer, names in enumerate(LAYERS)
        for column, room in enumerate(names)
    }
    figure = Figure(figsize=(9, 7), layout="constrained")
    axes = figure.subplots()
    for room, (x, y) in middles.items():
        corner = x - WIDTH / 2, y - HEIGHT / 2
        box = FancyBboxPatch(corner, WIDTH, HEIGHT, "round,pad=0.02", zorder=3)
        box.set(facecolor="#e8eef7", edgecolor="#33507a")
        axes.add_patch(box)
        axes.text(x, y, room.replace(".", "/"), ha="center", va="center", fontsize=12, zorder=4)
    for room, target in reduce_edges(rooms):
        (x0, y0), (x1, y1) = middles[room], middles[target]
        bend = 0.0 if y0 - y1 < 1.5 * (HEIGHT + GAP) else (0.18 if x1 >= x0 else -0.18)
        arrow = {
            "arrowstyle": "-|>",
            "color": "#33507a",
            "connectionstyle": f"arc3,rad={bend}",
            "lw": 1.2,
        }
        ends = (x1, y1 + HEIGHT / 2 + 0.03), (x0, y0 - HEIGHT / 2 - 0.03)
        axes.annotate("", *ends, arrowprops=arrow, zorder=2)
    axes.set_xlim(-5, 5)
    axes.set_ylim(-(len(LAYERS) - 1) * (HEIGHT + GAP) - 0.6, 0.6)
    axes.axis("off")
    with matplotlib.rc_context({"svg.hashsalt": "marl_cair", "svg.fonttype": "none"}):
        figure.savefig(PICTURE, metadata={"Date": None, "Description": describe(rooms)})


if __name__ == "__main__":
    draw(read_rooms())
