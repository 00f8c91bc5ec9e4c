"""The README's table of all scenarios, written anew by `python docs/tables.py`."""

from __future__ import annotations

import re
from pathlib import Path

from marl_cair.cli.games import format_markdown
from marl_cair.files import write_atomically
from marl_cair.games import GAMES

README = Path(__file__).parents[1] / "README.md"
PLACE = re.compile(r"(?<=<!-- docs/tables.py -->\n).*?(?=<!-- end -->)", re.DOTALL)


def find_table(text: str) -> str:
    """The table that stands in the text. Raises ValueError where there is no place for one."""
    found = PLACE.search(text)
    if found is None:
        raise ValueError("no place between <!-- docs/tables.py --> and <!-- end -->")
    return found[0]


def main() -> None:
    """Put the games of this repository into its README."""
    text = README.read_text("utf-8")
    find_table(text)
    write_atomically(README, PLACE.sub(lambda _: format_markdown(GAMES.load_own()), text))


if __name__ == "__main__":
    main()
