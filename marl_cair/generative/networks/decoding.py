"""Compiled loops over cells for inference on CPUs: the likeliest next board, or a sampled one.

PyTorch needs a dozen passes over all candidates of all cells and takes ten times as long, although
most cells and their neighbours are empty.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import njit
from torch import Tensor

_SURE = np.float32(12.0)  # logits beyond are certain: no exp is taken
# Less likely edits are not drawn: on a board of hundreds of cells the errors of such odds would add
# up to units that come from nowhere. An event that is even over 50 cells or more is lost by that.
_LEAST_ODDS = 0.02


def decode_board(
    logits: Tensor,
    of_boards: Tensor,
    planes: Tensor,
    layer_of: Tensor,
    shifts: tuple[tuple[int, int], ...],
    drawn: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """The base uint8 [N, P, H, W], which cells are edited, bool like it, and the log probability
    [N] of the likeliest of both.

    logits: float32 [N, L * K + P, H, W]: sources of L layers, then edits. of_boards: float32
    [N, L * K + P], added on the whole board. planes: uint8 [N, P, H, W], now. layer_of: int64 [P].
    shifts: of the sources, as in `boards.stack_sources`.
    drawn: float32 [N, L, 1 + H * W] of 0..1: base and edits are sampled, instead of the likeliest.
    A number of each cell decides where its unit goes: both cells of a move change, or none. Edits
    are drawn over the whole board at even distances (systematic sampling), from the first number
    on: of ten cells with a chance of 1/10 each exactly one is edited, in all planes of a layer.
    """
    device, planes = planes.device, planes.contiguous().cpu()
    base, edited = torch.empty_like(planes), torch.zeros_like(planes, dtype=torch.bool)
    surety = torch.zeros(len(planes))
    _decode(
        logits.permute(0, 2, 3, 1).contiguous().cpu().numpy(),
        of_boards.contiguous().cpu().numpy(),
        planes.numpy(),
        layer_of.cpu().numpy(),
        np.array(shifts, np.int64).reshape(-1, 2),
        np.empty((len(planes), 0, 0), np.float32) if drawn is None else drawn.numpy(),
        (base.numpy(), edited.numpy(), surety.numpy()),
    )
    return base.to(device), edited.to(device), surety.to(device)


@njit(cache=True, nogil=True)
def _decode(
    logits: Any,
    of_boards: Any,
    planes: Any,
    layer_of: Any,
    shifts: Any,
    drawn: Any,
    out: Any,
) -> None:
    base, edited, surety = out
    num, _, rows, columns = planes.shape
    num_layers, num_sources = layer_of.max() + 1, shifts.shape[0] + 2
    layers = sort_planes(layer_of)
    is_near = np.zeros((rows * columns, num_layers), np.bool_)
    chances = np.zeros((num_layers, 2, rows * columns, num_sources))
    chosen = np.zeros((num_layers, rows * columns), np.int64)
    for image in range(num):
        outputs = logits[image] + of_boards[image]
        base[image], chosen[:], chances[:] = planes[image], 0, 0.0
        find_near(planes[image], layer_of, shifts, is_near)
        known = planes[image], is_near, layers, shifts
        total = _choose_sources(outputs, known, chosen, chances)
        starts = np.full(num_layers, 0.5)
        if drawn.shape[1]:
            starts[:] = drawn[image, :, 0]
            for layer in range(num_layers):
                if is_near[:, layer].any():
                    numbers = drawn[image, layer, 1:]
                    _move(chances[layer], shifts, columns, numbers, chosen[layer])
        _take_sources(known, chosen, base[image])
        edits = outputs[:, :, num_layers * num_sources :]
        surety[image] = total + _mark_edits(edits, edited[image], layer_of, starts)


@njit(cache=True, nogil=True)
def _choose_sources(outputs: Any, known: Any, chosen: Any, chances: Any) -> float:
    """Write the likeliest sources [L, H * W], and the chances [L, 2, H * W, K] of `_choose`, where
    a unit is near. Returns the log probability of the former.
    """
    planes, is_near, (planes_of, first_of), shifts = known
    num_sources, total = shifts.shape[0] + 2, 0.0
    values = np.zeros((num_sources, planes.shape[0]), np.uint8)
    for place in range(len(is_near)):
        if not is_near[place].any():
            continue
        row, column = place // planes.shape[2], place % planes.shape[2]
        read_sources(planes, row, column, shifts, values)
        for layer in range(is_near.shape[1]):
            if is_near[place, layer]:
                own = outputs[row, column, layer * num_sources : (layer + 1) * num_sources]
                members = planes_of[first_of[layer] : first_of[layer + 1]]
                best, log_prob = _choose(own, values, members, chances[layer, :, place])
                chosen[layer, place], total = best, total + log_prob
    return total


@njit(cache=True, nogil=True)
def _take_sources(known: Any, chosen: Any, base: Any) -> None:
    """Write the values [P, H, W] of the sources `chosen` [L, H * W] where they are not the present
    ones, source 0.
    """
    planes, _, (planes_of, first_of), shifts = known
    values = np.zeros((shifts.shape[0] + 2, planes.shape[0]), np.uint8)
    for place in range(chosen.shape[1]):
        if chosen[:, place].any():
            row, column = place // planes.shape[2], place % planes.shape[2]
            read_sources(planes, row, column, shifts, values)
            for layer in range(chosen.shape[0]):
                for plane in planes_of[first_of[layer] : first_of[layer + 1]]:
                    base[plane, row, column] = values[chosen[layer, place], plane]


@njit(cache=True, nogil=True)
def _mark_edits(logits: Any, edited: Any, layer_of: Any, starts: Any) -> float:
    """Mark which values are edited, bool [P, H, W]: the likeliest where all `starts` [L] are 1/2,
    else sampled from there on. Returns the log probability of the likeliest.
    """
    num_planes, rows, columns = edited.shape
    is_sampled = (starts != 0.5).any()
    odds, largest, total = np.zeros(num_planes), np.zeros(len(starts)), 0.0
    for place in range(rows * columns):
        row, column = place // columns, place % columns
        total += _find_odds(logits[row, column], odds)
        largest[:] = 0.0
        for plane in range(num_planes):
            layer, chance = layer_of[plane], odds[plane]
            if is_sampled and chance < _LEAST_ODDS:
                chance = 0.0
            reached = np.floor(starts[layer] + chance)
            edited[plane, row, column] = reached > np.floor(starts[layer])
            largest[layer] = max(largest[layer], chance)
        if is_sampled:
            starts += largest
    return total


@njit(cache=True, nogil=True)
def _move(chances: Any, shifts: Any, columns: int, drawn: Any, chosen: Any) -> None:
    """Sample the sources int64 [H * W] of the cells of a layer.

    chances: [2, H * W, K], as `_choose` gives them. drawn: [H * W] of 0..1, one number for the unit
    of each cell. Cells to which it may go have parts of 0..1 and take the unit if its number is in
    theirs; its own cell is empty for numbers from 0 to the chance of that. So each cell changes as
    often as the network says, and cells that belong together change together.
    """
    number = _find_numbers(chances[1], shifts, columns, drawn)
    chances = chances[0]
    num_cells, num_sources = chances.shape
    taken = np.zeros(num_cells)
    for place in range(num_cells):
        chosen[place] = 0
        for source in range(1, num_sources - 1):
            if chances[place, source] > 0.0:
                unit = place - shifts[source - 1, 0] * columns - shifts[source - 1, 1]
                # From the start again beyond 1: a unit may move while another one follows it.
                if (number[unit] - taken[unit]) % 1.0 < chances[place, source]:
                    chosen[place] = source
                taken[unit] += chances[place, source]
    for place in range(num_cells):
        may_go = chosen[place] == 0 and chances[place, num_sources - 1] > 0.0
        if may_go and number[place] < chances[place].sum():
            chosen[place] = num_sources - 1


@njit(cache=True, nogil=True)
def _find_numbers(chances: Any, shifts: Any, columns: int, drawn: Any) -> Any:
    """The numbers [H * W] of the units of all cells. One that may enter another one's cell has that
    one's number: it moves when there is room.

    chances: [H * W, K] of all sources with a unit.
    """
    num_cells, num_sources = chances.shape
    room = np.full(num_cells, -1)  # the cell whose unit must leave first
    most = np.full(num_cells, _LEAST_ODDS)
    for place in range(num_cells):
        if chances[place, 0] > 0.0:  # there is a unit
            for source in range(1, num_sources - 1):
                if chances[place, source] > 0.0:
                    unit = place - shifts[source - 1, 0] * columns - shifts[source - 1, 1]
                    if chances[place, source] > most[unit]:
                        room[unit], most[unit] = place, chances[place, source]
    number = np.zeros(num_cells)
    for place in range(num_cells):
        front, steps = place, 0
        while room[front] >= 0 and steps < num_cells:
            front, steps = room[front], steps + 1
        first, following = front, room[front]
        while steps == num_cells and following != front:  # a ring has no front: its first cell
            first, following = min(first, following), room[following]
        number[place] = drawn[first]
    return number


@njit(cache=True, nogil=True)
def _find_odds(logits: Any, odds: Any) -> float:
    """Write the probabilities [P] of edits; returns the log probability of the likeliest."""
    product = 1.0
    for plane in range(logits.shape[0]):
        logit = logits[plane]
        odds[plane] = 1.0 if logit > 0.0 else 0.0
        if abs(logit) < _SURE:
            weight = 1.0 + np.exp(-abs(logit))
            product *= weight  # one logarithm for all planes
            odds[plane] = (1.0 if logit > 0.0 else weight - 1.0) / weight
    return float(-np.log(product))


@njit(cache=True, nogil=True)
def read_sources(planes: Any, row: int, column: int, shifts: Any, values: Any) -> None:
    """Write the values [K, P] that a cell may take over; the last ones stay 0."""
    num_planes, rows, columns = planes.shape
    for source in range(shifts.shape[0] + 1):
        from_row, from_column = row, column
        if source:
            from_row -= shifts[source - 1, 0]
            from_column -= shifts[source - 1, 1]
        is_inside = 0 <= from_row < rows and 0 <= from_column < columns
        for plane in range(num_planes):
            values[source, plane] = planes[plane, from_row, from_column] if is_inside else 0


@njit(cache=True, nogil=True)
def sort_planes(layer_of: Any) -> Any:
    """The planes [P] layer by layer, and the place [L + 1] of the first one of each layer."""
    planes_of = np.argsort(layer_of)
    return planes_of, np.searchsorted(layer_of[planes_of], np.arange(layer_of.max() + 2))


@njit(cache=True, nogil=True)
def find_near(planes: Any, layer_of: Any, shifts: Any, is_near: Any) -> None:
    """Write in which cells [H * W, L] a source has a unit of a layer: elsewhere all are equal."""
    num_planes, rows, columns = planes.shape
    is_near[:] = False
    for plane in range(num_planes):
        layer = layer_of[plane]
        for row in range(rows):
            for column in range(columns):
                if planes[plane, row, column] != 0:
                    is_near[row * columns + column, layer] = True
                    for shift in range(shifts.shape[0]):
                        to_row, to_column = row + shifts[shift, 0], column + shifts[shift, 1]
                        if 0 <= to_row < rows and 0 <= to_column < columns:
                            is_near[to_row * columns + to_column, layer] = True


@njit(cache=True, nogil=True)
def _choose(outputs: Any, values: Any, planes: Any, chances: Any) -> tuple[int, float]:
    """The likeliest source of a layer at a cell, and the log probability of its values.

    planes: int64, of the layer. Adds to the chances [2, K] those of sources whose values are not
    the present ones, where neighbours without a unit count with the last source, which is 0 in a
    cell without one; and those of all sources with a unit.
    """
    num_sources = outputs.shape[0]
    last, best = num_sources - 1, int(np.argmax(outputs))
    whole = same = 0.0
    for source in range(num_sources):
        is_likeliest, is_now, is_empty = True, True, True
        for plane in planes:
            value = values[source, plane]
            is_likeliest &= value == values[best, plane]
            is_now &= value == values[0, plane]
            is_empty &= value == 0
        weight = np.exp(outputs[source] - outputs[best])
        whole += weight
        if is_likeliest:
            same += weight
        if not is_now:
            chances[0, last if is_empty else source] += weight
        if not is_empty:
            chances[1, source] = weight
    for source in range(num_sources):
        chances[0, source] /= whole
        chances[1, source] /= whole
    return best, float(np.log(same / whole))
