"""How a board is split: layers of planes that move together, and patches of pixels."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from marl_cair.generative.settings import GeneratorSpec

FRAME_PATCH, LEAST_FRAME = 2, 64  # pixels along a side


def find_layers(spec: GeneratorSpec) -> list[list[int]]:
    """Groups of positions among the moving planes: planes of one event move together, each other
    plane by itself.
    """
    place = {plane: index for index, plane in enumerate(spec.moving_planes)}
    layers = [
        [place[plane] for plane in group if plane in place] for group in spec.event_plane_groups
    ]
    grouped = {index for layer in layers for index in layer}
    return [layer for layer in layers if layer] + [
        [index] for index in place.values() if index not in grouped
    ]


def stack_sources(planes: Tensor, shifts: tuple[tuple[int, int], ...]) -> Tensor:
    """Values [N, K, P, H, W] that cells of [N, P, H, W] may have next, in the order of the network:
    the own one, that of each neighbour, and 0.
    """
    reach = max((max(abs(dr), abs(dc)) for dr, dc in shifts), default=0)
    rows, columns = planes.shape[2:]
    padded = functional.pad(planes, (reach,) * 4)
    near = [
        padded[:, :, reach - dr : reach - dr + rows, reach - dc : reach - dc + columns]
        for dr, dc in shifts
    ]
    return torch.stack([planes, *near, torch.zeros_like(planes)], 1)


def is_picture(spec: GeneratorSpec) -> bool:
    """Whether planes are grey pictures, not boards: frames, or one large plane of shades."""
    is_large = min(spec.num_rows, spec.num_columns) >= LEAST_FRAME
    return spec.num_frames > 1 or (spec.num_planes == 1 and is_large)


def choose_patch(rows: int, columns: int) -> int:
    """Side of the square patches in which pictures are read: 1 of small ones.

    Raises ValueError for pictures that patches do not cover.
    """
    if min(rows, columns) < LEAST_FRAME:
        return 1
    if rows % FRAME_PATCH or columns % FRAME_PATCH:
        raise ValueError(
            f"frames are {rows} x {columns}, but both sides must be multiples of {FRAME_PATCH}: "
            "use another size, or set generator.name=none"
        )
    return FRAME_PATCH
