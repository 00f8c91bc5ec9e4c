"""Draws real transitions beside what the generator predicts from the same states and actions."""

from __future__ import annotations

import colorsys
import os
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from marl_cair.files import atomic_path
from marl_cair.games.game import Representation

PICTURE_FILE = "generator.png"  # in a run's folder
PREDICTION_ROWS = "before", "after", "predicted", "wrong"
NUM_DRAWN = 6  # transitions, one in each column
_LEAST_SIDE = 126  # pixels of a board
_GAP, _GREY = 6, 64
_LETTERS = 14  # pixels of the names of rows


def draw_predictions(
    path: str | os.PathLike[str],
    seen: Representation,
    static_planes: Sequence[int],
    *observations: Tensor,
) -> None:
    """Write a PNG of four rows: before, after, predicted, and where the last two differ.

    static_planes: those of `seen` that never change; they are drawn dark.
    observations: before, after and predicted, uint8 [N, C, H, W] each, as `seen` describes them.
    """
    shown = seen.shape[0] - seen.num_uniform
    planes = [observation[:, :shown].numpy() for observation in observations]
    boards = [paint(seen, static_planes, values) for values in planes]
    save_rows(path, PREDICTION_ROWS, [*boards, paint_difference(*planes[1:])])


def draw_progress(
    path: str | os.PathLike[str],
    seen: Representation,
    static_planes: Sequence[int],
    before: Tensor,
    after: Tensor,
    guesses: Mapping[str, Tensor],
) -> None:
    """Write a PNG of the thesis's figure: rows of states, true next states, and predicted ones by
    name, in the order of training. A column is a transition; arrays as in `draw_predictions`.
    """
    shown = seen.shape[0] - seen.num_uniform
    rows = {"before": before, "after": after, **guesses}
    boards = [paint(seen, static_planes, one[:, :shown].numpy()) for one in rows.values()]
    save_rows(path, list(rows), boards)


def draw_losses(path: str | os.PathLike[str], rows: Sequence[Mapping[str, float]]) -> None:
    """Write a PNG of losses by update, each smoothed over a hundredth of the updates.

    rows: "update", and losses by name.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4), layout="constrained")
    FigureCanvasAgg(figure)
    panel = figure.subplots()
    width = max(1, len(rows) // 100)
    for name in (name for name in rows[0] if name not in ("update", "grad_norm", "total")):
        points = [(row["update"], row[name]) for row in rows if name in row]
        updates, values = np.array(points).T
        smooth = np.convolve(values, np.full(width, 1.0 / width), "valid")
        panel.plot(updates[width - 1 :], smooth, label=name)
    panel.set(xlabel="updates", ylabel="loss", yscale="log")
    panel.legend(fontsize=8)
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=130)


def save_rows(
    path: str | os.PathLike[str], names: Sequence[str], boards: Sequence[NDArray[np.uint8]]
) -> None:
    """Write rows of pictures, uint8 [N, H, W, 3] each, as one PNG, their names on the left."""
    from PIL import Image, ImageDraw, ImageFont

    scale = -(-_LEAST_SIDE // max(boards[0].shape[1:3]))
    rows = [np.concatenate([_frame(board, scale) for board in row], 1) for row in boards]
    font = ImageFont.load_default(_LETTERS)
    margin = 2 * _GAP + int(max(map(font.getlength, names)))
    table = np.pad(np.concatenate(rows), ((0, 0), (margin, 0), (0, 0)), constant_values=_GREY)
    image = Image.fromarray(table)
    for row, name in enumerate(names):
        middle = margin / 2, (row + 0.5) * len(rows[0])
        ImageDraw.Draw(image).text(middle, name, "white", font, anchor="mm")
    with atomic_path(path) as unfinished:
        image.save(unfinished)


def paint(
    seen: Representation, static_planes: Sequence[int], planes: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Observations [N, C, H, W] as RGB [N, H, W, 3]: the newest of several frames; of a board the
    sum of its planes, each in a colour of its own. One plane is a grey picture.
    """
    values = planes / 255.0
    if seen.num_frames > 1 or len(planes[0]) == 1:
        return _colour(values[:, -1:], np.ones((1, 3)))
    hues = np.arange(planes.shape[1]) * 0.618 % 1.0  # the golden ratio: neighbours differ most
    colours = np.array([colorsys.hsv_to_rgb(hue, 0.75, 1.0) for hue in hues])
    colours[[plane for plane in static_planes if plane < len(colours)]] = 0.15
    return _colour(values, colours)


def paint_difference(one: NDArray[np.uint8], other: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Where planes [N, C, H, W] differ, as grey pictures [N, H, W, 3]."""
    differs = np.abs(one.astype(np.int16) - other).max(1)
    return _colour(differs[:, None] / 255.0, np.ones((1, 3)))


def _colour(values: NDArray[np.float64], colours: NDArray[np.float64]) -> NDArray[np.uint8]:
    mixed = np.einsum("nchw,cx->nhwx", values, colours)
    image: NDArray[np.uint8] = (255.0 * np.clip(mixed, 0.0, 1.0)).astype(np.uint8)
    return image


def _frame(board: NDArray[np.uint8], scale: int) -> NDArray[np.uint8]:
    large = board.repeat(scale, 0).repeat(scale, 1)
    return np.pad(large, ((_GAP, 0), (_GAP, 0), (0, 0)), constant_values=_GREY)
