"""The console command `marl-cair`: train, curves, evaluate, match, league, games and more."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence

from marl_cair import __version__
from marl_cair.interrupts import interrupts_raised
from marl_cair.lookup import LazyTable, find_by_name
from marl_cair.text import clean_text

# Each takes the words after its name and returns an exit code; imported when it is called.
COMMANDS: LazyTable[Callable[[Sequence[str]], int]] = LazyTable(
    {
        "train": "marl_cair.cli.train:run",
        "curves": "marl_cair.cli.curves:run",
        "dashboard": "marl_cair.cli.viewing.dashboard:run",
        "evaluate": "marl_cair.cli.evaluate:run",
        "match": "marl_cair.cli.match:run",
        "league": "marl_cair.cli.league:run",
        "play": "marl_cair.cli.viewing.play:run",
        "watch": "marl_cair.cli.viewing.watch:run",
        "replay": "marl_cair.cli.viewing.replay:run",
        "experiment": "marl_cair.cli.experiment:run",
        "reproduce": "marl_cair.cli.experiment:reproduce",
        "dataset": "marl_cair.cli.generating.dataset:run",
        "generator": "marl_cair.cli.generating.generator:run",
        "export": "marl_cair.cli.agent.export:run",
        "explain": "marl_cair.cli.agent.explain:run",
        "flash": "marl_cair.cli.flash:run",
        "games": "marl_cair.cli.games:run",
        "verify": "marl_cair.cli.verify:run",
        "compile": "marl_cair.cli.compile:run",
    }
)
# The tasks in the order of a user's work: the words of the command, and a description.
TASKS = {
    "games": "list games, scenarios, representations, actions and bots",
    "train": "train an agent against bots, itself and its past selves",
    "train --multirun": "train one agent for each combination of values: seeds, networks",
    "train resume=RUN": "continue an interrupted run",
    "dataset collect": "write transitions of random play or of agents to a data set",
    "generator train": "train a generator of transitions on a data set; `generator watch` films it",
    "curves": "plot learning curves of training runs",
    "dashboard": "show training runs on a local page while they train",
    "experiment PLAN": "train and rate the product of networks, learners, games and seeds",
    "evaluate": "shares of games won by one agent against others, with 95 % intervals",
    "match": "compare two agents in any scenario",
    "play": "play a game by hand against bots, trained agents or people",
    "league": "rate agents by a round-robin, with 95 % intervals",
    "league train": "train a population of agents (league psro: best responses in turn)",
    "league exploit": "train against one agent: how far can it be exploited?",
}
EXIT_DONE, EXIT_DAMAGED, EXIT_REFUSED, EXIT_INTERRUPTED = 0, 1, 2, 130
RESUMED = ("experiment", "league", "reproduce")  # where nothing else says so


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a sub-command; returns the exit code: 0 done, 1 `verify` found damage, 2 refused (nothing
    was changed), 130 interrupted by one of `interrupts.SIGNALS` (a run saves at the first, and
    stops at once at a second).
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if not arguments or arguments[0] in ("-h", "--help"):
        sys.stdout.write(describe_commands())
        return EXIT_DONE
    if arguments[0] == "--version":
        sys.stdout.write(f"marl_cair {__version__}\n")
        return EXIT_DONE
    # Threads of torch wait for one another: beside other programs several take ten times as long.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        run = find_by_name("command", arguments[0], COMMANDS)
        with interrupts_raised():
            return run(arguments[1:])
    except KeyboardInterrupt:
        again = "; the same command goes on from here" if arguments[0] in RESUMED else ""
        sys.stderr.write(f"marl-cair: interrupted{again}\n")
        return EXIT_INTERRUPTED
    except (ValueError, OSError, MemoryError, ArithmeticError, RecursionError) as error:
        text = f"{error}" or type(error).__name__
        if isinstance(error, MemoryError):
            text = f"not enough memory: {text}; give smaller numbers"
        return _refuse(error, text)
    except RuntimeError as error:
        if "allocate memory" not in f"{error}":  # torch's form of a MemoryError
            raise
        return _refuse(error, f"not enough memory: {error}; give smaller numbers")


def _refuse(error: Exception, text: str) -> int:
    for line in (text, *getattr(error, "__notes__", ())):
        sys.stderr.write(f"marl-cair: {clean_text(line)}\n")
    return EXIT_REFUSED


def describe_commands() -> str:
    """The text of `marl-cair --help`."""
    lines = ["usage: marl-cair COMMAND [options]", ""]
    width = max(map(len, TASKS))
    lines += [f"  {task:{width}}  {text}" for task, text in TASKS.items()]
    others = (name for name in COMMANDS if not any(name in task.split() for task in TASKS))
    lines += ["", f"  other commands: {', '.join(others)}", ""]
    lines += ["marl-cair COMMAND --help lists all options, marl-cair --version prints the version."]
    return "\n".join(lines) + "\n"
