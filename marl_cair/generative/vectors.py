"""`VectorGenerator`: a generator of planes that learns from vectors, entry by entry as one byte.

A vector observation becomes uniform planes on a board of one cell, which is what the economy of
CCDN predicts: each entry given the action, all entries before it, and its own value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.gate import GateReport
from marl_cair.generative.generator import Generator
from marl_cair.replay.transition import NEXT_OBSERVATION, OBSERVATION

LEVELS = 255


class VectorCodec:
    """Vectors float32 [N, V] <-> planes uint8 [N, 1 + V, 1, 1], of which the first is 0.

    Generators of planes need one that is not uniform. low, high: V bounds each, of the entries; an
    entry is known to 1/255 of its range, and values outside are moved to the nearest bound.

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
        return 1 + len(self.low), 1, 1

    def encode(self, vectors: Tensor) -> Tensor:
        """The planes of the vectors."""
        levels = ((vectors - self.low) / self.scale).round().clamp(0, LEVELS).to(torch.uint8)
        nothing = torch.zeros(len(vectors), 1, dtype=torch.uint8)
        return torch.cat([nothing, levels], 1)[:, :, None, None]

    def decode(self, planes: Tensor) -> Tensor:
        """The vectors of the planes."""
        return self.low + planes[:, 1:, 0, 0].float() * self.scale


class VectorGenerator:
    """A Generator of transitions between vectors.

    What is generated starts from vectors as they are and leads to ones whose entries are levels of
    the codec.

    Args:
        generator: of planes, made for the codec's shape with all planes but the first uniform.
        codec: of the vectors.
    """

    def __init__(self, generator: Generator, codec: VectorCodec) -> None:
        self.generator = generator
        self.codec = codec

    @property
    def last_report(self) -> GateReport | None:
        """Of the gate."""
        return self.generator.last_report

    @property
    def last_generation(self) -> dict[str, float]:
        """Numbers of the last `generate`."""
        return self.generator.last_generation

    def observe(self, batch: TensorDict) -> None:
        """Take note of new real transitions."""
        self.generator.observe(self._convert(batch, self.codec.encode))

    def update(self, batch: TensorDict) -> dict[str, float]:
        """Learn from real transitions."""
        return self.generator.update(self._convert(batch, self.codec.encode))

    def evaluate(self) -> GateReport:
        """Measure on held-out real transitions, and open or shut the gate."""
        return self.generator.evaluate()

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """Up to `num_rows` accepted transitions from the states of `starts`."""
        made = self.generator.generate(self._convert(starts, self.codec.encode), num_rows)
        return self._convert(made, self.codec.decode)

    def state_dict(self) -> dict[str, Any]:
        """Of the generator; the codec is the game's."""
        return self.generator.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`."""
        self.generator.load_state_dict(state)

    @staticmethod
    def _convert(rows: TensorDict, convert: Callable[[Tensor], Tensor]) -> TensorDict:
        converted = rows.exclude(OBSERVATION, NEXT_OBSERVATION)
        for key in (OBSERVATION, NEXT_OBSERVATION):
            converted[key] = convert(rows[key])
        return cast(TensorDict, converted)
