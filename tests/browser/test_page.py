"""The page in a real browser: a person plays by mouse and keys, on a phone and a desk."""

import json
from contextlib import contextmanager

import numpy as np
import pytest

from marl_cair.browser.folder import PAGE_FILE
from marl_cair.games import GAMES, replays
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.replays import hash_state
from tests.browser.conftest import open_page
from tests.chromium import FIND_CONTRAST, READABLE

WIDTHS = (360, 1280)


def played(page):
    return page.evaluate("play.played.map((step) => step[0])")


def step(page, times=1):
    """Play single steps, paused."""
    for _ in range(times):
        before = len(played(page))
        page.keyboard.press("n")
        page.wait_for_timeout(10)
        while len(played(page)) == before and not page.locator("#cover").is_visible():
            page.wait_for_timeout(10)


@pytest.fixture
def line_wars(browser, folders):
    with open_page(browser, folders("deep_line_wars"), search="?seed=5") as page:
        page.click("#start")
        page.keyboard.press("p")
        step(page)
        yield page


def test_keys_and_buttons_give_orders(line_wars):
    page = line_wars
    page.keyboard.press("1")
    step(page)
    page.get_by_role("button", name="buy footman 20 gold").click()
    step(page)
    assert played(page)[-2:] == [1, 2]  # buy_militia, buy_footman


def test_a_tower_stands_where_a_person_clicks(line_wars):
    page = line_wars
    page.get_by_role("button", name="build basic").click()
    assert page.get_by_role("button", name="build basic").get_attribute("aria-pressed") == "true"
    box = page.locator("#board").bounding_box()
    scale = box["width"] / 800  # the picture is 800 x 600, its board begins at (17.5, 82)
    x, y = 17.5 + 2.5 * 51, 82 + 3.5 * 51
    page.mouse.click(box["x"] + x * scale, box["y"] + y * scale)
    step(page)
    assert page.evaluate("[...play.rules.arrays['world.tower_row']]")[0] == 3
    assert page.evaluate("[...play.rules.arrays['world.tower_column']]")[0] == 2


def test_a_tower_is_built_by_keys_alone(line_wars):
    page = line_wars
    for key in ("5", "ArrowDown", "ArrowRight", "Enter"):
        page.keyboard.press(key)
    step(page)
    assert page.evaluate("[...play.rules.arrays['world.tower_row']]")[0] == 1
    assert page.evaluate("[...play.rules.arrays['world.tower_column']]")[0] == 2


def test_an_order_that_cannot_be_paid_is_dropped_with_a_message(line_wars):
    page = line_wars
    for _ in range(5):  # 100 gold each
        page.keyboard.press("4")
    step(page, 5)
    assert page.inner_text("#message") == "buy armoured grunt is not possible now"


def test_a_game_ends_with_a_replay_file(line_wars, tmp_path):
    page = line_wars
    page.select_option("#speed", "10")
    page.get_by_role("button", name="Go on").click()
    page.locator("#save").wait_for(timeout=60_000)
    assert page.inner_text("#result") in ("You win", "You lose", "Draw")
    with page.expect_download() as download:
        page.click("#save")
    file = tmp_path / "game.replay"
    download.value.save_as(file)
    head = json.loads(file.read_bytes().split(b"\n", 1)[0])
    assert head["game"] == "deep_line_wars"
    (played_game,) = head["games"]
    assert (played_game["map_seed"], played_game["players"]) == (5, ["person", "counter"])
    replay = replays.read_replay(file)
    assert replay.actions[:, 0].tolist() == played(page)
    assert len(replay.hashes) == 1
    for _ in replays.replay_steps(replay):  # raises where the state differs
        pass
    page.click("#start")
    assert not page.evaluate("play.rules.isOver")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_fits_the_screen(browser, folders, width, scheme):
    with open_page(browser, folders("deep_line_wars"), width, scheme) as page:
        page.click("#start")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        sides = page.locator("#orders button, #time button").evaluate_all(
            "all => all.map((one) => one.getBoundingClientRect().height)"
        )
        assert min(sides) >= 44  # fingers
        assert page.locator("#board").bounding_box()["width"] > 0.6 * min(width, 1000)
        contrast, text = page.evaluate(FIND_CONTRAST)
        assert contrast >= READABLE, text


@pytest.mark.parametrize(
    ("width", "height", "density", "shown", "rendering"),
    [
        (1280, 800, 1, 288, "pixelated"),  # its own size, as twice its height is too much
        (1280, 1400, 1, 576, "pixelated"),
        (1280, 800, 2, 288, "pixelated"),  # 2 pixels of the screen
        (1280, 1100, 2, 432, "pixelated"),  # 3
        (1280, 800, 1.5, 288, "auto"),
        (280, 800, 1, None, "auto"),
    ],
)
def test_the_board_has_whole_pixels(browser, folders, width, height, density, shown, rendering):
    context = browser.new_context(
        viewport={"width": width, "height": height}, device_scale_factor=density
    )
    page = context.new_page()
    page.goto((folders("flappy_bird") / PAGE_FILE).as_uri())
    page.locator("#start:enabled").wait_for()
    page.wait_for_timeout(100)
    box, style = page.locator("#board").evaluate(
        "one => [one.getBoundingClientRect().width, one.style.imageRendering]"
    )
    room = page.evaluate("document.getElementById('stage').clientWidth")
    context.close()
    assert (round(box), style) == (shown or room, rendering)


def test_the_table_is_of_the_moment_that_the_board_shows(line_wars):
    page = line_wars
    half = """async () => {
      play.controls.order(2, "buy_footman");
      play.isPaused = false;
      await play.advance(500 * play.game.seconds_per_step);
      play.isPaused = true;
      const later = [...play.rules.glimpse(play.actions, play.shownTicks, 0)[1]];
      return [later, play.played.length, [...play.rules.observe("vector", 0)]];
    }"""
    later, steps, earlier = page.evaluate(half)
    names = [row["own"] for row in page.evaluate("play.game.numbers")]
    own = page.locator("#numbers td:nth-child(2)").all_inner_texts()
    assert steps == 1
    assert [float(text) for text in own] == pytest.approx([later[at] for at in names], abs=0.01)
    assert [later[at] for at in names] != [earlier[at] for at in names]


def test_a_bird_flaps_by_space(browser, folders):
    with open_page(browser, folders("flappy_bird"), search="?seed=1&speed=0.25") as page:
        assert page.inner_text("#result") == "Ready?"
        page.click("#start")
        page.keyboard.press("p")
        page.locator("#board").focus()
        step(page)  # the first step cannot flap
        page.keyboard.press(" ")
        step(page)
        assert played(page)[-1] == 1
        assert not page.locator("#opponent").is_visible()


def test_a_tap_on_the_picture_flaps(browser, folders):
    with open_page(browser, folders("flappy_bird"), search="?seed=1") as page:
        page.click("#start")
        page.keyboard.press("p")
        step(page)  # the first step cannot flap
        page.click("#board")
        step(page)
        assert played(page)[-1] == 1


def test_a_browser_without_webassembly_is_told_so(browser, folders):
    page = browser.new_page()
    page.add_init_script("delete globalThis.WebAssembly")
    page.goto((folders("flappy_bird") / PAGE_FILE).as_uri())
    page.get_by_text("This game cannot be played here").wait_for()
    assert "WebAssembly" in page.inner_text("#about")
    assert not page.locator("#start").is_visible()
    page.close()


# --- Deep Maze and Deep RTS: the same orders in Python -------------------------------------------


@contextmanager
def both(browser, folders, name):
    """The page, paused, and an engine with the same game."""
    game = GAMES[name]
    engine = BatchedEngine(game, game.scenario())
    engine.reset(5)
    with open_page(browser, folders(name), search="?seed=5") as page:
        page.click("#start")
        page.keyboard.press("p")
        step_both(page, engine)  # its action may have been chosen before the pause
        yield page, engine


def step_both(page, engine, times=1):
    """Play single steps; returns the person's action of the last one."""
    for _ in range(times):
        step(page)
        actions = page.evaluate("play.played.at(-1)")
        engine.step(np.array([actions]))
    return actions[0]


def assert_same_state(page, engine):
    assert page.evaluate("play.rules.hash()").startswith(hash_state(engine).hex())


def test_a_maze_is_solved_by_arrow_keys(browser, folders):
    with both(browser, folders, "deep_maze") as (page, engine):
        guide = GAMES["deep_maze"].bot("oracle", engine.scenario)
        while not engine.terminated[0]:
            (action,) = guide.act(engine.observe(guide.representation)[0], engine.action_mask()[0])
            page.keyboard.press(f"Arrow{engine.spec.action_names[action].capitalize()}")
            assert step_both(page, engine) == action
        assert page.inner_text("#result") == f"Score {page.inner_text('#score')}"
        assert_same_state(page, engine)


@pytest.fixture
def rts(browser, folders):
    with both(browser, folders, "deep_rts") as (page, engine):
        yield page, engine


def find_cells(engine, *names):
    """The cells at which the person's planes of all these names are set."""
    names_of_planes = engine.spec.representations["planes"].plane_names
    planes = engine.observe("planes")[0, 0]
    shown = [planes[names_of_planes.index(name)] > 0 for name in names]
    return np.flatnonzero(np.logical_and.reduce(shown)).tolist()


def find_action(engine, kind, cell):
    spec = engine.spec
    is_kind = spec.action_groups == spec.action_group_names.index(kind)
    return np.flatnonzero(is_kind & (spec.action_cells == cell)).item()


def click_cell(page, cell, button="left"):
    row, column = divmod(cell, 15)  # the board is the whole picture
    box = page.locator("#board").bounding_box()
    side = box["width"] / 15
    x, y = box["x"] + (column + 0.5) * side, box["y"] + (row + 0.5) * side
    page.mouse.click(x, y, button=button)


@pytest.mark.slow  # to compile the rules takes minutes
def test_an_rts_unit_is_selected_by_a_click_and_sent_by_a_right_click(rts):
    page, engine = rts
    start = find_cells(engine, "own", "peasant")[0]
    assert find_cells(engine, "selected") != [start]
    click_cell(page, start)
    assert step_both(page, engine) == find_action(engine, "select", start)
    assert find_cells(engine, "selected") == [start]
    goal = find_cells(engine, "desert")[0]
    click_cell(page, goal, "right")
    assert step_both(page, engine) == find_action(engine, "go", goal)
    step_both(page, engine, 20)
    peasants = find_cells(engine, "own", "peasant")
    assert goal in peasants
    assert start not in peasants
    assert_same_state(page, engine)


@pytest.mark.slow
def test_an_rts_unit_is_selected_and_sent_by_keys(rts):
    page, engine = rts

    def press_key_of(kind):
        button = page.locator("#orders button", has=page.get_by_text(kind, exact=True))
        page.keyboard.press(button.locator("kbd").inner_text())

    before = find_cells(engine, "selected")
    press_key_of("next unit")
    step_both(page, engine)
    assert find_cells(engine, "selected") != before
    press_key_of("go")  # the first legal cell is marked
    for key in ("ArrowDown", "ArrowRight", "Enter"):
        page.keyboard.press(key)
    assert step_both(page, engine) == find_action(engine, "go", 16)
    assert_same_state(page, engine)
