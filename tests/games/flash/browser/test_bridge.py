"""The page's server: only one page with the token gets its socket; messages of every size."""

import http.client
import os
import socket
import struct
import time

import pytest

from marl_cair.games.flash.browser.bridge import Bridge, BridgeError

MASK = b"\x12\x34\x56\x78"


@pytest.fixture
def page(tmp_path):
    path = tmp_path / "page.html"
    path.write_text("<p>A page", "utf-8")
    return path


@pytest.fixture
def bridge(page):
    with Bridge({"page.html": page}) as bridge:
        yield bridge


@pytest.fixture
def browser(bridge):
    with connect(bridge) as connection:
        assert upgrade(connection, bridge).startswith("HTTP/1.1 101 ")
        assert bridge.wait_for_page(5)
        yield connection


def connect(bridge):
    return socket.create_connection(("127.0.0.1", bridge.port), 5)


def upgrade(connection, bridge, origin=None, token=None, key="dGhlIHNhbXBsZSBub25jZQ=="):
    """Ask for the socket; return the answer's head."""
    token = bridge.address.split("/")[3] if token is None else token
    origin = f"http://127.0.0.1:{bridge.port}" if origin is None else origin
    lines = [f"GET /{token}/socket HTTP/1.1", f"Origin: {origin}", "Upgrade: websocket"]
    lines += ["Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "", ""]
    connection.sendall("\r\n".join(lines).encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        data = connection.recv(1)
        if not data:
            break
        head += data
    return head.decode()


def frame(data, kind=2, is_last=True, is_masked=True):
    """What a browser sends."""
    size = len(data)
    head = bytes([kind | 0x80 * is_last])
    flag = 0x80 * is_masked
    if size < 126:
        head += bytes([flag | size])
    elif size < 1 << 16:
        head += struct.pack(">BH", flag | 126, size)
    else:
        head += struct.pack(">BQ", flag | 127, size)
    masked = bytes(byte ^ MASK[index % 4] for index, byte in enumerate(data))
    return head + (MASK + masked if is_masked else data)


def get(bridge, path):
    connection = http.client.HTTPConnection("127.0.0.1", bridge.port, timeout=5)
    connection.request("GET", path)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def test_files_are_served_to_the_token_alone(bridge):
    folder = "/" + bridge.address.split("/", 3)[3]
    answer, body = get(bridge, f"{folder}page.html?a=b")
    assert (answer.status, body) == (200, b"<p>A page")
    for path in ("/page.html", "/", "/wrong/page.html", "//page.html", "/%00/page.html"):
        assert get(bridge, path)[0].status == 403
    for path in ("", "other.html", "../page.html", "page.html/../../../etc/passwd"):
        assert get(bridge, folder + path)[0].status == 404


def test_every_file_forbids_eval_and_other_servers(bridge):
    answer, _ = get(bridge, "/" + bridge.address.split("/", 3)[3] + "page.html")
    policy = answer.headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert f"connect-src 'self' ws://127.0.0.1:{bridge.port};" in policy
    assert "unsafe-eval" not in policy.replace("wasm-unsafe-eval", "")


@pytest.mark.parametrize("wrong", [{"origin": "http://evil.example"}, {"token": "x"}, {"key": ""}])
def test_other_pages_get_no_socket(bridge, wrong):
    with connect(bridge) as connection:
        assert upgrade(connection, bridge, **wrong).split()[1] == "403"
    assert not bridge.wait_for_page(0.05)


def test_the_accepted_key_is_that_of_the_standard(bridge):
    with connect(bridge) as connection:  # RFC 6455, section 1.3
        head = upgrade(connection, bridge)
    assert "Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo=\r\n" in head


def test_nothing_listens_after_the_page_has_connected(bridge, browser):
    with pytest.raises(ConnectionRefusedError):
        connect(bridge)


@pytest.mark.parametrize("size", [0, 1, 5, 125, 126, 65_535, 65_536, 300_001])
def test_messages_of_every_size_arrive(bridge, browser, size):
    data = os.urandom(size)
    browser.sendall(frame(data))
    assert bridge.receive(5) == data
    text = "ü" * (size // 2)
    bridge.send(text)
    expected = frame(text.encode(), kind=1, is_masked=False)
    received = b""
    while len(received) < len(expected):
        received += browser.recv(1 << 16)
    assert received == expected


def test_a_message_may_come_in_parts(bridge, browser):
    pong = frame(b"", kind=10)
    browser.sendall(frame(b"one ", is_last=False) + pong + frame(b"two", kind=0))
    assert bridge.receive(5) == b"one two"


@pytest.mark.parametrize(
    ("sent", "message"),
    [
        (frame(b"", kind=8), "closed its socket"),
        (frame(b"hello", is_masked=False), "not masked"),
        (struct.pack(">BBQ", 0x82, 0xFF, 1 << 40), "too long"),
        (frame(b"hello")[:-2], "closed its socket"),
    ],
)
def test_a_page_that_ends_or_sends_nonsense_is_an_error(bridge, browser, sent, message):
    browser.sendall(sent)
    browser.shutdown(socket.SHUT_WR)
    with pytest.raises(BridgeError, match=message):
        bridge.receive(5)


def test_a_page_that_is_silent_is_a_timeout(bridge, browser):
    start = time.monotonic()
    with pytest.raises(TimeoutError, match=r"no reply within 0.1 s"):
        bridge.receive(0.1)
    assert time.monotonic() - start < 2
    bridge.check_open()


def test_a_page_that_is_gone_is_noticed(bridge, browser):
    browser.close()
    with pytest.raises(BridgeError, match="closed its socket"):
        bridge.receive(5)
    with pytest.raises(BridgeError, match="closed its socket"):
        bridge.check_open()


def test_messages_need_a_page(bridge):
    with pytest.raises(BridgeError, match="call wait_for_page first"):
        bridge.send("hello")
