"""Renders a report as HTML, Markdown and plain text from one model and three Jinja templates."""

from __future__ import annotations

import re
import textwrap
from itertools import zip_longest

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from marl_cair.league.report.sections import Report, Table
from marl_cair.text import clean_lines, clean_text
from marl_cair.viewer.page import make_policy, read_script, read_theme

LINE_WIDTH = 100
MAX_MARKDOWN_COLUMNS = 32
MAX_OPEN_ITEMS = 12  # a longer list is folded on the page
CHART_LABEL = "Chart; its numbers are in the table below"


def render_html(report: Report) -> str:
    """One page without network access or other files; all text is escaped. Its only script is the
    viewer of games, where it shows games.
    """
    from marl_cair.league.report.charts import make_svg  # matplotlib takes long to import

    environment = _make_environment(autoescape=True)
    environment.filters.update(breaks=allow_breaks, code=mark_code, sign=use_unicode_signs)
    page = environment.get_template("report.html.jinja")
    return page.render(
        report=report,
        draw=lambda chart: Markup(make_svg(report, chart, CHART_LABEL)),  # noqa: S704
        max_open_items=MAX_OPEN_ITEMS,
        policy=make_policy(read_script()),
        viewer=Markup(read_script()),  # noqa: S704  (our own, and its hash is in the policy)
        theme=Markup(read_theme()),  # noqa: S704
    )


def render_markdown(report: Report) -> str:
    """Markdown as GitHub shows it; replays and the figure are linked as files beside it."""
    environment = _make_environment(autoescape=False)
    environment.filters.update(markdown=escape_markdown)
    page = environment.get_template("report.md.jinja").render(
        report=report, max_columns=MAX_MARKDOWN_COLUMNS
    )
    return re.sub(r"\n{3,}", "\n\n", page).strip() + "\n"


def render_text(report: Report) -> str:
    """Plain text for a terminal, ASCII but for names; tables that are too wide name their file."""
    environment = _make_environment(autoescape=False)
    environment.filters.update(fill=lambda text: textwrap.fill(text, LINE_WIDTH))
    environment.filters.update(table=format_table)
    page = environment.get_template("report.txt.jinja").render(report=report)
    return clean_lines(re.sub(r"\n{3,}", "\n\n", page).strip()) + "\n"


def _make_environment(autoescape: bool) -> Environment:
    return Environment(
        loader=PackageLoader("marl_cair.league.report"),
        autoescape=autoescape,  # noqa: S701  (Markdown and text have no tags)
        undefined=StrictUndefined,
        finalize=clean_value if autoescape else None,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def clean_value(value: object) -> object:
    """Text without control characters; other values as they are."""
    return clean_text(value) if type(value) is str else value


def use_unicode_signs(text: str) -> str:
    """`text` with the signs of bounds that not every terminal can show."""
    return text.replace(">=", "\u2265").replace("<=", "\u2264")


def allow_breaks(name: str) -> Markup:
    """`name` escaped, with possible line breaks after the parts of a path and of a word."""
    lines = (clean_text(line) for line in name.split("\n"))
    broken = (Markup("<wbr>").join(re.split(r"(?<=[/_@])", line)) for line in lines)
    return Markup("<br>").join(broken)


def mark_code(text: str) -> Markup:
    """`text` escaped, with what is between backticks as code."""
    text = clean_text(text)
    parts = text.split("`")
    if len(parts) % 2 == 0:  # a single backtick
        return escape(text)
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if number % 2 else escape(part)
        for number, part in enumerate(parts)
    )


def escape_markdown(text: str) -> str:
    """`text` so that Markdown shows it unchanged; what is between backticks stays code."""
    parts = re.split(r"(`[^`]*`)", use_unicode_signs(clean_text(text)))
    return "".join(
        part if number % 2 else re.sub(r"([\\*_{}\[\]<>#|~`$&])", r"\\\1", part)
        for number, part in enumerate(parts)
    )


def format_table(table: Table) -> str:
    """Columns of equal width, words from the left and numbers from the right; cells may have
    several lines. A table wider than LINE_WIDTH is replaced by a reference to `report.md`.
    """
    rows = [
        line
        for row in (table.header, *table.rows)
        for line in zip_longest(*(cell.split("\n") for cell in row), fillvalue="")
    ]
    sides = "<" * table.num_words + ">" * len(table.header)
    pads = [
        f"{{:{side}{max(map(len, column))}}}"
        for side, column in zip(sides, zip(*rows, strict=True), strict=False)
    ]
    lines = ["  ".join(pads).format(*row).rstrip() for row in rows]
    if max(map(len, lines)) > LINE_WIDTH:
        return "Too wide for a terminal: see report.md."
    return "\n".join(lines)
