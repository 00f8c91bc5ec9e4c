"""Distribution of one cell's next value: copies of nearby values and a discretised logistic.

A cell of a plane keeps its value, takes that of a neighbour (units walk), changes by a step that is
common in its plane (`steps.py`), empties, fills, or takes a new value (damage). Its next value is a
mixture of point masses at the candidate values [own, neighbours..., steps..., 0, 255] and one
logistic that is rounded to 0..255. Copies are exact, and a moved unit keeps its exact value (the
copy gate of CCDN v2, extended to neighbours).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

NUM_VALUES = 256
MAX_VALUE = 255.0
FLOOR_SHARE = 1e-4  # of the mass is uniform over 0..255, so that no likelihood is 0
MIN_LOG_SCALE, MAX_LOG_SCALE = -2.0, 5.0  # of the logistic, in units of plane values
MEAN_UNIT = 16.0  # plane values per unit of the network's output


class CellDistribution(NamedTuple):
    """Distributions of M cells; K candidates each. Values are float32 whole numbers 0..255.

    The cells run along the last axis: sums over a few components are then vectorised.
    """

    weights: Tensor  # [K, M], of the candidates
    logistic_weight: Tensor  # [M]; with `weights` it sums to 1
    candidates: Tensor  # [K, M], the first is the cell's own value
    mean: Tensor  # [M]
    scale: Tensor  # [M]

    def select(self, chosen: Tensor) -> CellDistribution:
        """The cells at `chosen` (int64)."""
        return CellDistribution(*(part[..., chosen] for part in self))


Select = Callable[[Tensor], CellDistribution]  # distributions of the cells int64 [m]


def count_outputs(num_shifts: int, num_steps: int) -> int:
    """Number of network outputs for one cell of one plane: weights, mean, log scale."""
    return num_shifts + num_steps + 3 + 1 + 2


def build_distribution(
    outputs: Tensor, candidates: Tensor, mean_unit: float = MEAN_UNIT
) -> CellDistribution:
    """Turn outputs [K + 3, M] and candidates [K, M] into the mixture."""
    num_candidates = candidates.shape[0]
    logits, offset, log_scale = torch.split(outputs, [num_candidates + 1, 1, 1])
    weights, logistic_weight = torch.split(functional.softmax(logits, 0), [num_candidates, 1])
    # The logistic starts from the mean of the candidates: a unit that walked here and was hit has a
    # little less than the neighbour's value.
    anchor = (weights * candidates).sum(0) / weights.sum(0).clamp_min(1e-6)
    mean = anchor + mean_unit * offset[0]
    scale = log_scale[0].clamp(MIN_LOG_SCALE, MAX_LOG_SCALE).exp()
    return CellDistribution(weights, logistic_weight[0], candidates, mean, scale)


def gather_candidates(
    planes: Tensor, shifts: tuple[tuple[int, int], ...], step_results: Tensor, flat: Tensor
) -> Tensor:
    """Candidate values of cells: [own, one per shift, one per step, 0, 255]; 0 beyond the board.

    planes: uint8 [N, P, H, W]; flat: int64 [M] into its N*P*H*W cells.
    step_results: uint8 [P, K + 1, 256], results of K steps of the own value, and of the step of
        values that arrive from a neighbour (`StepTable.results`).
    Returns float32 [K', M]. Shift (dr, dc) gives the value from (row - dr, column - dc).
    """
    rows, columns = planes.shape[2:]
    reach = max((max(abs(dr), abs(dc)) for dr, dc in shifts), default=0)
    padded = functional.pad(
        _apply_arrival_steps(planes, step_results[:, -1]), (reach, reach, reach, reach)
    )
    own = planes.flatten()[flat]
    of_plane = torch.arange(planes.shape[1]) * step_results[0].numel()
    places = own + of_plane[flat // (rows * columns) % planes.shape[1]]
    wide = columns + 2 * reach
    column, line = flat % columns, flat // columns
    row, image = line % rows, line // rows
    start = (image * (rows + 2 * reach) + row + reach) * wide + column + reach
    values = padded.flatten()
    near = [values[start - (dr * wide + dc)] for dr, dc in shifts]
    results, num_steps = step_results.flatten(), step_results.shape[1] - 1
    stepped = [results[places + step * NUM_VALUES] for step in range(num_steps)]
    ends = [torch.full_like(own, 0), torch.full_like(own, NUM_VALUES - 1)]
    return torch.stack([own, *near, *stepped, *ends]).float()


def _apply_arrival_steps(planes: Tensor, results: Tensor) -> Tensor:
    """Planes uint8 [N, P, H, W] after the step [P, 256] of values that arrive at a cell."""
    stepping = (results != torch.arange(NUM_VALUES)).any(-1).nonzero().squeeze(-1)
    arrived = planes.clone()
    for plane in stepping.tolist():
        arrived[:, plane] = results[plane][planes[:, plane].long()]
    return arrived


def find_log_prob(cells: CellDistribution, values: Tensor) -> Tensor:
    """Log probability [M] of whole values [M]."""
    return floor_and_log(find_mass(cells, values))


def floor_and_log(masses: Tensor) -> Tensor:
    """Log probabilities from `masses` before the floor."""
    return (masses * (1.0 - FLOOR_SHARE) + FLOOR_SHARE / 256.0).log()


def find_mass(cells: CellDistribution, values: Tensor) -> Tensor:
    """Probability [M] of whole values [M], before the floor."""
    points = (cells.weights * (cells.candidates == values)).sum(0)
    return points + cells.logistic_weight * _find_logistic_mass(cells, values)


def _find_logistic_mass(cells: CellDistribution, values: Tensor) -> Tensor:
    """Mass of the rounded, clamped logistic at `values`; 0 and 255 take the tails."""
    from_mean = values - cells.mean
    upper = torch.sigmoid((from_mean + 0.5) / cells.scale)
    lower = torch.sigmoid((from_mean - 0.5) / cells.scale)
    return torch.where(values >= MAX_VALUE, 1.0, upper) - torch.where(values <= 0.0, 0.0, lower)


def find_mode(own: Tensor, own_masses: Tensor, select: Select) -> tuple[Tensor, Tensor]:
    """The likeliest value [M] of each cell and its probability [M].

    own: current values; own_masses: their probabilities.
    """
    values, masses = own.clone(), own_masses.clone()
    # Nearly all cells keep their value; only the others are searched.
    unsure = (masses <= 0.5).nonzero().squeeze(-1)
    if unsure.numel():
        part = select(unsure)
        best, best_mass = values[unsure], masses[unsure]
        for option in [*part.candidates[1:], part.mean.round().clamp(0.0, MAX_VALUE)]:
            mass = find_mass(part, option)
            better = mass > best_mass
            best = torch.where(better, option, best)
            best_mass = torch.where(better, mass, best_mass)
        values[unsure], masses[unsure] = best, best_mass
    return values, masses


def sample_without_mode(
    cells: CellDistribution, modes: Tensor, generator: torch.Generator
) -> Tensor:
    """Draw values [M] from the distributions given that they are not `modes` [M]."""
    mass = _find_logistic_mass(cells, modes).clamp(0.0, 1.0)
    points = cells.weights.masked_fill(cells.candidates == modes, 0.0)
    # A little of the logistic always remains, so that the weights are not all 0.
    smooth = (cells.logistic_weight * (1.0 - mass)).clamp_min(1e-9)
    weights = torch.cat([points, smooth[None]]).T
    component = torch.multinomial(weights, 1, generator=generator).squeeze(-1)
    # Quantile function of the logistic without the mass of the mode.
    below = torch.sigmoid((modes - 0.5 - cells.mean) / cells.scale)
    below = torch.where(modes <= 0.0, 0.0, below)
    level = torch.rand(modes.shape, generator=generator) * (1.0 - mass)
    level = torch.where(level >= below, level + mass, level).clamp(1e-6, 1.0 - 1e-6)
    drawn = (cells.mean + cells.scale * torch.logit(level)).round().clamp(0.0, MAX_VALUE)
    options = torch.cat([cells.candidates, drawn[None]])
    return options.gather(0, component[None]).squeeze(0)


def decode_cells(
    own: Tensor,
    own_masses: Tensor,
    select: Select,
    can_appear: Tensor,
    offsets: Tensor | None,
    generator: torch.Generator | None,
) -> Tensor:
    """Values uint8 [M]: sampled, or the likeliest without a generator.

    own, own_masses, select: as in `find_mode`; can_appear: bool [N, P, cells] and offsets: [N, P]
    as in `sample_deviations`.
    """
    values, masses = find_mode(own, own_masses, select)
    if generator is not None and offsets is not None:
        odds = (1.0 - masses).clamp(0.0, 1.0).view(can_appear.shape)
        chosen = sample_deviations(odds, can_appear, offsets).flatten().nonzero().squeeze(-1)
        if chosen.numel():
            values[chosen] = sample_without_mode(select(chosen), values[chosen], generator)
    return values.to(torch.uint8)


def sample_deviations(odds: Tensor, can_appear: Tensor, offsets: Tensor) -> Tensor:
    """Choose the cells that do not take their likeliest value: bool, by systematic sampling.

    odds: [N, P, cells], the probability of each; can_appear: bool, cells that are empty like their
    neighbours; offsets: [N, P] in 0..1. Each cell is chosen with its own odds, but the number of
    chosen cells of a plane is within one of its expectation: a unit that appears in one of ten
    cells appears once, where independent draws would show none in 35 % of the boards. Cells where
    something can appear come first, so that planes with equal offsets agree on the cell.
    """
    empty_odds = torch.where(can_appear, odds, 0.0).double()
    other_odds = torch.where(can_appear, 0.0, odds).double()
    first = empty_odds.cumsum(-1)
    later = other_odds.cumsum(-1) + first[..., -1:]
    reached = torch.where(can_appear, first, later) + offsets[..., None].double()
    return reached.floor() > (reached - odds.double()).floor()
