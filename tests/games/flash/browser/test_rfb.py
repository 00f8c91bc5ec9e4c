"""The VNC client against a server of this file that sends exact bytes, right and wrong ones."""

import contextlib
import socket
import struct
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from marl_cair.games.flash.browser.rfb import RFBClient, RFBError
from marl_cair.lookup import UnknownNameError
from tests.games.flash.browser.rfb_bytes import (
    CHANGE,
    CHANGES_REQUEST,
    FULL_REQUEST,
    GREETING,
    HEIGHT,
    NUM_SETTINGS,
    PICTURE,
    SESSION,
    WIDTH,
    changed_picture,
    raw,
    rectangle,
    update,
)


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


def test_an_error_of_the_protocol_ends_the_client(serve):
    with RFBClient(serve(send_then_wait(SESSION, b"\xc8"))) as client:
        for call in (client.wait_for_update, client.refresh, lambda: client.press("a")):
            with pytest.raises(RFBError, match="unknown message 200 from .*, known are 0 to 3"):
                call()
        np.testing.assert_array_equal(client.frame(), PICTURE)


def test_a_refusal_closes_the_connection(serve):
    with pytest.raises(RFBError, match="refused the connection: 'too many'"):
        RFBClient(serve(send_then_wait(GREETING, b"\0", struct.pack(">I", 8), b"too many")))
