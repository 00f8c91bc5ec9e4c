"""Writes the table of all scenarios into docs/games.md: `python docs/tables.py`."""

from __future__ import annotations

import re
from pathlib import Path

from marl_cair.cli.games import format_markdown
from marl_cair.files import write_atomically
from marl_cair.games import GAMES

PAGE = Path(__file__).parent / "games.md"
PLACE = re.compile(r"(?<=<!-- docs/tables.py -->\n).*?(?=<!-- end -->)", re.DOTALL)


def find_table(text: str) -> str:
    """The table in `text`. Raises ValueError if the markers around it are missing."""
    found = PLACE.search(text)
    if found is None:
        raise ValueError("no place between <!-- docs/tables.py --> and <!-- end -->")
    return found[0]


def make_table() -> str:
    """All scenarios of this repository's games, with links relative to docs/."""
    table = format_markdown(GAMES.load_own())
    return table.replace("](marl_cair/", "](../marl_cair/").replace("](docs/", "](")


def main() -> None:
    """Write the table into the page."""
    text = PAGE.read_text("utf-8")
    find_table(text)
    write_atomically(PAGE, PLACE.sub(lambda _: make_table(), text))


if __name__ == "__main__":
    main()
