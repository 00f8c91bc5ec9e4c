"""`FrameCCDN`: one ensemble member for stacks of grey frames.

Like `CCDN` it multiplies a state stream and an action stream, copies pixels that do not change, and
computes reward, end and mask from both states. Frames are large and have shades: it works on
patches of pixels and has no uniform planes. Only the newest frame of the next stack is new.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks import cells
from marl_cair.generative.networks.outcome import Heads, Outcome, RareCorrection, RewardBins
from marl_cair.generative.networks.readout import SUM_UNIT
from marl_cair.generative.networks.steps import StepTable
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.policies.body import standardise

PATCH = 4  # pixels along a side
OUTPUTS_PER_PIXEL = 4  # weights of copy and logistic, mean, log scale
SHADES_PER_UNIT = 64.0  # of the logistic's mean: a moving edge changes a pixel by a hundred
COPY_BIAS = 1.0  # logit of "keeps its shade" before training
LOG_SCALE_BIAS = 2.0  # of the logistic before training: about ten shades
OUTCOME_CHANNELS = 32
# Thousands of pixels change where boards change a few cells. The outcome heads share no weights
# with the pixels: this only keeps the gradient norm below the clipping threshold.
PIXEL_WEIGHT = 0.002


class FrameOutcome(Heads):
    """Frames float32 [N, F + 1, H, W] (the stack and the next one), actions int64 [N], masks bool
    [N, A] -> Outcome.
    """

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        rows, columns = (side // PATCH for side in spec.observation_shape[1:])
        width, hidden = OUTCOME_CHANNELS, 2 * size.hidden
        self.conv1 = nn.Conv2d((spec.num_planes + 1) * PATCH**2, width, 3, padding=1)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1)
        self.conv3 = nn.Conv2d(width, width, 3, padding=1)
        self.shrink = nn.Conv2d(width, width, 3, stride=2, padding=1)
        num_seen = width * (2 + ((rows + 1) // 2) * ((columns + 1) // 2))
        self.enter = nn.Linear(num_seen, hidden)
        self.act = nn.Embedding(spec.num_kinds, hidden)
        self.middle = nn.Linear(hidden, hidden)
        self.add_heads(spec, size, hidden, hidden)

    def forward(self, frames: Tensor, action: Tensor, action_mask: Tensor) -> Outcome:
        board = functional.relu(self.conv1(_split_patches(frames)))
        board = functional.relu(board + self.conv2(board))
        board = functional.relu(board + self.conv3(board))
        places = functional.relu(self.shrink(board)).flatten(1)
        # Pooled: a contact is recognised at any position, from few examples.
        anywhere = [board.amax((2, 3)), board.sum((2, 3)) * SUM_UNIT]
        seen = self.enter(torch.cat([places, *anywhere], 1)) + self.act(self.kinds[action])
        hidden = functional.relu(seen)
        hidden = functional.relu(hidden + self.middle(hidden))
        return self.compute_outcome(hidden, hidden, self.compute_mask(hidden, action_mask))


class FrameCCDN(nn.Module):
    """A distribution over (next frame, reward, end, mask), given a stack of frames.

    Observations are uint8 [N, F, H, W], the oldest first. Next observations hold the next frame
    instead of the newest (see `codecs.FrameCodec`).
    Raises ValueError if H or W is no multiple of 4.
    """

    kinds: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        num_frames, height, width = spec.observation_shape
        if height % PATCH or width % PATCH:
            raise ValueError(
                f"frames are {height} x {width}, but both sides must be multiples of {PATCH}: "
                "use another size, or set generator.name=none"
            )
        channels = size.frame_channels
        self.register_buffer("kinds", torch.tensor(spec.kinds), persistent=False)
        self.action_embedding = nn.Embedding(spec.num_kinds, size.action_embedding)
        self.film = nn.Linear(size.action_embedding, 4 * channels)
        self.conv1 = nn.Conv2d(num_frames * PATCH**2, channels, 3, padding=1)
        self.position = nn.Parameter(torch.zeros(channels, height // PATCH, width // PATCH))
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1)
        self.conv3 = nn.Conv2d(channels, channels, 3, padding=1)
        self.pixels = nn.Conv2d(channels, OUTPUTS_PER_PIXEL * PATCH**2, 1)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.outcome = FrameOutcome(spec, size)
        self.bins = RewardBins(spec.reward_range, size.reward_bins)
        with torch.no_grad():
            self.pixels.weight.mul_(0.3)
            start = torch.zeros(OUTPUTS_PER_PIXEL, PATCH**2)
            start[0], start[-1] = COPY_BIAS, LOG_SCALE_BIAS
            self.pixels.load_state_dict({"weight": self.pixels.weight, "bias": start.flatten()})

    def find_pixels(self, observation: Tensor, action: Tensor) -> cells.CellDistribution:
        """Distributions of the next frame's pixels, over [N, H, W] flattened."""
        patches = _split_patches(standardise(_to_float(observation)))
        film = self.film(self.action_embedding(self.kinds[action]))[..., None, None].chunk(4, 1)
        first = functional.relu(self.conv1(patches) + self.position)
        mixed = first * (1.0 + film[0]) + film[1]
        second = functional.relu(mixed + self.conv2(mixed))
        mixed = second * (1.0 + film[2]) + film[3]
        third = functional.relu(mixed + self.conv3(mixed))
        # [N, outputs * patch, h, w] -> [outputs, N * H * W]
        outputs = functional.pixel_shuffle(self.pixels(third), PATCH)
        outputs = outputs.transpose(0, 1).reshape(OUTPUTS_PER_PIXEL, -1)
        own = observation[:, -1].reshape(1, -1).float()
        return cells.build_distribution(outputs, own, SHADES_PER_UNIT)

    def predict_outcome(self, rows: TensorDict) -> Outcome:
        """Reward, end and next mask of transitions."""
        newest = rows["next", "observation"][:, -1:]
        frames = _to_float(torch.cat([rows["observation"], newest], 1))
        outcome: Outcome = self.outcome(standardise(frames), rows["action"], rows["action_mask"])
        return outcome

    @torch.no_grad()
    def decode(
        self, observation: Tensor, action: Tensor, generator: torch.Generator | None
    ) -> Tensor:
        """Next observations uint8 [N, F, H, W]: sampled, or the likeliest without a generator."""
        pixels = self.find_pixels(observation, action)
        following = observation.clone()
        newest = observation[:, -1:].flatten(2)
        offsets, can_appear = None, torch.zeros_like(newest, dtype=torch.bool)
        if generator is not None:
            offsets = torch.rand(len(newest), 1, generator=generator)
        own = pixels.candidates[0]
        masses = cells.find_mass(pixels, own)
        decoded = cells.decode_cells(own, masses, pixels.select, can_appear, offsets, generator)
        following[:, -1] = decoded.view_as(following[:, -1])
        return following

    def compute_losses(
        self, rows: TensorDict, correction: RareCorrection, stride: int, offset: int
    ) -> dict[str, Tensor]:
        """Mean negative log likelihoods of `rows` by head, in nats per row; of all pixels."""
        nll = -self._find_log_prob(rows).sum(-1)
        outcome = self.predict_outcome(rows)
        return {
            "cells": (nll * correction.row_weights).mean() * PIXEL_WEIGHT,
            **outcome.compute_losses(self.bins, rows, correction),
        }

    def predict(self, rows: TensorDict) -> tuple[Tensor, ...]:
        """Predictions for `rows` [N] with given next states, in the order of `Predictions`."""
        log_prob = self._find_log_prob(rows)
        of_state = log_prob.sum(-1), log_prob.amin(-1), torch.zeros(rows.shape[0])
        return (*of_state, *self.predict_outcome(rows).predict(self.bins))

    def _find_log_prob(self, rows: TensorDict) -> Tensor:
        """Log probabilities [N, H * W] of the next frame's pixels."""
        pixels = self.find_pixels(rows["observation"], rows["action"])
        newest = rows["next", "observation"][:, -1]
        return cells.find_log_prob(pixels, newest.flatten().float()).view(newest.flatten(1).shape)

    def group_parameters(self, config: GeneratorConfig) -> list[dict[str, Any]]:
        """One parameter group for Adam, with its "peak" learning rate."""
        rate = config.frame_learning_rate
        return [{"params": list(self.parameters()), "lr": rate, "peak": rate}]

    @staticmethod
    def record_transitions(
        members: Sequence[FrameCCDN], steps: StepTable, rows: TensorDict
    ) -> None:
        """Frames have no counted steps."""


def _to_float(frames: Tensor) -> Tensor:
    return frames.float() * (1.0 / 255.0)


def _split_patches(frames: Tensor) -> Tensor:
    """[N, C, H, W] -> [N, C * 16, H / 4, W / 4], channels last in memory."""
    patches = functional.pixel_unshuffle(frames, PATCH)
    return patches.contiguous(memory_format=torch.channels_last)
