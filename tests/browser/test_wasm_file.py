"""Modules from objects: numbers, symbols, segments, and objects that cannot be modules."""

import json

import pytest

from marl_cair.browser import wasm_file
from marl_cair.browser.wasm_file import Segment, make_module

MAGIC = b"\0asm\1\0\0\0"


def section(kind, body):
    return bytes([kind, len(body)]) + body


def make_object(imported=b"__linear_memory", data=b""):
    """An object with one function, `run`, that returns 0."""
    types = b"\1\x60\0\1\x7f"
    imports = b"\1\3env" + bytes([len(imported)]) + imported + b"\2\0\1"
    code = b"\1\4\0\x41\0\x0b"
    symbols = b"\1\0\0\0\3run"  # one function: flags 0, number 0, its name
    linking = b"\7linking\2" + b"\x08" + bytes([len(symbols)]) + symbols
    sections = [section(1, types), section(2, imports), section(3, b"\1\0"), section(10, code)]
    if data:
        sections.append(section(11, data))
    return MAGIC + b"".join(sections) + section(0, linking)


RUN = """async (bytes) => {
  const memory = new WebAssembly.Memory({ initial: 1 });
  const module = await WebAssembly.compile(new Uint8Array(bytes));
  const { exports } = await WebAssembly.instantiate(module, { env: { __linear_memory: memory } });
  const note = WebAssembly.Module.customSections(module, "marl_cair")[0];
  const content = Array.from(new Uint8Array(memory.buffer, 1000, 3));
  return [exports.run(), content, new TextDecoder().decode(note)];
}"""


def test_a_browser_takes_the_module(browser):
    from tests.chromium import watched_page

    module = make_module(make_object(), ["run"], [Segment(1000, b"abc")], 64, json.dumps({"a": 1}))
    with watched_page(browser) as page:
        assert page.evaluate(RUN, list(module)) == [0, list(b"abc"), '{"a": 1}']


def test_a_function_that_is_nowhere_is_named():
    with pytest.raises(ValueError, match="the rules call cosine, which WebAssembly does not have"):
        make_module(make_object(b"cosine"), ["run"], [], 64, "")


def test_the_page_may_give_functions():
    assert make_module(make_object(b"cosine"), ["run"], [], 64, "", ["cosine"]).startswith(MAGIC)


def test_constants_that_would_meet_the_stack_are_refused():
    data = b"\1\0\x41\x08\x0b\4abcd"  # at address 8
    make_module(make_object(data=data), ["run"], [], 12, "")
    with pytest.raises(ValueError, match="constants take 12 bytes, at most 11 are free"):
        make_module(make_object(data=data), ["run"], [], 11, "")


def test_data_without_a_constant_address_is_refused():
    with pytest.raises(ValueError, match="not at constant addresses"):
        make_module(make_object(data=b"\1\1\4abcd"), ["run"], [], 64, "")


@pytest.mark.parametrize("number", [0, 1, 63, 64, 127, 128, 300, 2**32 - 1])
def test_numbers_are_read_as_they_were_written(number):
    for written in (wasm_file._number(number), wasm_file._signed(number)):
        assert wasm_file._read_number(written + b"\xff", 0) == (number, len(written))
    assert not wasm_file._signed(number)[-1] & 0x40  # the sign bit
