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


def decode_board(
    logits: Tensor,
    of_boards: Tensor,
    planes: Tensor,
    layer_of: Tensor,
    shifts: tuple[tuple[int, int], ...],
    offsets: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """The base uint8 [N, P, H, W], which cells are edited, bool like it, and the log probability
    [N] of the likeliest of both.

    logits: float32 [N, L * K + P, H, W]: sources of L layers, then edits. of_boards: float32
    [N, L * K + P], added on the whole board. planes: uint8 [N, P, H, W], now. layer_of: int64 [P].
    shifts: of the sources, as in `boards.stack_sources`.
    offsets: float32 [N, L] of 0..1: base and edits are sampled, instead of the likeliest. Changes
    are drawn over the whole board at even distances (systematic sampling): of ten cells with a
    chance of 1/10 each exactly one changes, in all planes of a layer.
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
        np.empty((len(planes), 0), np.float32) if offsets is None else offsets.numpy(),
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
    offsets: Any,
    out: Any,
) -> None:
    base, edited, surety = out
    num, num_planes, rows, columns = planes.shape
    num_layers, num_sources = layer_of.max() + 1, shifts.shape[0] + 2
    is_sampled = offsets.shape[1] > 0
    values = np.zeros((num_sources, num_planes), np.uint8)
    odds = np.zeros(num_planes)  # of edits
    for image in range(num):
        total = 0.0
        drawn = offsets[image].astype(np.float64)
        for row in range(rows):
            for column in range(columns):
                read_sources(planes[image], row, column, shifts, values)
                outputs = logits[image, row, column] + of_boards[image]
                total += _find_odds(outputs[num_layers * num_sources :], odds)
                for layer in range(num_layers):
                    first = layer * num_sources
                    chosen, other, log_prob, change = _choose(
                        outputs[first : first + num_sources], values, layer, layer_of
                    )
                    total += log_prob
                    largest, start = 0.0, 0.5
                    if is_sampled:
                        before = np.floor(drawn[layer])
                        drawn[layer] += change
                        start = drawn[layer]
                        chosen = other if np.floor(start) > before else 0
                    for plane in range(num_planes):
                        if layer_of[plane] == layer:
                            base[image, plane, row, column] = values[chosen, plane]
                            is_edited = np.floor(start + odds[plane]) > np.floor(start)
                            edited[image, plane, row, column] = is_edited
                            largest = max(largest, odds[plane])
                    if is_sampled:
                        drawn[layer] += largest
        surety[image] = total


@njit(cache=True, nogil=True)
def _find_odds(logits: Any, odds: Any) -> float:
    """Write the probabilities [P] of edits; returns the log probability of the likeliest."""
    total = 0.0
    for plane in range(logits.shape[0]):
        logit = logits[plane]
        odds[plane] = 1.0 if logit > 0.0 else 0.0
        if abs(logit) < _SURE:
            weight = np.exp(-abs(logit))
            total -= np.log1p(weight)
            odds[plane] = (1.0 if logit > 0.0 else weight) / (1.0 + weight)
    return total


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
def _choose(outputs: Any, values: Any, layer: int, layer_of: Any) -> tuple[int, int, float, float]:
    """The likeliest source of a layer at a cell; the likeliest whose values are not the present
    ones; the log probability of the first one's values; the probability of a change.
    """
    num_sources = outputs.shape[0]
    if not _differs(values, 0, num_sources - 1, layer, layer_of):
        is_empty = True
        for source in range(1, num_sources - 1):
            if _differs(values, source, num_sources - 1, layer, layer_of):
                is_empty = False
        if is_empty:
            return 0, 0, 0.0, 0.0
    best, other = 0, 0
    for source in range(1, num_sources):
        if outputs[source] > outputs[best]:
            best = source
        is_other = _differs(values, source, 0, layer, layer_of)
        if is_other and (other == 0 or outputs[source] > outputs[other]):
            other = source
    whole = same = own = 0.0
    for source in range(num_sources):
        weight = np.exp(outputs[source] - outputs[best])
        whole += weight
        if not _differs(values, source, best, layer, layer_of):
            same += weight
        if not _differs(values, source, 0, layer, layer_of):
            own += weight
    return best, other, np.log(same / whole), 1.0 - own / whole


@njit(cache=True, nogil=True)
def _differs(values: Any, source: int, another: int, layer: int, layer_of: Any) -> bool:
    """Whether two sources have other values in a plane of the layer."""
    for plane in range(layer_of.shape[0]):
        if layer_of[plane] == layer and values[source, plane] != values[another, plane]:
            return True
    return False
