"""`marl-cair dashboard`: show training runs on a local page while they train."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.curves import name_runs
from marl_cair.cli.parser import Parser
from marl_cair.training.settings.config_file import CONFIG_FILE

DEFAULT_PORT = 8420


def run(arguments: Sequence[str]) -> int:
    """Serve the page until it is interrupted, or write it; returns the exit code."""
    options = make_parser().parse_args(arguments)
    runs = name_runs(options.runs, CONFIG_FILE)
    from marl_cair.dashboard.server import HOST, make_server, write_dashboard

    if options.out:
        write_dashboard(runs, Path(options.out))
        sys.stdout.write(f"{options.out}: {', '.join(runs)}\n")
        return EXIT_DONE
    with make_server(runs, options.port) as server:
        sys.stdout.write(f"open http://{HOST}:{server.server_port}/ (Ctrl+C ends it)\n")
        sys.stdout.flush()
        server.serve_forever()
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair dashboard",
        description=__doc__,
        epilog="example: marl-cair dashboard runs/conv runs/capsule",
    )
    parser.add_argument("runs", nargs="+", metavar="RUN", help="folder of a training run")
    parser.add_argument(
        "--port",
        type=read_port,
        default=DEFAULT_PORT,
        help="port of the page, which only this machine can open; 0: any free one "
        "(default: %(default)s)",
    )
    parser.add_argument("--out", metavar="HTML", help="write the page as one file instead")
    return parser


def read_port(text: str) -> int:
    """Raises ArgumentTypeError unless `text` is a whole number from 0 to 65535."""
    if not (text.isascii() and text.isdigit() and int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is no port: give a number from 0 to 65535")
    return int(text)
