"""Reads and writes mixtures: a folder with `mixture.json` and copies of its members' checkpoints.

The folder is an agent, as a checkpoint is: see `games.players.mixed_agent`. Its members are
checkpoints inside the folder and bots, so that loading it runs no code.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from marl_cair.checkpoint import CheckpointError, find_agent
from marl_cair.files import copy_content, find_folder, replaced_folder
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.league.agents.allowed_code import is_process
from marl_cair.stored import read_json

SLACK = 0.02  # of a score, which a more even mixture may cost
MIXTURE_FILE = "mixture.json"
FORMAT = "marl_cair mixture"
FORMAT_VERSION = 1
_MEMBERS = "members"
MOST_MEMBERS = 256  # all are loaded into memory before the first game


@dataclass(frozen=True)
class Mixture:
    """Contents of `mixture.json`."""

    sources: tuple[str, ...]  # members: folders inside the mixture's, or bots as "game/bot"
    weights: tuple[float, ...]  # probabilities of the members, above 0, in sum 1


def is_mixture(source: str | os.PathLike[str]) -> bool:
    """Whether `source` is the folder of a mixture, or of a run that stands for one.

    Raises CheckpointError as `find_agent`.
    """
    return not is_process(source) and _holds_mixture(find_agent(source))


def _holds_mixture(folder: Path) -> bool:
    return (find_folder(folder) / MIXTURE_FILE).is_file()


def qualify_bot(source: str, game: Game) -> str:
    """`source`; "game/bot" if it is a bot's name."""
    return f"{game.name}/{source}" if source in game.bots else source


def require_data(sources: Sequence[str]) -> None:
    """Raise ValueError if a member is neither a folder nor a bot as "game/bot"."""
    for source in sources:
        if is_process(source) or (":" in source and not find_folder(source).is_dir()):
            raise ValueError(
                f"{source} is code, which a mixture cannot hold: name checkpoints and bots alone"
            )
        if "/" not in source and not find_folder(source).is_dir():
            raise ValueError(f"{source} is no folder: write a bot as game/bot")


def save_mixture(
    folder: str | os.PathLike[str], sources: Sequence[str], weights: Sequence[float]
) -> None:
    """Write a mixture to `folder`, atomically; replaces a mixture that is there.

    sources: members: folders of checkpoints, which are copied, or of mixtures, whose members are
    taken, and bots as "game/bot". weights: above 0, proportional to the probabilities.

    Raises:
        FileExistsError: `folder` holds something else.
        CheckpointError: a mixture among the members cannot be read.
        ValueError: a member is foreign code, or neither folder nor bot; or there are too many.
    """
    target = Path(folder)
    if target.exists() and not _holds_mixture(target):
        raise FileExistsError(f"{folder} is there and is no mixture: give another folder")
    require_data(sources)
    flat: list[tuple[str, float]] = []
    for source, weight in zip(sources, weights, strict=True):
        inner = read_mixture(source) if is_mixture(source) else Mixture((source,), (1.0,))
        flat += [(s, w * weight) for s, w in zip(inner.sources, inner.weights, strict=True)]
    if len(flat) > MOST_MEMBERS:
        raise ValueError(f"a mixture has at most {MOST_MEMBERS} members, these are {len(flat)}")
    total = sum(weights)
    with replaced_folder(target) as fresh:
        members = []
        for number, (source, weight) in enumerate(flat):
            member: dict[str, object] = {"weight": weight / total}
            origin = find_agent(source)
            place = find_folder(origin)
            if place.is_dir():
                inside = f"{_MEMBERS}/{number:02}"
                copy_content(place, fresh / inside)
                member |= {"folder": inside, "from": str(origin.absolute())}
            else:
                member["agent"] = source
            members.append(member)
        record = {"format": FORMAT, "format_version": FORMAT_VERSION, "members": members}
        (fresh / MIXTURE_FILE).write_text(json.dumps(record, indent=2) + "\n", "utf-8")


def read_mixture(folder: str | os.PathLike[str]) -> Mixture:
    """Read the mixture in `folder`. Raises CheckpointError: no mixture, a damaged one, or one of a
    newer format.
    """
    place = find_folder(find_agent(folder))
    path = place / MIXTURE_FILE
    try:
        record = read_json(path)
        found = record["format"], record["format_version"]
        if found != (FORMAT, FORMAT_VERSION):
            raise ValueError(f"its format is {found}, it must be {(FORMAT, FORMAT_VERSION)}")
        members = record["members"]
        if not 1 <= len(members) <= MOST_MEMBERS:
            raise ValueError(f"it has {len(members)} members, it must have 1 to {MOST_MEMBERS}")
        sources = [_read_member(place, member) for member in members]
        weights = [float(member["weight"]) for member in members]
        if not all(0 < weight <= 1 for weight in weights):
            raise ValueError(f"its members have the weights {weights}, all must be above 0")
        return Mixture(tuple(sources), tuple(weights))
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise CheckpointError(f"{path} cannot be read as a mixture of agents: {error!r}") from error


def _read_member(place: Path, member: Mapping[str, Any]) -> str:
    """The source of a member of the mixture in `place`: a checkpoint folder inside it, or a bot.

    Raises ValueError for code, for a folder elsewhere (which copies of the mixture would include),
    and for another mixture.
    """
    if "folder" not in member:
        source = str(member["agent"])
        game, _, bot = source.rpartition("/")
        if game not in GAMES or not bot.isidentifier() or find_folder(source).is_dir():
            raise ValueError(f"its member {source!r} is no bot, written as game/bot")
        return source
    folder = place / str(member["folder"])
    if not folder.resolve().is_relative_to(place.resolve() / _MEMBERS):
        raise ValueError(f"its member {str(folder)!r} lies outside its folder {_MEMBERS}")
    if (folder / MIXTURE_FILE).exists():
        raise ValueError(f"its member {str(folder)!r} is a mixture itself")
    return str(folder.absolute())
