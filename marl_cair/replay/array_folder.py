"""Write named arrays and plain facts to a folder, and read them back, without pickle."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import atomic_path, require_free_space, write_atomically

FACTS_NAME = "facts.json"
_MAPPED_FROM_BYTES = 1 << 20  # smaller files are read at once: an empty array cannot be mapped


def save_arrays(folder: Path, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
    """Write each array to `<name>.npy` and `facts` (plain data) to `facts.json` in a new folder.

    The arrays go from where they lie to the file, without a copy in memory.
    Raises NotEnoughSpaceError before anything is written.
    """
    require_free_space(folder, sum(array.nbytes for array in arrays.values()) + (1 << 16))
    folder.mkdir(parents=True)
    for name, array in arrays.items():
        with atomic_path(folder / f"{name}.npy") as path, path.open("wb") as file:
            np.save(file, np.asarray(array), allow_pickle=False)
    write_atomically(folder / FACTS_NAME, json.dumps(dict(facts), indent=2) + "\n")


def load_arrays(folder: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the arrays (large ones mapped from their files, read only) and the facts of a folder.

    Raises FileNotFoundError where `folder` was not written by `save_arrays`.
    """
    facts_path = folder / FACTS_NAME
    if not facts_path.is_file():
        raise FileNotFoundError(
            f"{folder} holds no saved replay ({FACTS_NAME} is missing): give the folder that "
            "save() wrote"
        )
    facts: dict[str, Any] = json.loads(facts_path.read_text(encoding="utf-8"))
    arrays = {path.stem: _open_array(path) for path in sorted(folder.glob("*.npy"))}
    return arrays, facts


def require_layout(saved: Mapping[str, Any], own: Mapping[str, Any], what: str) -> None:
    """Raise ValueError unless `saved` says the same as `own`; what: the replay, for the message."""
    for name, value in own.items():
        if saved.get(name) != value:
            raise ValueError(
                f"the saved {what} has {name} {saved.get(name)}, this one has {value}: make it "
                "with the settings it was saved with"
            )


def _open_array(path: Path) -> NDArray[Any]:
    if path.stat().st_size < _MAPPED_FROM_BYTES:
        array: NDArray[Any] = np.load(path, allow_pickle=False)
        return array
    mapped: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    return mapped
