"""`CodedGenerator`: a generator that learns from another form of the observations."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.gate import GateReport
from marl_cair.generative.generator import Generator
from marl_cair.replay.transition import NEXT_OBSERVATION, OBSERVATION


class Codec(Protocol):
    """Turns pairs of observations into what a generator learns from, and back."""

    def encode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """Observations [N, ...] before and after a step -> those of the generator."""

    def decode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """The other way round."""


class FrameCodec:
    """Stacks of pictures [N, F, H, W], the oldest first: of the stack after a step only its newest
    picture is new. It is shown to the generator in the place of the newest picture before, and all
    others stay as they are.
    """

    def encode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """Of the later stacks only the newest picture is kept."""
        return now, torch.cat([now[:, :-1], later[:, -1:]], 1)

    def decode(self, now: Tensor, later: Tensor) -> tuple[Tensor, Tensor]:
        """The pictures move up by one."""
        return now, torch.cat([now[:, 1:], later[:, -1:]], 1)


class CodedGenerator:
    """A Generator of transitions as a game gives them.

    What is generated starts from observations that the codec knows exactly, or nearly so.

    Args:
        generator: made for the codec's form.
        codec: of the observations.
    """

    def __init__(self, generator: Generator, codec: Codec) -> None:
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
        self.generator.observe(_convert(batch, self.codec.encode))

    def update(self, batch: TensorDict) -> dict[str, float]:
        """Learn from real transitions."""
        return self.generator.update(_convert(batch, self.codec.encode))

    def evaluate(self) -> GateReport:
        """Measure on held-out real transitions, and open or shut the gate."""
        return self.generator.evaluate()

    def generate(self, starts: TensorDict, num_rows: int) -> TensorDict:
        """Up to `num_rows` accepted transitions from the states of `starts`."""
        made = self.generator.generate(_convert(starts, self.codec.encode), num_rows)
        return _convert(made, self.codec.decode)

    def predict(self, starts: TensorDict) -> tuple[TensorDict, Tensor]:
        """What follows on each state and action of `starts`, and whether it is accepted."""
        coded = starts.copy()
        coded[OBSERVATION], _ = self.codec.encode(starts[OBSERVATION], starts[OBSERVATION])
        rows, accepted = self.generator.predict(coded)
        return _convert(rows, self.codec.decode), accepted

    def state_dict(self) -> dict[str, Any]:
        """Of the generator; the codec is the game's."""
        return self.generator.state_dict()

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from `state_dict`."""
        self.generator.load_state_dict(state)

    def export_knowledge(self) -> dict[str, Any]:
        """Of the generator."""
        return self.generator.export_knowledge()

    def import_knowledge(self, knowledge: dict[str, Any]) -> None:
        """Begin with `export_knowledge`."""
        self.generator.import_knowledge(knowledge)


def _convert(
    rows: TensorDict, convert: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
) -> TensorDict:
    converted = rows.exclude(OBSERVATION, NEXT_OBSERVATION)
    now, later = convert(rows[OBSERVATION], rows[NEXT_OBSERVATION])
    converted[OBSERVATION], converted[NEXT_OBSERVATION] = now, later
    return cast(TensorDict, converted)
