"""`marl-cair league train` and `league psro`: train a population of agents from a YAML file."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED
from marl_cair.cli.match_options import add_options
from marl_cair.cli.parser import Parser
from marl_cair.lookup import find_by_name, import_place
from marl_cair.training.population.league_examples import EXAMPLES, PSRO_EXAMPLES
from marl_cair.training.population.league_settings import (
    LeagueSettings,
    build_league,
    load_settings,
)
from marl_cair.training.population.psro_settings import PsroSettings, build_psro
from marl_cair.training.settings.options import read_comments


class _Command(NamedTuple):
    """One of the two commands."""

    words: str
    file: str  # the name of its file in help
    about: str
    settings: type
    parts: str  # the unit of its progress
    more: str  # the option that makes a run longer
    examples: Mapping[str, dict[str, Any]]
    build: Callable[[Mapping[str, Any]], Any]
    train: str  # "module:function", imported when it is called


_POPULATION = "marl_cair.training.population"
TRAIN = _Command(
    words="marl-cair league train",
    file="league.yaml",
    about="Train main agents and exploiters against one another in turns, as in AlphaStar.",
    settings=LeagueSettings,
    parts="slices",
    more="total_frames",
    examples=EXAMPLES,
    build=build_league,
    train=f"{_POPULATION}.league_run:train_league",
)
PSRO = _Command(
    words="marl-cair league psro",
    file="psro.yaml",
    about="Train best responses in turn, each against a mixture of all earlier ones "
    "(policy-space response oracles), and save the safest mixture as one agent.",
    settings=PsroSettings,
    parts="rounds",
    more="rounds",
    examples=PSRO_EXAMPLES,
    build=build_psro,
    train=f"{_POPULATION}.psro:train_psro",
)


def run_training(arguments: Sequence[str]) -> int:
    """Run `marl-cair league train`; returns the exit code."""
    return _run(TRAIN, arguments)


def run_psro(arguments: Sequence[str]) -> int:
    """Run `marl-cair league psro`; returns the exit code."""
    return _run(PSRO, arguments)


def _run(command: _Command, arguments: Sequence[str]) -> int:
    options = _make_parser(command).parse_args(arguments)
    if options.example is not None:
        values = command.build(find_by_name("example", options.example, command.examples))
        head = f"# {command.words} {command.file}; this is the example {options.example}.\n"
        sys.stdout.write(head + format_options(values))
        return EXIT_DONE
    if options.file is None:
        raise ValueError(f"no file is given: write {command.words} {command.file}")
    settings: Any = load_settings(options.file, command.build, options.allow_code)
    changes = {"out": options.out, "max_minutes": options.minutes}
    given = {name: value for name, value in changes.items() if value is not None}
    result = import_place(command.train)(dataclasses.replace(settings, **given))
    if not result.is_done:
        why = "interrupted" if result.was_interrupted else "time is over"
        again = " ".join([command.words, *arguments])
        done = getattr(result, command.parts)
        sys.stderr.write(f"{why}, {done} {command.parts} are done: resume with {again}\n")
        return EXIT_INTERRUPTED if result.was_interrupted else EXIT_DONE
    sys.stdout.write(f"{result.text}\nThis report is in {result.folder}/report.txt\n")
    return EXIT_DONE


def _make_parser(command: _Command) -> Parser:
    parser = Parser(
        command.words,
        description=f"{command.about} The same command again resumes an interrupted run, and "
        f"continues a finished one with more {command.more} in the file.",
        epilog="options of the file, with their defaults:\n\n"
        + textwrap.indent(format_options(command.settings), "  "),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", nargs="?", help="YAML, as --example writes it")
    parser.add_argument(
        "--example",
        metavar="NAME",
        help=f"print an example file and exit: {', '.join(command.examples)}",
    )
    parser.add_argument("--out", help="output folder, instead of the file's")
    add_options(parser, "--allow-code", files="the file")
    parser.add_argument(
        "--minutes", type=float, help="for this run of the command, instead of max_minutes"
    )
    return parser


def format_options(settings: Any) -> str:
    """All options of a dataclass as YAML, each with its comment: of an instance, or the defaults of
    a class, which is then not made: checks of its values would load a game's rules.
    """
    return "\n".join(_format_group(settings, "")) + "\n"


def _format_group(group: Any, indent: str) -> Iterator[str]:
    is_class = isinstance(group, type)
    owner: type = group if is_class else type(group)
    comments = read_comments(owner)
    for item in dataclasses.fields(group):
        make = item.default_factory
        default = item.default if make is dataclasses.MISSING else make()
        value = default if is_class else getattr(group, item.name)
        if dataclasses.is_dataclass(value):
            yield f"{indent}{item.name}:"
            yield from _format_group(value, f"{indent}  ")
            continue
        mark = f"{indent}# "
        yield from textwrap.wrap(
            comments[item.name], 100, initial_indent=mark, subsequent_indent=mark
        )
        yield from _format_value(item.name, value, indent)


def _format_value(name: str, value: Any, indent: str) -> Iterator[str]:
    """Groups of options one below the other, others in a line; JSON is YAML too."""
    if isinstance(value, dict) and any(isinstance(below, dict) for below in value.values()):
        yield f"{indent}{name}:"
        for below in value:
            yield from _format_value(below, value[below], f"{indent}  ")
    else:
        yield f"{indent}{name}: {json.dumps(value)}"
