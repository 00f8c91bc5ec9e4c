"""Draws pictures of games that people play: `python -m docs.play_pictures [NAME ...]`.

They are those of docs/play.md and docs/browser.md. Needs chromium, and the extras `dev` and `play`.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import pygame
from PIL import Image

from docs.page_pictures import start_chromium
from docs.play_film import click, find_pixel
from marl_cair import load_agent
from marl_cair.browser.folder import PAGE_FILE
from marl_cair.cli.viewing.browser_play import write_game
from marl_cair.games import GAMES
from marl_cair.games.deep_rts.tables import ARCHER, CAVALRY, FOOTMAN
from marl_cair.games.game import Agent
from marl_cair.window.controls.rts import RtsControls
from marl_cair.window.session import Session
from marl_cair.window.window import Window

ROOT = Path(__file__).resolve().parents[1]
SIZE, SIX_SIZE = (1280, 800), (1280, 1000)  # of windows: all of a board of six fits
PACE_FPS, PACE_SECONDS = 60, 4
PAGE, PAGE_SIZE, NUM_COLOURS = "browser_play", (1280, 960), 128
BOARD_COLUMNS = 15  # of 10x15
SIX_BOTS = ("mixed", "rusher", "boomer", "archers", "turtle", "economist")
SOLDIERS = (FOOTMAN, ARCHER, CAVALRY)


def build_and_send(window: Window) -> None:
    """A person of Deep Line Wars who has towers and units, and chooses the next tower's cell."""
    window.press(ord("5"))
    for row in (1, 3, 6, 8):
        click(window, find_pixel(window, row * BOARD_COLUMNS + 4))
        window.step()
    window.press(ord("5"))
    for _ in range(430):
        window.step()
        if window.moment.numbers.resources["gold"][0] > 90:
            window.press(ord("2"))
    window.press(ord("6"))
    window.pointer = find_pixel(window, 4 * BOARD_COLUMNS + 5)


def send_soldiers(window: Window) -> None:
    """A person of Deep RTS, until now played by a bot, who sends all soldiers to fight."""
    session, control = window.session, window.controls[0]
    if not isinstance(control, RtsControls):
        raise TypeError(f"{control} gives no orders to units")
    bot = GAMES["deep_rts"].bot("mixed", session.scenario)
    for step in range(1_250):
        orders = {}
        if step % session.steps_per_decision == 0:
            seen = session.engine.observe(bot.representation)[:, 0]
            orders[0] = bot.act(seen.copy(), session.engine.action_mask()[:, 0])[0]
        session.advance(orders)
    window.shown["pause"] = False
    window.step()
    soldiers = [u for u in control.list_units(window.moment) if u.kind in SOLDIERS]
    control.select(soldiers)
    window.press(ord("a"))
    click(window, find_pixel(window, 10 * session.scenario.columns + 9))
    wait(window, 3 * len(soldiers))
    window.press(ord("a"))  # the next order


# Picture -> game, scenario, players by seat ("": a person), and what is done before it is taken.
PICTURES: dict[str, tuple[str, str, tuple[str, ...], Callable[[Window], object]]] = {
    "play_line_wars": ("deep_line_wars", "10x15", ("", "counter"), build_and_send),
    "play_deep_rts": ("deep_rts", "1v1-15x15-fog", ("", "rusher@0.3"), send_soldiers),
    "play_menu": ("deep_maze", "9x9-stochastic", ("",), lambda window: window.press(ord("g"))),
    "watch_agents": (
        *("deep_line_wars", "10x15", (str(ROOT / "agents/deep_line_wars_10x15"), "counter")),
        lambda window: wait(window, 900),
    ),
    "watch_six": (
        *("deep_rts", "FFA-6-31x31", SIX_BOTS),
        lambda window: wait(window, 2_000),
    ),
}


def main() -> None:
    """Write the named pictures to docs/images, or all."""
    names = sys.argv[1:] or [*PICTURES, PAGE]
    pygame.display.init()
    for name in names:
        if name == PAGE:
            with TemporaryDirectory() as folder:
                draw_page(Path(folder) / "page")
        else:
            draw_window(name)


def draw_window(name: str) -> None:
    """Write a picture of the window."""
    game, scenario, players, play = PICTURES[name]
    chosen = GAMES[game].scenario(scenario)
    agents: list[Agent | None] = [
        load_agent(source, game, chosen) if source else None for source in players
    ]
    surface = pygame.Surface(SIX_SIZE if players == SIX_BOTS else SIZE)
    window = Window(Session(GAMES[game], chosen, agents), surface)
    show_pace(window)
    play(window)
    window.scene.draw()
    pygame.image.save(window.surface, ROOT / f"docs/images/{name}.png")
    window.shut_down()


def show_pace(window: Window) -> None:
    """Run the window for some seconds, for its graphs of frames and ticks per second."""
    window.shown["pause"] = False
    clock = pygame.time.Clock()
    for _ in range(PACE_FPS * PACE_SECONDS):
        window.update(1 / PACE_FPS)
        window.draw()
        clock.tick(PACE_FPS)
    window.finish_job()


def wait(window: Window, steps: int) -> None:
    """Play some steps."""
    for _ in range(steps):
        window.step()


def draw_page(folder: Path) -> None:
    """Write the picture of a game against a trained agent in a browser."""
    write_game(folder, GAMES["deep_line_wars"], None, (), None)
    width, height = PAGE_SIZE
    with start_chromium() as browser:
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto((folder / PAGE_FILE).as_uri() + "?seed=5")
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
        image.quantize(NUM_COLOURS).save(ROOT / f"docs/images/{PAGE}.png", optimize=True)


if __name__ == "__main__":
    main()
