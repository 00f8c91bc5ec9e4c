"""Serves the folder of a page on loopback."""

from __future__ import annotations

from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

LOOPBACK = "127.0.0.1"


class _Files(SimpleHTTPRequestHandler):
    """The files of a folder; anything outside of it is not found."""

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "no-cache")  # the folder may be written again
        super().end_headers()

    def log_message(self, format: str, *arguments: object) -> None:
        """Print nothing."""


def make_server(folder: Path, port: int = 0) -> ThreadingHTTPServer:
    """A server of `folder` on 127.0.0.1; port 0 takes a free one. Raises OSError if it is taken."""
    return ThreadingHTTPServer((LOOPBACK, port), partial(_Files, directory=str(folder)))
