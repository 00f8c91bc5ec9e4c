"""Games in a real Chromium: a page of each game, opened from disk, and what its console says."""

from contextlib import contextmanager

import pytest

from marl_cair.browser.folder import PAGE_FILE, Opponent, write_folder
from marl_cair.games import GAMES
from tests.chromium import browser, watched_page

__all__ = ["browser"]  # a fixture


@contextmanager
def open_page(browser, folder, width=1280, scheme="light", search=""):
    """A page whose game is ready to start; an error on its console fails the test."""
    with watched_page(browser, width, scheme, height=900) as page:
        page.goto((folder / PAGE_FILE).as_uri() + search)
        page.locator("#start:enabled, #start[hidden]").wait_for(state="attached", timeout=60_000)
        yield page


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    """A function from a game, and a scenario of it, to a folder against the game's last bot. The
    first use after a change of rules compiles for a minute or more.
    """
    made = {}

    def write(name, scenario=None):
        game = GAMES[name]
        if (name, scenario) not in made:
            made[name, scenario] = folder = tmp_path_factory.mktemp(name) / "page"
            opponent = Opponent([*game.bots][-1], bot=[*game.bots][-1])
            chosen = scenario or game.default_scenario
            write_folder(folder, game, chosen, game.scenario(chosen), opponent)
        return made[name, scenario]

    return write
