"""`marl-cair league train` and `marl-cair league psro`: learners that train against one another,
from a YAML file.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from marl_cair.cli import EXIT_DONE, EXIT_INTERRUPTED
from marl_cair.cli.match_options import add_allow_code
from marl_cair.cli.parser import Parser
from marl_cair.lookup import find_by_name
from marl_cair.training.population.league_examples import EXAMPLES, PSRO_EXAMPLES
from marl_cair.training.population.league_settings import LeagueSettings, build_league, load_league
from marl_cair.training.population.psro_settings import PsroSettings, build_psro, load_psro
from marl_cair.training.settings.options import read_comments

if TYPE_CHECKING:
    from marl_cair.training.population.league_run import LeagueTraining
    from marl_cair.training.population.psro import PsroResult

_WIDTH = 100


class _Command(NamedTuple):
    """One of the commands: its words, what it does, its files, and what runs one."""

    words: str
    file: str  # how its file may be called
    about: str
    parts: str  # what it is done in
    more: str  # the option that makes it longer
    examples: Mapping[str, dict[str, Any]]
    build: Callable[[Mapping[str, Any]], Any]
    load: Callable[[str, bool], Any]
    train: Callable[[Any], LeagueTraining | PsroResult]


def _train_league(settings: LeagueSettings) -> LeagueTraining:
    from marl_cair.training.population.league_run import train_league

    return train_league(settings)


def _train_psro(settings: PsroSettings) -> PsroResult:
    from marl_cair.training.population.psro import train_psro

    return train_psro(settings)


def run_training(arguments: Sequence[str]) -> int:
    """Main agents and exploiters that train against one another in turns, as in AlphaStar."""
    about = run_training.__doc__ or ""
    return _run(
        _Command(
            "train",
            "league.yaml",
            about,
            "slices",
            "total_frames",
            EXAMPLES,
            build_league,
            load_league,
            _train_league,
        ),
        LeagueSettings(),
        arguments,
    )


def run_psro(arguments: Sequence[str]) -> int:
    """Best responses, one after the other, each to mixtures of all that were there before
    (policy-space response oracles), and the safest mixture of them as one agent.
    """
    about = " ".join((run_psro.__doc__ or "").split())
    return _run(
        _Command(
            "psro",
            "psro.yaml",
            about,
            "rounds",
            "rounds",
            PSRO_EXAMPLES,
            build_psro,
            load_psro,
            _train_psro,
        ),
        PsroSettings(),
        arguments,
    )


def _run(command: _Command, defaults: Any, arguments: Sequence[str]) -> int:
    words = f"marl-cair league {command.words}"
    options = _make_parser(command, words, defaults).parse_args(arguments)
    if options.example is not None:
        find_by_name("example", options.example, command.examples)
        values = command.build(command.examples[options.example])
        head = f"# {words} {command.file}; this is the example {options.example}.\n"
        sys.stdout.write(head + format_options(values))
        return EXIT_DONE
    if options.file is None:
        raise ValueError(f"no file is given: write {words} {command.file}")
    settings = command.load(options.file, options.allow_code)
    changes = {"out": options.out, "max_minutes": options.minutes}
    given = {name: value for name, value in changes.items() if value is not None}
    result = command.train(dataclasses.replace(settings, **given))
    if not result.is_done:
        why = "interrupted" if result.was_interrupted else "time is over"
        again = " ".join([words, *arguments])
        done = getattr(result, command.parts)
        sys.stderr.write(f"{why}, {done} {command.parts} are done: go on with {again}\n")
        return EXIT_INTERRUPTED if result.was_interrupted else EXIT_DONE
    sys.stdout.write(f"{result.text}\nThis report is in {result.folder}/report.txt\n")
    return EXIT_DONE


def _make_parser(command: _Command, words: str, defaults: Any) -> Parser:
    parser = Parser(
        words,
        description=f"{command.about} The same command again goes on where it stopped, and with "
        f"more {command.more} in the file from where it had ended.",
        epilog="options of the file, with their defaults:\n\n"
        + textwrap.indent(format_options(defaults), "  "),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", nargs="?", help="YAML, as --example writes it")
    parser.add_argument(
        "--example",
        metavar="NAME",
        help=f"print a ready-made file, and end: {', '.join(command.examples)}",
    )
    parser.add_argument("--out", help="output folder, in place of the file's")
    add_allow_code(parser, "the file")
    parser.add_argument(
        "--minutes", type=float, help="of this sitting, in place of the file's max_minutes"
    )
    return parser


def format_options(settings: Any) -> str:
    """All options of a dataclass as YAML, each with what it is."""
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
