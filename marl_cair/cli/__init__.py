"""The console command `marl-cair`: train, curves, evaluate, match, league, games and more."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from importlib import import_module

from marl_cair import __version__
from marl_cair.interrupts import interrupts_raised
from marl_cair.lookup import find_by_name
from marl_cair.text import clean_text

# name -> (module of this package with `run(arguments) -> exit code`, what it does)
COMMANDS: dict[str, tuple[str, str]] = {
    "train": ("train", "train an agent against bots, itself and its past selves"),
    "curves": ("curves", "learning curves of training runs as one picture"),
    "evaluate": ("evaluate", "win rates of one agent against others, with 95 % intervals"),
    "match": ("match", "compare two agents in any scenario, of one seat or many"),
    "league": ("league", "rate any set of agents by a round-robin, with 95 % intervals"),
    "verify": ("verify", "check the stored files of a run, an agent, a mixture or a league"),
    "games": ("games", "list games, scenarios, representations, actions and bots"),
    "compile": ("compile", "compile the rules of games now, for images and clusters"),
    "benchmark": ("benchmark", "run the speed measurements of a source checkout"),
}
EXIT_DONE, EXIT_DAMAGED, EXIT_REFUSED, EXIT_INTERRUPTED = 0, 1, 2, 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a sub-command; returns the exit code: 0 done, 1 `verify` found damage, 2 refused (nothing
    was changed), 130 interrupted by one of `interrupts.SIGNALS` (what was saved before stays; a run
    saves at the first, not at a second).
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if not arguments or arguments[0] in ("-h", "--help"):
        sys.stdout.write(describe_commands())
        return EXIT_DONE
    if arguments[0] == "--version":
        sys.stdout.write(f"marl_cair {__version__}\n")
        return EXIT_DONE
    try:
        module, _ = find_by_name("command", arguments[0], COMMANDS)
        run: Callable[[list[str]], int] = import_module(f"marl_cair.cli.{module}").run
        with interrupts_raised():
            return run(arguments[1:])
    except KeyboardInterrupt:
        sys.stderr.write("marl-cair: interrupted\n")
        return EXIT_INTERRUPTED
    except (ValueError, OSError, MemoryError, ArithmeticError, RecursionError) as error:
        told = f"{error}" or type(error).__name__
        if isinstance(error, MemoryError):
            told = f"not enough memory: {told}; give smaller numbers"
        sys.stderr.write(f"marl-cair: {clean_text(told)}\n")
        return EXIT_REFUSED
    except RuntimeError as error:
        if "allocate memory" not in f"{error}":  # what torch says in place of a MemoryError
            raise
        sys.stderr.write(f"marl-cair: not enough memory: {error}; give smaller numbers\n")
        return EXIT_REFUSED


def describe_commands() -> str:
    """The text of `marl-cair --help`."""
    lines = ["usage: marl-cair COMMAND [options]", ""]
    lines += [f"  {name:10} {text}" for name, (_, text) in COMMANDS.items()]
    lines += ["", "marl-cair COMMAND --help tells all options; marl-cair --version the version."]
    return "\n".join(lines) + "\n"
