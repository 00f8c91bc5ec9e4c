"""`marl-cair play`: play a game by hand, against bots, trained agents or other people."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser
from marl_cair.cli.viewing import browser_play
from marl_cair.games import GAMES
from marl_cair.games.game import Agent
from marl_cair.games.players.random_player import RANDOM
from marl_cair.games.replays import REPLAY_SUFFIX
from marl_cair.lookup import find_by_name
from marl_cair.window.display import import_pygame, open_display

if TYPE_CHECKING:
    from marl_cair.window.session import Session

DEFAULT_SIZE = "1280x800"
LEAST_SIZE, MOST_SIZE = 160, 8_192  # pixels along a side


def run(arguments: Sequence[str]) -> int:
    """Open the window and play until it is closed; returns the exit code."""
    if "--browser" in arguments or list(arguments) == [browser_play.INSTALL]:
        return browser_play.run(arguments)
    options = make_parser().parse_args(arguments)
    game = find_by_name("game", options.game_name, GAMES)
    options.game = game.name
    return show_games(options, options.opponent, options.humans)


def show_games(options: argparse.Namespace, agents: Sequence[str], num_persons: int) -> int:
    """Open a window in which persons and agents play; returns the exit code."""
    import_pygame()
    from marl_cair.window.window import Window

    size = read_window_size(options.size)
    if not 0.01 <= options.speed <= 1_000.0:
        raise ValueError(f"--speed is {options.speed}, it must be in 0.01..1000")
    with closing(make_session(options, agents, num_persons)) as session:
        surface = open_display(size, f"{session.game.title}: marl_cair")
        Window(session, surface, Path(options.folder), options.speed).run()
    return EXIT_DONE


def make_session(options: argparse.Namespace, agents: Sequence[str], num_persons: int) -> Session:
    """The games that the options describe. Raises ValueError as `seat_players`, and for agents and
    scenarios.
    """
    from marl_cair.window.session import Session

    game, name, scenario = shared.choose_scenario(options, agents)
    num_seats = game.make_spec(scenario).num_players
    first = getattr(options, "seat", 0)
    seats = seat_players(agents, num_seats, num_persons, first, f"{game.name} {name}")
    load = shared.choose_load(options)
    players: list[Agent | None] = [
        None if source is None else load(source, game.name, scenario) for source in seats
    ]
    record, statistics = name_files(options, game.name)
    if record is not None:
        _make_folder(record.parent, "--record" if options.record else "--folder, or --no-record")
    return Session(game, scenario, players, options.seed, record, statistics)


def seat_players(
    agents: Sequence[str], num_seats: int, num_persons: int, first: int, game: str
) -> list[str | None]:
    """Who sits in each seat: None for a person. Persons sit from seat `first` on; a last agent
    takes all seats that are left.

    Raises ValueError for a seat that does not exist, or more players than seats.
    """
    if not 0 <= first < num_seats:
        raise ValueError(f"--seat is {first}, {game} has the seats 0..{num_seats - 1}")
    if not 0 <= num_persons <= num_seats:
        raise ValueError(f"--humans is {num_persons}, {game} has {num_seats} seats")
    num_agents = num_seats - num_persons
    if len(agents) > num_agents and not (num_agents == 0 and list(agents) == [RANDOM]):
        raise ValueError(
            f"{len(agents)} agents for {num_agents} seats of {game}: name at most {num_agents}"
        )
    persons = {(first + number) % num_seats for number in range(num_persons)}
    filled = [*agents, *[agents[-1]] * num_agents][:num_agents]
    sources = iter(filled)
    return [None if seat in persons else next(sources) for seat in range(num_seats)]


def name_files(options: argparse.Namespace, game: str) -> tuple[Path | None, Path]:
    """The replay (None: there is none) and the statistics, without suffix, of the first game.

    Replays go to --record, those of `play` else to --folder; statistics to --statistics, else
    beside the replay, else to --folder. Names without --record have the time in them.
    """
    name = f"{game}-{datetime.now().astimezone():%Y%m%d-%H%M%S-%f}"
    record = Path(options.record) if options.record else None
    if record is None and options.records:
        record = Path(options.folder) / f"{name}{REPLAY_SUFFIX}"
    if options.statistics or record is None:
        return record, Path(options.statistics or options.folder) / name
    return record, record.with_suffix("")


def _make_folder(folder: Path, options: str) -> None:
    """Make the folder of recordings. Raises ValueError where that is not possible."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError("it is read-only")
    except OSError as error:
        raise ValueError(
            f"games cannot be recorded in {folder} ({error}): give another {options}"
        ) from error


def read_window_size(text: str) -> tuple[int, int]:
    """Width and height of "1280x800". Raises ValueError for other words and sizes."""
    found = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text)
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    if not all(LEAST_SIZE <= side <= MOST_SIZE for side in size):
        raise ValueError(
            f"--size is {text!r}, it must be width x height in pixels, {LEAST_SIZE}..{MOST_SIZE} "
            f"each, for example {DEFAULT_SIZE}"
        )
    return size


def add_window_options(parser: argparse.ArgumentParser, unrecorded: str) -> None:
    """Options that `play` and `watch` share; `unrecorded`: what is done without --record."""
    parser.add_argument(
        "--record", metavar="FILE", help=f"record the game as a replay ({unrecorded})"
    )
    parser.add_argument(
        "--statistics",
        metavar="FOLDER",
        help="of statistics, CSV and JSON: a folder (default: beside the replay, else --folder)",
    )
    parser.add_argument(
        "--folder",
        default="runs/play",
        help="of replays, statistics and screenshots (default: %(default)s)",
    )
    parser.add_argument(
        "--speed", type=float, default=1.0, help="1 is the game's own (default: %(default)s)"
    )
    parser.add_argument(
        "--size", default=DEFAULT_SIZE, help="of the window in pixels (default: %(default)s)"
    )


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair play",
        description=__doc__,
        epilog="example: marl-cair play deep_line_wars --opponent agents/deep_line_wars_10x15. "
        "The key G lists all keys.",
    )
    parser.add_argument("game_name", metavar="GAME", help="a game, as `marl-cair games` lists them")
    parser.add_argument(
        "--opponent",
        nargs="+",
        default=[RANDOM],
        metavar="AGENT",
        help=f"one for each other seat, the last takes all that are left: {shared.AGENT_HELP} "
        "(default: random)",
    )
    parser.add_argument(
        "--seat", type=int, default=0, help="of the first person (default: %(default)s)"
    )
    parser.add_argument(
        "--humans", type=int, default=1, help="people at this machine (default: %(default)s)"
    )
    shared.add_options(parser, "--seed", "--scenario", "--set", *shared.ANSWER_LIMITS)
    parser.add_argument(
        "--browser",
        action="store_true",
        help="play on a page instead: see `marl-cair play --browser --help`",
    )
    add_window_options(parser, "default: in --folder, with the time in its name")
    parser.add_argument(
        "--no-record", dest="records", action="store_false", help="record no game by default"
    )
    return parser
