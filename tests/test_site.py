"""The documentation site, opened from disk: its game is played, and nothing else is loaded."""

import os
import subprocess
import sys

import numpy as np
import pytest

from marl_cair.browser.runtime import find_runtime
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.replays import hash_state
from marl_cair.npm import InstallError
from tests.chromium import browser, watched_page
from tests.test_architecture import ROOT

__all__ = ["browser"]  # a fixture
STEPS = 3


@pytest.fixture(scope="module")
def site(browser, tmp_path_factory):
    """The first page of what `make docs` builds."""
    hooks = pytest.importorskip("docs.hooks", reason="needs mkdocs (extra `docs`)")
    try:
        find_runtime()
        hooks.install_search()
    except InstallError as error:
        if "MARL_CAIR_NEEDS_BROWSER" in os.environ:  # set by .ci/run
            raise
        pytest.skip(f"the first page's game or the search of the site is missing: {error}")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", folder]
    quiet = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    subprocess.run(command, cwd=ROOT, env=quiet, check=True)
    return folder / "index.html"


def test_search_works_from_disk(browser, site):
    with watched_page(browser) as page:
        page.goto(site.as_uri())
        page.get_by_placeholder("Search").first.click()
        page.keyboard.type("capsule")
        page.locator(".md-search-result__item").first.wait_for(timeout=30_000)


@pytest.mark.parametrize("width", [360, 1280])
def test_the_first_page_holds_a_game_and_loads_nothing_from_the_network(browser, site, width):
    loaded = []
    with watched_page(browser, width) as page:
        page.on("request", lambda request: loaded.append(request.url))
        page.goto(site.as_uri())
        page.locator("#game").scroll_into_view_if_needed()
        page.frame_locator("#game").locator("#start:enabled").click(timeout=60_000)
        frame = page.frame(url="**/game/index.html")
        for _ in range(STEPS):
            frame.evaluate("play.setPaused(true); play.controls.order(2, 'buy_footman')")
            frame.evaluate("play.stepOnce()")
        seed, played, found = frame.evaluate(
            "async () => [play.seed, play.played, await play.rules.hash()]"
        )
        assert frame.evaluate("document.documentElement.scrollHeight <= innerHeight")
        assert frame.evaluate("document.documentElement.scrollWidth <= innerWidth")
        page.wait_for_load_state("networkidle")
    assert [url for url in loaded if not url.startswith(("file:", "blob:", "data:"))] == []
    game = GAMES["deep_line_wars"]
    engine = BatchedEngine(game, game.scenario())
    engine.reset(int(seed))
    for actions in played:
        engine.step(np.array([actions]))
    assert len(played) >= STEPS
    assert found.startswith(hash_state(engine).hex())
