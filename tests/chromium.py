"""Chromium for tests of pages: skipped where it is missing, a failure in CI."""

import os
import shutil
import threading
from contextlib import contextmanager
from importlib.util import find_spec

import pytest

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser")
IS_MISSING = "MARL_CAIR_NEEDS_BROWSER" not in os.environ and (  # set by .ci/run
    BROWSER is None or find_spec("playwright") is None
)
WHY = "needs chromium (Debian: apt-get install chromium) and playwright (extra `dev`)"
need_browser = pytest.mark.skipif(IS_MISSING, reason=WHY)
READABLE = 4.5  # contrast of text that WCAG 2 asks for (AA)

# The smallest contrast of any text on the page with what is painted behind it, and whose it is.
FIND_CONTRAST = """() => {
  const parse = text => (text.match(/[0-9.]+/g) || []).map(Number);
  const light = colour => {
    const parts = colour.slice(0, 3).map(c => c / 255)
      .map(c => c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
  };
  const ground = element => {
    const own = element.getBoundingClientRect(), x = own.x + own.width / 2;
    const y = own.y + own.height / 2;
    for (let at = element; at; at = at.parentElement) {
      const box = at.getBoundingClientRect();
      if (x < box.left || x > box.right || y < box.top || y > box.bottom) continue;
      const colour = parse(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return parse(getComputedStyle(document.body).backgroundColor);
  };
  let worst = [99, ""];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const text = walker.currentNode.textContent.trim(), element = walker.currentNode.parentElement;
    if (!text || !element.checkVisibility()) continue;
    const lights = [light(parse(getComputedStyle(element).color)), light(ground(element))];
    const found = (Math.max(...lights) + 0.05) / (Math.min(...lights) + 0.05);
    if (found < worst[0]) worst = [found, text];
  }
  return worst;
}"""
# Elements that reach beyond the screen and are not in a frame that scrolls by itself.
FIND_WIDE = """() => [...document.querySelectorAll("main *")]
  .filter(e => !e.closest(".scroll, .ladder thead, details:not([open])"))
  .filter(e => e.getBoundingClientRect().right > innerWidth + 0.5)
  .map(e => e.outerHTML.slice(0, 80))"""


# Not of the session: while it lives, no other module of this process can start it, or asyncio.
@pytest.fixture(scope="module")
def browser():
    if IS_MISSING:
        pytest.skip(WHY)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as started:
        # Debian's sandbox needs rights that a container does not give; the page is our own.
        opened = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield opened
        opened.close()


@contextmanager
def watched_page(browser, width=1280, scheme="light", height=800):
    """An empty page of its own context. Fails at the end if it has logged errors."""
    errors = []
    viewport = {"width": width, "height": height}
    context = browser.new_context(viewport=viewport, color_scheme=scheme)
    page = context.new_page()
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("console", lambda line: line.type == "error" and errors.append(line.text))
    try:
        yield page
    finally:
        context.close()
    assert errors == [], errors


@contextmanager
def serving(server):
    """The address of a server from `make_server`, which answers until the end."""
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


def open_page(browser, path, width=1280, scheme="light"):
    """The page, and what it has asked for or complained about."""
    page = browser.new_page(viewport={"width": width, "height": 800}, color_scheme=scheme)
    messages = []
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.on("dialog", lambda dialog: messages.append(f"dialog {dialog.message}"))
    page.on(
        "request",
        lambda request: (
            None
            if request.url == path.as_uri() or request.url.startswith("data:")
            else messages.append(request.url)
        ),
    )
    page.goto(path.as_uri(), wait_until="load")
    return page, messages
