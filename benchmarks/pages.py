"""How fast games run and draw in a browser, and how fast the viewer of replays draws.

    python -m benchmarks.pages [--games deep_line_wars deep_maze flappy_bird] [--seconds 3]

Prints two Markdown tables. Games: steps of the rules in a second without drawing, how many times
faster than the game's own time that is, and drawn pictures in a second; bots play. Viewer: steps in
a second with all that a step draws. Needs chromium and the extra `dev`.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Page, sync_playwright

from marl_cair.browser.folder import PAGE_FILE, Opponent, write_folder
from marl_cair.games import GAMES
from marl_cair.league.play.match import record_game
from marl_cair.viewer.page import write_viewer

STEP = """async (seconds) => {
  const { rules, game: { opponent } } = globalThis.play;
  let steps = 0, spent = 0;
  for (let seed = 0; spent < 1000 * seconds; seed++)
    for (rules.reset(seed), rules.arrays.random[0] = BigInt(seed); !rules.isOver; steps++) {
      rules.legalActions(0);
      rules.observe(opponent.representation, 0);
      rules.run("decide");
      const chosen = Array.from(rules.arrays.decisions, Number), before = performance.now();
      rules.step(chosen);
      spent += performance.now() - before;
    }
  return 1000 * steps / spent;
}"""
DRAW = """(seconds) => {
  const { play } = globalThis, begun = performance.now();
  let pictures = 0;
  for (play.rules.reset(3); performance.now() - begun < 1000 * seconds; pictures++)
    play.draw(...play.rules.observeBoard(0));
  return 1000 * pictures / (performance.now() - begun);
}"""
SEEK = """(seconds) => {
  const slider = document.querySelector(".mc-line input"), begun = performance.now();
  let steps = 0;
  for (; performance.now() - begun < 1000 * seconds; steps++) {
    slider.value = steps % (Number(slider.max) + 1);
    slider.dispatchEvent(new Event("input"));
    document.body.offsetHeight;  // lays the page out
  }
  return 1000 * steps / (performance.now() - begun);
}"""


def measure_game(page: Page, name: str, folder: Path, seconds: float) -> str:
    """A row of the first table."""
    game = GAMES[name]
    scenario, bot = game.scenario(), [*game.bots][-1]
    write_folder(folder, game, game.default_scenario, scenario, Opponent(bot, bot=bot))
    spec = game.make_spec(scenario)
    page.goto((folder / PAGE_FILE).as_uri())
    page.locator("#start:enabled").wait_for(timeout=60_000)
    rate, pictures = (page.evaluate(code, seconds) for code in (STEP, DRAW))
    ratio = rate * spec.ticks_per_step / spec.ticks_per_second
    return f"| {name} | {rate:,.0f} | {ratio:,.0f} | {pictures:.0f} |"


def measure_viewer(page: Page, folder: Path, seconds: float) -> str:
    """A row of the second table: the spectator's view of a game of two bots."""
    game = GAMES["deep_rts"]
    scenario = game.scenario("1v1-15x15")
    bots = game.bot("mixed", scenario), game.bot("rusher", scenario)
    replay = record_game(*bots, game, scenario, 0)
    write_viewer(folder / "game.html", replay, views=[None])
    page.goto((folder / "game.html").as_uri())
    page.locator(".mc-line input").wait_for()
    rate = page.evaluate(SEEK, seconds)
    return f"| deep_rts 1v1-15x15, {len(replay.actions)} steps | {rate:.0f} |"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = ["deep_line_wars", "deep_maze", "flappy_bird"]
    parser.add_argument("--games", nargs="*", default=names, metavar="GAME")
    parser.add_argument("--seconds", type=float, default=3.0)
    words = parser.parse_args()
    with sync_playwright() as started, TemporaryDirectory() as place:
        # Debian's sandbox needs rights that a container does not give; the pages are our own.
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        print("| game | steps/s | times its own time | pictures/s |\n|---|---|---|---|")
        for name in words.games:
            page = browser.new_page()
            print(measure_game(page, name, Path(place) / name, words.seconds), flush=True)
            page.close()
        print("\n| viewer | steps/s |\n|---|---|")
        print(measure_viewer(browser.new_page(), Path(place), words.seconds))
        browser.close()


if __name__ == "__main__":
    main()
