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
from playwright.sync_api import Browser, sync_playwright

PICTURE = Path(__file__).parent / "images" / "league_report.png"
DESK, PHONE = 960, 380  # pixels wide
HEIGHT, GAP, NUM_COLOURS = 1460, 24, 128


def shoot(
    browser: Browser, path: Path, width: int, scheme: Literal["light", "dark"], start: str = ""
) -> Image.Image:
    """The page from the section `start` on (default: the top)."""
    page = browser.new_page(viewport={"width": width, "height": HEIGHT}, color_scheme=scheme)
    page.goto(path.absolute().as_uri())
    if start:
        section = page.locator(f"[data-key={start}]")
        section.evaluate("e => e.scrollIntoView({behavior: 'instant'})")
    return Image.open(io.BytesIO(page.screenshot()))


def main() -> None:
    """Put a desk in light and a phone in dark side by side."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    path = parser.parse_args().folder / "report.html"
    with sync_playwright() as started:
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        desk = shoot(browser, path, DESK, "light")
        phone = shoot(browser, path, PHONE, "dark", "matrix")
        browser.close()
    picture = Image.new("RGB", (DESK + GAP + PHONE, HEIGHT), "white")
    picture.paste(desk, (0, 0))
    picture.paste(phone, (DESK + GAP, 0))
    picture.quantize(NUM_COLOURS).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
