"""`marl-cair compile`: compile the rules of games ahead of their first use.

For the image of a container, or before many processes start on one machine. The code is kept in
$MARL_CAIR_CACHE, else in the user's cache folder, until a rule, numba or the processor changes.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from tqdm import tqdm

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.parser import Parser
from marl_cair.games import GAMES
from marl_cair.games.compiled import cache_root, is_compiling
from marl_cair.games.precompile import compile_parts, list_parts, list_representations
from marl_cair.memory import count_cores


def run(arguments: Sequence[str]) -> int:
    """Compile, with a progress bar; returns the exit code.

    Raises:
        UnknownNameError: no such game; names the nearest.
        GameLoadError: a game that is named is of an installed package, and fails.
        ValueError: fewer than one worker, or the compiler is off.
        OSError: a worker process has died.
    """
    parser = Parser("marl-cair compile", description=__doc__)
    parser.add_argument("games", nargs="*", metavar="GAME", help="default: all games")
    parser.add_argument(
        "--workers", type=int, default=count_cores(), help="processes (default: one per core)"
    )
    options = parser.parse_args(arguments)
    if not is_compiling():
        raise ValueError("NUMBA_DISABLE_JIT is set, so rules are not compiled: unset it")
    began = time.monotonic()
    games = list(dict.fromkeys(options.games)) or list(GAMES.apply_to_all(list_representations))
    parts = list_parts(games)
    with tqdm(total=len(parts), unit="part", disable=None) as bar:
        for part in compile_parts(parts, options.workers):
            bar.set_postfix_str(f"{part.game} {part.use}")
            bar.update()
    seconds = time.monotonic() - began
    sys.stdout.write(
        f"compiled the rules of {', '.join(games)} in {seconds:.0f} s: {cache_root()}\n"
    )
    return EXIT_DONE
