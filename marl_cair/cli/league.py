"""`marl-cair league`: rate agents by seat-balanced games, with 95 % intervals."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser, require_counts
from marl_cair.games.replays import REPLAY_SUFFIX, write_replay
from marl_cair.league.agents.load import find_scenario
from marl_cair.league.agents.run_folders import MOST_SNAPSHOTS
from marl_cair.league.play.blocks import SEATINGS
from marl_cair.league.store.export import FORMATS, QUERIES, export_league
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from marl_cair.lookup import LazyTable, check_name
from marl_cair.text import clean_text

GAMES_PER_PAIR = 40
MOST_GAMES_PER_PAIR = 2_000  # of the adaptive schedule


def run(arguments: Sequence[str]) -> int:
    """Play and print ladder and matrix, or run a sub-command; returns the exit code."""
    if arguments and arguments[0] in SUBCOMMANDS:
        return SUBCOMMANDS[arguments[0]](arguments[1:])
    options = make_parser().parse_args(arguments)
    from marl_cair.league.league import LeagueConfig, run_league

    found = shared.expand_agents([*options.agents, *options.ladder])
    agents, ladder = found.list_agents(options.agents), found.list_agents(options.ladder)
    game, scenario, fields = find_scenario([*agents, *ladder], options.game, options.scenario)
    fields = shared.change_fields(game, scenario, fields, options.fields)
    max_seconds, games = read_limits(options)
    result = run_league(
        LeagueConfig(
            agents=agents,
            game=game.name,
            scenario=scenario,
            scenario_options=fields,
            games_per_pair=GAMES_PER_PAIR if games is None else games,
            seed=options.seed,
            out=options.out,
            ladder=ladder,
            seating=options.seating,
            workers=options.workers,
            cluster=options.cluster,
            half_width_elo=options.ci,
            max_seconds=max_seconds,
            replays=not options.no_replays,
            zero=options.zero,
            record=options.record,
            command=shared.format_command("league", arguments),
        ),
        shared.choose_load(options),
    )
    return shared.print_league(result)


def report(arguments: Sequence[str]) -> int:
    """Rate all stored games again; plays only the few games that the report shows."""
    parser = _make_folder_parser("report", report.__doc__)
    parser.add_argument(
        "--alpha-rank",
        action="store_true",
        help="alpha-Rank too; needs pip install 'marl_cair[openspiel]' (default: no)",
    )
    shared.add_options(parser, "--no-replays")
    add_zero(parser)
    options = parser.parse_args(arguments)
    from marl_cair.league.report.report import report_stored

    folder, replays = Path(options.out), not options.no_replays
    return shared.print_league(report_stored(folder, options.alpha_rank, replays, options.zero))


def print_status(arguments: Sequence[str]) -> int:
    """List the agents and games in a league file; also while the league is played."""
    options = _make_folder_parser("status", print_status.__doc__).parse_args(arguments)
    from marl_cair.league.report.background import describe_training

    with closing(LeagueStore(Path(options.out) / STORE_FILE)) as store:
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
        forfeits = sorted(Counter(filter(None, games.reasons)).items())
        lines += [f"  forfeits, {count}: {reason}" for reason, count in forfeits]
    sys.stdout.write("\n".join(lines) + "\n")
    return EXIT_DONE


def export(arguments: Sequence[str]) -> int:
    """Write the tables of a league file for other programs."""
    parser = _make_folder_parser("export", export.__doc__)
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
    folder = Path(options.to or Path(options.out) / "export")
    with closing(LeagueStore(Path(options.out) / STORE_FILE)) as store:
        paths = export_league(store, folder, options.format)
    sys.stdout.write(f"{', '.join(path.name for path in paths)} are in {folder}\n")
    return EXIT_DONE


def replay(arguments: Sequence[str]) -> int:
    """Write games of a league as replay files, played again from their seeds."""
    parser = _make_folder_parser("replay", replay.__doc__)
    parser.add_argument(
        "--between",
        nargs="+",
        default=[],
        metavar="NAME",
        help="only games in which all these agents play, as the ladder calls them (default: all)",
    )
    parser.add_argument("--games", type=int, default=10, help="at most (default: %(default)s)")
    parser.add_argument(
        "--to", help="folder to write to (default: `games` in the folder of the league)"
    )
    shared.add_options(parser, "--allow-code", *shared.ANSWER_LIMITS, files="the league file")
    options = parser.parse_args(arguments)
    require_counts(options, "games")
    from marl_cair.league.report.replays import NotShownError, ReplayRenderer
    from marl_cair.league.report.report import name_agents

    folder = Path(options.out)
    target = Path(options.to or folder / "games")
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        stored, names = store.read_games(), name_agents(store.read_agents())
        for name in options.between:
            check_name("agent of this league", name, names.values())
        ids = [number for number, name in names.items() if name in options.between]
        chosen = [place for place, row in enumerate(stored.agents) if np.isin(ids, row).all()]
        load = shared.choose_load(options)
        renderer = ReplayRenderer(store, stored, names, folder, load, options.allow_code)
        for place in chosen[: options.games]:
            number, turn = int(stored.line_ups[place]), int(stored.turns[place])
            name = f"{number:04}-{int(stored.numbers[place]):04}-{turn}{REPLAY_SUFFIX}"
            try:
                write_replay(target / name, renderer.play_again(place)[0])
                sys.stdout.write(f"{target / name}: {renderer.describe(place)}\n")
            except NotShownError as error:
                sys.stdout.write(f"not written: {renderer.describe(place)} {error}\n")
    return EXIT_DONE


# name -> "module:function", imported when it is called
SUBCOMMANDS: LazyTable[Callable[[Sequence[str]], int]] = LazyTable(
    {
        "train": "marl_cair.cli.league_train:run_training",
        "psro": "marl_cair.cli.league_train:run_psro",
        "report": "marl_cair.cli.league:report",
        "status": "marl_cair.cli.league:print_status",
        "export": "marl_cair.cli.league:export",
        "replay": "marl_cair.cli.league:replay",
        "add": "marl_cair.cli.league_members:add",
        "mix": "marl_cair.cli.league_members:mix",
        "exploit": "marl_cair.cli.exploit:run",
    }
)


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair league",
        description=f"{__doc__} The same command again resumes an interrupted league; with more "
        "games or agents it plays only the new ones.",
        epilog="`marl-cair league report FOLDER` rates all stored games, `league status FOLDER` "
        f"lists them, `league export FOLDER` writes them ({', '.join(QUERIES)}) as CSV, JSON or "
        "Parquet, `league replay FOLDER` as replays. `league add AGENT` adds an agent, `league mix "
        "FOLDER` mixes agents, `league exploit AGENT` trains against one, `league train FILE` "
        "trains a league, `league psro FILE` trains best responses in turn. See their --help.",
    )
    parser.add_argument(
        "agents",
        nargs="+",
        help=f"two or more, each: {shared.AGENT_HELP}. A run of `train` stands for `latest` and "
        f"{MOST_SNAPSHOTS} snapshots at most, one of `league train` for each learner, one of "
        "`league psro` for the mixture, one of `league exploit` for the best response",
    )
    shared.add_options(
        parser,
        *shared.MATCH_OPTIONS,
        *("--workers", "--cluster", "--no-replays", "--record"),
        games_of="of each pair",
        games=GAMES_PER_PAIR,
    )
    parser.add_argument(
        "--ladder",
        nargs="+",
        default=[],
        metavar="AGENT",
        help="further agents that the others play, but that play no new games between each other; "
        "their stored games count (default: none)",
    )
    parser.add_argument(
        "--seating",
        default="",
        choices=SEATINGS,
        help="how more than three play a map seed: in all orders of the seats, or in the rotations "
        "of a random ring (default: all for two and three, ring for more)",
    )
    add_limits(parser)
    add_zero(parser)
    parser.add_argument(
        "--out",
        default=shared.DEFAULT_OUT,
        help="folder of results and report; that of another seed, game or scenario is refused "
        "(default: %(default)s)",
    )
    return parser


def add_limits(parser: Parser) -> None:
    """The options `--ci` and `--time`."""
    parser.add_argument(
        "--ci",
        type=float,
        default=0.0,
        metavar="ELO",
        help="play the most informative games until each 95 %% interval is ELO or less either way; "
        f"--games is then the most per pair, by default {MOST_GAMES_PER_PAIR} (default: no)",
    )
    parser.add_argument(
        "--time", default="", help="as --ci, for this time: 90s, 10m or 2h (default: no)"
    )


def read_limits(options: argparse.Namespace) -> tuple[float, int | None]:
    """The seconds of `--time`, 0 without it; and `--games`, or its default with a limit."""
    seconds = shared.read_seconds(options.time, "--time") if options.time else 0.0
    is_adaptive = options.ci > 0.0 or seconds > 0.0
    usual = MOST_GAMES_PER_PAIR if is_adaptive else None
    return seconds, usual if options.games is None else options.games


def add_zero(parser: Parser) -> None:
    """The option `--zero`."""
    parser.add_argument(
        "--zero",
        default="",
        metavar="NAME",
        help="the agent that is rated 0, as the ladder calls it, if games limit its rating "
        "(default: the mean of all whose ratings games limit is 0)",
    )


def _make_folder_parser(command: str, about: str | None) -> Parser:
    parser = Parser(f"marl-cair league {command}", description=about)
    parser.add_argument(
        "out",
        nargs="?",
        default=shared.DEFAULT_OUT,
        help="folder of the league (default: %(default)s)",
    )
    return parser
