"""Reads the header of Flash files: the size of the stage and the frame rate."""

from __future__ import annotations

import lzma
import zlib
from pathlib import Path
from typing import NamedTuple

_HEADER_BYTES = 64  # that hold both
_SIGNATURES = b"FWS", b"CWS", b"ZWS"  # plain, zlib, LZMA


class Header(NamedTuple):
    """Size of the stage in pixels, and frames per second."""

    size: tuple[int, int]
    fps: float


def check_signature(swf: Path) -> None:
    """Raise ValueError if a file is no Flash file, OSError if it cannot be read."""
    with swf.open("rb") as file:
        _check(str(swf), file.read(3))


def read_header(swf: Path) -> Header:
    """Raises ValueError if the file is no Flash file, OSError if it cannot be read."""
    with swf.open("rb") as file:
        data = file.read(1 << 16)
    signature, packed = data[:3], data[8:]
    _check(str(swf), signature)
    try:
        if signature == b"CWS":
            packed = zlib.decompressobj().decompress(packed, _HEADER_BYTES)
        elif signature == b"ZWS":  # a length, the properties, then a raw stream
            header = packed[4:9] + b"\xff" * 8
            packed = lzma.LZMADecompressor().decompress(header + packed[9:], _HEADER_BYTES)
        return _unpack(packed[:_HEADER_BYTES])
    except (IndexError, ValueError, zlib.error, lzma.LZMAError) as error:
        raise ValueError(f"{swf} is a damaged Flash file ({error})") from None


def _check(name: str, head: bytes) -> None:
    if head not in _SIGNATURES:
        raise ValueError(f"{name} is no Flash file: it begins with {head!r}, not FWS, CWS or ZWS")


def _unpack(packed: bytes) -> Header:
    bits = packed[0] >> 3
    whole, total = int.from_bytes(packed, "big"), 8 * len(packed)
    left, right, top, bottom = (
        (whole >> (total - 5 - bits * n)) & ((1 << bits) - 1) for n in range(1, 5)
    )  # in twentieths of a pixel
    end = (5 + 4 * bits + 7) // 8
    fps = packed[end] / 256 + packed[end + 1]
    return Header(((right - left) // 20, (bottom - top) // 20), fps)
