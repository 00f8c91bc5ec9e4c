"""Remove control characters and formulas from text of files and foreign code."""

import csv
import io
import unicodedata
from collections.abc import Iterable

# First characters that make a spreadsheet read a cell as a formula.
_FORMULA_MARKS = "=+-@"


def clean_text(text: str) -> str:
    r"""`text` in one line of visible characters: white space becomes single spaces; control
    characters, marks of direction and characters of no width become escapes such as \x1b, \u202e.
    """
    return _show(" ".join(text.split()))


def clean_lines(text: str) -> str:
    """The same, line by line; spaces stay as they are, as tables are made of them."""
    return "\n".join(map(_show, text.split("\n")))


def clean_cell(value: object) -> object:
    """A cell of a CSV file: text as `clean_text`, and after an apostrophe where a spreadsheet would
    read a formula. Numbers stay as they are, also as text.
    """
    if not isinstance(value, str):
        return value
    shown = clean_text(value)
    first = unicodedata.normalize("NFKC", shown[:1])  # of wide forms too
    is_formula = first != "" and first in _FORMULA_MARKS and not _is_number(shown)
    return f"'{shown}" if is_formula else shown


def format_csv(rows: Iterable[Iterable[object]]) -> str:
    """Rows as CSV with line ends of UNIX, each cell as `clean_cell`."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(clean_cell, row) for row in rows)
    return text.getvalue()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _show(line: str) -> str:
    if line.isprintable():
        return line
    escaped = (one.encode("unicode_escape").decode("ascii") for one in line)
    return "".join(o if o.isprintable() else e for o, e in zip(line, escaped, strict=True))
