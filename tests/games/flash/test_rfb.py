"""The VNC client against a server of this file that sends exact bytes, right and wrong ones."""

import contextlib
import random
import socket
import struct
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from marl_cair.games.flash.rfb import RFBClient, RFBError
from marl_cair.games.flash.rfb_messages import Conversation, encode_password
from marl_cair.lookup import UnknownNameError

WIDTH, HEIGHT = 6, 4
GREETING = b"RFB 003.008\n"
OPEN = b"\1\1" + bytes(4)  # one security type, none; log-in is right
PICTURE = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
FULL_REQUEST = struct.pack(">BBHHHH", 3, 0, 0, 0, WIDTH, HEIGHT)
CHANGES_REQUEST = struct.pack(">BBHHHH", 3, 1, 0, 0, WIDTH, HEIGHT)
NUM_SETTINGS = 20 + 16  # bytes of SetPixelFormat and SetEncodings


def pack_init(width=WIDTH, height=HEIGHT, name=b"test"):
    return struct.pack(">HH16xI", width, height, len(name)) + name


def rectangle(x, y, width, height, encoding, data=b""):
    return struct.pack(">HHHHi", x, y, width, height, encoding) + data


def raw(x, y, pixels):
    height, width = pixels.shape[:2]
    wire = np.full((height, width, 4), 77, np.uint8)
    wire[..., :3] = pixels
    return rectangle(x, y, width, height, 0, wire.tobytes())


def update(*rectangles):
    return struct.pack(">BxH", 0, len(rectangles)) + b"".join(rectangles)


SESSION = GREETING + OPEN + pack_init() + update(raw(0, 0, PICTURE))
CHANGE = np.full((2, 3, 3), 9, np.uint8)


def changed_picture():
    picture = PICTURE.copy()
    picture[1:3, 2:5] = CHANGE
    return picture


def receive(connection, num_bytes):
    connection.settimeout(5)
    data = b""
    while len(data) < num_bytes:
        chunk = connection.recv(num_bytes - len(data))
        assert chunk, f"the client closed after {data!r}"
        data += chunk
    return data


def receive_log_in(connection):
    return receive(connection, 12 + 1 + 1 + NUM_SETTINGS + 10)


@pytest.fixture
def serve(tmp_path):
    """Start a server that calls `talk(connection)` for one client; returns its address."""
    errors, threads = [], []

    def start(talk):
        path = tmp_path / "rfb.sock"
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(str(path))
        listener.listen()

        def run():
            with listener, contextlib.suppress(ConnectionError):
                listener.settimeout(5)
                connection, _ = listener.accept()
                with connection:
                    try:
                        talk(connection)
                    except (AssertionError, TimeoutError) as error:
                        errors.append(error)

        threads.append(threading.Thread(target=run))
        threads[-1].start()
        return path

    yield start
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
    assert errors == []


def drain(connection):
    """Wait until the client closes."""
    connection.settimeout(5)
    while connection.recv(4096):
        pass


def send_then_wait(*messages):
    """A server that sends all at once."""

    def talk(connection):
        connection.sendall(b"".join(messages))
        drain(connection)

    return talk


def test_log_in_and_input_are_byte_exact(serve):
    settings = b"\0\0\0\0\x20\x18\0\1\0\xff\0\xff\0\xff\0\x08\x10\0\0\0\2\0\0\3"
    settings += struct.pack(">3i", 1, 0, -223)
    log_in = GREETING + b"\1" + b"\1" + settings + FULL_REQUEST
    keys = [(4, 1, 0xFF51), (4, 0, 0xFF51), (4, 1, 0x61), (4, 0, 0x61)]
    mouse = [(0, 5, 3), (1, 5, 3), (0, 5, 3), (0, 1, 2), (4, 1, 2), (0, 1, 2)]
    events = [struct.pack(">BBxxI", *key) for key in keys]
    events += [struct.pack(">BBHH", 5, *event) for event in mouse]

    def talk(connection):
        connection.sendall(SESSION)
        assert receive(connection, len(log_in)) == log_in
        for event in events:
            assert receive(connection, len(event)) == event

    with RFBClient(serve(talk)) as client:
        assert (client.width, client.height) == (WIDTH, HEIGHT)
        np.testing.assert_array_equal(client.frame(), PICTURE)
        client.press("left")
        client.release("left")
        client.tap("a")
        client.move(5, 3)
        client.mouse_down()
        client.mouse_up()
        client.click(1, 2, "right")


def test_cursor_is_announced_to_keep_it_out_of_the_frame(serve):
    shape = rectangle(0, 0, 9, 2, -239, bytes(9 * 2 * 4 + 2 * 2))

    def talk(connection):
        connection.sendall(GREETING + OPEN + pack_init() + update(shape, raw(0, 0, PICTURE)))
        settings = receive(connection, 12 + 1 + 1 + NUM_SETTINGS + 4)
        assert settings.endswith(struct.pack(">BxH4i", 2, 4, 1, 0, -223, -239))
        drain(connection)

    with RFBClient(serve(talk), with_cursor=False) as client:
        np.testing.assert_array_equal(client.frame(), PICTURE)


@pytest.mark.parametrize(
    ("greeting", "answer", "log_in"),
    [
        (b"RFB 003.003\n", b"RFB 003.003\n\1", struct.pack(">I", 1)),
        (b"RFB 003.005\n", b"RFB 003.003\n\1", struct.pack(">I", 1)),
        (b"RFB 003.007\n", b"RFB 003.007\n\1\1", b"\2\2\1"),
        (b"RFB 003.889\n", b"RFB 003.008\n\1\1", b"\2\2\1" + bytes(4)),
        (b"RFB 005.000\n", b"RFB 003.008\n\1\1", OPEN),
    ],
)
def test_other_versions_of_the_protocol(serve, greeting, answer, log_in):
    def talk(connection):
        connection.sendall(greeting + log_in + pack_init() + update(raw(0, 0, PICTURE)))
        assert receive(connection, len(answer)) == answer
        drain(connection)

    with RFBClient(serve(talk)) as client:
        np.testing.assert_array_equal(client.frame(), PICTURE)


def test_messages_torn_into_bytes(serve):
    def talk(connection):
        for byte in SESSION + b"\2" + update(raw(2, 1, CHANGE)):
            connection.sendall(bytes([byte]))
            time.sleep(0.0005)
        drain(connection)

    with RFBClient(serve(talk)) as client:
        np.testing.assert_array_equal(client.frame(), PICTURE)
        np.testing.assert_array_equal(client.wait_for_update(), changed_picture())


def test_a_message_that_a_timeout_interrupts_continues_in_the_next_call(serve):
    message = update(raw(2, 1, CHANGE))
    is_late = threading.Event()

    def talk(connection):
        connection.sendall(SESSION + message[:25])
        receive_log_in(connection)
        assert is_late.wait(5)
        connection.sendall(message[25:])
        assert receive(connection, 10) == CHANGES_REQUEST  # not requested twice

    with RFBClient(serve(talk)) as client:
        with pytest.raises(TimeoutError, match=r"no update from .*rfb.sock in 0.05 s"):
            client.wait_for_update(0.05)
        np.testing.assert_array_equal(client.frame(), PICTURE)
        is_late.set()
        np.testing.assert_array_equal(client.wait_for_update(), changed_picture())


def test_what_moves_is_copied_and_other_messages_are_skipped(serve):
    skipped = (
        b"\2" + struct.pack(">BxHH", 1, 0, 2) + bytes(12) + struct.pack(">B3xI", 3, 5) + b"hello"
    )
    copy = rectangle(1, 1, 5, 3, 1, struct.pack(">HH", 0, 0))  # source and target overlap
    with RFBClient(serve(send_then_wait(SESSION, skipped, update(copy)))) as client:
        expected = PICTURE.copy()
        expected[1:4, 1:6] = PICTURE[:3, :5]
        np.testing.assert_array_equal(client.wait_for_update(), expected)


def test_a_frame_of_a_new_size_is_requested_whole(serve):
    whole = struct.pack(">BBHHHH", 3, 0, 0, 0, 3, 2)

    def talk(connection):
        connection.sendall(SESSION)
        receive_log_in(connection)
        assert receive(connection, 10) == CHANGES_REQUEST
        connection.sendall(update(rectangle(0, 0, 3, 2, -223)))
        assert receive(connection, 10) == whole
        connection.sendall(update(raw(0, 0, CHANGE[:1])))  # half of it
        assert receive(connection, 10) == whole
        connection.sendall(update(raw(0, 0, CHANGE)))

    with RFBClient(serve(talk)) as client:
        np.testing.assert_array_equal(client.wait_for_update(), CHANGE)
        assert (client.width, client.height) == (3, 2)
        with pytest.raises(ValueError, match="x is 5, it must be from 0 to 2"):
            client.move(5, 0)


def test_refresh_takes_no_old_changes_for_the_whole(serve):
    def talk(connection):
        connection.sendall(SESSION)
        receive_log_in(connection)
        assert receive(connection, 20) == CHANGES_REQUEST + FULL_REQUEST
        connection.sendall(update(raw(2, 1, CHANGE)))
        assert receive(connection, 10) == FULL_REQUEST
        connection.sendall(update(raw(0, 0, PICTURE)))

    with RFBClient(serve(talk)) as client:
        with pytest.raises(TimeoutError):
            client.wait_for_update(0.02)
        np.testing.assert_array_equal(client.refresh(), PICTURE)


VIOLATIONS = {
    "a rectangle of 3x2 pixels at (4, 0) from .* is outside the frame of 6x4": update(
        raw(4, 0, CHANGE)
    ),
    "a rectangle of 2x2 pixels at (65535, 3) .* outside the frame of 6x4": update(
        rectangle(0, 0, 2, 2, 1, struct.pack(">HH", 65535, 3))
    ),
    "has a frame of 65535x65535 pixels, it must be of 1 to 16777216": update(
        rectangle(0, 0, 65535, 65535, -223)
    ),
    "has a frame of 0x9 pixels": update(rectangle(0, 0, 0, 9, -223)),
    "a cursor of 1025x1 pixels, at most 1024 a side": update(rectangle(0, 0, 1025, 1, -239)),
    "encoding 16 from .* was not asked for": update(rectangle(0, 0, 1, 1, 16)),
    "unknown message 200 from .*, known are 0 to 3": b"\xc8",
    "a clipboard of 4294967295 bytes, at most 1048576": struct.pack(">B3xI", 3, 2**32 - 1),
}


@pytest.mark.parametrize("message", VIOLATIONS)
def test_violations_of_the_protocol_end_the_client(serve, message):
    pattern = message.replace("(", r"\(").replace(")", r"\)")
    with RFBClient(serve(send_then_wait(SESSION, VIOLATIONS[message]))) as client:
        for _ in range(2):
            with pytest.raises(RFBError, match=pattern):
                client.wait_for_update()
        with pytest.raises(RFBError, match=pattern):
            client.press("a")
        np.testing.assert_array_equal(client.frame(), PICTURE)


REFUSALS = {
    "is no VNC server, it begins with b'HTTP/1.1 400'": b"HTTP/1.1 400 Bad Request",
    "is no VNC server, it begins with b'RFB 003.002": b"RFB 003.002\n",
    "refused the connection: 'too many'": GREETING + b"\0" + struct.pack(">I", 8) + b"too many",
    "refused the connection: 'full'": b"RFB 003.003\n" + struct.pack(">II", 0, 4) + b"full",
    "refused the log-in: 'no'": GREETING + b"\1\1" + struct.pack(">II", 1, 2) + b"no",
    "a reason of 4294967295 bytes": GREETING + b"\0" + b"\xff" * 4,
    r"offers the security types \[2, 19\]: without a password it must": GREETING + b"\2\2\x13",
    "has a frame of 0x0 pixels": GREETING + OPEN + pack_init(0, 0),
    "has a frame of 65535x300 pixels": GREETING + OPEN + pack_init(65535, 300),
    "a name of 2097152 bytes": GREETING + OPEN + struct.pack(">HH16xI", 6, 4, 2**21),
}


@pytest.mark.parametrize("message", REFUSALS)
def test_refusals(serve, message):
    with pytest.raises(RFBError, match=message):
        RFBClient(serve(send_then_wait(REFUSALS[message])))


@pytest.mark.parametrize("num_bytes", [0, 5, 12, 13, 16, 20, 45, 70])
def test_a_server_that_closes_in_the_log_in(serve, num_bytes):
    def talk(connection):
        connection.sendall(SESSION[:num_bytes])
        connection.shutdown(socket.SHUT_WR)
        drain(connection)

    with pytest.raises(RFBError, match="closed the connection: no (greeting|answer|update)"):
        RFBClient(serve(talk))


@pytest.mark.parametrize("num_bytes", [0, 5, 13, 70])
def test_a_server_that_stalls_in_the_log_in(serve, num_bytes):
    with pytest.raises(TimeoutError, match="no (greeting|answer to the log-in|update) .* in 0.1 s"):
        RFBClient(serve(send_then_wait(SESSION[:num_bytes])), timeout_s=0.1)


def test_a_trickling_server_does_not_extend_the_limit(serve):
    def talk(connection):
        connection.sendall(SESSION)
        with contextlib.suppress(OSError):
            for _ in range(500):
                connection.sendall(b"\2")
                time.sleep(0.01)

    with RFBClient(serve(talk)) as client:
        began = time.monotonic()
        with pytest.raises(TimeoutError):
            client.wait_for_update(0.2)
        assert time.monotonic() - began < 1


def test_a_server_that_takes_no_input(serve):
    is_done = threading.Event()

    def talk(connection):
        connection.sendall(SESSION)
        assert is_done.wait(5)

    with RFBClient(serve(talk), timeout_s=0.2) as client:

        def type_for_ever():
            while True:
                client.tap("a")

        with pytest.raises(TimeoutError, match="took no message in 0.2 s: the client gave up"):
            type_for_ever()
        with pytest.raises(RFBError, match="took no message in 0.2 s"):
            client.tap("a")
    is_done.set()


def run_in_threads(*calls):
    """Call each in a thread; returns the threads and the list that their results go to."""
    results = []

    def run(call):
        try:
            results.append(call())
        except OSError as error:
            results.append(error)

    threads = [threading.Thread(target=run, args=[call]) for call in calls]
    for thread in threads:
        thread.start()
    return threads, results


def test_input_is_sent_while_threads_wait_for_one_update(serve):
    def talk(connection):
        connection.sendall(SESSION)
        receive_log_in(connection)
        assert receive(connection, 10) == CHANGES_REQUEST
        assert receive(connection, 8) == struct.pack(">BBxxI", 4, 1, 0x20)
        connection.sendall(update(raw(2, 1, CHANGE)))
        receive(connection, 10)

    with RFBClient(serve(talk)) as client:
        threads, frames = run_in_threads(*[client.wait_for_update] * 3)
        time.sleep(0.1)
        client.press("space")
        for thread in threads:
            thread.join(5)
        assert len(frames) == 3
        for frame in frames:
            np.testing.assert_array_equal(frame, changed_picture())


def test_a_waiting_thread_has_a_limit_and_close_ends_all(serve):
    client = RFBClient(serve(send_then_wait(SESSION)))
    threads, results = run_in_threads(client.wait_for_update)
    time.sleep(0.1)
    with pytest.raises(TimeoutError, match="other threads waited for frames all the 0.05 s"):
        client.refresh(0.05)
    began = time.monotonic()
    client.close()
    threads[0].join(5)
    assert time.monotonic() - began < 1
    assert isinstance(results[0], RFBError)
    client.close()
    for call in (client.refresh, lambda: client.press("a"), client.wait_for_update):
        with pytest.raises(RFBError, match="the client is closed"):
            call()


def test_frames_belong_to_the_caller(serve):
    with RFBClient(serve(send_then_wait(SESSION))) as client:
        client.frame()[:] = 0
        np.testing.assert_array_equal(client.frame(), PICTURE)


def test_bad_arguments(serve):
    for timeout_s in (0, -1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="timeout_s is .*, it must be above 0"):
            RFBClient(Path("unused"), timeout_s=timeout_s)
    with pytest.raises(ValueError, match="only characters of Latin-1"):
        RFBClient(Path("unused"), password=chr(0x20AC))
    with RFBClient(serve(send_then_wait(SESSION))) as client:
        with pytest.raises(UnknownNameError, match="unknown key 'entre': nearest are 'enter'"):
            client.tap("entre")
        with pytest.raises(UnknownNameError, match="unknown mouse button 'lift'"):
            client.click(0, 0, "lift")
        with pytest.raises(ValueError, match="y is -1, it must be from 0 to 3"):
            client.click(0, -1)


def test_no_server(tmp_path):
    with pytest.raises(RFBError, match=r"no connection to .*none.sock: .*No such file"):
        RFBClient(tmp_path / "none.sock")
    with pytest.raises(RFBError, match="no connection to .*path too long"):
        RFBClient(tmp_path / ("x" * 200))
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
    with pytest.raises(RFBError, match="no connection to .*refused"):
        RFBClient(address)


def test_password_without_cryptography(serve, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography.hazmat.primitives.ciphers", None)
    monkeypatch.setitem(sys.modules, "cryptography", None)
    server = serve(send_then_wait(GREETING, b"\1\2", bytes(16)))
    with pytest.raises(RFBError, match=r"pip install 'marl_cair\[vnc\]'"):
        RFBClient(server, password="x" * 8)


def test_password_key_has_the_bits_of_each_byte_reversed():
    assert encode_password("\x01\x80A") == b"\x80\x01\x82" + bytes(5)
    assert encode_password("123456789") == encode_password("12345678")


def test_damaged_bytes_raise_only_rfb_errors_and_need_little_memory():
    valid = bytearray(
        SESSION
        + update(raw(2, 1, CHANGE), rectangle(1, 1, 5, 3, 1, bytes(4)))
        + update(rectangle(0, 0, 3, 2, -223), rectangle(0, 0, 9, 2, -239, bytes(76)))
    )
    draw = random.Random(0)
    num_errors = 0
    for _ in range(2000):
        data = bytearray(valid)
        for _ in range(draw.randint(1, 4)):
            data[draw.randrange(len(data))] = draw.choice([0, 1, 127, 255, draw.randrange(256)])
        try:
            converse(bytes(data))
        except RFBError:
            num_errors += 1
    assert 500 < num_errors < 2000


def converse(data):
    """Feed the bytes of a server to the client's protocol."""
    messages = Conversation("test", lambda _: None, None, with_cursor=False).listen()
    for wanted in messages:
        assert len(wanted) < 2**27
        if len(wanted) > len(data):
            return
        wanted[:] = data[: len(wanted)]
        data = data[len(wanted) :]
