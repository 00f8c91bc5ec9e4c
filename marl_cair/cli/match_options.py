"""Options that `evaluate`, `match` and `league` share: games, seed, scenario and more."""

from __future__ import annotations

import argparse
import functools
import math
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.compose import read_value
from marl_cair.cli.parser import refuse_repeats
from marl_cair.cluster import LOCAL
from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import change_scenario
from marl_cair.games.game import Agent, Game, GameSpec
from marl_cair.league.agents.allowed_code import ANSWER_SECONDS, FUNCTION_SECONDS, is_foreign
from marl_cair.league.agents.load import find_scenario, load_agent
from marl_cair.league.agents.run_folders import Expansion, expand_runs
from marl_cair.league.play.arena import Load
from marl_cair.league.play.recording import Recording
from marl_cair.training.settings.config_file import read_options

if TYPE_CHECKING:
    from marl_cair.league.report.report import LeagueResult

DEFAULT_OUT = "runs/league"
AGENT_HELP = (
    "folder of a checkpoint (runs/a/latest), of a run (runs/a: its `latest`) or of a mixture, a "
    "bot (`marl-cair games` lists them), module:function, or process:COMMAND (a program that "
    "speaks JSON lines)"
)
CHECKPOINT_HELP = "folder of a checkpoint (runs/a/latest) or of a run (runs/a)"
_SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}
# Options as `argparse` takes them; texts in braces are given by each command.
_OPTIONS: dict[str, dict[str, Any]] = {
    "--games": {
        "type": int,
        "help": "number of games {games_of}, as many in each seat (default: {games})",
    },
    "--seed": {
        "type": int,
        "default": 0,
        "help": "whole number; the same seed gives the same games (default: %(default)s)",
    },
    "--game": {
        "choices": GAMES,  # looked up late: packages and tests add games
        "help": "default: the game that the first checkpoint was trained on, else deep_line_wars",
    },
    "--scenario": {
        "help": "a scenario of the game, as `marl-cair games` lists them (default: the one that "
        "the first checkpoint was trained on; for bots alone the game's default)",
    },
    "--set": {
        "dest": "fields",
        "action": "append",
        "default": [],
        "metavar": "FIELD=VALUE",
        "help": "change a field of the scenario, for example max_ticks=500{more}; repeatable "
        "(default: none)",
    },
    "--workers": {
        "type": int,
        "default": 1,
        "help": "processes that play; results do not depend on it (default: %(default)s)",
    },
    "--cluster": {
        "default": LOCAL,
        "metavar": "WHERE",
        "help": "local: processes of this machine; ray: a Ray that is started here, with --workers "
        "cores; ray:HOST:PORT, ray:auto: the machines of a Ray that runs there, or here. Results "
        "do not depend on it (default: %(default)s)",
    },
    "--no-replays": {
        "action": "store_true",
        "help": "show no games in the report: they are played again for it (default: three)",
    },
    "--record": {
        "default": "",
        "metavar": "FOLDER",
        "help": "record the games that are played, in files that `marl-cair replay` reads "
        "(default: none is recorded)",
    },
    "--allow-code": {
        "action": "store_true",
        "help": "also run the code that {files} names (process:COMMAND, module:function), and list "
        "it; only for files from people you trust (default: such files are refused)",
    },
    "--answer-seconds": {
        "type": float,
        "help": "time limit for each answer of an agent that is code, in a process of its own; an "
        "agent that exceeds it forfeits. 0: functions run in this process without limit, for speed "
        "and debuggers: one that hangs or dies ends everything (default: "
        f"{FUNCTION_SECONDS:g} for module:function, {ANSWER_SECONDS:g} for process:COMMAND)",
    },
    "--answer-memory": {
        "default": "",
        "metavar": "SIZE",
        "help": "limit for the address space of each process of such an agent, for example 2GiB; "
        "Linux only (default: none)",
    },
    "--answer-processes": {
        "type": int,
        "default": 0,
        "metavar": "N",
        "help": "limit for the number of processes of such an agent; Linux only (default: none)",
    },
}
SCENARIO_OPTIONS = ("--game", "--scenario", "--set")
ANSWER_LIMITS = ("--answer-seconds", "--answer-memory", "--answer-processes")
MATCH_OPTIONS = ("--games", "--seed", *SCENARIO_OPTIONS, *ANSWER_LIMITS)


def add_options(parser: argparse.ArgumentParser, *names: str, **texts: object) -> None:
    """Add options of the table; `texts` replace the braces in their helps."""
    for name in names:
        settings = _OPTIONS[name]
        words = {"more": "", **texts}
        parser.add_argument(name, **{**settings, "help": settings["help"].format_map(words)})


def read_changes(words: Sequence[str], form: str) -> dict[str, Any]:
    """Values of `--set NAME=VALUE` by name. form: of a word, for the error.

    Raises ValueError for a word without `=`, and for a name that is set twice.
    """
    refuse_repeats(words)
    for word in words:
        if "=" not in word:
            raise ValueError(f"--set {word}: write --set {form}")
    return {word.partition("=")[0]: read_value(word) for word in words}


def read_fields(game: Game, scenario: Any, words: Sequence[str]) -> dict[str, Any]:
    """Values of `--set FIELD=VALUE` by field of `scenario`.

    Raises:
        UnknownNameError: no such field. ValueError: a value of another kind, or a field set twice.
    """
    for word in words:
        if word.startswith("reward="):
            raise ValueError(f"--set {word}: leave it out, the rated reward is used")
    changes = read_changes(words, "field=value, for example max_ticks=500")
    return read_options(game.name, scenario, changes, "scenario")


def choose_scenario(options: argparse.Namespace, agents: Sequence[str]) -> tuple[Game, str, Any]:
    """The game of the options and these agents, the scenario's name, and it as `--set` changes it.
    Raises as `find_scenario` and `read_fields`.
    """
    game, name, fields = find_scenario(agents, options.game, options.scenario)
    scenario = game.scenario(name, **fields)
    changes = read_fields(game, scenario, options.fields)
    return game, name, change_scenario(game.name, scenario, changes)


def change_fields(
    game: Game, name: str, fields: Mapping[str, Any], words: Sequence[str]
) -> dict[str, Any]:
    """`fields` of the scenario `name`, changed by `--set`, with those that follow the changes."""
    scenario = game.scenario(name, **fields)
    changes = read_fields(game, scenario, words)
    return {**fields, **getattr(scenario, "follow", dict)(changes)}


def expand_agents(sources: Sequence[str]) -> Expansion:
    """`expand_runs`; prints which agents each run stands for."""
    found = expand_runs(sources)
    sys.stderr.writelines(f"{line}\n" for line in found.notes)
    return found


def choose_recording(folder: str, *names: str) -> Recording | None:
    """Where --record records games between agents of these names; None without a folder."""
    return Recording(Path(folder), names) if folder else None


def round_games(num_games: int, spec: GameSpec) -> int:
    """`num_games` rounded up, with a notice, to whole blocks: a map seed in each seat (or team)."""
    num_teams = spec.num_teams
    rounded = -(-num_games // num_teams) * num_teams
    if rounded != num_games:
        place = "seats" if num_teams == spec.num_players else "teams"
        sys.stderr.write(
            f"games is {num_games}, playing {rounded}: each map seed once in each of {num_teams} "
            f"{place}\n"
        )
    return rounded


def read_seconds(text: str, option: str, other: str = "") -> float:
    """Seconds of "90s", "10m" or "2h". Raises ValueError for other words, with `other` forms that
    the option has.
    """
    try:
        seconds = float(text[:-1]) * _SECONDS[text[-1:]]
    except (KeyError, ValueError):
        seconds = math.nan
    if not 0.0 < seconds < math.inf:  # NaN is neither
        raise ValueError(
            f"{option} is {text!r}, it must be {other}a number above 0 with s, m or h, for "
            "example 10m"
        )
    return seconds


def read_size(text: str, option: str) -> int:
    """Bytes of "500MiB" or "2GiB"; 0 of "". Raises ValueError for other words."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?) ?([KMGT])i?B?", text)
    if found is None and text:
        raise ValueError(f"{option} is {text!r}, it must be a size, for example 500MiB or 2GiB")
    return int(float(found[1]) * 1024.0 ** ("KMGT".index(found[2]) + 1)) if found else 0


def choose_load(options: argparse.Namespace) -> Load:
    """The function that loads agents with the limits of ANSWER_LIMITS."""
    memory = read_size(options.answer_memory, "--answer-memory")
    if options.answer_seconds == 0 and (memory or options.answer_processes):
        raise ValueError(
            "--answer-seconds 0 runs functions in this process, where --answer-memory and "
            "--answer-processes have no effect: leave one or the others out"
        )
    return functools.partial(
        _load_limited,
        seconds=options.answer_seconds,
        answer_memory=memory,
        answer_processes=options.answer_processes,
    )


def _load_limited(
    source: str,
    game: str | None = None,
    scenario: Any = None,
    seconds: float | None = None,
    **limits: int,
) -> Agent:
    default = FUNCTION_SECONDS if is_foreign(source) else None
    limit = default if seconds is None else seconds or None  # 0: no limit
    return load_agent(source, game, scenario, answer_seconds=limit, **limits)


def print_league(result: LeagueResult) -> int:
    """Print the result of a league; returns the exit code."""
    from marl_cair.league.report.files import FILES

    page, *others = FILES
    sys.stdout.write(
        f"{result.text}\nThe report is {result.folder / page}; beside it are "
        f"{', '.join(others[:-1])} and {others[-1]}\n"
    )
    if result.ending:
        sys.stdout.write(f"{result.ending}\n")
    return EXIT_DONE


def format_command(name: str, arguments: Sequence[str]) -> str:
    """The command as it was typed."""
    return shlex.join(["marl-cair", *name.split(), *arguments])
