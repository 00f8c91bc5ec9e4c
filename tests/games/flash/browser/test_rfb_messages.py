"""The client's side of the VNC protocol, without sockets: right, wrong and damaged bytes."""

import random
import struct
import sys

import numpy as np
import pytest

from marl_cair.games.flash.browser.rfb_messages import Conversation, RFBError, encode_password
from tests.games.flash.browser.rfb_bytes import (
    CHANGE,
    FULL_REQUEST,
    GREETING,
    OPEN,
    PICTURE,
    SESSION,
    pack_init,
    raw,
    rectangle,
    update,
)

SETTINGS = b"\0\0\0\0\x20\x18\0\1\0\xff\0\xff\0\xff\0\x08\x10\0\0\0\2\0\0\3"
SETTINGS += struct.pack(">3i", 1, 0, -223)  # CopyRect, Raw, DesktopSize


def converse(data, password=None, *, with_cursor=True):
    """Feed the bytes of a server. Returns the conversation and the bytes that the client sent."""
    sent = []
    conversation = Conversation("test", sent.append, password, with_cursor=with_cursor)
    for wanted in conversation.listen():
        assert len(wanted) < 2**27
        if len(wanted) > len(data):
            break
        wanted[:] = data[: len(wanted)]
        data = data[len(wanted) :]
    return conversation, b"".join(sent)


@pytest.mark.parametrize(
    ("greeting", "log_in", "answer"),
    [
        (GREETING, OPEN, b"RFB 003.008\n\1\1"),
        (b"RFB 003.003\n", struct.pack(">I", 1), b"RFB 003.003\n\1"),
        (b"RFB 003.005\n", struct.pack(">I", 1), b"RFB 003.003\n\1"),
        (b"RFB 003.007\n", b"\2\2\1", b"RFB 003.007\n\1\1"),
        (b"RFB 003.889\n", b"\2\2\1" + bytes(4), b"RFB 003.008\n\1\1"),
        (b"RFB 005.000\n", OPEN, b"RFB 003.008\n\1\1"),
    ],
)
def test_log_in_of_each_version(greeting, log_in, answer):
    data = greeting + log_in + pack_init() + update(raw(0, 0, PICTURE))
    conversation, sent = converse(data)
    np.testing.assert_array_equal(conversation.frame, PICTURE)
    assert sent == answer + SETTINGS + FULL_REQUEST


def test_cursor_is_announced_to_keep_it_out_of_the_frame():
    shape = rectangle(0, 0, 9, 2, -239, bytes(9 * 2 * 4 + 2 * 2))
    data = GREETING + OPEN + pack_init() + update(shape, raw(0, 0, PICTURE))
    conversation, sent = converse(data, with_cursor=False)
    np.testing.assert_array_equal(conversation.frame, PICTURE)
    assert struct.pack(">BxH4i", 2, 4, 1, 0, -223, -239) in sent


def test_overlapping_areas_are_copied_and_other_messages_are_skipped():
    skipped = (
        b"\2" + struct.pack(">BxHH", 1, 0, 2) + bytes(12) + struct.pack(">B3xI", 3, 5) + b"hello"
    )
    copy = rectangle(1, 1, 5, 3, 1, struct.pack(">HH", 0, 0))
    expected = PICTURE.copy()
    expected[1:4, 1:6] = PICTURE[:3, :5]
    conversation, _ = converse(SESSION + skipped + update(copy))
    np.testing.assert_array_equal(conversation.frame, expected)
    assert conversation.num_updates == 2


def test_a_frame_of_a_new_size_is_requested_until_it_is_whole():
    resized = update(rectangle(0, 0, 3, 2, -223))
    whole = struct.pack(">BBHHHH", 3, 0, 0, 0, 3, 2)
    conversation, sent = converse(SESSION + resized)
    np.testing.assert_array_equal(conversation.frame, PICTURE)
    assert sent.endswith(FULL_REQUEST + whole)
    # A copy from what is not known stays unknown.
    copy = rectangle(0, 1, 3, 1, 1, struct.pack(">HH", 0, 1))
    conversation, sent = converse(SESSION + resized + update(raw(0, 0, CHANGE[:1]), copy))
    np.testing.assert_array_equal(conversation.frame, PICTURE)
    assert sent.endswith(FULL_REQUEST + whole + whole)
    conversation, sent = converse(SESSION + resized + update(raw(0, 0, CHANGE)))
    np.testing.assert_array_equal(conversation.frame, CHANGE)
    assert sent.endswith(FULL_REQUEST + whole)


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
def test_violations_of_the_protocol(message):
    pattern = message.replace("(", r"\(").replace(")", r"\)")
    with pytest.raises(RFBError, match=pattern):
        converse(SESSION + VIOLATIONS[message])


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
def test_refusals(message):
    with pytest.raises(RFBError, match=message):
        converse(REFUSALS[message])


def test_password_without_cryptography(monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography.hazmat.primitives.ciphers", None)
    monkeypatch.setitem(sys.modules, "cryptography", None)
    with pytest.raises(RFBError, match=r"pip install 'marl_cair\[vnc\]'"):
        converse(GREETING + b"\1\2" + bytes(16), encode_password("secret"))


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
