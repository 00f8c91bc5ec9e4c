"""The pictures of scenarios in the documentation, drawn anew by `python docs/pictures.py [game]`.

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
from marl_cair.lookup import find_by_name

matplotlib.use("Agg")
from matplotlib import pyplot as plt  # without a screen

IMAGES = Path(__file__).parent / "images"


class Scene(NamedTuple):
    """Who plays what for how long, and who looks."""

    scenario: str
    bots: tuple[str, ...]  # of the seats
    decisions: int
    seat: int | None = None  # None: the spectator


DEEP_RTS = (
    Scene("1v1-15x15", ("turtle", "rusher"), 260),
    Scene("FFA-6-31x31", ("mixed", "rusher", "boomer", "archers", "turtle", "economist"), 420),
    Scene("Skirmish-31x31-fog", ("rusher", "archers"), 45, 0),
    Scene("LavaMaze-31x31", ("economist",), 60),
    Scene("Economy-15x15", ("economist",), 400),
    Scene("Teams-2v2-31x31", ("archers", "rusher", "turtle", "mixed"), 380),
)


DEEP_MAZE = (
    Scene("25x25-stochastic", ("oracle",), 9),
    Scene("25x25-square", ("oracle",), 45, 0),
    Scene("15x15-line_of_sight", ("wall_follower",), 32, 0),
    Scene("25x25-loops", ("wall_follower",), 20),
    Scene("15x15-race-4p", ("oracle", "wall_follower", "random", "oracle"), 4),
    Scene("15x15-chase-4p", ("oracle", "oracle", "oracle", "wall_follower"), 3),
)
GALLERIES = {  # of each game: its scenes, the inches of the whole, and where it is kept
    "deep_rts": (DEEP_RTS, (15, 10.6), "deep_rts.png"),
    "deep_maze": (DEEP_MAZE, (15, 8.2), "deep_maze.png"),
}


def play(scene: Scene, game: str) -> BatchedEngine:
    """The scene's world after its decisions, or at its end."""
    engine = make_engine(game, scene.scenario)
    agents = [engine.game.bot(name, engine.scenario) for name in scene.bots]
    for seat, agent in enumerate(agents):
        agent.seed(seat)
    engine.reset(0)
    for _ in range(scene.decisions):
        seen, mask = engine.observe("planes"), engine.action_mask()
        chosen = [agent.act(seen[:, seat], mask[:, seat])[0] for seat, agent in enumerate(agents)]
        engine.step(np.array([chosen]))
        if engine.terminated[0] or engine.truncated[0]:
            break
    return engine


def show(scene: Scene, game: str) -> NDArray[np.uint8]:
    """The picture of a scene."""
    return play(scene, game).render(0, scene.seat)


def draw_gallery(game: str) -> None:
    """Draw all scenes of a game side by side."""
    scenes, inches, file = find_by_name("gallery", game, GALLERIES)
    figure, axes = plt.subplots(2, 3, figsize=inches, layout="constrained")
    for axis, scene in zip(axes.flat, scenes, strict=True):
        axis.imshow(show(scene, game), interpolation="none")
        axis.set_title(scene.scenario, fontsize=15)
        axis.axis("off")
    figure.savefig(IMAGES / file, dpi=90)
    plt.close(figure)


def main() -> None:
    """Draw the pictures of the named games, or of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("games", nargs="*", help=f"of {', '.join(GALLERIES)} (default: all)")
    for game in parser.parse_args().games or GALLERIES:
        draw_gallery(game)


if __name__ == "__main__":
    main()
