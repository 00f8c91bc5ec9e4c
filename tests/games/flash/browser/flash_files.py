"""Flash files of tests, and what playing them needs, skipped when it is not installed."""

import shutil
import struct
from pathlib import Path

import pytest

from marl_cair.games.flash.browser import server
from marl_cair.games.flash.browser.installing import diagnose
from tests.games.flash.browser.vnc_servers import IS_NEEDED

PROBE = Path(__file__).parent / "probe" / "probe.swf"  # see Probe.hx
SIZE = (480, 360)


def need_flash() -> None:
    missing = diagnose()
    if missing:
        reason = ", ".join(f"{part.name} is missing: {part.command}" for part in missing)
        if IS_NEEDED:
            pytest.fail(reason)
        pytest.skip(reason)


def change_page(folder: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str) -> None:
    """Give the next browsers a page with a part of player.js replaced."""
    page = shutil.copytree(server._PAGE, folder / "page")
    text = (page / "player.js").read_text("utf-8")
    assert old in text
    (page / "player.js").write_text(text.replace(old, new), "utf-8")
    monkeypatch.setattr(server, "_PAGE", page)


def pack_timeline(num_frames: int) -> bytes:
    """A Flash 5 file without scripts: in frame n, from 0, a red square of 40 pixels is at 40 n."""
    side = 40 * 20  # twips
    square = [(1, 4), (0, 4), (0b000101, 6), (1, 5), (0, 1), (0, 1), (1, 1)]
    for change in ((side, 0), (0, side), (-side, 0), (0, -side)):
        square += [(0b11, 2), (13, 4), (1, 1), *((part, 15) for part in change)]
    fill = b"\1\0\xcc\x22\0\0"  # one, plain; no lines
    shape = struct.pack("<H", 1) + _pack_box(side, side) + fill + _pack_bits(*square, (0, 6))
    body = _pack_box(SIZE[0] * 20, SIZE[1] * 20) + struct.pack("<BBH", 0, 30, num_frames)
    body += _pack_tag(9, b"\xff\xff\xff") + _pack_tag(2, shape)
    for frame in range(num_frames):
        place = struct.pack("<BHH", 6, 1, 1) if frame == 0 else struct.pack("<BH", 5, 1)
        shift = _pack_bits((0, 2), (15, 5), (frame * side, 15), (0, 15))
        body += _pack_tag(26, place + shift) + _pack_tag(1)
    body += _pack_tag(0)
    return b"FWS\5" + struct.pack("<I", 8 + len(body)) + body


def _pack_tag(code: int, data: bytes = b"") -> bytes:
    return struct.pack("<HI", code << 6 | 63, len(data)) + data


def _pack_box(width: int, height: int) -> bytes:
    return _pack_bits((15, 5), (0, 15), (width, 15), (0, 15), (height, 15))


def _pack_bits(*fields: tuple[int, int]) -> bytes:
    """Numbers, each with its count of bits, filled up to a whole byte."""
    text = "".join(format(value % (1 << count), f"0{count}b") for value, count in fields)
    text += "0" * (-len(text) % 8)
    return int(text, 2).to_bytes(len(text) // 8, "big")
