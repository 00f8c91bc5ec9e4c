"""Size and frame rate of Flash files, plain and packed, and files that are none."""

import lzma
import struct
import zlib

import pytest

from marl_cair.games.flash.browser.swf_header import check_signature, read_header
from marl_cair.games.flash.description import FOLDER

MULTITASK = (FOLDER / "multitask.swf").read_bytes()
PLAIN = b"FWS" + MULTITASK[3:8] + zlib.decompress(MULTITASK[8:])


def pack_lzma(plain):
    packed = lzma.compress(plain[8:], lzma.FORMAT_ALONE)  # 5 bytes of properties, 8 of the size
    return b"ZWS" + plain[3:8] + struct.pack("<I", len(packed) - 13) + packed[:5] + packed[13:]


@pytest.fixture
def swf(tmp_path):
    return tmp_path / "game.swf"


@pytest.mark.parametrize(
    "data", [MULTITASK, PLAIN, pack_lzma(PLAIN)], ids=["zlib", "plain", "LZMA"]
)
def test_size_and_rate_are_in_the_file(swf, data):
    swf.write_bytes(data)
    check_signature(swf)
    assert read_header(swf) == ((480, 360), 30.0)


@pytest.mark.parametrize("data", [b"", b"GIF89a" * 9])
def test_other_files_are_refused_by_name(swf, data):
    swf.write_bytes(data)
    for read in (check_signature, read_header):
        with pytest.raises(ValueError, match=r"game\.swf is no Flash file: it begins with"):
            read(swf)


@pytest.mark.parametrize("data", [b"FWS", b"CWS12345junk", b"ZWS12345junk", PLAIN[:12]])
def test_damaged_files_are_refused_by_name(swf, data):
    swf.write_bytes(data)
    with pytest.raises(ValueError, match=r"game\.swf is a damaged Flash file"):
        read_header(swf)
