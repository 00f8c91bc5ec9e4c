"""Keys by name: X11 keysyms for VNC, and DOM `code`, `key` and `keyCode` for a page."""

from __future__ import annotations

from typing import NamedTuple

from marl_cair.lookup import find_by_name


class Key(NamedTuple):
    """One key of a US keyboard. `code`, `key` and `key_code` are those of a DOM KeyboardEvent."""

    keysym: int
    code: str
    key: str
    key_code: int


_NAMED = {
    "left": Key(0xFF51, "ArrowLeft", "ArrowLeft", 37),
    "up": Key(0xFF52, "ArrowUp", "ArrowUp", 38),
    "right": Key(0xFF53, "ArrowRight", "ArrowRight", 39),
    "down": Key(0xFF54, "ArrowDown", "ArrowDown", 40),
    "space": Key(0x20, "Space", " ", 32),
    "enter": Key(0xFF0D, "Enter", "Enter", 13),
    "escape": Key(0xFF1B, "Escape", "Escape", 27),
    "tab": Key(0xFF09, "Tab", "Tab", 9),
    "backspace": Key(0xFF08, "Backspace", "Backspace", 8),
    "delete": Key(0xFFFF, "Delete", "Delete", 46),
    "insert": Key(0xFF63, "Insert", "Insert", 45),
    "home": Key(0xFF50, "Home", "Home", 36),
    "end": Key(0xFF57, "End", "End", 35),
    "page_up": Key(0xFF55, "PageUp", "PageUp", 33),
    "page_down": Key(0xFF56, "PageDown", "PageDown", 34),
    "pause": Key(0xFF13, "Pause", "Pause", 19),
    "scroll_lock": Key(0xFF14, "ScrollLock", "ScrollLock", 145),
    "shift": Key(0xFFE1, "ShiftLeft", "Shift", 16),
    "control": Key(0xFFE3, "ControlLeft", "Control", 17),
    "alt": Key(0xFFE9, "AltLeft", "Alt", 18),
}
# Character -> DOM code and keyCode. Characters with shift are no keys: press "shift" too.
_PUNCTUATION = {
    "`": ("Backquote", 192),
    "-": ("Minus", 189),
    "=": ("Equal", 187),
    "[": ("BracketLeft", 219),
    "]": ("BracketRight", 221),
    "\\": ("Backslash", 220),
    ";": ("Semicolon", 186),
    "'": ("Quote", 222),
    ",": ("Comma", 188),
    ".": ("Period", 190),
    "/": ("Slash", 191),
}
# The keysym of a printed character is its code point.
KEYS: dict[str, Key] = {
    **_NAMED,
    **{f"f{n}": Key(0xFFBD + n, f"F{n}", f"F{n}", 111 + n) for n in range(1, 13)},
    **{c: Key(ord(c), f"Key{c.upper()}", c, ord(c.upper())) for c in "abcdefghijklmnopqrstuvwxyz"},
    **{c: Key(ord(c), f"Digit{c}", c, ord(c)) for c in "0123456789"},
    **{c: Key(ord(c), code, c, key_code) for c, (code, key_code) in _PUNCTUATION.items()},
}


def find_key(name: str) -> Key:
    """The key of that name: "left", "space", "f1", "a", "7", "/", ... Raises UnknownNameError with
    the nearest names.
    """
    return find_by_name("key", name, KEYS)
