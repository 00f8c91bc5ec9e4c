"""Makes a WebAssembly module of a relocatable object: exports, and the first content of memory.

LLVM writes an object as a module that is valid in itself: its functions call one another by their
final numbers, and its data lies from address 0 on. One object needs no linker, only names for
what it exports. See "Linking.md" of github.com/WebAssembly/tool-conventions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

_MAGIC = b"\0asm\1\0\0\0"
_CUSTOM, _IMPORT, _EXPORT, _CODE, _DATA, _DATA_COUNT = 0, 2, 7, 10, 11, 12
_ORDER = (1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 10, 11)  # of sections in a module
_SYMBOL_TABLE = 8  # a part of the section "linking"
_FUNCTION = 0  # the kind of a symbol and of an export
_UNDEFINED, _NAMED = 0x10, 0x40  # flags of a symbol
NOTE = "marl_cair"
MEMORY, STACK, TABLE = "__linear_memory", "__stack_pointer", "__indirect_function_table"


class Segment(NamedTuple):
    """Bytes that lie at an address when the module starts."""

    address: int
    content: bytes


def make_module(
    code: bytes,
    names: Sequence[str],
    segments: Sequence[Segment],
    data_limit: int,
    note: str,
    given: Collection[str] = (),
) -> bytes:
    """The object as a module that exports the functions `names` and holds further `segments`. The
    `note` is its custom section NOTE.

    It imports memory and, where it needs them, stack pointer, table and the functions `given` from
    "env".

    Raises:
        ValueError: the object needs a function that is not in it, or more than `data_limit` bytes
            of memory for its constants.
    """
    sections = {kind: body for kind, body in _read_sections(code) if kind != _CUSTOM}
    known = (MEMORY, STACK, TABLE, *given)
    if foreign := [name for name in _read_imports(sections) if name not in known]:
        raise ValueError(
            f"the rules call {', '.join(foreign)}, which WebAssembly does not have: write them "
            "without"
        )
    functions = _read_function_numbers(code)
    exports = [_name(name) + bytes([_FUNCTION]) + _number(functions[name]) for name in names]
    sections[_EXPORT] = _number(len(exports)) + b"".join(exports)
    own, data = _read_segments(sections.get(_DATA, b"\0"))
    if own and (end := max(s.address + len(s.content) for s in own)) > data_limit:
        raise ValueError(f"the rules' constants take {end} bytes, at most {data_limit} are free")
    added = b"".join(
        b"\0\x41" + _signed(address) + b"\x0b" + _number(len(content)) + content
        for address, content in segments
    )
    count = len(own) + len(segments)
    sections[_DATA] = _number(count) + data + added
    sections[_DATA_COUNT] = _number(count)
    parts = [
        bytes([kind]) + _number(len(sections[kind])) + sections[kind]
        for kind in _ORDER
        if kind in sections
    ]
    noted = _name(NOTE) + note.encode()
    return _MAGIC + b"".join(parts) + bytes([_CUSTOM]) + _number(len(noted)) + noted


def _read_sections(code: bytes) -> Iterator[tuple[int, bytes]]:
    place = len(_MAGIC)
    while place < len(code):
        kind = code[place]
        size, place = _read_number(code, place + 1)
        yield kind, code[place : place + size]
        place += size


def _read_imports(sections: Mapping[int, bytes]) -> Iterator[str]:
    """The names of all imports."""
    body = sections.get(_IMPORT, b"\0")
    count, place = _read_number(body, 0)
    for _ in range(count):
        _, place = _read_name(body, place)
        name, place = _read_name(body, place)
        yield name
        kind, place = body[place], place + 1
        if kind == 3:  # a global: type and whether it changes
            place += 2
            continue
        place += kind == 1  # a table: the type of its entries
        if kind == _FUNCTION:
            _, place = _read_number(body, place)
            continue
        has_most, place = body[place] & 1, place + 1
        for _ in range(1 + has_most):
            _, place = _read_number(body, place)


def _read_function_numbers(code: bytes) -> dict[str, int]:
    """The numbers of the functions that the object names and holds."""
    numbers: dict[str, int] = {}
    for kind, body in _read_sections(code):
        name, place = _read_name(body, 0) if kind == _CUSTOM else ("", 0)
        if name != "linking":
            continue
        _, place = _read_number(body, place)  # version
        while place < len(body):
            part, place = body[place], place + 1
            size, place = _read_number(body, place)
            if part == _SYMBOL_TABLE:
                numbers |= _read_symbols(body[place : place + size])
            place += size
    return numbers


def _read_symbols(table: bytes) -> dict[str, int]:
    numbers: dict[str, int] = {}
    count, place = _read_number(table, 0)
    for _ in range(count):
        kind, place = table[place], place + 1
        flags, place = _read_number(table, place)
        if kind == 1:  # data: name and, where it is defined, segment, offset and size
            _, place = _read_name(table, place)
            for _ in range(0 if flags & _UNDEFINED else 3):
                _, place = _read_number(table, place)
            continue
        number, place = _read_number(table, place)
        if kind != 3 and (not flags & _UNDEFINED or flags & _NAMED):  # 3: a section
            name, place = _read_name(table, place)
            if kind == _FUNCTION:
                numbers[name] = number
    return numbers


def _read_segments(body: bytes) -> tuple[list[Segment], bytes]:
    """The segments of a data section, and its bytes behind their count."""
    count, first = _read_number(body, 0)
    place, found = first, []
    for _ in range(count):
        if body[place : place + 2] != b"\0\x41":  # of memory 0, at a constant
            raise ValueError("the object's data is not at constant addresses of memory 0")
        address, place = _read_number(body, place + 2)
        size, place = _read_number(body, place + 1)  # behind the end of the expression
        found.append(Segment(address, body[place : place + size]))
        place += size
    return found, body[first:]


# --- numbers and names as WebAssembly writes them ------------------------------------------------


def _read_number(data: bytes, place: int) -> tuple[int, int]:
    """A number of 0 or more, 7 bits a byte, the lowest first; and the place behind it."""
    number = shift = 0
    while True:
        byte = data[place]
        number |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            return number, place


def _read_name(data: bytes, place: int) -> tuple[str, int]:
    size, place = _read_number(data, place)
    return data[place : place + size].decode(), place + size


def _number(value: int) -> bytes:
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _signed(value: int) -> bytes:
    """As `_number` for a signed number of 0 or more: the highest bit written is its sign."""
    out = bytearray()
    while value >= 0x40:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _name(text: str) -> bytes:
    return _number(len(text.encode())) + text.encode()
