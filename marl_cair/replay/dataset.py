"""Data sets of transitions on disk: memory-mapped TensorDicts, split by episode."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import torch
from tensordict import MemoryMappedTensor, TensorDict

from marl_cair.files import (
    find_folder,
    refuse_foreign_files,
    replaced_folder,
    require_free_space,
    write_json,
)
from marl_cair.replay.transition import OTHER_ACTIONS, Key, TransitionSpec
from marl_cair.stored import MANIFEST_FILE, DamagedFileError, read_json, read_manifest

DATASET_FILE = "dataset.json"
FORMAT_VERSION = 1
TRAIN, HELDOUT = "train", "heldout"
HELDOUT_SHARE = 0.4
LEAST_EPISODES = 2  # on each side of the split
EPISODE, SEAT, STEP = "episode", "seat", "step"
_COLUMNS: tuple[Key, ...] = (
    *("observation", "action_mask", "action", ("next", "observation"), ("next", "action_mask")),
    *(("next", "reward"), ("next", "terminated"), ("next", "done"), OTHER_ACTIONS),
)


@dataclass(frozen=True)
class DatasetDescription:
    """The game that a data set's transitions are of, and how they were collected."""

    game: str
    game_version: str
    scenario: str
    scenario_options: Mapping[str, Any]  # all fields of the scenario
    representation: str
    observation_shape: tuple[int, ...]
    observation_dtype: str  # "uint8" or "float32"
    num_actions: int
    num_players: int
    players: tuple[str, ...]  # who played: one for each seat
    seed: int
    num_train: int  # transitions
    num_heldout: int
    train_episodes: int
    heldout_episodes: int

    def columns(self) -> dict[Key, tuple[torch.dtype, tuple[int, ...]]]:
        """Dtype and shape of one row of each column.

        "other_actions" holds the actions of the other seats, if any, from the next one on;
        `episode`, `seat` and `step` say where the transition is from.
        """
        dtype = getattr(torch, self.observation_dtype)
        others = self.num_players - 1
        spec = TransitionSpec(
            self.observation_shape, self.num_actions, observation_dtype=dtype, num_others=others
        )
        columns = {key: kind for key, kind in spec.fields().items() if key in _COLUMNS}
        return {**columns, **dict.fromkeys((EPISODE, SEAT, STEP), (torch.int64, ()))}


class TransitionDataset(NamedTuple):
    """Transitions of a game; no episode has rows on both sides."""

    about: DatasetDescription
    train: TensorDict  # [N], memory-mapped, with the columns of `about`
    heldout: TensorDict  # [M]


@contextmanager
def new_dataset(folder: Path, about: DatasetDescription) -> Iterator[TransitionDataset]:
    """Yield an empty data set to fill: its files replace `folder` at the end of the block.

    The counts of transitions in `about` size it; `finish` writes the final description.
    Raises NotEnoughSpaceError before anything is written, OutputFolderError for a folder of
    something else.
    """
    if folder.is_dir():
        refuse_foreign_files(folder, DATASET_FILE, "data set")
    row_bytes = sum(dtype.itemsize * math.prod(shape) for dtype, shape in about.columns().values())
    num_rows = about.num_train + about.num_heldout
    require_free_space(folder, num_rows * row_bytes + (1 << 20))
    with replaced_folder(folder) as fresh:
        sides = [
            _allocate(fresh / side, about, num)
            for side, num in ((TRAIN, about.num_train), (HELDOUT, about.num_heldout))
        ]
        yield TransitionDataset(about, *sides)
        counts = [int(side[EPISODE].unique().numel()) for side in sides]
        if min(counts) < LEAST_EPISODES:
            raise ValueError(
                f"the transitions are of {counts[0]} and {counts[1]} episodes, but a split by "
                f"episode needs {LEAST_EPISODES} or more on each side: collect more transitions, "
                "or from a scenario with shorter games (--set max_ticks=...)"
            )
        counted = {"train_episodes": counts[0], "heldout_episodes": counts[1]}
        facts = {"format_version": FORMAT_VERSION, **asdict(about), **counted}
        write_json(fresh / DATASET_FILE, facts)


def _allocate(folder: Path, about: DatasetDescription, num: int) -> TensorDict:
    rows = TensorDict({}, [num])
    for key, (dtype, shape) in about.columns().items():
        rows[key] = torch.zeros((), dtype=dtype).expand(num, *shape)
    return rows.memmap_like(folder)


def load_dataset(folder: str | Path) -> TransitionDataset:
    """Map the data set in `folder`; nothing in it is executed, and no game is needed.

    Raises:
        FileNotFoundError: no data set in `folder`.
        DamagedFileError: a file is missing, cut off, or its size does not fit the description.
        ValueError: a later version of marl_cair has written it.
    """
    place = find_folder(folder)
    about = read_description(place)
    sides = [
        _map_side(place, side, about, num)
        for side, num in ((TRAIN, about.num_train), (HELDOUT, about.num_heldout))
    ]
    return TransitionDataset(about, *sides)


def read_description(folder: str | Path) -> DatasetDescription:
    """The description of the data set in `folder`. Raises as `load_dataset`."""
    path = find_folder(folder) / DATASET_FILE
    if not path.is_file():
        raise FileNotFoundError(
            f"{folder} holds no data set ({DATASET_FILE} is missing): make one with "
            f"`marl-cair dataset collect --out {folder}`"
        )
    facts = read_json(path)
    version = facts.get("format_version") if isinstance(facts, dict) else None
    if isinstance(version, int) and version > FORMAT_VERSION:
        raise ValueError(
            f"{folder} is a data set of format {version}, this version reads up to "
            f"{FORMAT_VERSION}: update marl_cair, or collect it again"
        )
    try:
        values = {field.name: facts[field.name] for field in fields(DatasetDescription)}
        values["observation_shape"] = tuple(int(size) for size in values["observation_shape"])
        values["players"] = tuple(map(str, values["players"]))
        about = DatasetDescription(**values)
        counts = (about.num_train, about.num_heldout, about.num_players, about.num_actions)
        if min(counts) < 1:
            raise ValueError(f"a count is below 1: {counts}")
        about.columns()
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DamagedFileError(
            f"{path} does not describe a data set ({error!r}): collect it again"
        ) from error
    return about


def _map_side(place: Path, side: str, about: DatasetDescription, num: int) -> TensorDict:
    listed = read_manifest(place) if (place / MANIFEST_FILE).is_file() else {}
    rows = TensorDict({}, [num])
    for key, (dtype, shape) in about.columns().items():
        name = "/".join((side, *((key,) if isinstance(key, str) else key)))
        path = place / f"{name}.memmap"
        if not path.is_file():
            raise DamagedFileError(f"{path} is missing: copy the whole data set, or collect again")
        needed, found = num * math.prod(shape) * dtype.itemsize, path.stat().st_size
        if found != needed or listed.get(f"{name}.memmap", (needed, ""))[0] != needed:
            raise DamagedFileError(
                f"{path} has {found:,} bytes, but {num:,} rows of {dtype} {list(shape)} are "
                f"{needed:,}: copy it again, or collect the data set again"
            )
        full = torch.Size((num, *shape))
        rows[key] = MemoryMappedTensor.from_filename(path, dtype=dtype, shape=full)
    return rows
