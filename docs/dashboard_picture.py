"""The pictures of the dashboard in the documentation: `python docs/dashboard_picture.py RUN...`.

Needs chromium, and the extras `dev` and `dashboard`.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from marl_cair.cli.curves import name_runs
from marl_cair.dashboard.server import write_dashboard

IMAGES = Path(__file__).parent / "images"
WIDTH, HEIGHT, NUM_COLOURS = 1280, 1000, 200


def main() -> None:
    """Draw the upper part of the page, and the generators' pictures and a game below the charts."""
    with TemporaryDirectory() as folder, sync_playwright() as started:
        page_file = Path(folder) / "page.html"
        write_dashboard(name_runs(sys.argv[1:]), page_file)
        browser = started.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(page_file.as_uri())
        page.wait_for_selector(".js-plotly-plot .scatterlayer .trace")
        write_picture(page, "dashboard.png")
        page.locator("#list button").first.click()
        viewer = page.frame_locator("#viewer")
        viewer.get_by_text("step 0 /").wait_for()
        viewer.get_by_role("slider").first.press("PageUp")  # where there is more to see
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT * 33 // 20})
        page.wait_for_timeout(1000)  # it is laid out again
        page.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
        write_picture(page, "dashboard_below.png")
        browser.close()


def write_picture(page: Page, name: str) -> None:
    """Write what is seen of the page, with few colours."""
    image = Image.open(io.BytesIO(page.screenshot()))
    image.convert("RGB").quantize(NUM_COLOURS).save(IMAGES / name, optimize=True)


if __name__ == "__main__":
    main()
