"""Counts exact steps of plane values: a progress bar grows by 26, a mined tile loses 1 or 2.

A network takes long to regress such a step exactly. The steps are counted instead, and their
results are candidates of the cells' mixture; their probabilities are learned.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.economy import NUM_DIFFERENCES, NUM_VALUES
from marl_cair.ranges import COUNT, Range, take_arrays

SMALLEST_ROUNDED = 8  # steps from here on may differ by 1 from value to value (25.5 of a clock)
MIN_COUNT = 3  # of a step, before it gets a slot
IN_PLACE, ON_ARRIVAL = range(2)


class Moves(NamedTuple):
    """M values that changed: int64 [M] each."""

    plane: Tensor
    before: Tensor
    after: Tensor


class StepTable(nn.Module):
    """Counts steps, and keeps the most common ones of each plane in slots.

    The last slot is for values that arrive from a neighbouring cell (a walker's progress restarts).
    A slot is given to another step only if that is more than twice as common: its network output
    has learned when the present step is taken.
    """

    seen: Tensor  # int64 [2, P, differences], IN_PLACE and ON_ARRIVAL
    slots: Tensor  # int64 [P, K + 1], 0 where empty
    rounding: Tensor  # int64 [P, K + 1, 256, 3], how far results lie from the slot's step
    results: Tensor  # uint8 [P, K + 1, 256], the value after the step; 0 stays 0

    def __init__(self, num_planes: int, num_steps: int) -> None:
        super().__init__()
        self.num_planes, self.num_steps = num_planes, num_steps
        self.register_buffer("seen", torch.zeros(2, num_planes, NUM_DIFFERENCES).long())
        self.register_buffer("slots", torch.zeros(num_planes, num_steps + 1).long())
        self.register_buffer("rounding", torch.zeros(num_planes, num_steps + 1, 256, 3).long())
        values = torch.arange(NUM_VALUES).to(torch.uint8)
        self.register_buffer("results", values.repeat(num_planes, num_steps + 1, 1))
        steps = torch.arange(NUM_DIFFERENCES) - (NUM_VALUES - 1)
        self.register_buffer("is_rounded", steps.abs() >= SMALLEST_ROUNDED, persistent=False)

    is_rounded: Tensor

    @torch.no_grad()
    def count(self, planes: Tensor, later: Tensor, shifts: tuple[tuple[int, int], ...]) -> None:
        """Count the steps between boards uint8 [N, P, H, W].

        Shift (dr, dc): a value may come from (row - dr, column - dc).
        """
        for kind, moves in enumerate(_find_moves(planes, later, shifts)):
            places = moves.plane * NUM_DIFFERENCES + moves.after - moves.before + NUM_VALUES - 1
            length = self.num_planes * NUM_DIFFERENCES
            self.seen[kind] += torch.bincount(places, minlength=length).view(self.num_planes, -1)
            self._fill_slots(kind)
            self._count_rounding(kind, moves)
        self._find_results()

    def restore(self, saved: Mapping[str, Tensor]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers out of range."""
        own = {name: held.numpy() for name, held in self.state_dict().items()}
        steps = Range(1 - NUM_VALUES, NUM_VALUES - 1)
        ranges = {"seen": COUNT, "rounding": COUNT, "slots": steps}
        arrays = take_arrays(saved, own, ranges)
        self.load_state_dict({name: torch.from_numpy(array) for name, array in arrays.items()})

    def _slots_of(self, kind: int) -> slice:
        return slice(self.num_steps) if kind == IN_PLACE else slice(self.num_steps, None)

    def _fill_slots(self, kind: int) -> None:
        """Give the least common slot of each plane to the most common step without one, if due."""
        slots, seen = self.slots[:, self._slots_of(kind)], self.seen[kind]
        if not slots.shape[1]:
            return
        near = 2 * seen  # of three neighbouring steps the middle one wins
        near[:, 1:] += seen[:, :-1]
        near[:, :-1] += seen[:, 1:]
        counts = torch.where(self.is_rounded, near, 2 * seen)
        places = slots + NUM_VALUES - 1
        of_slots = counts.gather(1, places)
        if kind == IN_PLACE:  # on arrival an empty slot stands for the value as it was
            of_slots = of_slots.masked_fill(slots == 0, 0)
        # Steps that a slot covers already, by rounding too, do not compete.
        for offset in (-2, -1, 0, 1, 2):
            beside = (places + offset).clamp(0, NUM_DIFFERENCES - 1)
            covered = self.is_rounded[places] | (offset == 0)
            counts = counts.scatter(1, beside, counts.gather(1, beside).masked_fill(covered, 0))
        best, step = counts.max(1)
        weakest, slot = of_slots.min(1)
        wins = (best > 2 * weakest) & (best >= 2 * MIN_COUNT)
        planes = wins.nonzero().squeeze(-1)
        slot = slot[planes]
        slots[planes, slot] = step[planes] - (NUM_VALUES - 1)
        self.rounding[:, self._slots_of(kind)][planes, slot] = 0

    def _count_rounding(self, kind: int, moves: Moves) -> None:
        steps = self.slots[:, self._slots_of(kind)][moves.plane]
        off = (moves.after - moves.before)[:, None] - steps
        row, slot = ((off.abs() <= 1) & (steps.abs() >= SMALLEST_ROUNDED)).nonzero().T
        place = moves.plane[row], slot, moves.before[row], off[row, slot] + 1
        rounding = self.rounding[:, self._slots_of(kind)]
        rounding.index_put_(place, torch.ones_like(row), accumulate=True)

    def _find_results(self) -> None:
        values = torch.arange(NUM_VALUES)
        below, exact, above = self.rounding.unbind(-1)
        best = torch.where(below > torch.maximum(exact, above), -1, (above > exact).long())
        results = (values + self.slots[..., None] + best).clamp(0, NUM_VALUES - 1)
        results = torch.where(self.slots[..., None] == 0, values, results)
        results[..., 0] = 0
        self.results.copy_(results)


def _find_moves(
    planes: Tensor, later: Tensor, shifts: tuple[tuple[int, int], ...]
) -> tuple[Moves, Moves]:
    """Moves in place, and moves that may have come to an empty cell from a neighbour."""
    image, plane, row, column = ((planes != later) & (later > 0)).nonzero().T
    own, after = (board[image, plane, row, column].long() for board in (planes, later))
    stays = own > 0
    reach = max((max(abs(dr), abs(dc)) for dr, dc in shifts), default=0)
    padded = functional.pad(planes, (reach, reach, reach, reach))
    sources = [
        padded[image, plane, row + reach - dr, column + reach - dc].long() * ~stays
        for dr, dc in shifts
    ]
    before = torch.cat([own[:0], *sources])
    came = before > 0
    plane_came, after_came = (part.repeat(len(shifts))[came] for part in (plane, after))
    in_place = Moves(plane[stays], own[stays], after[stays])
    return in_place, Moves(plane_came, before[came], after_came)
