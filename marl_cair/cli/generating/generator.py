"""`marl-cair generator`: train a generator on a data set and measure it, or watch one."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.match_options import read_changes
from marl_cair.cli.parser import Parser, require_counts, run_subcommand
from marl_cair.generative import GENERATORS
from marl_cair.generative.settings import GeneratorConfig
from marl_cair.lookup import check_name
from marl_cair.training.settings.config_file import build_value

_SHOWN = (
    *("cells/changed_f1", "cells/change_explained", "cells/moved", "cells/exact"),
    *("open_loop/4_changed_f1", "open_loop/8_moved", "open_loop/safe_steps"),
    *("reward/explained", "end/auc", "mask/given_next"),
)


def run(arguments: Sequence[str]) -> int:
    """Train or watch a generator; returns the exit code."""
    return run_subcommand("generator", {"train": _train, "watch": _watch}, arguments)


def _train(arguments: Sequence[str]) -> int:
    """Train, and print the numbers of each measurement."""
    options = make_parser().parse_args(arguments)
    check_name("generator", options.model, GENERATORS)
    config = read_model(options.fields)
    from marl_cair.training.offline.generator_training import (
        QUALITY_FILE,
        GeneratorTraining,
        train_generator,
    )

    settings = GeneratorTraining(
        options.model,
        options.updates,
        options.batch_size,
        options.measurements,
        seed=options.seed,
        config=config,
    )
    for numbers in train_generator(options.dataset, options.out, settings, options.device):
        shown = (f"{name} {numbers[name]:.4f}" for name in _SHOWN if name in numbers)
        sys.stdout.write(
            f"update {numbers['update']:,.0f}, {numbers['processor_seconds']:.0f} s: "
            f"{', '.join(shown)}\n"
        )
        sys.stdout.flush()
    sys.stdout.write(f"all numbers are in {options.out}/{QUALITY_FILE}\n")
    return EXIT_DONE


def _watch(arguments: Sequence[str]) -> int:
    """Write a film, and print how long it is."""
    options = make_watch_parser().parse_args(arguments)
    require_counts(options, "steps", "fps", "open")
    from marl_cair.training.offline.watching import film_generator

    count = film_generator(
        options.run,
        options.to,
        options.steps,
        options.open,
        options.players.split(",") if options.players else (),
        options.seed,
        options.fps,
        shared.choose_load(options),
    )
    sys.stdout.write(f"{options.to}: {count} steps\n")
    return EXIT_DONE


def read_model(words: Sequence[str]) -> GeneratorConfig:
    """The settings that `--set NAME=VALUE` changes; `size.depth=2` is a setting of the network."""
    changes: dict[str, Any] = {}
    for name, value in read_changes(words, "name=value, for example size.depth=2").items():
        place = changes
        *parents, last = name.split(".")
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    config: GeneratorConfig = build_value(GeneratorConfig, changes, "generator.model")
    return config


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair generator train",
        description="Train a generator on a data set of `marl-cair dataset collect`. The held-out "
        "episodes measure it while it trains. The folder gets the weights (generator.pt, for "
        "initial_generator), tables (quality.csv, losses.csv) and pictures.",
        epilog="example: marl-cair generator train data/maze --out runs/maze_generator",
    )
    parser.add_argument("dataset", help="folder of a data set")
    parser.add_argument("--out", required=True, metavar="FOLDER", help="folder of the results")
    parser.add_argument(
        "--model",
        default="ccdn",
        help=f"{', '.join(GENERATORS)} or module:Class (default: %(default)s); ccdn_thesis needs "
        "a data set of --representation gray",
    )
    for name, default, meaning in (
        ("updates", 5_000, "of the network"),
        ("batch-size", 64, "transitions of an update"),
        ("measurements", 5, "spread over the updates"),
        ("seed", 0, "of weights and batches"),
    ):
        text = f"{meaning} (default: %(default)s)"
        parser.add_argument(f"--{name}", type=int, default=default, help=text)
    help_text = "of the network: cpu, cuda or cuda:N (default: %(default)s)"
    parser.add_argument("--device", default="cpu", help=help_text)
    parser.add_argument(
        "--set",
        dest="fields",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="change a setting of generator.model, for example size.depth=2; repeatable",
    )
    return parser


def make_watch_parser() -> Parser:
    """The options of `generator watch`."""
    parser = Parser(
        "marl-cair generator watch",
        description="Film a real game beside what the generator imagines: some steps from imagined "
        "states with the real actions, and then again from the real state.",
        epilog="example: marl-cair generator watch runs/train --to imagined.gif",
    )
    parser.add_argument("run", help="folder of a training run, or of `marl-cair generator train`")
    parser.add_argument(
        "--to",
        required=True,
        help=".gif, .mp4 (needs pip install 'marl_cair[video]'), a new folder for PNG files, or "
        ".png: one roll-out, a column for each of up to 17 steps",
    )
    parser.add_argument(
        "--player",
        dest="players",
        metavar="AGENT[,AGENT...]",
        help="of the real game, one for all seats or one for each (default: the agent of the run, "
        "or the players of the data set)",
    )
    for name, default, meaning in (
        ("open", 8, "imagined steps before the real state is taken again"),
        ("steps", 200, "of the film"),
        ("fps", 4, "steps per second of a film"),
    ):
        text = f"{meaning} (default: %(default)s)"
        parser.add_argument(f"--{name}", type=int, default=default, help=text)
    shared.add_options(parser, "--seed", *shared.ANSWER_LIMITS)
    return parser
