"""Serves the game's page on 127.0.0.1 and exchanges messages with it over one WebSocket (RFC 6455).

Every address begins with a random token, and the socket takes one page, of the same origin. After
that page has connected nothing listens any more.

Why not the package `websockets` (17.4): a step with a picture of 84 x 84 took 15 % more processor
time (3.6 ms instead of 3.1, browser included; medians of 12 runs in turns), because a thread of its
own reads the messages. Its server also cannot stop listening and keep a page.
"""

from __future__ import annotations

import base64
import hashlib
import secrets
import select
import socket
import struct
import threading
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Self

import numpy as np

_TYPES = {".html": "text/html", ".js": "text/javascript", ".wasm": "application/wasm"}
_POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src 'self' {socket}; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'; sandbox allow-scripts allow-same-origin"
)
_KEY_SUFFIX = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # of RFC 6455
_TEXT, _CLOSE, _PING, _PONG = 1, 8, 9, 10
_MAX_MESSAGE = 1 << 28  # bytes


class BridgeError(ConnectionError):
    """The page closed its socket, or sent what is no message."""


class Bridge:
    """The page's server and, once the page has connected, its socket.

    files: name in the address -> file; "socket" is the WebSocket.
    """

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._server = _Server(files)
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), daemon=True
        )
        self._thread.start()
        self._page: socket.socket | None = None

    @property
    def address(self) -> str:
        """Address of the folder that holds the files; it ends with a slash."""
        return f"{self._server.origin}/{self._server.token}/"

    @property
    def port(self) -> int:
        return self._server.server_port

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait_for_page(self, timeout_s: float) -> bool:
        """Whether the page has connected within this time; then nothing listens any more."""
        if self._page is None and self._server.has_page.wait(timeout_s):
            self._page = self._server.page
            self._stop_listening()
        return self._page is not None

    def _stop_listening(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def close(self) -> None:
        """End the page's socket, and the server if it still listens."""
        if self._page is None:
            self._stop_listening()
        if self._server.page is not None:
            self._server.page.close()

    def check_open(self) -> None:
        """Raise BridgeError if the page is gone. Only for a page that has nothing to send."""
        if select.select([self._connected()], [], [], 0)[0]:
            raise BridgeError("the page closed its socket")

    def send(self, text: str) -> None:
        """Send one text message. Raises BridgeError when the page is gone."""
        data = text.encode()
        if len(data) < 126:
            head = struct.pack(">BB", 0x80 | _TEXT, len(data))
        elif len(data) < 1 << 16:
            head = struct.pack(">BBH", 0x80 | _TEXT, 126, len(data))
        else:
            head = struct.pack(">BBQ", 0x80 | _TEXT, 127, len(data))
        try:
            self._connected().sendall(head + data)
        except OSError as error:
            raise BridgeError(f"the page closed its socket ({error})") from error

    def receive(self, timeout_s: float) -> bytearray:
        """The next message. Raises BridgeError when the page is gone, TimeoutError."""
        message = bytearray()
        while True:
            is_last, kind, data = self._receive_frame(timeout_s)
            if kind == _CLOSE:
                raise BridgeError("the page closed its socket")
            if kind in (_PING, _PONG):
                continue  # browsers send none
            if is_last and not message:
                return data
            message += data
            if is_last:
                return message

    def _receive_frame(self, timeout_s: float) -> tuple[bool, int, bytearray]:
        first, second = self._read(2, timeout_s)
        size = second & 0x7F
        if size == 126:
            (size,) = struct.unpack(">H", self._read(2, timeout_s))
        elif size == 127:
            (size,) = struct.unpack(">Q", self._read(8, timeout_s))
        if not second & 0x80 or size > _MAX_MESSAGE:
            raise BridgeError(
                f"the page sent a frame of {size} bytes that is too long or not masked"
            )
        mask = np.frombuffer(self._read(4, timeout_s), np.uint32)
        data = self._read(size, timeout_s)
        padding = -size % 4
        data += bytes(padding)
        words = np.frombuffer(data, np.uint32)
        words ^= mask
        del words  # a bytearray that is looked at cannot shrink
        del data[size:]
        return bool(first & 0x80), first & 0x0F, data

    def _read(self, size: int, timeout_s: float) -> bytearray:
        page, data = self._connected(), bytearray(size)
        page.settimeout(timeout_s)
        view = memoryview(data)
        while view:
            try:
                count = page.recv_into(view)
            except TimeoutError:
                raise TimeoutError(f"the page sent no reply within {timeout_s:g} s") from None
            except OSError as error:
                raise BridgeError(f"the page closed its socket ({error})") from error
            if count == 0:
                raise BridgeError("the page closed its socket")
            view = view[count:]
        return data

    def _connected(self) -> socket.socket:
        if self._page is None:
            raise BridgeError("the page has not connected; call wait_for_page first")
        return self._page


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, files: Mapping[str, Path]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.files = files
        self.token = secrets.token_urlsafe(24)
        self.origin = f"http://127.0.0.1:{self.server_port}"
        self.page: socket.socket | None = None
        self.has_page = threading.Event()
        self.lock = threading.Lock()

    def shutdown_request(self, request: Any) -> None:
        if request is not self.page:  # the page's socket stays open
            super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that ends drops its connections."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    timeout = 10.0  # seconds; browsers open connections ahead and may never use them

    def do_GET(self) -> None:
        _, token, name = [*self.path.partition("?")[0].split("/", 2), "", ""][:3]
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif name == "socket":
            self._take_socket()
        elif name in self.server.files:
            self._send_file(self.server.files[name])
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _send_file(self, path: Path) -> None:
        data = path.read_bytes()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", _TYPES.get(path.suffix, "application/octet-stream"))
        self.send_header("Content-Length", str(len(data)))
        web_socket = self.server.origin.replace("http", "ws")
        self.send_header("Content-Security-Policy", _POLICY.format(socket=web_socket))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        self.wfile.write(data)

    def _take_socket(self) -> None:
        key = self.headers.get("Sec-WebSocket-Key", "")
        is_ours = self.headers.get("Origin") == self.server.origin
        is_upgrade = self.headers.get("Upgrade", "").lower() == "websocket" and key
        with self.server.lock:
            if not (is_ours and is_upgrade) or self.server.page is not None:
                self.send_error(HTTPStatus.FORBIDDEN)
                return
            self.server.page = self.connection
        digest = hashlib.sha1(key.encode() + _KEY_SUFFIX, usedforsecurity=False).digest()
        self.protocol_version = "HTTP/1.1"
        self.send_response(HTTPStatus.SWITCHING_PROTOCOLS)
        self.send_header("Upgrade", "websocket")
        self.send_header("Connection", "Upgrade")
        self.send_header("Sec-WebSocket-Accept", base64.b64encode(digest).decode())
        self.end_headers()
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.server.has_page.set()

    def log_message(self, format: str, *arguments: Any) -> None:
        """The page's requests are of no interest to users."""
