"""`marl-cair watch`: agents play in a window, or in a film that needs no display."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser, require_counts
from marl_cair.cli.viewing.play import (
    add_window_options,
    make_session,
    read_window_size,
    show_games,
)
from marl_cair.league.play.film import WRITERS
from marl_cair.lookup import find_by_name
from marl_cair.window.display import import_pygame

LEAST_FPS = 10


def run(arguments: Sequence[str]) -> int:
    """Show or film the games; returns the exit code."""
    options = make_parser().parse_args(arguments)
    if options.to is None:
        return show_games(options, options.agents, 0)
    require_counts(options, "every", "fps")
    path, size = Path(options.to), read_window_size(options.size)
    write = find_by_name("kind of film", path.suffix, WRITERS)
    import_pygame()
    from marl_cair.window.window import film_game

    session = make_session(options, options.agents, 0)
    every = options.every or (session.steps_per_decision if path.suffix == ".gif" else 1)
    fps = options.fps or max(LEAST_FPS, round(session.steps_per_second / every))
    seats = ", ".join(f"{seat} {name}" for seat, name in enumerate(session.names))
    num_frames = write(path, film_game(session, size, every), fps)
    num_ticks, each = len(session.history.actions), session.steps_per_decision
    length = f"{num_ticks} steps" if each == 1 else f"{num_ticks} ticks (steps of {each})"
    sys.stdout.write(
        f"{seats}: {session.describe_end()} after {length}; {path} has {num_frames} frames, {fps} "
        "in a second\n"
    )
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair watch",
        description=__doc__,
        epilog="example: marl-cair watch deep_rts/mixed deep_rts/rusher --to runs/game.gif",
    )
    parser.add_argument(
        "agents",
        nargs="+",
        metavar="AGENT",
        help=f"one for each seat, the last takes all that are left: {shared.AGENT_HELP}",
    )
    shared.add_options(parser, "--seed", *shared.SCENARIO_OPTIONS, *shared.ANSWER_LIMITS)
    parser.add_argument(
        "--to",
        metavar="FILE",
        help="write a film (.mp4, .gif, or a folder of pictures) and open no window",
    )
    parser.add_argument(
        "--every",
        type=int,
        help="of a film: show each so many ticks (default: 1; in a .gif, the steps of agents)",
    )
    parser.add_argument(
        "--fps",
        type=int,
        help="of a film: frames in a second (default: the game's own pace, at least 10)",
    )
    add_window_options(parser, "default: none")
    parser.set_defaults(records=False)
    return parser
