"""Fast inference of per-cell likelihoods (no autograd).

Nearly all cells need the probability of one value only. PyTorch computes it from a dozen arrays of
all candidates and takes six times as long; the compiled loops here stay in the processor's cache.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit
from torch import Tensor

from marl_cair.generative.networks import cells

_MIN_SHARE = np.float32(1e-6)  # as in `build_distribution`
_NO_NAN = {"nnan", "nsz"}  # the inputs hold no NaN: the compiler can vectorise maxima
_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_UNIT, _MAX = np.float32(cells.MEAN_UNIT), np.float32(cells.MAX_VALUE)
_MIN_SCALE, _MAX_SCALE = np.float32(cells.MIN_LOG_SCALE), np.float32(cells.MAX_LOG_SCALE)
_LOWEST = np.float32(-80.0)  # exp is practically 0, and not yet denormal
_LOG2_E, _LN_2 = np.float32(1.4426950408889634), np.float32(0.6931471805599453)
_TAYLOR = tuple(np.float32(1.0 / n) for n in (720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0))


class BoardCells(NamedTuple):
    """Distributions of all cells of N boards with P planes, as network outputs."""

    outputs: Tensor  # float32 [K * P, N * H * W], of each cell
    of_planes: Tensor  # float32 [N, K * P], added on the whole board
    planes: Tensor  # uint8 [N, P, H, W], the values now, contiguous
    shifts: tuple[tuple[int, int], ...]  # as in `cells.gather_candidates`
    step_results: Tensor  # as in `cells.gather_candidates`

    def find_masses(self, values: Tensor) -> tuple[Tensor, Tensor]:
        """Probabilities of values uint8 [N, P, H, W] before the floor (`cells.find_mass`, within
        3e-6): float32 [N, P, H * W]; and whether a cell and its neighbours are empty, bool.
        """
        num, num_planes, rows, columns = self.planes.shape
        masses = torch.empty(num, num_planes, rows * columns)
        is_empty = torch.empty(num, num_planes, rows * columns, dtype=torch.bool)
        _find_masses(
            self.outputs.numpy(),
            self.of_planes.numpy(),
            self.planes.numpy(),
            values.contiguous().numpy(),
            np.array(self.shifts, np.int64).reshape(-1, 2),
            self.step_results.numpy(),
            masses.numpy(),
            is_empty.numpy(),
        )
        return masses, is_empty

    def select(self, chosen: Tensor) -> cells.CellDistribution:
        """Distributions of the cells `chosen`, int64 [M], of all N * P * H * W."""
        num_planes, area = self.planes.shape[1], self.planes[0, 0].numel()
        image, plane, cell = (
            chosen // area // num_planes,
            chosen // area % num_planes,
            chosen % area,
        )
        first = torch.arange(0, self.outputs.shape[0], num_planes)
        numbers = first[:, None] + plane
        outputs = self.outputs[numbers, image * area + cell] + self.of_planes[image, numbers]
        candidates = cells.gather_candidates(self.planes, self.shifts, self.step_results, chosen)
        return cells.build_distribution(outputs, candidates)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_NO_NAN)
def _exponentiate(numbers: Any, powers: Any) -> None:
    """Replace float32 `numbers` [M] by their exp, to a relative 2e-6. powers: int32 [M], scratch.

    Without calls the compiler vectorises it: ten times as fast as calls of exp. torch.exp between
    loops is slower by 40 %: the arrays of all candidates leave the cache.
    """
    for place in range(numbers.size):
        number = max(numbers[place], _LOWEST)
        power = np.floor(number * _LOG2_E + np.float32(0.5))
        rest = number - power * _LN_2
        value = _TAYLOR[0]
        value = value * rest + _TAYLOR[1]
        value = value * rest + _TAYLOR[2]
        value = value * rest + _TAYLOR[3]
        value = value * rest + _TAYLOR[4]
        value = value * rest + _TAYLOR[5]
        value = value * rest + _TAYLOR[6]
        numbers[place] = value
        powers[place] = (np.int32(power) + np.int32(127)) << np.int32(23)
    scales = powers.view(np.float32)
    for place in range(numbers.size):
        numbers[place] *= scales[place]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_NO_NAN)
def _find_candidates(
    plane: int, board: Any, shifts: Any, results: Any, around: Any, found: Any
) -> None:
    """Write the candidates of all cells of one plane, except the last two (0 and 255).

    board: uint8 [H, W]; around: uint8 [H + 2 R, W + 2 R], scratch whose edges are 0; found: float32
    [K', H * W].
    """
    rows, columns = board.shape
    reach = (around.shape[0] - rows) // 2
    num_shifts, num_steps = shifts.shape[0], results.shape[1] - 1
    for row in range(rows):
        for column in range(columns):
            own = board[row, column]
            found[0, row * columns + column] = own
            around[reach + row, reach + column] = results[plane, num_steps, own]
    for shift in range(num_shifts):
        up, left = reach - shifts[shift, 0], reach - shifts[shift, 1]
        for row in range(rows):
            for column in range(columns):
                found[1 + shift, row * columns + column] = around[up + row, left + column]
    for step in range(num_steps):
        after = results[plane, step]
        for row in range(rows):
            for column in range(columns):
                found[1 + num_shifts + step, row * columns + column] = after[board[row, column]]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_NO_NAN)
def _find_logistic(ends: Any, powers: Any, asked: Any, mean: Any) -> None:
    """Replace the log scales in ends[0] by the mass of the rounded logistic at `asked` [M].

    mean: float32 [M]; ends: float32 [3, M]; powers: int32 [2 * M]. powers, ends[1:]: scratch.
    """
    count = asked.size
    scale, above, below = ends[0], ends[1], ends[2]
    for cell in range(count):
        scale[cell] = min(max(scale[cell], _MIN_SCALE), _MAX_SCALE)
    _exponentiate(scale, powers[:count])
    for cell in range(count):
        from_mean = asked[cell] - mean[cell]
        above[cell] = min(-(from_mean + _HALF) / scale[cell], -_LOWEST)
        below[cell] = min(-(from_mean - _HALF) / scale[cell], -_LOWEST)
    _exponentiate(ends[1:].reshape(2 * count), powers)
    for cell in range(count):
        upper, lower = _ONE / (_ONE + above[cell]), _ONE / (_ONE + below[cell])
        upper = _ONE if asked[cell] >= _MAX else upper
        lower = _ZERO if asked[cell] <= _ZERO else lower
        scale[cell] = upper - lower


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_NO_NAN)
def _find_weights(
    outputs: Any, first: int, of_planes: Any, plane: int, powers: Any, found: Any
) -> None:
    """Write the outputs of one board and plane, with weights (the largest is 1) instead of logits.

    found: float32 [K, H * W], the last two rows are mean and log scale; outputs: float32
    [K * P, N * H * W], the board's from `first` on; of_planes: float32 [K * P]; powers: int32
    [(K - 2) * H * W], scratch.
    """
    num, area = found.shape
    num_planes = of_planes.size // num
    for one in range(num):
        number = one * num_planes + plane
        given, extra = outputs[number, first : first + area], of_planes[number]
        for cell in range(area):
            found[one, cell] = given[cell] + extra
    top = found[0].copy()
    for one in range(1, num - 2):
        for cell in range(area):
            top[cell] = max(top[cell], found[one, cell])
    for one in range(num - 2):
        for cell in range(area):
            found[one, cell] -= top[cell]
    _exponentiate(found[: num - 2].reshape((num - 2) * area), powers)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_NO_NAN)
def _sum_up(weights: Any, candidates: Any, asked: Any, sums: Any) -> None:
    """Sum each cell's candidates: sums float32 [4, H * W], their weight, weighted value, weight at
    `asked`, and the largest value except the last candidate, 255.
    """
    sums[:] = _ZERO
    kept, values, hit, largest = sums[0], sums[1], sums[2], sums[3]
    for one in range(candidates.shape[0]):
        for cell in range(asked.size):
            kept[cell] += weights[one, cell]
        for cell in range(asked.size):
            values[cell] += weights[one, cell] * candidates[one, cell]
        for cell in range(asked.size):
            is_hit = candidates[one, cell] == asked[cell]
            hit[cell] += weights[one, cell] if is_hit else _ZERO
    for one in range(candidates.shape[0] - 1):
        for cell in range(asked.size):
            largest[cell] = max(largest[cell], candidates[one, cell])


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_NO_NAN)
def _find_masses(
    outputs: Any,
    of_planes: Any,
    planes: Any,
    values: Any,
    shifts: Any,
    results: Any,
    masses: Any,
    is_empty: Any,
) -> None:
    num, num_planes, rows, columns = planes.shape
    area, num_outputs = rows * columns, outputs.shape[0] // num_planes
    found = np.empty((num_outputs, area), np.float32)
    powers = np.empty((num_outputs - 2) * area, np.int32)
    candidates = np.zeros((num_outputs - 3, area), np.float32)
    candidates[num_outputs - 4] = _MAX
    reach = np.abs(shifts).max() if shifts.size else 0
    around = np.zeros((rows + 2 * reach, columns + 2 * reach), np.uint8)
    sums, ends = np.empty((4, area), np.float32), np.empty((3, area), np.float32)
    asked, mean = np.empty(area, np.float32), np.empty(area, np.float32)
    kept, anchor, hit, largest = sums[0], sums[1], sums[2], sums[3]
    smooth = found[num_outputs - 3]
    for image in range(num):
        for plane in range(num_planes):
            _find_candidates(plane, planes[image, plane], shifts, results, around, candidates)
            asked[:] = values[image, plane].reshape(area)
            _find_weights(outputs, image * area, of_planes[image], plane, powers, found)
            _sum_up(found, candidates, asked, sums)
            for cell in range(area):
                least = _MIN_SHARE * (kept[cell] + smooth[cell])
                mean[cell] = anchor[cell] / max(kept[cell], least)
                mean[cell] += _UNIT * found[num_outputs - 2, cell]
                ends[0, cell] = found[num_outputs - 1, cell]
            _find_logistic(ends, powers, asked, mean)
            for cell in range(area):
                mass = hit[cell] + smooth[cell] * ends[0, cell]
                masses[image, plane, cell] = mass / (kept[cell] + smooth[cell])
                is_empty[image, plane, cell] = largest[cell] == _ZERO
