"""Generators for frames and vectors: codecs between observations and a generator's planes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.generator import Generator
from marl_cair.generative.quality import VECTOR_STEPS, Imagined, join_digits
from marl_cair.replay.transition import NEXT_OBSERVATION, OBSERVATION

LEVELS = 256 * VECTOR_STEPS - 1  # of a vector's entry: steps of 256 coarse levels


class Codec(Protocol):
    """Converts pairs of observations [N, ...] before and after a step."""

    def encode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """Observations of the game -> observations of the generator."""

    def decode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """Observations of the generator -> observations of the game."""


class FrameCodec:
    """Stacks of frames [N, F, H, W], the oldest first: only the newest frame after a step is new.

    In the encoded stack after a step it replaces the newest frame before the step.
    """

    def encode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        return now, torch.cat([now[:, :-1], later[:, -1:]], 1)

    def decode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        return now, torch.cat([now[:, 1:], later[:, -1:]], 1)


class VectorCodec:
    """Vectors float32 [N, V] <-> planes uint8 [N, 1 + 2 V, 1, 1] on a board of one cell: a plane of
    zeros (generators need a spatial plane), then for each entry its level, 0..255, and its step
    within the level, 0..15.

    low, high: bounds of the V entries; values outside are moved to the nearest bound. The
    resolution is 1/4095 of the range.
    Raises ValueError for different numbers of bounds, one that is not finite, or low not below
    high.
    """

    def __init__(self, low: Sequence[float], high: Sequence[float]) -> None:
        if len(low) != len(high):
            raise ValueError(f"low has {len(low)} bounds, high {len(high)}: give one an entry")
        for entry, (least, most) in enumerate(zip(low, high, strict=True)):
            if not (math.isfinite(least) and math.isfinite(most) and least < most):
                raise ValueError(
                    f"entry {entry} has the bounds {least!r}..{most!r}: both must be finite, the "
                    "lower one below the upper one"
                )
        self.low = torch.tensor(low, dtype=torch.float32)
        self.scale = (torch.tensor(high, dtype=torch.float32) - self.low) / LEVELS

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the planes."""
        return 1 + self.num_uniform, 1, 1

    @property
    def num_uniform(self) -> int:
        """Number of uniform planes: all but the first."""
        return 2 * len(self.low)

    def encode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        return self._encode(now), self._encode(later)

    def decode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        return self._decode(now), self._decode(later)

    def _encode(self, vectors: Tensor) -> Tensor:
        levels = ((vectors - self.low) / self.scale).round().clamp(0, LEVELS).long()
        digits = torch.stack([levels // VECTOR_STEPS, levels % VECTOR_STEPS], -1)
        digits = digits.to(torch.uint8).flatten(1)
        zeros = torch.zeros(len(vectors), 1, dtype=torch.uint8)
        return torch.cat([zeros, digits], 1)[:, :, None, None]

    def _decode(self, planes: Tensor) -> Tensor:
        vectors: Tensor = self.low + join_digits(planes.flatten(1)).float() * self.scale
        return vectors


class _CodedGenerator:
    """A generator behind a codec; other methods are those of `generator`."""

    def __init__(self, generator: Generator, codec: Codec) -> None:
        self.generator = generator
        self.codec = codec

    def __getattr__(self, name: str) -> Any:
        if name == "generator":  # not set yet, as in copies
            raise AttributeError(name)
        return getattr(self.generator, name)

    def observe(self, batch: TensorDict) -> None:
        self.generator.observe(_convert(batch, self.codec.encode))

    def hold_out(self, batch: TensorDict) -> None:
        self.generator.hold_out(_convert(batch, self.codec.encode))

    def imagine(self, rows: TensorDict, generator: torch.Generator | None = None) -> Imagined:
        coded = self._encode_starts(rows)
        made: Imagined = cast(Any, self.generator).imagine(coded, generator)
        _, following = self.codec.decode(coded[OBSERVATION], made.observation)
        return made._replace(observation=following)

    def rate_masks(self, rows: TensorDict) -> dict[str, float]:
        rated: dict[str, float] = cast(Any, self.generator).rate_masks(
            _convert(rows, self.codec.encode)
        )
        return rated

    def update(self, batch: TensorDict) -> dict[str, float]:
        return self.generator.update(_convert(batch, self.codec.encode))

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        made = self.generator.generate(_convert(starts, self.codec.encode), num_rows)
        return _convert(made, self.codec.decode)

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        rows, accepted = self.generator.predict(self._encode_starts(starts))
        return _convert(rows, self.codec.decode), accepted

    def _encode_starts(self, starts: TensorDict) -> TensorDict:
        coded = starts.copy()
        coded[OBSERVATION], _ = self.codec.encode(starts[OBSERVATION], starts[OBSERVATION])
        return coded


def make_coded_generator(generator: Generator, codec: Codec) -> Generator:
    """A Generator for the game's observations from one for the codec's.

    Generated rows start from observations that the codec keeps exactly, or nearly so.
    """
    return cast(Generator, _CodedGenerator(generator, codec))


def _convert(
    rows: TensorDict, convert: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
) -> TensorDict:
    converted = rows.exclude(OBSERVATION, NEXT_OBSERVATION)
    now, later = convert(rows[OBSERVATION], rows[NEXT_OBSERVATION])
    converted[OBSERVATION], converted[NEXT_OBSERVATION] = now, later
    return cast(TensorDict, converted)
