"""The picture of the dashboard in the documentation: `python docs/dashboard_picture.py RUN...`.

Needs chromium, and the extras `dev` and `dashboard`.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import sync_playwright

from marl_cair.cli.curves import name_runs
from marl_cair.dashboard.server import write_dashboard

PICTURE = Path(__file__).parent / "images" / "dashboard.png"
WIDTH, HEIGHT, NUM_COLOURS = 1280, 1000, 64


def main() -> None:
    """Draw the upper part of the page, and write it with few colours."""
    with TemporaryDirectory() as folder, sync_playwright() as started:
        page_file = Path(folder) / "page.html"
        write_dashboard(name_runs(sys.argv[1:]), page_file)
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(page_file.as_uri())
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        image = Image.open(io.BytesIO(page.screenshot()))
        image.convert("RGB").quantize(NUM_COLOURS).save(PICTURE, optimize=True)
        browser.close()


if __name__ == "__main__":
    main()
