"""The report as one HTML page that needs nothing else: no network, no script, no other file."""

from __future__ import annotations

import re

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from marl_cair.league.report.drawings import (
    MOST_FULL_CELLS,
    find_axis,
    lay_out_bars,
    lay_out_cells,
    lay_out_curves,
)
from marl_cair.league.report.sections import Report
from marl_cair.league.report.wording import set_signs
from marl_cair.text import clean_text

TEMPLATE = "report.html.jinja"
MOST_OPEN_ITEMS = 12  # of a list; a longer one is folded


def write_page(report: Report) -> str:
    """The text of `report.html`; what comes from outside (names, reasons, commands) is escaped."""
    table = report.table
    axis = find_axis(table)
    environment = Environment(
        loader=PackageLoader("marl_cair.league.report"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=clean_value,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(breaks=allow_breaks, code=mark_code, sign=set_signs)
    return environment.get_template(TEMPLATE).render(
        report=report,
        axis=axis,
        bars=lay_out_bars(table, axis),
        cells=lay_out_cells(table),
        is_full=len(table.names) <= MOST_FULL_CELLS,
        chart=lay_out_curves(table, report.curves) if report.curves else None,
        most_open_items=MOST_OPEN_ITEMS,
    )


def clean_value(value: object) -> object:
    """What the page shows of a value: text without control characters."""
    return clean_text(value) if type(value) is str else value


def allow_breaks(name: str) -> Markup:
    """`name` escaped, that may be broken after the parts of a path and of a word."""
    return Markup("<wbr>").join(re.split(r"(?<=[/_@])", clean_text(name)))


def mark_code(text: str) -> Markup:
    """`text` escaped, with what stands between backticks as code."""
    text = clean_text(text)
    parts = text.split("`")
    if len(parts) % 2 == 0:  # a backtick alone is one
        return escape(text)
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if number % 2 else escape(part)
        for number, part in enumerate(parts)
    )
