"""`marl-cair flash`: install Ruffle, list what is missing, add SWF files, play by hand."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from marl_cair.cli import EXIT_DAMAGED, EXIT_DONE
from marl_cair.cli.parser import Parser


def run(arguments: Sequence[str]) -> int:
    """Run `install`, `doctor`, `add` or `play`; returns the exit code."""
    parser = Parser("marl-cair flash", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, parser_class=Parser)
    commands.add_parser("install", help="fetch Ruffle, the Flash player, from npm")
    commands.add_parser("doctor", help="list what is missing, and the command that installs it")
    _add_add(commands)
    play = commands.add_parser("play", help="play by hand, in a window or in any VNC viewer")
    play.add_argument(
        "game", help="multitask, duel, a Flash file (.swf) or its description (.toml)"
    )
    play.add_argument("--vnc", action="store_true", help="print the VNC socket and wait; no window")
    chosen = parser.parse_args(arguments)
    if chosen.command == "install":
        from marl_cair.games.flash.browser.installing import install_ruffle

        sys.stdout.write(f"Ruffle is in {install_ruffle()}\n")
    elif chosen.command == "doctor":
        return _report_missing()
    elif chosen.command == "add":
        from marl_cair.cli.flash.add import describe_swf

        sys.stdout.write(describe_swf(chosen))
    else:
        from marl_cair.cli.flash.play import play_by_hand

        play_by_hand(chosen.game, with_window=not chosen.vnc)
    return EXIT_DONE


def _add_add(commands: Any) -> None:
    add = commands.add_parser("add", help="describe a SWF file, so that agents can play it")
    add.add_argument("swf", type=Path, metavar="GAME.swf")
    add.add_argument("--name", help="of the description that is written (default: the SWF's)")
    add.add_argument("--keys", default="", help="as left,right,up,down; players divided by ;")
    add.add_argument("--mouse-grid", metavar="8x6", help="columns and rows of places to click")
    add.add_argument("--start", default="", help="what begins a game: a key, a click x,y or a "
                     "number of frames, divided by ; as 30;240,200;enter")  # fmt: skip
    add.add_argument("--callback", default="", help="of ExternalInterface, returning an object")
    add.add_argument("--reward", default="alive", help="alive (a point per frame, the default), "
                     "the name of a number in that object, or x,y,width,height: the brightness of "
                     "that part of the picture")  # fmt: skip
    add.add_argument("--renderer", default="", help="canvas (the default), or webgl: slower, but "
                     "right for games that need filters or blend modes")  # fmt: skip
    add.add_argument("--done", required=True, help="the end: name of a truth value in that "
                     "object, or x,y,width,height,PICTURE.png: the part that looks so")  # fmt: skip
    add.add_argument("--out", type=Path, default=Path(), help="folder to write to (default: here)")


def _report_missing() -> int:
    """Print what is missing; exit code 1 where something is."""
    from marl_cair.games.flash.browser.installing import diagnose

    missing = diagnose()
    for part in missing:
        sys.stdout.write(f"missing: {part.name} ({part.purpose})\n  {part.command}\n")
    if not missing:
        sys.stdout.write("nothing is missing: try `marl-cair flash play multitask`\n")
    return EXIT_DAMAGED if missing else EXIT_DONE
