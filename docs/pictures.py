"""The pictures of scenarios in the documentation, drawn anew by `python docs/pictures.py`
(`--game flappy_bird` draws that game's alone).

Bots play, seeded; each picture is what a spectator or one seat sees after so many decisions.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray

from marl_cair.games import make_engine
from marl_cair.games.engine import BatchedEngine

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # without a screen

IMAGES = Path(__file__).parent / "images"


class Scene(NamedTuple):
    """Who plays what for how long, and who looks."""

    scenario: str
    bots: tuple[str, ...]  # of the seats
    decisions: int
    seat: int | None = None  # None: the spectator
    representation: str | None = None  # what the seat observes, in place of the picture
    seed: int = 0


DEEP_RTS = (
    Scene("1v1-15x15", ("turtle", "rusher"), 260),
    Scene("FFA-6-31x31", ("mixed", "rusher", "boomer", "archers", "turtle", "economist"), 420),
    Scene("Skirmish-31x31-fog", ("rusher", "archers"), 45, 0),
    Scene("LavaMaze-31x31", ("economist",), 60),
    Scene("Economy-15x15", ("economist",), 400),
    Scene("Teams-2v2-31x31", ("archers", "rusher", "turtle", "mixed"), 380),
)

FLAPPY_BIRD = (
    Scene("classic", ("oracle",), 262),
    Scene("hard", ("oracle",), 124),
    Scene("storm", ("oracle",), 138, seed=3),
    Scene("race-8", ("oracle", *["random"] * 7), 42, seed=5),
    Scene("classic", ("oracle",), 262, 0, "gray"),
)


class Sheet(NamedTuple):
    """Scenes of a game side by side."""

    scenes: tuple[Scene, ...]
    file: str
    rows: int
    size: tuple[float, float]  # inches


SHEETS = {
    "deep_rts": Sheet(DEEP_RTS, "deep_rts_scenarios.png", 2, (15, 10.6)),
    "flappy_bird": Sheet(FLAPPY_BIRD, "flappy_bird_scenarios.png", 1, (15, 5.8)),
}


def play(scene: Scene, game: str = "deep_rts") -> BatchedEngine:
    """The scene's world after its decisions, or at its end."""
    engine = make_engine(game, scene.scenario)
    agents = [engine.game.bot(name, engine.scenario) for name in scene.bots]
    for seat, agent in enumerate(agents):
        agent.seed(seat)
    engine.reset(scene.seed)
    names = {agent.representation for agent in agents}
    for _ in range(scene.decisions):
        seen, mask = {name: engine.observe(name) for name in names}, engine.action_mask()
        chosen = [
            agent.act(seen[agent.representation][:, seat], mask[:, seat])[0]
            for seat, agent in enumerate(agents)
        ]
        engine.step(np.array([chosen]))
        if engine.terminated[0] or engine.truncated[0]:
            break
    return engine


def show(scene: Scene, game: str = "deep_rts") -> NDArray[np.uint8]:
    """The picture of a scene."""
    engine = play(scene, game)
    if scene.representation is None:
        return engine.render(0, scene.seat)
    return engine.observe(scene.representation)[0, scene.seat or 0, 0]


def draw_sheet(game: str, sheet: Sheet, out: Path) -> None:
    """Draw a game's scenes side by side."""
    columns = len(sheet.scenes) // sheet.rows
    figure, axes = plt.subplots(sheet.rows, columns, figsize=sheet.size, layout="constrained")
    for axis, scene in zip(axes.flat, sheet.scenes, strict=True):
        picture = show(scene, game)
        aspect = "equal" if scene.representation is None else 512 / 288  # shown as it was shrunk
        axis.imshow(picture, interpolation="none", aspect=aspect, cmap="gray", vmin=0, vmax=255)
        axis.set_title(scene.representation or scene.scenario, fontsize=15)
        axis.axis("off")
    figure.savefig(out, dpi=90)


def main() -> None:
    """Draw all sheets, or one game's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", choices=SHEETS, help="draw that game's alone")
    parser.add_argument("--out", type=Path, default=IMAGES, help="folder")
    options = parser.parse_args()
    for game, sheet in SHEETS.items():
        if options.game in (None, game):
            draw_sheet(game, sheet, options.out / sheet.file)


if __name__ == "__main__":
    main()
