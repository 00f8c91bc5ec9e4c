"""Draws HTML pages for the documentation: `python -m docs.page_pictures report|dashboard|viewer`.

`report` takes the folder of a league, `dashboard` those of runs. Needs chromium, and the extras
`dev` and `dashboard`.
"""

from __future__ import annotations

import io
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from PIL import Image
from playwright.sync_api import Browser, FrameLocator, Page, sync_playwright

from docs.pictures import write_viewed_game
from marl_cair.cli.curves import name_runs
from marl_cair.dashboard.server import write_dashboard
from marl_cair.lookup import find_by_name

ROOT = Path(__file__).resolve().parents[1]
MARGIN, GAP = 24, 24  # pixels
EDGES = "e => [e.getBoundingClientRect().top + scrollY, e.getBoundingClientRect().bottom + scrollY]"
Scheme = Literal["light", "dark"]


@contextmanager
def start_chromium() -> Iterator[Browser]:
    """The system's Chromium."""
    with sync_playwright() as started:
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        yield browser
        browser.close()


def open_page(browser: Browser, path: Path, width: int, scheme: Scheme) -> Page:
    """A page of a width, in a colour scheme."""
    page = browser.new_page(viewport={"width": width, "height": 1000}, color_scheme=scheme)
    page.goto(path.absolute().as_uri())
    return page


def scrub(page: Page | FrameLocator, times: int) -> None:
    """Go on in a game, where there is more to see."""
    for _ in range(times):
        page.get_by_role("slider").first.press("PageUp")
    page.get_by_role("slider").first.evaluate("e => e.blur()")


def shoot(page: Page, first: str, last: str, height: int = 0) -> Image.Image:
    """The page from the start of an element to the end of another one, or `height` pixels of it."""
    page.wait_for_timeout(1000)  # it is laid out
    (top, _), (_, bottom) = (page.locator(name).first.evaluate(EDGES) for name in (first, last))
    image = Image.open(io.BytesIO(page.screenshot(full_page=True)))
    start = max(0, round(top) - MARGIN)
    end = start + height if height else min(image.height, round(bottom) + MARGIN)
    return image.crop((0, start, image.width, end))


def save(name: str, columns: Sequence[Sequence[Image.Image]]) -> None:
    """Write columns of pictures to docs/images."""
    width = sum(column[0].width for column in columns) + GAP * (len(columns) - 1)
    height = max(sum(image.height for image in column) for column in columns)
    picture, left = Image.new("RGB", (width, height), "white"), 0
    for column in columns:
        top = 0
        for image in column:
            picture.paste(image, (left, top))
            top += image.height
        left += column[0].width + GAP
    path = ROOT / f"docs/images/{name}.png"
    picture.save(path, optimize=True)


def draw_report(browser: Browser, sources: Sequence[str]) -> None:
    """Ladder and matrix, and a game on a phone."""
    path = Path(sources[0]) / "report.html"
    desk = open_page(browser, path, 960, "light")
    ladder = shoot(desk, "body", "[data-key=ladder]")
    matrix = shoot(desk, "[data-key=matrix]", "[data-key=matrix] svg")
    phone = open_page(browser, path, 400, "dark")
    scrub(phone, 6)
    game = shoot(phone, "[data-key=replays] h3", "body", ladder.height + matrix.height)
    save("league_report", [[ladder, matrix], [game]])


def draw_dashboard(browser: Browser, sources: Sequence[str]) -> None:
    """The first four charts, and what is below all: the generators' pictures, and a game."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        write_dashboard(name_runs(sources), path)
        charts = open_page(browser, path, 1280, "light")
        charts.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        save("dashboard", [[shoot(charts, "body", "h2:text('Learning') + .grid > div")]])
        page = open_page(browser, path, 1310, "dark")
        page.locator("#list button").first.click()
        page.set_viewport_size({"width": 1310, "height": 1400})  # of which the game has its share
        scrub(page.frame_locator("#viewer"), 4)
        save("dashboard_below", [[shoot(page, "h2:text('Pictures')", "#games")]])


def draw_viewer(browser: Browser, sources: Sequence[str]) -> None:
    """The page of a game, on a desk and on a phone."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "page.html"
        agent = str(ROOT / "agents/deep_rts_1v1_15x15")
        write_viewed_game(agent, "mixed", "deep_rts", "1v1-15x15", 0, path)
        pages = open_page(browser, path, 1180, "light"), open_page(browser, path, 400, "dark")
        for page in pages:
            scrub(page, 6)
        desk = shoot(pages[0], "body", "main")
        save("viewer", [[desk], [shoot(pages[1], "body", "main", desk.height)]])


PAGES = {"report": draw_report, "dashboard": draw_dashboard, "viewer": draw_viewer}


def main() -> None:
    """Draw one page."""
    kind, *sources = sys.argv[1:]
    draw = find_by_name("page", kind, PAGES)
    with start_chromium() as browser:
        draw(browser, sources)


if __name__ == "__main__":
    main()
