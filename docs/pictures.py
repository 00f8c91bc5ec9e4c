"""Draws the pictures and films of scenarios in the documentation: `python docs/pictures.py [game]`.

Bots play, seeded; each picture is what a spectator or one seat sees after so many decisions.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray

from marl_cair.games import GAMES, make_engine
from marl_cair.games.engine import BatchedEngine
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.film import write_gif
from marl_cair.league.play.match import record_game
from marl_cair.lookup import find_by_name
from marl_cair.training.demo import film_win
from marl_cair.viewer.page import write_viewer
from marl_cair.viewer.values import add_values

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

    def describe(self) -> str:
        """The title of the picture."""
        players = f": {' v '.join(self.bots)}" if len(self.bots) == 2 else ""
        return self.representation or f"{self.scenario}{players}"


class Gallery(NamedTuple):
    """Scenes of a game side by side."""

    rows: int
    inches: tuple[float, float]
    scenes: tuple[Scene, ...]


GALLERIES = {
    "deep_line_wars": Gallery(
        1,
        (15, 6.2),
        (
            Scene("10x15", ("turtle", "rusher"), 90),
            Scene("10x15", ("counter", "zigzag"), 150),
        ),
    ),
    "deep_rts": Gallery(
        2,
        (15, 10.6),
        (
            Scene("1v1-15x15", ("turtle", "rusher"), 190),
            Scene(
                "FFA-6-31x31",
                ("mixed", "rusher", "boomer", "archers", "turtle", "economist"),
                300,
            ),
            Scene("Skirmish-31x31-fog", ("rusher", "archers"), 45, 0),
            Scene("LavaMaze-31x31", ("economist",), 60),
            Scene("Economy-15x15", ("economist",), 400),
            Scene("Teams-2v2-31x31", ("archers", "rusher", "turtle", "mixed"), 380),
        ),
    ),
    "deep_maze": Gallery(
        2,
        (15, 8.2),
        (
            Scene("25x25-stochastic", ("oracle",), 9),
            Scene("25x25-square", ("oracle",), 45, 0),
            Scene("15x15-line_of_sight", ("wall_follower",), 32, 0),
            Scene("25x25-loops", ("wall_follower",), 20),
            Scene("15x15-race-4p", ("oracle", "wall_follower", "random", "oracle"), 4),
            Scene("15x15-chase-4p", ("oracle", "oracle", "oracle", "wall_follower"), 3),
        ),
    ),
    "flappy_bird": Gallery(
        1,
        (15, 5.8),
        (
            Scene("classic", ("oracle",), 262),
            Scene("hard", ("oracle",), 124),
            Scene("storm", ("oracle",), 138, seed=3),
            Scene("race-8", ("oracle", *["random"] * 7), 42, seed=5),
            Scene("classic", ("oracle",), 262, 0, "gray"),
        ),
    ),
    "flash": Gallery(
        1,
        (15, 3.4),
        (
            Scene("multitask", ("juggler",), 70),
            Scene("multitask", ("juggler",), 455),
            Scene("duel", ("duelist", "random"), 42, seed=2),
            Scene("duel", ("duelist", "duelist"), 400),
        ),
    ),
}


class Film(NamedTuple):
    """Parts of a game, as numbers of decisions."""

    scene: Scene
    parts: tuple[range, ...]


FPS = 8  # of films: about as quick as the game
FILMS = {
    "deep_rts": (Film(Scene("1v1-15x15", ("mixed", "turtle"), 500, seed=1), (range(500),)),),
    "flash": (
        Film(
            Scene("multitask", ("agents/flash_multitask",), 1_000, seed=2),
            (range(50), range(190, 240), range(560, 620), range(930, 1_000)),
        ),
        Film(Scene("duel", ("agents/flash_duel", "duelist"), 300, seed=2), (range(300),)),
    ),
}


def play(scene: Scene, game: str) -> Iterator[BatchedEngine]:
    """The scene's world after each of its decisions, up to its end."""
    engine = make_engine(game, scene.scenario)
    agents = [load_agent(name, game, engine.scenario) for name in scene.bots]
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
        yield engine
        if engine.terminated[0] or engine.truncated[0]:
            break


def show(scene: Scene, game: str) -> NDArray[np.uint8]:
    """The picture of a scene."""
    *_, engine = play(scene, game)
    if scene.representation is None:
        return engine.render(0, scene.seat)
    seen: NDArray[np.uint8] = engine.observe(scene.representation)[0, scene.seat or 0, 0]
    return seen


def draw_gallery(game: str) -> None:
    """Draw all scenes of a game side by side."""
    gallery = find_by_name("gallery", game, GALLERIES)
    columns = len(gallery.scenes) // gallery.rows
    figure, axes = plt.subplots(
        gallery.rows, columns, figsize=gallery.inches, layout="constrained", squeeze=False
    )
    for axis, scene in zip(axes.flat, gallery.scenes, strict=True):
        # A square observation of a game that is taller is shown as it was before it was shrunk.
        shape: dict[str, Any] = {} if scene.representation is None else {"aspect": 512 / 288}
        axis.imshow(show(scene, game), interpolation="none", cmap="gray", vmin=0, vmax=255, **shape)
        axis.set_title(scene.describe(), fontsize=15)
        axis.axis("off")
    figure.savefig(IMAGES / f"{game}.png", dpi=90, bbox_inches="tight", pad_inches=0.05)
    plt.close(figure)


def draw_film(film: Film, game: str) -> None:
    """Draw every second decision of the parts of a film, as images/<scenario>.gif."""
    frames = (
        engine.render(0)
        for number, engine in enumerate(play(film.scene, game))
        if number % 2 == 0 and any(number in part for part in film.parts)
    )
    write_gif(IMAGES / f"{film.scene.scenario}.gif", frames, FPS)


def write_viewed_game(
    agent: str, opponent: str, game: str, scenario: str, seed: int, path: Path
) -> None:
    """Write a page that plays a game, with the action values of the agent in seat 0."""
    rules = GAMES[game]
    played = rules.scenario(scenario)
    first, second = load_agent(agent, game, played), load_agent(opponent, game, played)
    replay = record_game(first, second, rules, played, seed)
    write_viewer(path, add_values(replay, {0: first}))


def main() -> None:
    """Draw the pictures of the named games, or of all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("games", nargs="*", help=f"of {', '.join(GALLERIES)} (default: all)")
    for game in parser.parse_args().games or GALLERIES:
        draw_gallery(game)
        for film in FILMS.get(game, ()):
            draw_film(film, game)
        if game == "deep_line_wars":
            agent = str(IMAGES.parents[1] / "agents/deep_line_wars_10x15")
            film_win(agent, "counter", game, "10x15", 0, IMAGES / f"{game}.gif")
            write_viewed_game(agent, "counter", game, "10x15", 0, IMAGES / f"{game}.html")


if __name__ == "__main__":
    main()
