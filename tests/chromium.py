"""Chromium for tests of pages: skipped where it is missing, a failure in CI."""

import os
import shutil
from contextlib import contextmanager
from importlib.util import find_spec

import pytest

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
need_browser = pytest.mark.skipif(
    "MARL_CAIR_NEEDS_BROWSER" not in os.environ  # set by .ci/run
    and (BROWSER is None or find_spec("playwright") is None),
    reason="needs chromium (Debian: apt-get install chromium) and playwright (extra `dev`)",
)


@contextmanager
def launch_chromium(width, scheme):
    """A page of this width and colour scheme ("light" or "dark"). Fails at the end if the page has
    logged errors.
    """
    from playwright.sync_api import sync_playwright

    errors = []
    with sync_playwright() as started:
        # Debian's sandbox needs rights that a container does not give; the page is our own.
        opened = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        page = opened.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
        page.on("console", lambda text: text.type == "error" and errors.append(text.text))
        page.on("pageerror", lambda error: errors.append(str(error)))
        yield page
        opened.close()
    assert errors == [], errors
