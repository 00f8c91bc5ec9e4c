"""`VectorCodec`: vectors as the generator of planes learns from them, entry by entry in two bytes.

A vector observation becomes uniform planes on a board of one cell, which is what the economy of
CCDN predicts: each entry given the action, all entries before it, and its own value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

COARSE, FINE = 256, 16  # levels of an entry, and steps of each level
LEVELS = COARSE * FINE - 1


class VectorCodec:
    """Vectors float32 [N, V] <-> planes uint8 [N, 1 + 2 V, 1, 1]: nothing, then of each entry its
    level, 0..255, and its step within it, 0..15.

    Generators of planes need one that is not uniform. low, high: V bounds each, of the entries; an
    entry is known to 1/4095 of its range, and values outside are moved to the nearest bound.

    Raises:
        ValueError: other numbers of bounds, one that is not finite, or low not below high.
    """

    def __init__(self, low: Sequence[float], high: Sequence[float]) -> None:
        if len(low) != len(high):
            raise ValueError(f"low has {len(low)} bounds, high {len(high)}: give one an entry")
        for entry, (least, most) in enumerate(zip(low, high, strict=True)):
            if not (math.isfinite(least) and math.isfinite(most) and least < most):
                raise ValueError(
                    f"entry {entry} is said to lie in {least!r}..{most!r}: both bounds must be "
                    "finite, the lower one below the upper one"
                )
        self.low = torch.tensor(low, dtype=torch.float32)
        self.scale = (torch.tensor(high, dtype=torch.float32) - self.low) / LEVELS

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the planes."""
        return 1 + self.num_uniform, 1, 1

    @property
    def num_uniform(self) -> int:
        """How many of the planes are uniform: all but the first."""
        return 2 * len(self.low)

    def encode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """The planes of the vectors."""
        return self._encode(now), self._encode(later)

    def decode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """The vectors of the planes."""
        return self._decode(now), self._decode(later)

    def _encode(self, vectors: Tensor) -> Tensor:
        levels = ((vectors - self.low) / self.scale).round().clamp(0, LEVELS).long()
        digits = torch.stack([levels // FINE, levels % FINE], -1).to(torch.uint8).flatten(1)
        nothing = torch.zeros(len(vectors), 1, dtype=torch.uint8)
        return torch.cat([nothing, digits], 1)[:, :, None, None]

    def _decode(self, planes: Tensor) -> Tensor:
        digits = planes[:, 1:, 0, 0].long()
        # A sample may step beyond the last step of a level.
        levels = digits[:, ::2] * FINE + digits[:, 1::2].clamp(max=FINE - 1)
        vectors: Tensor = self.low + levels.float() * self.scale
        return vectors
