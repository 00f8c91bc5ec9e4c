"""Writes HTML with the viewer: a page of one game, or parts of other pages."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path

from marl_cair.files import write_atomically
from marl_cair.games.replays import Replay
from marl_cair.stored import VIEWER, DamagedFileError, read_text
from marl_cair.text import clean_text
from marl_cair.viewer.game_data import MAX_BYTES, pack_game

SCRIPT_FILE = Path(__file__).with_name("viewer.js")  # built from viewer/
_BEFORE, _AFTER = '<div class="mc-replay"><script type="application/json">', "</script></div>"
_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{title}</title>
<style>{theme}
body {{ margin: 0; background: var(--page); }}
main {{ max-width: 78rem; margin: 0 auto; padding: clamp(.6rem, 2vw, 1.5rem); }}
</style>
</head>
<body>
<main>
{element}
</main>
<script>{script}</script>
</body>
</html>
"""


def read_theme() -> str:
    """The colours of pages as CSS; the viewer takes them from its page."""
    return Path(__file__).with_name("theme.css").read_text("utf-8")


@cache
def read_script() -> str:
    """The script that starts the viewer in all elements of a page before it."""
    return SCRIPT_FILE.read_text("utf-8")


def make_policy(script: str, more: str = "") -> str:
    """Content-Security-Policy of a page with this script and `more` sources: no network."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return f"default-src 'none'; script-src 'sha256-{digest}'{more}; style-src 'unsafe-inline'"


def make_element(game: str) -> str:
    """The HTML element of a game that `pack_game` has packed."""
    safe = game.replace("<", "\\u003c")  # no tag ends the script
    return f"{_BEFORE}{safe}{_AFTER}"


def read_game(path: str | os.PathLike[str]) -> str:
    """The packed game in a page that `write_viewer` has written; nothing in it is run.

    Raises DamagedFileError for another page, OSError if it cannot be opened.
    """
    _, _, rest = read_text(path, VIEWER).partition(_BEFORE)
    try:
        game = json.loads(rest.partition(_AFTER)[0])
    except (ValueError, RecursionError) as error:
        raise DamagedFileError(
            f"{path} is no page of a game ({error}): write it again with `marl-cair replay`"
        ) from error
    return json.dumps(game, separators=(",", ":"))


def write_viewer(
    path: str | os.PathLike[str],
    replay: Replay,
    *,
    max_bytes: int = MAX_BYTES,
    views: Sequence[int | None] | None = None,
    every: int = 1,
    fps: float | None = None,
) -> int:
    """Write a page that plays one game, without a server or network; returns its size in bytes.

    Arguments and errors as `pack_game`. Raises OSError if the file cannot be written.
    """
    game = pack_game(replay, max_bytes=max_bytes, views=views, every=every, fps=fps)
    content = make_page(replay, game).encode()
    write_atomically(path, content)
    return len(content)


def make_page(replay: Replay, game: str) -> str:
    """The page of a replay that `pack_game` has packed as `game`."""
    return _PAGE.format(
        policy=make_policy(read_script()),
        title=html.escape(clean_text(" v ".join(replay.players))),
        element=make_element(game),
        script=read_script(),
        theme=read_theme(),
    )
