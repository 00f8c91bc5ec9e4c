"""Writes the table of all scenarios into docs/games.md: `python docs/tables.py`."""

from __future__ import annotations

import re
from pathlib import Path

from marl_cair.cli.games import list_rows
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.games.game import Game

PAGE = Path(__file__).parent / "games.md"
COLUMNS = ("game", "scenarios", "players", "actions", "representations", "reward", "picture")
PLACE = re.compile(r"(?<=<!-- docs/tables.py -->\n).*?(?=<!-- end -->)", re.DOTALL)


def find_table(text: str) -> str:
    """The table in `text`. Raises ValueError if the markers around it are missing."""
    found = PLACE.search(text)
    if found is None:
        raise ValueError("no place between <!-- docs/tables.py --> and <!-- end -->")
    return found[0]


def make_table() -> str:
    """All scenarios of this repository's games, with links relative to docs/; an empty cell repeats
    the one above it.
    """
    head = f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"
    return head + "".join(map(_format_rows, GAMES.load_own()))


def _format_rows(game: Game) -> str:
    lines = []
    page, picture = f"../marl_cair/games/{game.name}/README.md", f"images/{game.name}.png"
    above: tuple[str, ...] = ("",) * len(COLUMNS)
    for row in list_rows(game):
        scenarios = ", ".join(row.scenarios)
        cells = (f"[{game.title}]({page})", scenarios, *row[1:], f"[picture]({picture})")
        shown = ["" if cell == last else cell for cell, last in zip(cells, above, strict=True)]
        lines.append(f"| {' | '.join(shown)} |\n")
        above = cells
    return "".join(lines)


def main() -> None:
    """Write the table into the page."""
    text = PAGE.read_text("utf-8")
    find_table(text)
    write_atomically(PAGE, PLACE.sub(lambda _: make_table(), text))


if __name__ == "__main__":
    main()
