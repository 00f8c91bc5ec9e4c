"""The page in a real browser: on a phone and a desk, light and dark, without a network."""

import json

import pytest

from marl_cair.league.ratings.payoffs import Share
from marl_cair.league.report.background import Background
from marl_cair.league.report.render import render_html
from marl_cair.league.report.replays import ShownGame
from marl_cair.league.report.sections import make_report
from marl_cair.league.store.schema import AgentRecord
from marl_cair.viewer.page import write_viewer
from tests.chromium import FIND_CONTRAST, FIND_WIDE, READABLE, browser, need_browser, open_page
from tests.league.leagues import EDGES, make, make_games
from tests.league.report.test_render import unrated
from tests.viewer.recorded import record

__all__ = ["browser"]  # a fixture
pytestmark = need_browser
LONG = "runs/a_run_with_a_rather_long_name/snapshots/frames_"
NAMES = [f"{LONG}0000051200", f"{LONG}0000102400", "<script>alert(1)</script>", "random"]
SCREENS = [(width, scheme) for width in (360, 1280) for scheme in ("light", "dark")]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page")
    bots = "rusher", "turtle"
    for place in range(2):
        replay = record(folder / "a.replay", "deep_line_wars", bots, steps=20, scenario="11x11")
        write_viewer(folder / f"{place}.html", replay)

    def describe(frames):
        about = {"run": "/runs/a", "name": "a", "seed": 0, "frames": frames, "frames_total": frames}
        return json.dumps({"training": about})

    background = Background(
        title="Deep RTS",
        settings=(("Command", "marl-cair league " + " ".join(NAMES)), ("Scenario", "a" * 300)),
        records={
            name: AgentRecord("0" * 32, name, "network", "greedy", "1", describe(frames))
            for name, frames in zip(NAMES[:2], (51_200, 102_400), strict=True)
        },
        map_shares={(name, f"map {n}"): Share(0.5, 0, 1, 8) for name in NAMES for n in range(9)},
        replays=(
            ShownGame("The best two", "a v b", folder / "0.html"),
            ShownGame("The greatest upset", "a v b", folder / "1.html"),
            ShownGame("The longest game", "a v b", None, "The replay differs."),
        ),
        replay_words="",
    )
    table = make({**EDGES, (0, 1): 20}, NAMES, repeats=4, forfeits=((NAMES[0], "it " * 99, 3),))
    path = folder / "report.html"
    path.write_text(render_html(make_report(table, background)), "utf-8")
    return path


@pytest.fixture(scope="module")
def bare_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("bare") / "report.html"
    table = unrated(["a", "b", "c", "d"], make_games({(0, 1): 25, (2, 3): 25}))
    path.write_text(render_html(make_report(table)), "utf-8")
    return path


@pytest.mark.parametrize(("width", "scheme"), SCREENS)
@pytest.mark.parametrize("file", ["page_file", "bare_file"])
def test_the_page_fits_and_is_readable(browser, request, file, width, scheme):
    page, messages = open_page(browser, request.getfixturevalue(file), width, scheme)
    try:
        assert messages == []
        assert page.evaluate(FIND_WIDE) == []
        assert page.evaluate("document.documentElement.scrollWidth") == width
        contrast, text = page.evaluate(FIND_CONTRAST)
        assert contrast >= READABLE, text
    finally:
        page.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_folded_parts_are_readable_too(browser, page_file, scheme):
    page, _ = open_page(browser, page_file, 360, scheme)
    try:
        page.evaluate("document.querySelectorAll('details').forEach(e => e.open = true)")
        assert page.evaluate("document.documentElement.scrollWidth") == 360
        contrast, text = page.evaluate(FIND_CONTRAST)
        assert contrast >= READABLE, text
    finally:
        page.close()


def test_dark_is_dark(browser, page_file):
    grounds = []
    for scheme in ("light", "dark"):
        page, _ = open_page(browser, page_file, scheme=scheme)
        grounds.append(page.evaluate("getComputedStyle(document.body).backgroundColor"))
        page.close()
    assert grounds == ["rgb(251, 251, 249)", "rgb(18, 20, 23)"]


def test_games_are_played_one_by_one(browser, page_file):
    page, messages = open_page(browser, page_file)
    try:
        sliders = page.get_by_label("Step", exact=True)
        page.locator(".mc-clock:not(:empty)").nth(1).wait_for()
        page.locator(".mc-viewer").nth(1).focus()
        page.keyboard.press("End")
        assert [slider.input_value() for slider in sliders.all()] == ["0", "20"]
        assert messages == []
    finally:
        page.close()


def test_wide_tables_scroll_within_themselves(browser, page_file):
    page, _ = open_page(browser, page_file, 360)
    try:
        wide = "e => e.scrollWidth > e.clientWidth"
        assert page.evaluate(f"[...document.querySelectorAll('.scroll')].some({wide})")
    finally:
        page.close()


def test_the_checks_above_can_fail(browser, tmp_path):
    path = tmp_path / "bad.html"
    path.write_text(
        "<main style='width:2000px'><p style='color:#888;background:#999'>pale</p>"
        "<img src='http://127.0.0.1:9/a.png'><script>console.log('ran')</script></main>",
        "utf-8",
    )
    page, messages = open_page(browser, path, 360)
    try:
        assert any("a.png" in line for line in messages)
        assert "ran" in messages
        assert page.evaluate(FIND_WIDE) != []
        assert page.evaluate(FIND_CONTRAST)[0] < READABLE
    finally:
        page.close()
