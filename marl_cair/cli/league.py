"""`marl-cair league`: any agents, seat-balanced games, ratings with intervals."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.match_options import (
    add_match_options,
    add_no_replays,
    add_workers,
    choose_load,
    expand_agents,
    read_seconds,
)
from marl_cair.cli.parser import Parser
from marl_cair.league.agents.load import find_scenario
from marl_cair.league.agents.run_folders import MOST_SNAPSHOTS
from marl_cair.league.play.blocks import SEATINGS
from marl_cair.league.store.export import FORMATS, QUERIES, export_league
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from marl_cair.text import clean_text

if TYPE_CHECKING:
    from marl_cair.league.report.report import LeagueResult

DEFAULT_OUT = "runs/league"
GAMES_PER_PAIR = 40
MOST_GAMES_PER_PAIR = 2_000  # of the adaptive schedule


def run(arguments: Sequence[str]) -> int:
    """Play and print ladder and matrix, or what a sub-command says; returns the exit code."""
    if arguments and arguments[0] in SUBCOMMANDS:
        return SUBCOMMANDS[arguments[0]](arguments[1:])
    options = make_parser().parse_args(arguments)
    from marl_cair.league.league import LeagueConfig, run_league

    found = expand_agents([*options.agents, *options.ladder])
    agents, ladder = found.list_agents(options.agents), found.list_agents(options.ladder)
    everyone = [*agents, *ladder]
    game, scenario, scenario_options = find_scenario(everyone, options.game, options.scenario)
    max_seconds = _read_time(options.time)
    is_adaptive = options.ci > 0.0 or max_seconds > 0.0
    games = (
        options.games
        if options.games is not None
        else (MOST_GAMES_PER_PAIR if is_adaptive else GAMES_PER_PAIR)
    )
    result = run_league(
        LeagueConfig(
            agents=agents,
            game=game.name,
            scenario=scenario,
            scenario_options=scenario_options,
            games_per_pair=games,
            seed=options.seed,
            out=options.out,
            ladder=ladder,
            seating=options.seating,
            workers=options.workers,
            half_width_elo=options.ci,
            max_seconds=max_seconds,
            replays=not options.no_replays,
            zero=options.zero,
            command=tell_command("league", arguments),
        ),
        choose_load(options),
    )
    return tell(result)


def report(arguments: Sequence[str]) -> int:
    """Ratings of all stored games; plays nothing but the few games that the report shows."""
    parser = Parser("marl-cair league report", description=report.__doc__)
    _add_folder(parser)
    parser.add_argument(
        "--alpha-rank",
        action="store_true",
        help="alpha-Rank too; needs pip install 'marl_cair[openspiel]' (default: no)",
    )
    add_no_replays(parser)
    _add_zero(parser)
    options = parser.parse_args(arguments)
    replays = not options.no_replays
    from marl_cair.league.report.report import report_stored

    return tell(report_stored(Path(options.out), options.alpha_rank, replays, options.zero))


def tell(result: LeagueResult) -> int:
    """Print what a league found; returns the exit code."""
    from marl_cair.league.report.files import FILES

    page, *others = FILES
    sys.stdout.write(
        f"{result.text}\nThe report is {result.folder / page}; beside it are "
        f"{', '.join(others[:-1])} and {others[-1]}\n"
    )
    if result.ending:
        sys.stdout.write(f"{result.ending}\n")
    return EXIT_DONE


def tell_command(name: str, arguments: Sequence[str]) -> str:
    """The command as it was typed."""
    return shlex.join(["marl-cair", *name.split(), *arguments])


def tell_status(arguments: Sequence[str]) -> int:
    """What a league file holds; also while the league is played."""
    parser = Parser("marl-cair league status", description=tell_status.__doc__)
    _add_folder(parser)
    store = LeagueStore(Path(parser.parse_args(arguments).out) / STORE_FILE)
    from marl_cair.league.report.background import describe_training

    try:
        games, agents = store.read_games(), store.read_agents()
        held = {key: store.settings[key] for key in ("game", "game_version", "seed", "seating")}
        lines = [clean_text(", ".join(f"{key} {value}" for key, value in held.items()))]
        lines.append(
            f"{len(agents)} agents, {len(games.agents)} games in {len(set(games.blocks.tolist()))} "
            f"blocks, {int(games.is_repeat.sum())} of them repeats of another"
        )
        for number, agent in agents.items():
            played = int((games.agents == number).any(axis=1).sum())
            about = agent.kind, agent.evaluation_policy, describe_training(agent), agent.fingerprint
            lines.append(f"  {agent.name}: {played} games; {', '.join(filter(None, about))}")
        lines += [f"  forfeits, {count}: {reason}" for reason, count in store.read_forfeits()]
    finally:
        store.close()
    sys.stdout.write("\n".join(lines) + "\n")
    return EXIT_DONE


def export(arguments: Sequence[str]) -> int:
    """The tables of a league file for other programs."""
    parser = Parser("marl-cair league export", description=export.__doc__)
    _add_folder(parser)
    parser.add_argument(
        "--format",
        default="csv",
        choices=list(FORMATS),
        help="parquet needs pyarrow: pip install 'marl_cair[parquet]' (default: %(default)s)",
    )
    parser.add_argument(
        "--to", help="folder to write to (default: `export` in the folder of the league)"
    )
    options = parser.parse_args(arguments)
    store = LeagueStore(Path(options.out) / STORE_FILE)
    try:
        folder = Path(options.to or Path(options.out) / "export")
        paths = export_league(store, folder, options.format)
    finally:
        store.close()
    sys.stdout.write(f"{', '.join(path.name for path in paths)} are in {folder}\n")
    return EXIT_DONE


def add(arguments: Sequence[str]) -> int:
    """New agents for a league that exists."""
    from marl_cair.cli import add as command  # which imports this

    return command.run(arguments)


def mix(arguments: Sequence[str]) -> int:
    """One agent of several."""
    from marl_cair.cli import mix as command  # which imports this package

    return command.run(arguments)


def run_exploit(arguments: Sequence[str]) -> int:
    """Best responses trained against one agent."""
    from marl_cair.cli import exploit  # torchrl takes seconds, and only this trains

    return exploit.run(arguments)


def train(arguments: Sequence[str]) -> int:
    """Learners that train against one another: `cli.league_train`."""
    from marl_cair.cli.league_train import run_training

    return run_training(arguments)


def train_psro(arguments: Sequence[str]) -> int:
    """Best responses, one after the other: `cli.league_train`."""
    from marl_cair.cli.league_train import run_psro

    return run_psro(arguments)


SUBCOMMANDS: dict[str, Callable[[Sequence[str]], int]] = {
    "train": train,
    "psro": train_psro,
    "report": report,
    "status": tell_status,
    "export": export,
    "add": add,
    "mix": mix,
    "exploit": run_exploit,
}


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair league",
        description=f"{__doc__} The same command again goes on where it stopped, and with more "
        "games or agents plays only what is new.",
        epilog="`marl-cair league report FOLDER` rates all that is stored, `league status FOLDER` "
        f"tells what that is, `league export FOLDER` writes it ({', '.join(QUERIES)}) as CSV, JSON "
        "or Parquet. `league add AGENT` adds an agent, `league exploit AGENT` trains against it, "
        "`league train FILE` trains a league, `league psro FILE` best responses one after the "
        "other (--help tells more).",
    )
    parser.add_argument(
        "agents",
        nargs="+",
        help="two or more: folders of checkpoints (runs/a/latest), of runs (runs/a: of `train` its "
        f"`latest` and {MOST_SNAPSHOTS} snapshots at most, of `league train` each learner, of "
        "`league psro` the mixture, of `league exploit` the best response) or of mixtures, bots "
        "(`marl-cair games` lists them), functions that make an agent (module:function, called "
        "with scenario and spec), and commands that speak JSON lines (process:COMMAND)",
    )
    add_match_options(parser, GAMES_PER_PAIR, "of each pair", "first checkpoint", "bots alone")
    parser.set_defaults(games=None)
    parser.add_argument(
        "--ladder",
        nargs="+",
        default=[],
        metavar="AGENT",
        help="further agents that the others play, but that do not play each other anew; what is "
        "stored of their games counts (default: nobody)",
    )
    parser.add_argument(
        "--seating",
        default="",
        choices=SEATINGS,
        help="how a map seed is played by more than three: in all orders of the seats, or in the "
        "rotations of a random ring (default: all for two and three, ring for more)",
    )
    parser.add_argument(
        "--ci",
        type=float,
        default=0.0,
        metavar="ELO",
        help="play where it tells most until every 95 %% interval is ELO or less either way; "
        f"--games is then the most for a pair, if not given {MOST_GAMES_PER_PAIR} (default: no)",
    )
    parser.add_argument(
        "--time",
        default="",
        help="as --ci, until so much time is over, for example 90s, 10m or 2h (default: no)",
    )
    add_workers(parser)
    add_no_replays(parser)
    _add_zero(parser)
    parser.add_argument(
        "--out",
        default=DEFAULT_OUT,
        help="folder of results and report; one of another seed, game or scenario is refused "
        "(default: %(default)s)",
    )
    return parser


def _read_time(text: str) -> float:
    if not text:
        return 0.0
    seconds = read_seconds(text)
    if seconds is None:
        raise ValueError(
            f"--time is {text!r}, it must be a number above 0 with s, m or h, for example 10m"
        )
    return seconds


def _add_zero(parser: Parser) -> None:
    parser.add_argument(
        "--zero",
        default="",
        metavar="NAME",
        help="the agent that is rated 0, as the ladder calls it, if games limit its rating "
        "(default: the mean of all whose ratings games limit is 0)",
    )


def _add_folder(parser: Parser) -> None:
    parser.add_argument(
        "out", nargs="?", default=DEFAULT_OUT, help="folder of the league (default: %(default)s)"
    )
