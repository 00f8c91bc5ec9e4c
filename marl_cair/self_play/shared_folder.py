"""The folder that the learners of a league share: players, newest checkpoints, win rates.

    <folder>/players/<owner>-<generation>-<frames>/   a frozen agent and its `player.json`
    <folder>/live/<owner>/                            the learner after its last slice
    <folder>/records/<owner>.json                     its weighted games against each opponent

Each file has one writer and is written atomically, and players never change: learners may read
while others write, in any process.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from marl_cair.checkpoint import LIVE_FOLDER, PLAYERS, CheckpointError
from marl_cair.files import find_folder, write_json
from marl_cair.ranges import COUNT, WEIGHT, check_number, read_number
from marl_cair.self_play.win_rates import Evidence, read_evidence
from marl_cair.stored import INDEX, read_json

PLAYER_FILE = "player.json"
RECORDS = "records"
MAIN, MAIN_EXPLOITER, LEAGUE_EXPLOITER = ROLES = ("main", "main_exploiter", "league_exploiter")


class Player(NamedTuple):
    """A frozen policy of any learner of a league."""

    name: str  # of its folder in `players`
    owner: str  # its learner
    role: str  # of the learner, one of ROLES
    generation: int  # number of resets of the learner
    frames: int  # of the learner's training, in all its generations
    fingerprint: str  # of its network, `league.agents.load.find_fingerprint`
    met: Mapping[str, Evidence]  # the learner's results before, by name of a player, live or a bot


@dataclass(frozen=True)
class LeagueSeat:
    """A learner's place in a league."""

    folder: Path  # shared by all learners
    owner: str  # name of the learner
    role: str
    generation: int = 0
    mains: tuple[str, ...] = ()  # names of all main agents, in the league's order
    reset_chance: float = 0.0  # probability of a reset after a player was frozen
    frames_before: int = 0  # sum over the learner's earlier generations

    def name_player(self, frames: int) -> str:
        """Name of the folder of a player that is frozen now."""
        return f"{self.owner}-{self.generation:03d}-{frames:010d}"

    def describe(self, age: int, fingerprint: str, met: Mapping[str, Evidence]) -> dict[str, str]:
        """The file `player.json`, text by name. age: frames of all generations."""
        about = {
            "owner": self.owner,
            "role": self.role,
            "generation": self.generation,
            "frames": age,
            "fingerprint": fingerprint,
            "met": {name: list(kept) for name, kept in met.items()},
        }
        return {PLAYER_FILE: json.dumps(about, indent=1) + "\n"}

    def find_live_mains(self) -> dict[int, Path]:
        """Folders of the other main agents' current policies by their places in `mains`."""
        places = {n: self.folder / LIVE_FOLDER / name for n, name in enumerate(self.mains)}
        return {
            n: path
            for n, path in places.items()
            if self.mains[n] != self.owner and find_folder(path).is_dir()
        }

    def find_new_players(self) -> list[Player]:
        """All players but those of this generation of the learner, the oldest first."""
        own = (self.owner, self.generation)
        players = [one for one in read_players(self.folder) if (one.owner, one.generation) != own]
        return sorted(players, key=lambda player: (player.frames, player.name))

    def save_records(self, frames: int, met: Mapping[str, Evidence], counts: list[int]) -> None:
        """Write the learner's games: weighted evidence at `frames`, and numbers of all games."""
        against = {
            name: [kept.points, kept.games, count]
            for (name, kept), count in zip(met.items(), counts, strict=True)
        }
        about = {"generation": self.generation, "frames": frames, "against": against}
        path = self.folder / RECORDS / f"{self.owner}.json"
        write_json(path, about)


def read_players(folder: Path) -> list[Player]:
    """All frozen players, by name. Raises CheckpointError if a player's file cannot be read."""
    # A folder that is being written has another name, `files.replaced_folder`.
    paths = sorted((folder / PLAYERS).glob(f"*/{PLAYER_FILE}"))
    return [_read_player(path) for path in paths if "." not in path.parent.name]


def _read_player(path: Path) -> Player:
    try:
        about = read_json(path, INDEX)
        met = read_evidence(about["met"])
        return Player(
            path.parent.name,
            str(about["owner"]),
            str(about["role"]),
            read_number(about, "generation", COUNT),
            read_number(about, "frames", COUNT),
            str(about["fingerprint"]),
            met,
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(
            f"{path} cannot be read as a player of a league ({error!r}): bring the file back, or "
            "delete the player's folder"
        ) from error


def _check_record(record: Any) -> dict[str, Any]:
    for points, games, count in record["against"].values():
        check_number(points, "points", WEIGHT)
        check_number(games, "games", WEIGHT)
        check_number(count, "count", COUNT)
    return dict(record)


def read_records(folder: Path) -> dict[str, dict[str, Any]]:
    """Results of each learner: {owner: {generation, frames, against: {name: [points, games,
    count]}}}; points and games are weighted, count is of all games.

    Raises CheckpointError if a file cannot be read.
    """
    found: dict[str, dict[str, Any]] = {}
    for path in sorted((folder / RECORDS).glob("*.json")):
        try:
            found[path.stem] = _check_record(read_json(path))
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise CheckpointError(
                f"{path} cannot be read ({error!r}): delete it, the learner's next slice writes it"
            ) from error
    return found
