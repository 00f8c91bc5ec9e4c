"""Key names, and that Chromium sees the keys and the mouse of the VNC client as the table says."""

import http.server
import json
import threading
import time

import pytest

from marl_cair.games.flash.browser.keys import KEYS, Key, find_key
from marl_cair.games.flash.browser.rfb import RFBClient
from marl_cair.lookup import UnknownNameError
from tests.games.flash.browser.vnc_servers import (
    list_socket_options,
    need_program,
    run_program,
    run_tigervnc,
    wait_until,
)

PAGE = """<!doctype html><body><script>
const send = (...event) => fetch("/event", {method: "POST", body: JSON.stringify(event)});
let last = Promise.resolve();
for (const kind of ["keydown", "keyup"]) addEventListener(kind, event => {
  event.preventDefault();
  last = last.then(() => send(kind, event.code, event.key, event.keyCode));
});
for (const kind of ["mousedown", "mouseup"]) addEventListener(kind, event => {
  last = last.then(() => send(kind, event.button, event.clientX, event.clientY));
});
</script>"""


def test_keys_by_name():
    assert find_key("left") == Key(0xFF51, "ArrowLeft", "ArrowLeft", 37)
    assert find_key("f12") == Key(0xFFC9, "F12", "F12", 123)
    assert find_key("z") == Key(0x7A, "KeyZ", "z", 90)
    assert find_key("7") == Key(0x37, "Digit7", "7", 55)
    assert find_key("/") == Key(0x2F, "Slash", "/", 191)
    assert len(KEYS) == 20 + 12 + 26 + 10 + 11


@pytest.mark.parametrize(("name", "nearest"), [("Left", "left"), ("entre", "enter"), ("A", "a")])
def test_unknown_key(name, nearest):
    with pytest.raises(UnknownNameError, match=f"unknown key '{name}': nearest are '{nearest}'"):
        find_key(name)


class PageHandler(http.server.BaseHTTPRequestHandler):
    """Serves PAGE, and keeps the events that it reports."""

    events: list

    def do_GET(self):
        self.answer(PAGE.encode())

    def do_POST(self):
        self.events.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.answer(b"")

    def answer(self, body):
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        """Silent."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """A VNC client of Chromium with PAGE, and the list of the page's events."""
    need_program("chromium", "chromium")
    folder = tmp_path_factory.mktemp("x")
    handler = type("Handler", (PageHandler,), {"events": []})
    with (
        http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server,
        run_tigervnc(*list_socket_options(folder / "rfb")) as environment,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        flags = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage"]
        flags += ["--window-position=0,0", "--window-size=481,361", "--kiosk"]
        flags += [f"--user-data-dir={folder}", f"--app=http://127.0.0.1:{server.server_port}/"]
        homes = dict.fromkeys(["HOME", "TMPDIR", "XDG_CONFIG_HOME"], str(folder))
        with (
            run_program(["chromium", *flags], env={**environment, **homes}),
            RFBClient(folder / "rfb") as client,
        ):
            # A page may be loaded before its window takes input.
            wait_until(lambda: client.click(9, 9) or ["mouseup", 0, 9, 9] in handler.events, 30)
            yield client, handler.events
        server.shutdown()


def test_chromium_sees_every_key_as_in_the_table(browser):
    client, events = browser
    for name, key in KEYS.items():
        client.tap(name)
        expected = [key.code, key.key, key.key_code]
        wait_until(lambda expected=expected: ["keyup", *expected] in events)
        assert ["keydown", *expected] in events


def test_chromium_sees_a_held_key_and_the_mouse(browser):
    client, events = browser
    time.sleep(0.2)  # for clicks of the fixture that are on their way
    events.clear()
    client.press("left")
    client.click(100, 50)
    client.click(479, 359, "right")
    client.release("left")
    wait_until(lambda: len(events) >= 6)
    left = ["ArrowLeft", "ArrowLeft", 37]
    mouse = [[0, 100, 50], [2, 479, 359]]
    expected = [[kind, *event] for event in mouse for kind in ("mousedown", "mouseup")]
    assert [events[0], *events[-5:]] == [["keydown", *left], *expected, ["keyup", *left]]
