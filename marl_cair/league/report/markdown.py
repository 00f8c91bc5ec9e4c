"""The report as Markdown, as GitHub shows it: the same words and tables as on the page."""

from __future__ import annotations

import re
from collections.abc import Iterator

from marl_cair.league.report.sections import Report, Table
from marl_cair.league.report.wording import set_signs
from marl_cair.text import clean_text

MAX_COLUMNS = 32  # of a table that a page of text can show


def write_markdown(report: Report) -> str:
    """The text of `report.md`; films and the picture are named as they lie beside it."""
    return "\n\n".join(_write_parts(report)) + "\n"


def _write_parts(report: Report) -> Iterator[str]:
    yield f"# {escape(report.headline)}"
    yield "\n".join(f"- {escape(sentence)}" for sentence in report.verdict)
    yield ", ".join(f"{number} {what}" for what, number in report.facts) + "."
    for section in report.sections:
        yield f"## {escape(section.title)}"
        yield from map(escape, section.words)
        if section.key == "ladder" and report.table.ladder is not None:
            yield "![Ladder and matrix of scores](league.png)"
        for table in section.tables:
            yield from _write_table(table)
        if section.items:
            yield "\n".join(f"- {escape(item)}" for item in section.items)
        yield from map(escape, section.notes)
        if section.key == "replays":
            yield from _write_replays(report)


def _write_table(table: Table) -> Iterator[str]:
    if table.title:
        yield f"### {escape(table.title)}"
    if len(table.header) > MAX_COLUMNS:
        yield f"{len(table.header)} columns do not fit here: see the CSV files beside this one."
        return
    marks = [":--" if place < table.num_words else "--:" for place in range(len(table.header))]
    rows = [table.header, marks, *table.rows]
    cells = [[cell if row is marks else escape(cell) for cell in row] for row in rows]
    yield "\n".join(f"| {' | '.join(row)} |" for row in cells)


def _write_replays(report: Report) -> Iterator[str]:
    for replay in report.background.replays:
        yield f"### {escape(replay.title)}"
        yield escape(replay.caption)
        if replay.path is None:
            yield escape(replay.note)
        else:
            yield f"![{escape(replay.title)}]({replay.path.parent.name}/{replay.path.name})"


def escape(text: str) -> str:
    """`text` so that Markdown shows it as it is; what stands between backticks stays code."""
    plain = set_signs(clean_text(text))
    parts = re.split(r"(`[^`]*`)", plain)
    return "".join(
        part if number % 2 else re.sub(r"([\\*_{}\[\]<>#|~`$&])", r"\\\1", part)
        for number, part in enumerate(parts)
    )
