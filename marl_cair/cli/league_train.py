"""`marl-cair league train`: learners that train against one another, from a YAML file."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED
from marl_cair.cli.options import read_comments
from marl_cair.lookup import find_by_name
from marl_cair.training.league_examples import EXAMPLES
from marl_cair.training.league_run import train_league
from marl_cair.training.league_settings import LeagueSettings, build_league, load_league

_WIDTH = 100


def run_training(arguments: Sequence[str]) -> int:
    """Main agents and exploiters that train against one another in turns, as in AlphaStar."""
    options = _make_parser().parse_args(arguments)
    if options.example is not None:
        find_by_name("example", options.example, EXAMPLES)
        sys.stdout.write(format_example(options.example))
        return EXIT_DONE
    if options.file is None:
        raise ValueError("no file is given: write marl-cair league train league.yaml")
    settings = load_league(options.file)
    changes = {"out": options.out, "max_minutes": options.minutes}
    given = {name: value for name, value in changes.items() if value is not None}
    result = train_league(dataclasses.replace(settings, **given))
    if not result.is_done:
        why = "interrupted" if result.was_interrupted else "time is over"
        again = " ".join(["marl-cair league train", *arguments])
        sys.stderr.write(f"{why}, {result.slices} slices are done: go on with {again}\n")
        return EXIT_INTERRUPTED if result.was_interrupted else EXIT_DONE
    sys.stdout.write(f"{result.text}\nThis report is in {result.folder}/report.txt\n")
    return EXIT_DONE


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "marl-cair league train",
        description=f"{run_training.__doc__} The same command again goes on where it stopped, and "
        "with more total_frames in the file from where it had ended.",
        epilog="options of the file, with their defaults:\n\n"
        + textwrap.indent(format_options(LeagueSettings()), "  "),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", nargs="?", help="YAML, as --example writes it")
    parser.add_argument(
        "--example",
        metavar="NAME",
        help=f"print the file of a ready-made league, and end: {', '.join(EXAMPLES)}",
    )
    parser.add_argument("--out", help="output folder, in place of the file's")
    parser.add_argument(
        "--minutes", type=float, help="of this sitting, in place of the file's max_minutes"
    )
    return parser


def format_example(name: str) -> str:
    """The YAML of one of EXAMPLES: every option, with its comment."""
    head = f"# marl-cair league train league.yaml; this is the example {name}.\n"
    return head + format_options(build_league(EXAMPLES[name]))


def format_options(settings: LeagueSettings) -> str:
    """All options as YAML, each with what it is."""
    return "\n".join(_format_group(settings, "")) + "\n"


def _format_group(group: Any, indent: str) -> Iterator[str]:
    owner: type = type(group)
    comments = read_comments(owner)
    for item in dataclasses.fields(group):
        value = getattr(group, item.name)
        if dataclasses.is_dataclass(value):
            yield f"{indent}{item.name}:"
            yield from _format_group(value, f"{indent}  ")
            continue
        yield from textwrap.wrap(
            comments[item.name],
            _WIDTH,
            initial_indent=f"{indent}# ",
            subsequent_indent=f"{indent}# ",
        )
        yield from _format_value(item.name, value, indent)


def _format_value(name: str, value: Any, indent: str) -> Iterator[str]:
    """Groups of options one below the other, all else in a line; JSON is YAML too."""
    if isinstance(value, dict) and any(isinstance(below, dict) for below in value.values()):
        yield f"{indent}{name}:"
        for below in value:
            yield from _format_value(below, value[below], f"{indent}  ")
    else:
        yield f"{indent}{name}: {json.dumps(value)}"
