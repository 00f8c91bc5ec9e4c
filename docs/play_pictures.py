"""Draws the pictures of docs/play.md and docs/browser.md: `python docs/play_pictures.py`.

Needs chromium, and the extras `dev` and `play`.
"""

from __future__ import annotations

import io
import os
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import pygame
from PIL import Image
from playwright.sync_api import sync_playwright

from marl_cair import load_agent
from marl_cair.browser.serving import make_server
from marl_cair.cli.viewing.browser_play import write_game
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


PAGE_SIZE, NUM_COLOURS = (1280, 960), 128


def main() -> None:
    """Write all pictures to docs/images."""
    draw_windows()
    with TemporaryDirectory() as folder:
        draw_page(Path(folder) / "page")


def draw_windows() -> None:
    """Write the pictures of the window."""
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


def draw_page(folder: Path) -> None:
    """Write the picture of a game against a trained agent in a browser."""
    write_game(folder, GAMES["deep_line_wars"], None, (), None)
    width, height = PAGE_SIZE
    with make_server(folder) as server, sync_playwright() as started:
        Thread(target=server.serve_forever, daemon=True).start()
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(f"http://127.0.0.1:{server.server_port}/?seed=5")
        page.locator("#start:enabled").click()
        page.keyboard.press("p")
        for number in range(40):  # units, and a tower every ten steps
            page.keyboard.press("2")
            if number % 10 == 0:
                for key in ("5", "ArrowRight", "ArrowDown", "ArrowDown", "Enter", "Escape"):
                    page.keyboard.press(key)
            page.evaluate("play.stepOnce()")
        page.keyboard.press("6")
        image = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        image.quantize(NUM_COLOURS).save(ROOT / "docs/images/browser_play.png", optimize=True)
        browser.close()
        server.shutdown()


if __name__ == "__main__":
    main()
