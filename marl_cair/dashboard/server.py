"""Serves the page of training runs on this machine alone, and writes it as one HTML file."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Lock
from typing import Any
from urllib.parse import unquote, urlsplit

from marl_cair.dashboard.runs import FILES, RunReader, list_files, read_runs
from marl_cair.files import write_atomically
from marl_cair.games.replays import read_replay
from marl_cair.viewer.game_data import pack_game
from marl_cair.viewer.page import make_page, read_theme

HOST = "127.0.0.1"
_PAGE = Path(__file__).with_name("page.html")
_TYPES = {".png": "image/png", ".gif": "image/gif"}
# Scripts and styles of the page itself; Plotly makes styles and pictures as it draws.
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src 'self' data: blob:; connect-src 'self'; frame-src 'self'"
)
# A game's page comes from a file of the run: it may not reach this server.
_GAME_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:"
)
_HTML, _GAME = "text/html; charset=utf-8", "text/html"


def make_server(runs: Mapping[str, Path], port: int) -> ThreadingHTTPServer:
    """A server of the page on 127.0.0.1; call `serve_forever`. Port 0: any free one.

    It answers with the page, the numbers of `runs` (label -> folder), their pictures, and viewers
    of their recorded games, and with nothing else.

    Raises OSError for a port in use, ValueError without Plotly.
    """
    read_data = _make_reader(runs)
    script = read_plotly().encode()
    page = _make_page(None, "/plotly.js").encode()

    def find(path: str) -> tuple[str, bytes] | None:
        """Type and content of what `path` names."""
        if path == "/":
            return _HTML, page
        if path == "/plotly.js":
            return "text/javascript", script
        if path == "/data.json":
            return "application/json", read_data()
        parts = [unquote(part) for part in path.split("/")]  # a run's name may have a slash
        if len(parts) != 4 or parts[2] not in runs:
            return None
        kind, folder, name = parts[1], runs[parts[2]], parts[3]
        if name not in list_files(folder).get(kind, ()):
            return None
        file = folder / FILES[kind][0] / name
        if kind == "games":
            return _GAME, make_viewer(file)
        return (_TYPES[file.suffix], file.read_bytes()) if kind == "pictures" else None

    try:
        return ThreadingHTTPServer((HOST, port), _make_handler(find))
    except OSError as error:
        raise OSError(f"port {port}: {error.strerror}; give another, or 0 for any free") from error


def write_dashboard(runs: Mapping[str, Path], path: Path) -> None:
    """Write the page with all numbers and pictures of now, and with the newest recorded game of
    each run, as one HTML file of about 5 MB, which needs neither a network nor a server.
    """
    data = read_runs([RunReader(label, folder) for label, folder in runs.items()])
    for run, folder in zip(data["runs"], runs.values(), strict=True):
        newest, run["games"] = sorted(run["games"], key=run["games"].get)[-1:], {}
        for name in newest:
            with suppress(ValueError, OSError):  # of other rules, damaged, or replaced
                run["games"][name] = make_viewer(folder / FILES["games"][0] / name).decode()
        run["pictures"] = {name: _encode(folder / name) for name in run["pictures"]}
    write_atomically(path, _make_page(data, None))


def read_plotly() -> str:
    """Return the JavaScript of Plotly. Raises ValueError without the extra `dashboard`."""
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise ValueError(
            'the dashboard draws with Plotly: pip install "marl_cair[dashboard]"'
        ) from error
    script: str = get_plotlyjs()
    return script


def make_viewer(path: Path) -> bytes:
    """The page that plays a recorded game: the game is played again, which takes some seconds."""
    replay = read_replay(path)
    return make_page(replay, pack_game(replay)).encode()


def _make_reader(runs: Mapping[str, Path]) -> Callable[[], bytes]:
    """A function that returns what the page shows as JSON: read again where a file has changed."""
    readers = [RunReader(label, folder) for label, folder in runs.items()]
    lock, known, text = Lock(), None, b""  # each request has a thread

    def read() -> bytes:
        nonlocal known, text
        with lock:
            files = [list_files(folder) for folder in runs.values()]
            if files != known:
                text = json.dumps(read_runs(readers)).encode()
                known = files
            return text

    return read


def _make_page(data: Mapping[str, Any] | None, script: str | None) -> str:
    """The page with `data`, or one that asks a server for it; Plotly is read from the address
    `script`, or is part of the page.
    """
    text = json.dumps(data).replace("<", "\\u003c")  # no script begins or ends inside of one
    plotly = f'<script src="{script}"></script>' if script else f"<script>{read_plotly()}</script>"
    page = _PAGE.read_text("utf-8").replace("/* theme */", read_theme())
    return page.replace("<!-- plotly -->", plotly).replace("/* data */ null", text)


def _encode(picture: Path) -> str:
    content = base64.b64encode(picture.read_bytes()).decode()
    return f"data:{_TYPES[picture.suffix]};base64,{content}"


def _make_handler(
    find: Callable[[str], tuple[str, bytes] | None],
) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        """Answers GET with what `find` returns."""

        def do_GET(self) -> None:
            # A page of another site could reach this server by a host name that leads here.
            host = urlsplit(f"//{self.headers.get('Host', '')}").hostname
            if host not in (HOST, "localhost"):
                self.send_error(HTTPStatus.FORBIDDEN, "open the page as http://127.0.0.1")
                return
            try:
                found = find(urlsplit(self.path).path)
            except (ValueError, OSError) as error:
                self._send(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", str(error).encode())
                return
            if found is None:
                self.send_error(HTTPStatus.NOT_FOUND)
                return
            self._send(HTTPStatus.OK, *found)

        def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Cache-Control", "no-store" if kind.endswith("json") else "no-cache")
            self.send_header("Content-Security-Policy", _GAME_POLICY if kind == _GAME else _POLICY)
            self.send_header("X-Content-Type-Options", "nosniff")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, format: str, *args: Any) -> None:
            """Print nothing: the page asks every few seconds."""

    return Handler
