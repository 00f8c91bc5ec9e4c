"""The picture of a league's report in the documentation: `python docs/report_picture.py FOLDER`.

FOLDER is a league's. Needs chromium and playwright (the extra `dev`).
"""

from __future__ import annotations

import argparse
import io
import shutil
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

PICTURE = Path(__file__).parent / "images" / "league_report.png"
DESK, PHONE = 960, 400  # pixels wide
MARGIN, GAP, NUM_COLOURS = 24, 24, 200
EDGES = "e => [e.getBoundingClientRect().top + scrollY, e.getBoundingClientRect().bottom + scrollY]"


def open_report(browser: Browser, path: Path, width: int, scheme: Literal["light", "dark"]) -> Page:
    """The page at a width, in a colour scheme."""
    page = browser.new_page(viewport={"width": width, "height": 1000}, color_scheme=scheme)
    page.goto(path.absolute().as_uri())
    return page


def shoot(page: Page, first: str, last: str, height: int = 0) -> Image.Image:
    """The page from the start of an element to the end of another one, or `height` pixels of it."""
    (top, _), (_, bottom) = (page.locator(name).first.evaluate(EDGES) for name in (first, last))
    image = Image.open(io.BytesIO(page.screenshot(full_page=True)))
    start = max(0, round(top) - MARGIN)
    return image.crop((0, start, image.width, start + height if height else round(bottom) + MARGIN))


def main() -> None:
    """Put a desk in light (ladder, matrix) and a phone in dark (a game) side by side."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    path = parser.parse_args().folder / "report.html"
    with sync_playwright() as started:
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        desk = open_report(browser, path, DESK, "light")
        ladder = shoot(desk, "body", "[data-key=ladder]")
        matrix = shoot(desk, "[data-key=matrix]", "[data-key=matrix] svg")
        height = ladder.height + matrix.height
        phone = open_report(browser, path, PHONE, "dark")
        for _ in range(6):
            phone.get_by_role("slider").first.press("PageUp")  # where there is more to see
        game = shoot(phone, "[data-key=replays] h3", "body", height)
        browser.close()
    picture = Image.new("RGB", (DESK + GAP + PHONE, height), "white")
    picture.paste(ladder, (0, 0))
    picture.paste(matrix, (0, ladder.height))
    picture.paste(game, (DESK + GAP, 0))
    picture.quantize(NUM_COLOURS).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
