"""Writes the results of an experiment as tables: CSV, Markdown and LaTeX."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from marl_cair.experiments.cells import name_agent
from marl_cair.experiments.plan import Plan
from marl_cair.experiments.summary import Entry, Estimate, Reached, Run
from marl_cair.files import write_atomically
from marl_cair.training.run_log import format_rows

LOOKS, TABLE, LEVELS = "looks.csv", "table", "levels"
Line = dict[str, str]
# Columns of the LaTeX table that do not fit on a page; units are in its caption.
_NOT_IN_LATEX = "unit", "seconds", "updates", "generated_share", "at the start"
_LATEX = str.maketrans(
    {mark: f"\\{mark}" for mark in "%_&#${}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
)


def write_looks(plan: Plan, runs: Sequence[Run], path: Path) -> None:
    """One CSV row for each run and look."""
    rows: list[dict[str, object]] = [
        {**_name(plan, run.task, run.kind), "seed": run.seed, **row}
        for run in runs
        for row in run.rows
    ]
    write_atomically(path, format_rows(rows))


def write_tables(
    plan: Plan, entries: Sequence[Entry], reached: Sequence[Reached], notes: str, out: Path
) -> str:
    """Write `table` and, where the plan has levels, `levels`, each as CSV (plain numbers, intervals
    as `_low` and `_high`), Markdown and LaTeX; returns the Markdown. notes: what a reader must know
    of all numbers.
    """
    about = f"{plan.about or ''} {notes}".strip()
    rows: dict[str, list[dict[str, object]]] = {TABLE: [_list_numbers(plan, e) for e in entries]}
    tables = {TABLE: [_format_entry(plan, entry) for entry in entries]}
    if reached:
        rows[LEVELS] = [_list_reached(plan, one) for one in reached]
        tables[LEVELS] = [_format_reached(plan, one) for one in reached]
    texts = []
    for name, lines in tables.items():
        texts.append(f"{about}\n\n{_format_markdown(lines)}")
        for ending, text in (
            (".csv", format_rows(rows[name])),
            (".tex", _format_latex(lines, about)),
            (".md", texts[-1]),
        ):
            write_atomically(out / f"{name}{ending}", text)
    return "\n".join([texts[0], *(text.partition("\n\n")[2] for text in texts[1:])])


def _name(plan: Plan, task: str, kind: Sequence[str]) -> Line:
    return {"task": task, **dict(zip(plan.factors, kind, strict=True))}


def _find_published(plan: Plan, entry: Entry) -> float | None:
    about = plan.tasks.get(entry.task)
    known = about.published if about else {}
    return next((score for one, score in known.items() if name_agent(one) in entry.kind), None)


def _list_numbers(plan: Plan, entry: Entry) -> dict[str, object]:
    row: dict[str, object] = {**_name(plan, entry.task, entry.kind), "runs": entry.num_runs}
    if (score := _find_published(plan, entry)) is not None:
        row[plan.source] = score
    for name, (value, low, high) in entry.values.items():
        row[name] = value
        if not math.isnan(low):
            row |= {f"{name}_low": low, f"{name}_high": high}
    return row


def _list_reached(plan: Plan, one: Reached) -> dict[str, object]:
    """`score` is the lowest from then on; the best, where the level is never reached."""
    when: Mapping[str, object] = one.first or {}
    row: dict[str, object] = {**_name(plan, one.run.task, one.run.kind), "seed": one.run.seed}
    row |= {"level": one.level, "seconds": when.get("seconds"), "steps": when.get("frames")}
    return row | {"untrained": one.run.rows[0]["score"], "score": one.lowest}


def _format_entry(plan: Plan, entry: Entry) -> Line:
    values = entry.values
    line = _name(plan, entry.task, entry.kind)
    about = plan.tasks.get(entry.task)
    if any(task.rating.unit for task in plan.tasks.values()):
        line["unit"] = (about and about.rating.unit) or ""
    if any(task.published for task in plan.tasks.values()):
        score = _find_published(plan, entry)
        line[plan.source] = "" if score is None else f"{score:g}"
    line["runs"] = str(entry.num_runs)
    for name, value in values.items():
        if name in ("steps", "seconds", "updates"):
            line[name] = f"{value.value:,.0f}" if value.value else "-"
        else:
            line[name] = format_estimate(value)
    return line


def format_estimate(one: Estimate) -> str:
    """Three or more digits, and the interval, if there is one."""
    digits = 3 if abs(one.value) < 10 else 1 if abs(one.value) < 1000 else 0
    shown = [f"{round(value, digits) + 0.0:,.{digits}f}" for value in one]  # no -0
    return shown[0] if math.isnan(one.low) else f"{shown[0]} [{shown[1]}, {shown[2]}]"


def _format_reached(plan: Plan, one: Reached) -> Line:
    line = _name(plan, one.run.task, one.run.kind)
    line |= {"seed": str(one.run.seed), "untrained": f"{one.run.rows[0]['score']:.3g}"}
    line["level"] = f"{one.level:g}"
    if one.first is None:
        return line | {"reached after": "never", "steps": "-", "later": f"best {one.lowest:.3g}"}
    line["reached after"] = f"{one.first['seconds']:.0f} s"
    line["steps"] = f"{one.first['frames']:,.0f}"
    is_held = "held" if one.lowest >= one.level else "lowest"
    return line | {"later": f"{is_held} {one.lowest:.3g}"}


def _columns(lines: Sequence[Mapping[str, str]]) -> list[str]:
    """All columns in which a line has something."""
    names = dict.fromkeys(name for line in lines for name in line)
    return [name for name in names if any(line.get(name) for line in lines)]


def _format_markdown(lines: Sequence[Line]) -> str:
    names = _columns(lines)
    rows = [names, *([line.get(name, "") for name in names] for line in lines)]
    rows = [[cell.replace("|", r"\|") for cell in row] for row in rows]
    text = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([text[0], f"|{'---|' * len(names)}", *text[1:]]) + "\n"


def _format_latex(lines: Sequence[Line], about: str) -> str:
    names = [name for name in _columns(lines) if name not in _NOT_IN_LATEX]
    rows = [[line.get(name, "").translate(_LATEX) for name in names] for line in lines]
    units = {line["task"]: line["unit"] for line in lines if line.get("unit")}
    about = " ".join([about, *(f"{task}: {unit}." for task, unit in units.items())])
    head = " & ".join(name.translate(_LATEX) for name in names)
    body = "\n".join(f"{' & '.join(row)} \\\\" for row in rows)
    caption = about.translate(_LATEX)
    return (
        "% needs \\usepackage{booktabs}\n\\begin{table}\n\\centering\n\\small\n"
        f"\\caption{{{caption}}}\n"
        f"\\begin{{tabular}}{{{'l' * len(names)}}}\n\\toprule\n{head} \\\\\n\\midrule\n{body}\n"
        "\\bottomrule\n\\end{tabular}\n\\end{table}\n"
    )
