"""Writes the log of a run: one table as CSV, and the same for TensorBoard."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from tqdm import tqdm

from marl_cair.files import write_atomically
from marl_cair.stored import LOG, DamagedFileError, read_text


class RunLog:
    """Rows of scalars: `log.csv` (one wide table) and TensorBoard files in the run's folder.

    Args:
        frames: the resumed step; rows after it are dropped.
    """

    FILE = "log.csv"

    def __init__(self, folder: Path, frames: int = 0) -> None:
        self._path = folder / self.FILE
        self.rows = [row for row in read_log(self._path) if row["frames"] <= frames]
        self.frames = frames  # of the last row
        self.prints = False  # whether lines of text are also printed, above a progress bar
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(str(folder / "tensorboard"), purge_step=frames + 1)

    def write(self, frames: int, values: Mapping[str, float]) -> None:
        """Add a row; both files are complete when this returns."""
        self.rows.append({"frames": float(frames), **values})
        self.frames = frames
        write_atomically(self._path, format_rows(self.rows))
        for name, value in values.items():
            self._writer.add_scalar(name, value, frames)
        self._writer.flush()

    def note(self, frames: int, tag: str, text: str) -> None:
        """A line of text, for TensorBoard and for the terminal."""
        self._writer.add_text(tag, text, frames)
        if self.prints:
            tqdm.write(f"frame {frames}: {text}")

    def close(self) -> None:
        """Close the TensorBoard file."""
        self._writer.close()


def format_rows(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as CSV text: the union of their columns, empty where a row has no value."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read_log(path: Path) -> list[dict[str, float]]:
    """Rows of a `log.csv`; none without a file. Raises DamagedFileError."""
    return parse_log(read_text(path, LOG), path) if path.is_file() else []


def parse_log(text: str, path: Path) -> list[dict[str, float]]:
    """Rows of the text of a `log.csv`. Raises DamagedFileError, which names `path`."""
    rows = csv.DictReader(io.StringIO(text), strict=True)
    try:
        read = [{name: float(value) for name, value in row.items() if value} for row in rows]
        if not all(math.isfinite(row["frames"]) for row in read):
            raise ValueError("frames are not finite")
    except (ValueError, TypeError, KeyError, csv.Error) as error:
        raise DamagedFileError(
            f"{path}, line {rows.line_num}, cannot be read ({error!r}): bring it back, or delete it"
        ) from error
    return read
