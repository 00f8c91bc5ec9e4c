"""Compiled passes over cells with gradients: curves of values, and how likely the next board is.

On a CPU PyTorch takes several times as long: it passes a dozen times over all sources of all cells,
although most cells and their neighbours are empty. Boards of a GPU are scored on the CPU.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numba import njit
from torch import Tensor
from torch.autograd import Function
from torch.autograd.function import once_differentiable

from marl_cair.generative.networks.decoding import find_near, read_sources, sort_planes


def apply_curves(planes: Tensor, curve: Tensor) -> Tensor:
    """Values of curves at planes uint8 [N, S, H, W]: float32 like them, channels last in memory.

    curve: float32 [S * 256], the values of plane 0, then those of plane 1, ...
    """
    if planes.device.type != "cpu":
        first = torch.arange(planes.shape[1], device=planes.device)[:, None, None] * 256
        return curve[planes.long() + first]
    values: Tensor = _Curves.apply(planes.contiguous(), curve)  # type: ignore[no-untyped-call]
    return values


class _Curves(Function):
    @staticmethod
    def forward(ctx: Any, planes: Tensor, curve: Tensor) -> Tensor:
        ctx.save_for_backward(planes)
        values = torch.empty_like(planes, dtype=torch.float32, memory_format=torch.channels_last)
        cells = values.permute(0, 2, 3, 1).flatten(1, 2)
        _look_up(planes.flatten(2).numpy(), curve.numpy(), cells.numpy())
        return values

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[None, Tensor]:
        (planes,) = ctx.saved_tensors
        of_curve = torch.zeros(planes.shape[1] * 256)
        cells = grad.permute(0, 2, 3, 1).contiguous().flatten(1, 2)
        _sum_up(planes.flatten(2).numpy(), cells.numpy(), of_curve.numpy())
        return None, of_curve


@njit(cache=True, nogil=True)
def _look_up(planes: Any, curve: Any, values: Any) -> None:
    for image in range(planes.shape[0]):
        for plane in range(planes.shape[1]):
            for cell in range(planes.shape[2]):
                place = plane * 256 + planes[image, plane, cell]
                values[image, cell, plane] = curve[place]


@njit(cache=True, nogil=True)
def _sum_up(planes: Any, grad: Any, of_curve: Any) -> None:
    for image in range(planes.shape[0]):
        for plane in range(planes.shape[1]):
            for cell in range(planes.shape[2]):
                place = plane * 256 + planes[image, plane, cell]
                of_curve[place] += grad[image, cell, plane]


def score_board(
    logits: Tensor,
    planes: Tensor,
    later: Tensor,
    layer_of: Tensor,
    shifts: tuple[tuple[int, int], ...],
) -> tuple[Tensor, Tensor, Tensor]:
    """Negative log likelihood [N] of the board `later`, but for by how much edited values differ;
    the base uint8 [N, P, H, W]; and which cells are edited, bool like it.

    The sources that explain the most planes of a layer count together, and the likeliest of them
    gives the base. Arguments are as in `decoding.decode_board`; later: uint8 like `planes`.
    """
    boards = (part.contiguous().cpu() for part in (planes, later))
    nll, base, edited = _Score.apply(  # type: ignore[no-untyped-call]
        logits.cpu(), *boards, layer_of.cpu(), shifts
    )
    return nll.to(logits.device), base.to(logits.device), edited.to(logits.device)


class _Score(Function):
    @staticmethod
    def forward(
        ctx: Any, logits: Tensor, planes: Tensor, later: Tensor, layer_of: Tensor, shifts: Any
    ) -> tuple[Tensor, Tensor, Tensor]:
        nll, base = torch.zeros(len(planes)), torch.empty_like(planes)
        scores = logits.permute(0, 2, 3, 1).contiguous()
        gradients = torch.zeros_like(scores)
        _score(
            scores.numpy(),
            planes.numpy(),
            later.numpy(),
            layer_of.numpy(),
            np.array(shifts, np.int64).reshape(-1, 2),
            (base.numpy(), nll.numpy(), gradients.numpy()),
        )
        edited = base != later
        ctx.save_for_backward(gradients)
        ctx.mark_non_differentiable(base, edited)
        return nll, base, edited

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor, *_: Tensor) -> tuple[Tensor, None, None, None, None]:
        (gradients,) = ctx.saved_tensors
        weighted = gradients * grad[:, None, None, None]
        return weighted.permute(0, 3, 1, 2), None, None, None, None


@njit(cache=True, nogil=True)
def _score(logits: Any, planes: Any, later: Any, layer_of: Any, shifts: Any, out: Any) -> None:
    base, nll, gradients = out
    num, num_planes, rows, columns = planes.shape
    num_layers, num_sources = layer_of.max() + 1, shifts.shape[0] + 2
    planes_of, first_of = sort_planes(layer_of)
    is_near = np.zeros((rows * columns, num_layers), np.bool_)
    values = np.zeros((num_sources, num_planes), np.uint8)
    explained = np.zeros(num_sources, np.int64)
    edits = num_layers * num_sources
    for image in range(num):
        total = 0.0
        base[image] = planes[image]
        find_near(planes[image], layer_of, shifts, is_near)
        for place in range(rows * columns):
            row, column = place // columns, place % columns
            outputs, slopes = logits[image, row, column], gradients[image, row, column]
            wanted, found = later[image, :, row, column], base[image, :, row, column]
            if is_near[place].any():
                read_sources(planes[image], row, column, shifts, values)
            for layer in range(num_layers):
                if is_near[place, layer]:  # else all sources are equal
                    members = planes_of[first_of[layer] : first_of[layer + 1]]
                    explained[:] = 0
                    for plane in members:
                        for source in range(num_sources):
                            explained[source] += values[source, plane] == wanted[plane]
                    own = slice(layer * num_sources, (layer + 1) * num_sources)
                    loss, best = _score_sources(outputs[own], explained, slopes[own])
                    total += loss
                    for plane in members:
                        found[plane] = values[best, plane]
            total += _score_edits(outputs[edits:], found, wanted, slopes[edits:])
        nll[image] = total


@njit(cache=True, nogil=True)
def _score_edits(logits: Any, base: Any, later: Any, slopes: Any) -> float:
    """Negative log likelihood of which values [P] of a cell differ from the base; writes the
    gradient by the logits.
    """
    product, total = 1.0, 0.0
    for plane in range(logits.shape[0]):
        logit, is_edited = logits[plane], base[plane] != later[plane]
        weight = 1.0 + np.exp(-abs(logit))
        product *= weight  # one logarithm for all planes
        total += max(logit, 0.0) - is_edited * logit
        slopes[plane] = (1.0 if logit > 0.0 else weight - 1.0) / weight - is_edited
    return float(total + np.log(product))


@njit(cache=True, nogil=True)
def _score_sources(logits: Any, explained: Any, slopes: Any) -> tuple[float, int]:
    """Negative log likelihood of the sources [K] that explain the most, and the likeliest of them;
    writes the gradient by the logits.
    """
    most, best = explained[0], 0
    is_even = True
    largest = logits[0]
    for source in range(1, logits.shape[0]):
        is_even = is_even and explained[source] == explained[0]
        largest = max(largest, logits[source])
        is_likelier = explained[source] == most and logits[source] > logits[best]
        if explained[source] > most or is_likelier:
            most, best = explained[source], source
    if is_even:
        return 0.0, best
    whole = kept = 0.0
    for source in range(logits.shape[0]):
        weight = np.exp(logits[source] - largest)
        slopes[source] = weight
        whole += weight
        if explained[source] == most:
            kept += weight
    kept = max(kept, 1e-30)
    for source in range(logits.shape[0]):
        is_kept = explained[source] == most
        slopes[source] *= 1.0 / whole - (1.0 / kept if is_kept else 0.0)
    return np.log(whole / kept), best
