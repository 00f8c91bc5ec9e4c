"""Draws the pictures of docs/play.md: `python docs/play_pictures.py`."""

from __future__ import annotations

import os
from pathlib import Path

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import pygame

from marl_cair import load_agent
from marl_cair.games import GAMES
from marl_cair.games.game import Agent
from marl_cair.window.session import Session
from marl_cair.window.window import Window

ROOT = Path(__file__).resolve().parents[1]
SIZE = (1280, 800)
# Picture -> game, scenario, players by seat ("": a person), steps, and keys before and after them.
PICTURES: dict[str, tuple[str, str, tuple[str, ...], int, str, str]] = {
    "play_line_wars": ("deep_line_wars", "10x15", ("", "counter"), 260, "2255", "5"),
    "play_deep_rts": ("deep_rts", "1v1-15x15-fog", ("", "mixed"), 300, "u", "u"),
    "play_menu": ("deep_maze", "9x9-stochastic", ("",), 0, "", "g"),
    "watch_agents": (
        *("deep_line_wars", "10x15", (str(ROOT / "agents/deep_line_wars_10x15"), "counter")),
        *(900, "", ""),
    ),
    "watch_six": ("deep_rts", "FFA-6-31x31", ("mixed",) * 6, 2_000, "", ""),
}


def main() -> None:
    """Write all pictures to docs/images."""
    pygame.display.init()
    for name, (game, scenario, players, steps, before, after) in PICTURES.items():
        chosen = GAMES[game].scenario(scenario)
        agents: list[Agent | None] = [
            load_agent(source, game, chosen) if source else None for source in players
        ]
        session = Session(GAMES[game], chosen, agents)
        window = Window(session, pygame.Surface(SIZE), threaded=False)
        window.draw()
        for key in before:
            window.press(ord(key))
        for _ in range(steps):
            window.step()
        for key in after:
            window.press(ord(key))
        window.scene.draw()
        pygame.image.save(window.surface, ROOT / f"docs/images/{name}.png")


if __name__ == "__main__":
    main()
