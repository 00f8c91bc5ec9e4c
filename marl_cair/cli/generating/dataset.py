"""`marl-cair dataset`: collect transitions of random play, bots or agents into a data set."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser, run_subcommand
from marl_cair.games.checks.scenario import change_scenario
from marl_cair.games.players.random_player import RANDOM
from marl_cair.lookup import check_name

DEFAULT_ROWS = 100_000


def run(arguments: Sequence[str]) -> int:
    """Collect a data set, or print the description of one; returns the exit code."""
    return run_subcommand("dataset", {"collect": _collect, "show": _show}, arguments)


def _collect(arguments: Sequence[str]) -> int:
    options = make_parser().parse_args(arguments)
    players = options.players.split(",")
    trained = [one for one in players if one != RANDOM]
    game, name, scenario = shared.choose_scenario(options, trained)
    default = "shaped" if "shaped" in game.rewards else game.rated_reward
    reward = options.reward or default
    check_name(f"{game.name} reward", reward, game.rewards)
    scenario = change_scenario(game.name, scenario, {"reward": reward})
    spec = game.make_spec(scenario)
    representation = options.representation or next(iter(spec.representations))
    check_name(f"{game.name} representation", representation, spec.representations)
    if len(players) not in (1, spec.num_players):
        raise ValueError(
            f"--player names {len(players)} players, {game.name} {name} has {spec.num_players} "
            "seats: name one for all seats, or one for each"
        )
    load = shared.choose_load(options)
    agents = [load(one, game.name, scenario) for one in players]
    # Each seat has an agent of its own: two seats of one object would share random draws.
    agents += [load(players[0], game.name, scenario) for _ in range(spec.num_players - len(agents))]
    from marl_cair.training.collecting.dataset import collect_dataset

    about = collect_dataset(
        Path(options.out), game, (name, scenario), representation, agents, options.rows,
        options.seed,
    )  # fmt: skip
    sys.stdout.write(
        f"{options.out}: {about.num_train:,} transitions of {about.train_episodes:,} episodes to "
        f"train on, {about.num_heldout:,} of {about.heldout_episodes:,} held out\n"
    )
    return EXIT_DONE


def _show(arguments: Sequence[str]) -> int:
    parser = Parser("marl-cair dataset show", description="Check a data set and describe it.")
    parser.add_argument("dataset", help="folder of a data set")
    from marl_cair.replay.dataset import load_dataset

    about = load_dataset(parser.parse_args(arguments).dataset).about
    for field, value in asdict(about).items():
        sys.stdout.write(f"{field}: {value}\n")
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of `marl-cair dataset collect`."""
    parser = Parser(
        "marl-cair dataset collect",
        description="Write unique transitions to a folder: 60 % to train on, 40 % held out, split "
        "by episode, as memory-mapped TensorDicts. `marl-cair dataset show FOLDER` describes one; "
        "`marl_cair.replay.load_dataset(folder)` loads it in Python.",
        epilog="example: marl-cair dataset collect --game deep_maze --scenario 9x9-stochastic "
        "--out data/maze",
    )
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder of the data set")
    parser.add_argument(
        "--rows", type=int, default=DEFAULT_ROWS, help="unique transitions (default: %(default)s)"
    )
    parser.add_argument(
        "--player",
        dest="players",
        default=RANDOM,
        metavar="AGENT[,AGENT...]",
        help=f"who plays, one for all seats or one for each: {shared.AGENT_HELP} (default: random)",
    )
    parser.add_argument(
        "--representation", help="what the data set shows (default: the game's first, planes)"
    )
    parser.add_argument("--reward", help="default: shaped where there is one, else the rated one")
    shared.add_options(parser, "--seed", *shared.SCENARIO_OPTIONS, *shared.ANSWER_LIMITS)
    return parser
