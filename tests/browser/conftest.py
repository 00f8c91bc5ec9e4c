"""Games in a real Chromium: a served folder of each game, and what the page's console says."""

from contextlib import contextmanager

import pytest

from marl_cair.browser.folder import Opponent, write_folder
from marl_cair.browser.serving import make_server
from marl_cair.games import GAMES
from tests.chromium import browser, serving, watched_page

__all__ = ["browser"]  # a fixture


def serve(folder):
    """The address at which a folder is served."""
    return serving(make_server(folder))


@contextmanager
def open_page(browser, address, width=1280, scheme="light", search=""):
    """A page whose game is ready to start; an error on its console fails the test."""
    with watched_page(browser, width, scheme, height=900) as page:
        page.goto(address + search)
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
