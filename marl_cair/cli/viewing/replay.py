"""`marl-cair replay`: print a recorded game, or export it as page, film, pictures or states.

The game is played again from its seed and actions, and compared with the recorded states on the
way.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.parser import Parser, require_counts
from marl_cair.files import atomic_path
from marl_cair.games import GAMES
from marl_cair.games.replays import Replay, count_games, read_replay, read_replays, replay_steps
from marl_cair.games.replays.reader import split_number
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.film import WRITERS, render_frames
from marl_cair.memory import require_memory
from marl_cair.text import clean_text
from marl_cair.viewer.page import write_viewer
from marl_cair.viewer.values import add_values

STATES, VIEWER = ".npz", ".html"


def run(arguments: Sequence[str]) -> int:
    """Print or export; returns the exit code."""
    options = make_parser().parse_args(arguments)
    require_counts(options, "every", "fps")
    suffix = Path(options.to or "").suffix
    if suffix not in (*WRITERS, STATES, VIEWER):
        raise ValueError(
            f"--to is {options.to!r}: give a file that ends in {VIEWER}, .gif, .mp4 or {STATES}, "
            "or a new folder for pictures"
        )
    file, chosen = split_number(options.file)
    if not Path(file).is_file():
        raise ValueError(
            f"{options.file} is no file: name a replay, as --record writes one, or FILE#3 for its "
            "game 3"
        )
    is_listed = not (options.to or options.agents or options.seat is not None)
    if is_listed and chosen is None and count_games(file) > 1:
        for number, replay in enumerate(read_replays(file)):
            line = f"{file}#{number}: {describe_result(replay)}"
            sys.stdout.write(f"{clean_text(line)}\n")
        return EXIT_DONE
    replay = read_replay(options.file)
    num_players = len(replay.players)
    if (num := len(options.agents)) not in (0, num_players):
        raise ValueError(
            f"--agents names {num}, the game has {num_players} seats: give one agent for each seat"
        )
    if options.seat is not None and options.seat not in range(num_players):
        raise ValueError(f"--seat is {options.seat}, it must be in 0..{num_players - 1}")
    if not options.to:
        sys.stdout.write(describe_replay(replay))
    elif suffix == STATES:
        count = save_states(options.to, replay, options.every)
        sys.stdout.write(f"{options.to}: {count} states\n")
    elif suffix == VIEWER:
        sys.stdout.write(f"{options.to}: {save_viewer(replay, options):,} bytes\n")
    else:
        frames = render_frames(replay, options.every, options.seat)
        fps = options.fps or max(1, replay.spec.render_fps // options.every)
        count = WRITERS[suffix](options.to, frames, fps)
        sys.stdout.write(f"{options.to}: {count} frames\n")
    return EXIT_DONE


def save_viewer(replay: Replay, options: argparse.Namespace) -> int:
    """Write the page that plays the game; returns its bytes."""
    given = [
        load_agent(source, game=replay.game, scenario=replay.scenario) for source in options.agents
    ]
    return write_viewer(
        options.to,
        add_values(replay, dict(enumerate(given))),
        views=None if options.seat is None else [options.seat],
        every=options.every,
        fps=options.fps,
    )


def describe_replay(replay: Replay) -> str:
    """What a replay holds, in lines; the game is played again for the last one.

    Raises ReplayError where a state differs from the recorded one.
    """
    rules = f"rules {replay.rules_version}, map seed {replay.map_seed}"
    lines = [
        f"{replay.game} {describe_scenario(replay)}, {rules}",
        describe_result(replay),
    ]
    for name, values in (replay.values or {}).items():
        lines.append(f"values of {name}: {values.dtype} {list(values.shape)}")
    lines += [f"{name}: {value}" for name, value in replay.extra.items()]
    for _ in replay_steps(replay):
        pass
    if replay.hashes:
        lines.append(f"played again: it is the same (recorded states: {len(replay.hashes)})")
    else:
        lines.append("not compared: the recording was cut off before its first hash of a state")
    return "".join(f"{clean_text(line)}\n" for line in lines)


def describe_result(replay: Replay) -> str:
    """Players, length and winner."""
    players = " v ".join(f"{name} (seat {seat})" for seat, name in enumerate(replay.players))
    num_steps, spec = len(replay.actions), replay.spec
    seconds = num_steps * spec.ticks_per_step / spec.ticks_per_second
    ended = "no winner" if replay.winner is None else f"{replay.players[replay.winner]} won"
    if not replay.is_complete:
        ended = "cut off there, before the end of the recording"
    return f"{players}: {num_steps} steps, {seconds:.0f} s of the game; {ended}"


def describe_scenario(replay: Replay) -> str:
    """The nearest of the game's scenarios, and the fields that differ from it."""

    def list_changes(name: str) -> list[str]:
        other = GAMES[replay.game].scenarios[name]
        fields = [field.name for field in dataclasses.fields(other) if field.init]
        values = ((one, getattr(replay.scenario, one), getattr(other, one)) for one in fields)
        return [f"{one}={value}" for one, value, usual in values if value != usual]

    changes = {name: list_changes(name) for name in GAMES[replay.game].scenarios}
    nearest = min(changes, key=lambda name: len(changes[name]))
    return " ".join([nearest, *changes[nearest]])


def save_states(path: str, replay: Replay, every: int) -> int:
    """Write the state arrays of the start, each `every`-th step and the end, [N, ...] each, as
    compressed NumPy arrays with "step" int64 [N] and "actions"; returns N.

    Raises ValueError for a game without states, or more states than the memory holds.
    """
    if not GAMES[replay.game].has_snapshots:
        raise ValueError(
            f"{replay.game} has no states that can be saved, its games run in a browser: export "
            "a film or pictures"
        )
    num_steps = len(replay.actions)
    steps = sorted({*range(0, num_steps + 1, every), num_steps})
    states: dict[str, Any] = {}
    for step, engine in enumerate(replay_steps(replay)):
        if step == 0:
            held = engine.state_dict()
            num_bytes = len(steps) * sum(value.nbytes for value in held.values())
            require_memory(f"{len(steps)} states", num_bytes)
            states = {
                name: np.empty((len(steps), *value.shape[1:]), value.dtype)
                for name, value in held.items()
            }
        if step % every == 0 or step == num_steps:
            for name, value in engine.state_dict().items():
                states[name][-(-step // every)] = value[0]
    with atomic_path(path) as unfinished, unfinished.open("wb") as file:
        np.savez_compressed(file, step=np.array(steps), actions=replay.actions, **states)
    return len(steps)


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair replay",
        description=__doc__,
        epilog="example: marl-cair replay games/a-v-b-0000-1f2e3d4c.replay#3 --to game.mp4",
    )
    parser.add_argument(
        "file",
        help="a replay, as --record and `marl-cair league replay` write it; FILE#3 is game 3, from "
        "0, of a file with several, which are listed without a number",
    )
    parser.add_argument(
        "--to",
        help="what to write: .html (a page that plays the game in any browser), .gif, .mp4 (needs "
        "pip install 'marl_cair[video]'), .npz (states), or a new folder for PNG files (default: "
        "the game is printed)",
    )
    parser.add_argument("--seat", type=int, help="the view of a seat, from 0 (default: the whole)")
    parser.add_argument(
        "--every", type=int, default=1, help="frames are of each so many steps (default: 1)"
    )
    parser.add_argument(
        "--fps", type=int, help="frames per second of a film (default: the pace of the game)"
    )
    parser.add_argument(
        "--agents",
        nargs="+",
        default=[],
        metavar="AGENT",
        help="of the seats, whose action values an .html shows; agents without values, as bots, "
        "are passed over",
    )
    return parser
