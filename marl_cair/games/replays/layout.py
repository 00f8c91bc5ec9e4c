"""The layout of replay files: a line of JSON (the head) and records, each appended whole.

kind 1 byte | bytes of the payload u32 | CRC-32 of the rest u32 | payload

A file holds the games that begin together on one engine, one or many. Hashes and ends come before
the steps in which they are: where a tear parts them, the game counts as cut off.

s  number of steps so far u32 | the next bytes of one deflate stream: the new steps, game after
   game. A step of a game is the actions of all seats, in the smallest unsigned type, then the
   values of viewers, float16, in the order of their names
v  names and shapes of these values, as JSON
h  game u32 | number of steps so far u32 | hash of the state after them
e  the end of a game: its number u32 | its number of steps u32 | its winner i8, -1 for none. Steps
   after it do not belong to the game
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from marl_cair.games.game import GameSpec

REPLAY_SUFFIX = ".replay"
FORMAT, FORMAT_VERSION = "marl_cair replay", 2
STEPS, VALUES, HASH, END = b"s", b"v", b"h", b"e"
HASH_BYTES = 8
COUNTED = struct.Struct("<I")
ENDED = struct.Struct("<IIb")
HASHED = struct.Struct(f"<II{HASH_BYTES}s")
_FRAME = struct.Struct("<cII")
_CHECKED = struct.Struct("<cI")  # of a frame, beside the payload


def pack_record(kind: bytes, payload: bytes) -> bytes:
    """One record."""
    return _FRAME.pack(kind, len(payload), _checksum(kind, payload)) + payload


def list_records(body: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and payload of each record up to the tear, if there is one. Raises ValueError where a
    checksum differs.
    """
    at = 0
    while at + _FRAME.size <= len(body) and any(body[at : at + _FRAME.size]):
        kind, size, checksum = _FRAME.unpack_from(body, at)
        end = at + _FRAME.size + size
        if end > len(body):
            return
        payload = body[at + _FRAME.size : end]
        if _checksum(kind, payload) != checksum:
            if not any(body[end - 1 :]):  # some disks fill a tear with zeros
                return
            raise ValueError(f"the record at byte {at} after the head has another checksum")
        yield kind, payload
        at = end


def _checksum(kind: bytes, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(_CHECKED.pack(kind, len(payload))))


def step_type(spec: GameSpec, shapes: Mapping[str, tuple[int, ...]]) -> np.dtype[Any]:
    """One step as it is packed."""
    values = np.dtype([(name, "<f2", shape) for name, shape in shapes.items()])
    shape = (spec.num_players, *spec.action_shape)
    return np.dtype([("actions", action_type(spec), shape), ("values", values)])


def action_type(spec: GameSpec) -> np.dtype[Any]:
    """The smallest type that holds all actions."""
    return np.min_scalar_type(spec.num_actions - 1).newbyteorder("<")
