"""Bytes that VNC servers and clients send, for tests."""

import struct

import numpy as np

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
