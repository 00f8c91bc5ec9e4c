"""The viewer in a real browser: the engine's own pixels, playing, keys, all sizes of screens."""

import base64
import dataclasses
import re

import numpy as np
import pytest

from marl_cair.viewer.page import SCRIPT_FILE, write_viewer
from tests.chromium import (
    FIND_CONTRAST,
    FIND_WIDE,
    READABLE,
    browser,
    need_browser,
    open_page,
)
from tests.viewer.recorded import pictures, record

__all__ = ["browser"]  # a fixture
pytestmark = need_browser
FASTEST = 6  # of the speeds
EVIL = "</script><img src=x onerror=alert(1)>"
MAX_SCRIPT_BYTES = 40_000
READ_PIXELS = """() => {
  const canvas = document.querySelector(".mc-picture");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let text = "";
  for (const value of data) text += String.fromCharCode(value);
  return [canvas.width, canvas.height, btoa(text)];
}"""


def expect(locator):
    from playwright.sync_api import expect as expect_locator

    return expect_locator(locator)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("viewer")


@pytest.fixture(scope="module")
def line_wars(folder):
    values = {"action values": np.random.default_rng(0).normal(size=(60, 2, 200))}
    options = {"game": "deep_line_wars", "scenario": "11x11", "bots": ("rusher", "turtle")}
    num_actions = record(folder / "a.replay", steps=1, **options).spec.num_actions
    values["action values"] = values["action values"][..., :num_actions]
    return record(folder / "a.replay", steps=60, values=values, names=("rusher", EVIL), **options)


@pytest.fixture(scope="module")
def fog(folder):
    options = {"game": "deep_rts", "scenario": "Skirmish-31x31-fog", "bots": ("rusher", "archers")}
    return record(folder / "b.replay", steps=25, **options)


@pytest.fixture(scope="module")
def file(folder, line_wars):
    write_viewer(folder / "a.html", line_wars)
    return folder / "a.html"


@pytest.fixture(scope="module")
def fog_file(folder, fog):
    write_viewer(folder / "b.html", fog)
    return folder / "b.html"


@pytest.fixture
def page(browser, file):
    yield from shown(browser, file)


@pytest.fixture
def fog_page(browser, fog_file):
    yield from shown(browser, fog_file)


def shown(browser, file, **screen):
    page, messages = open_page(browser, file, **screen)
    page.wait_for_selector(".mc-clock:not(:empty)")
    yield page
    page.close()
    assert messages == []


def step_of(page):
    return int(page.get_by_label("Step", exact=True).input_value())


def seek(page, step):
    page.get_by_label("Step", exact=True).fill(str(step))


def read_pixels(page):
    width, height, text = page.evaluate(READ_PIXELS)
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)[..., :3]


@pytest.mark.parametrize("view", [0, 1, 2])
def test_every_view_shows_the_pixels_of_the_engine(fog_page, fog, view):
    expected = pictures(fog, None if view == 0 else view - 1)
    fog_page.keyboard.press(str(view + 1))
    expect(fog_page.get_by_label("View", exact=True)).to_have_value(str(view))
    for step in (0, 25, 3, 24, 17):
        seek(fog_page, step)
        np.testing.assert_array_equal(read_pixels(fog_page), expected[step])


def test_it_plays_to_the_end_and_again(page):
    slider = page.get_by_label("Step", exact=True)
    page.get_by_label("Speed").select_option(index=FASTEST)
    page.get_by_role("button", name="Play", exact=True).click()
    page.get_by_role("button", name="Pause").wait_for()
    expect(slider).to_have_value("60")
    page.get_by_role("button", name="Play", exact=True).wait_for()
    page.get_by_label("Speed").select_option(index=0)
    page.locator(".mc-clock").click()  # the focus leaves the list
    page.keyboard.press("Space")
    expect(slider).not_to_have_value("60")


def test_a_pause_stays_at_its_step(page):
    page.keyboard.press("Space")
    expect(page.get_by_label("Step", exact=True)).not_to_have_value("0")
    page.keyboard.press("Space")
    step = step_of(page)
    page.wait_for_timeout(250)  # two steps at speed 1
    assert step_of(page) == step


def test_keys_do_what_the_help_says(page):
    page.keyboard.press("?")
    help_rows = page.locator(".mc-help tr").all_inner_texts()
    assert any("Play or pause" in row for row in help_rows)
    page.keyboard.press("?")
    assert not page.locator(".mc-help").is_visible()
    for key, step in (
        *(("ArrowRight", 1), ("Shift+ArrowRight", 11), ("ArrowLeft", 10), ("End", 60)),
        *(("Shift+ArrowLeft", 50), ("Home", 0)),
    ):
        page.keyboard.press(key)
        assert step_of(page) == step, key
    events = [int(text) for text in page.evaluate(EVENT_STEPS)]
    for step in sorted(set(events) - {0}):
        page.keyboard.press("n")
        assert step_of(page) == step
    page.keyboard.press("p")
    assert step_of(page) == sorted(set(events))[-2]
    speed = page.get_by_label("Speed")
    for key, value in (("+", 2), ("-", 1), ("-", 0.5)):
        page.keyboard.press(key)
        assert speed.evaluate("e => parseFloat(e.selectedOptions[0].text)") == value


EVENT_STEPS = """() => JSON.parse(document.querySelector(".mc-replay script").textContent)
  .events.map(event => event.step)"""


def test_all_controls_are_reached_and_named(page):
    page.locator("body").focus()
    names = []
    for _ in range(12):
        page.keyboard.press("Tab")
        names.append(page.evaluate("document.activeElement.ariaLabel"))
    for name in (
        "Step",
        "To the start",
        "Step back",
        "Play",
        "To the end",
        "Speed",
        "View",
        "Keys",
    ):
        assert name in names
    page.get_by_label("Play", exact=True).focus()
    page.keyboard.press("Space")  # presses the button, once
    page.get_by_role("button", name="Pause").wait_for()
    assert page.get_by_label("Step", exact=True).get_attribute("aria-valuetext").startswith("step ")


def test_a_graph_and_an_event_seek(page):
    plot = page.locator(".mc-plot").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20)
    assert step_of(page) == 30
    page.locator(".mc-events button").last.click()
    assert step_of(page) == 60


def test_players_graphs_and_values_follow_the_step(page, line_wars):
    spec = line_wars.spec
    for step in (0, 41):
        seek(page, step)
        actions = page.locator(".mc-players code").all_inner_texts()
        assert actions == [spec.action_names[action] for action in line_wars.actions[step]]
        values = line_wars.values["action values"][step, 0].astype(np.float32)
        best = page.locator(".mc-players li").first.locator(".mc-values div").first.inner_text()
        assert best.startswith(spec.action_names[int(values.argmax())])
    health = page.locator(".mc-chart", has_text="health").locator(".mc-numbers span")
    owned = page.locator(".mc-owned").all_inner_texts()
    for label, text in zip(health.all_inner_texts(), owned, strict=True):
        assert text.startswith(f"health {label} ")
    seek(page, 60)  # no action follows
    assert page.locator(".mc-players code").all_inner_texts() == ["-", "-"]


def test_names_are_text(page):
    assert page.locator("img").count() == 0
    assert EVIL in page.locator(".mc-name").all_inner_texts()
    assert page.title() == f"rusher v {EVIL}"


def test_the_page_holds_everything(file):
    text = file.read_text("utf-8")
    assert "default-src 'none'" in text
    assert re.findall(r"(?:src|href)=", text.replace("img src=x", "")) == []
    assert SCRIPT_FILE.stat().st_size <= MAX_SCRIPT_BYTES


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1280])
def test_it_fits_and_is_readable(browser, file, width, scheme):
    for page in shown(browser, file, width=width, scheme=scheme):
        assert page.evaluate("document.documentElement.scrollWidth") == width
        assert page.evaluate(FIND_WIDE) == []
        contrast, text = page.evaluate(FIND_CONTRAST)
        assert contrast >= READABLE, text


def test_a_game_without_an_end_says_so(browser, folder, line_wars):
    cut = dataclasses.replace(line_wars, is_complete=False, actions=line_wars.actions[:2])
    write_viewer(folder / "cut.html", dataclasses.replace(cut, hashes={}))
    for page in shown(browser, folder / "cut.html"):
        assert "cut off" in page.locator(".mc-events").inner_text()
