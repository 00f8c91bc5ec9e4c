"""Games in a real Chromium: a served folder of each game, and what the page's console says."""

import os
import threading
from contextlib import contextmanager

import pytest

from marl_cair.browser.folder import Opponent, write_folder
from marl_cair.browser.serving import make_server
from marl_cair.games import GAMES
from tests.chromium import BROWSER

NEEDED = "MARL_CAIR_NEEDS_BROWSER"  # set by .ci/run: there one that is missing is a failure


# Not of the session: while it lives, no other module of this process can start it, or asyncio.
@pytest.fixture(scope="module")
def chromium():
    if NEEDED in os.environ:
        from playwright import sync_api as playwright
    else:
        playwright = pytest.importorskip(
            "playwright.sync_api", reason="playwright is of the extra `dev`"
        )
        if BROWSER is None:
            pytest.skip("no chromium is installed (Debian: apt-get install chromium)")
    with playwright.sync_playwright() as started:
        # Debian's sandbox needs rights that a container does not give; the pages are our own.
        opened = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield opened
        opened.close()


@contextmanager
def serve(folder):
    """The address at which a folder is served."""
    with make_server(folder) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def open_blank(chromium):
    """A page without content, to run scripts."""
    context = chromium.new_context()
    yield context.new_page()
    context.close()


@contextmanager
def open_page(chromium, address, width=1280, scheme="light", search=""):
    """A page whose game is ready to start; an error on its console fails the test."""
    options = {"viewport": {"width": width, "height": 900}, "color_scheme": scheme}
    context = chromium.new_context(**options)
    page = context.new_page()
    errors = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    page.goto(address + search)
    page.locator("#start:enabled, #start[hidden]").wait_for(state="attached", timeout=60_000)
    assert errors == []
    yield page
    context.close()
    assert errors == []


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
