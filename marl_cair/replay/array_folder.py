"""Write named arrays and plain facts to a folder, and read them back, without pickle."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from marl_cair.files import atomic_path, require_free_space, write_atomically
from marl_cair.stored import ARRAY, DamagedFileError, open_stored, read_json

FACTS_NAME = "facts.json"
_MAPPED_FROM_BYTES = 1 << 20  # smaller files are read at once: an empty array cannot be mapped
_HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def save_arrays(folder: Path, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
    """Write each array to `<name>.npy` and `facts` (plain data) to `facts.json` in a new folder.

    Raises NotEnoughSpaceError before anything is written.
    """
    require_free_space(folder, sum(array.nbytes for array in arrays.values()) + (1 << 16))
    folder.mkdir(parents=True)
    for name, array in arrays.items():
        with atomic_path(folder / f"{name}.npy") as path, path.open("wb") as file:
            np.save(file, np.asarray(array), allow_pickle=False)
    write_atomically(folder / FACTS_NAME, json.dumps(dict(facts), indent=2) + "\n")


def load_arrays(folder: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the arrays (large ones mapped read-only) and the facts of a folder, both unchecked.

    Raises FileNotFoundError where `folder` was not written by `save_arrays`, DamagedFileError where
    a file of it is damaged.
    """
    facts_path = folder / FACTS_NAME
    if not facts_path.is_file():
        raise FileNotFoundError(
            f"{folder} holds no saved replay ({FACTS_NAME} is missing): give the folder that "
            "save() wrote"
        )
    facts = read_json(facts_path)
    if not isinstance(facts, dict):
        raise DamagedFileError(f"{facts_path} is {facts!r:.80}, it must be facts by name")
    arrays = {path.stem: _open_array(path) for path in sorted(folder.glob("*.npy"))}
    return arrays, facts


def require_layout(saved: Mapping[str, Any], own: Mapping[str, Any], kind: str) -> None:
    """Raise ValueError unless `saved` has the values of `own`. kind: of replay, for the message."""
    for name, value in own.items():
        if saved.get(name) != value:
            raise ValueError(
                f"the saved {kind} has {name} {saved.get(name)}, this one has {value}: make it "
                "with the settings it was saved with"
            )


def _open_array(path: Path) -> NDArray[Any]:
    with open_stored(path, ARRAY) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            shape, _, dtype = _HEADERS[npy.read_magic(file)](file)
            stated = math.prod(shape) * dtype.itemsize
        except Exception as error:  # NumPy raises many types for damaged headers
            raise DamagedFileError(
                f"{path} is no array of NumPy ({error!r}): bring it back"
            ) from error
        held = size - file.tell()
        # Checked before anything is allocated.
        if dtype.hasobject or stated != held or min(shape, default=0) < 0:
            raise DamagedFileError(
                f"{path} says that it is {dtype} {list(shape)}, {stated:,} bytes, but "
                f"holds {held:,}: bring it back"
            )
    is_small = size < _MAPPED_FROM_BYTES
    array: NDArray[Any] = np.load(path, mmap_mode=None if is_small else "r", allow_pickle=False)
    return array
