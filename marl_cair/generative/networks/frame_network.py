"""`FrameCCDN`: one member of the generator for stacks of pictures.

The same network as `CCDN` in what it does: a state stream and an action stream that multiply, a
next state that copies what does not change, and a reward, an end and a mask read from both states.
But pictures are large and hold shades, so it works on patches of pixels and has no uniform planes,
and of the next stack only the newest picture is new.
"""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.loss import RareCorrection, find_outcome_losses
from marl_cair.generative.networks.cells import (
    CellDistribution,
    build_distribution,
    decode_cells,
    find_log_prob,
    find_mass,
)
from marl_cair.generative.networks.outcome import (
    FINE_REACH,
    Outcome,
    RewardBins,
    judge_kinds,
    read_outcome,
)
from marl_cair.generative.networks.readout import SUM_UNIT
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.body import standardise

PATCH = 4  # pixels along a side
OUTPUTS_PER_PIXEL = 4  # weights of copy and logistic, mean, log scale
SHADES_PER_UNIT = 64.0  # of the logistic's mean: an edge that passes changes a pixel by a hundred
COPY_BIAS = 1.0  # logit of "keeps its shade" before training
LOG_SCALE_BIAS = 2.0  # of the logistic before training: some ten shades
OUTCOME_CHANNELS = 32
# Thousands of pixels change where boards change a few cells. The heads share no weights with what
# makes pixels, so this only keeps all gradients below the length where they are cut.
PIXEL_WEIGHT = 0.002


class FrameOutcome(nn.Module):
    """Pictures float32 [N, F + 1, H, W] (the stack and the next one), actions int64 [N], masks bool
    [N, A] -> Outcome.
    """

    kinds: Tensor
    reward_std: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        rows, columns = (side // PATCH for side in spec.observation_shape[1:])
        width, hidden = OUTCOME_CHANNELS, 2 * size.hidden
        self.register_buffer("kinds", torch.tensor(spec.kinds), persistent=False)
        self.conv1 = nn.Conv2d((spec.num_planes + 1) * PATCH**2, width, 3, padding=1)
        self.conv2 = nn.Conv2d(width, width, 3, padding=1)
        self.conv3 = nn.Conv2d(width, width, 3, padding=1)
        self.shrink = nn.Conv2d(width, width, 3, stride=2, padding=1)
        num_seen = width * (2 + ((rows + 1) // 2) * ((columns + 1) // 2))
        self.enter = nn.Linear(num_seen, hidden)
        self.act = nn.Embedding(spec.num_kinds, hidden)
        self.middle = nn.Linear(hidden, hidden)
        self.reward = nn.Linear(hidden, size.reward_bins)
        self.terminal = nn.Linear(hidden, 1)
        self.fine = nn.Linear(hidden, 1)
        nn.init.zeros_(self.fine.weight)
        nn.init.zeros_(self.fine.bias)
        self.register_buffer("reward_std", torch.ones(()))  # of the rewards learned from
        self.kind = nn.Linear(hidden, spec.num_kinds)
        self.keep = nn.Parameter(torch.full((spec.num_kinds,), 2.0))  # now legal, still legal

    def forward(self, pictures: Tensor, action: Tensor, action_mask: Tensor) -> Outcome:
        board = functional.relu(self.conv1(_cut(pictures)))
        board = functional.relu(board + self.conv2(board))
        board = functional.relu(board + self.conv3(board))
        places = functional.relu(self.shrink(board)).flatten(1)
        # What touches what is the same wherever it is, and found there from few examples.
        anywhere = [board.amax((2, 3)), board.sum((2, 3)) * SUM_UNIT]
        seen = self.enter(torch.cat([places, *anywhere], 1)) + self.act(self.kinds[action])
        hidden = functional.relu(seen)
        hidden = functional.relu(hidden + self.middle(hidden))
        mask = judge_kinds(self.kind(hidden), self.keep, self.kinds, action_mask)
        fine = FINE_REACH * self.reward_std * torch.tanh(self.fine(hidden).squeeze(-1))
        return Outcome(self.reward(hidden), self.terminal(hidden).squeeze(-1), mask, fine)


class FrameCCDN(nn.Module):
    """A distribution over (next picture, reward, end, mask), given a stack of pictures.

    Observations are uint8 [N, F, H, W], the oldest first. Next observations hold the next picture
    in the place of the newest (see `codecs.FrameCodec`).

    Raises:
        ValueError: H or W is no multiple of 4.
    """

    kinds: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        num_frames, height, width = spec.observation_shape
        if height % PATCH or width % PATCH:
            raise ValueError(
                f"pictures are {height} x {width}, but both sides must be multiples of {PATCH}: "
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

    def find_pixels(self, observation: Tensor, action: Tensor) -> CellDistribution:
        """Distributions of the next picture's pixels, over [N, H, W] flattened."""
        patches = _cut(standardise(_to_float(observation)))
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
        return build_distribution(outputs, own, SHADES_PER_UNIT)

    def judge(self, rows: TensorDict) -> Outcome:
        """Reward, end and next mask of transitions."""
        newest = rows["next", "observation"][:, -1:]
        pictures = _to_float(torch.cat([rows["observation"], newest], 1))
        outcome: Outcome = self.outcome(standardise(pictures), rows["action"], rows["action_mask"])
        return outcome

    @torch.no_grad()
    def decode(
        self, observation: Tensor, action: Tensor, generator: torch.Generator | None
    ) -> Tensor:
        """Next observations uint8 [N, F, H, W]: sampled, or the likeliest without a generator."""
        pixels = self.find_pixels(observation, action)
        following = observation.clone()
        newest = observation[:, -1:].flatten(2)
        offsets, appears = None, torch.zeros_like(newest, dtype=torch.bool)
        if generator is not None:
            offsets = torch.rand(len(newest), 1, generator=generator)
        own = pixels.candidates[0]
        masses = find_mass(pixels, own)
        decoded = decode_cells(own, masses, pixels.select, appears, offsets, generator)
        following[:, -1] = decoded.view_as(following[:, -1])
        return following


def find_frame_losses(
    network: FrameCCDN, rows: TensorDict, correction: RareCorrection
) -> dict[str, Tensor]:
    """Mean losses of `rows` by head, in nats per row."""
    observation, following = rows["observation"], rows["next", "observation"]
    pixels = network.find_pixels(observation, rows["action"])
    log_prob = find_log_prob(pixels, following[:, -1].flatten().float())
    nll = -log_prob.view(len(observation), -1).sum(-1)
    outcome = network.judge(rows)
    return {
        "cells": (nll * correction.row_weights).mean() * PIXEL_WEIGHT,
        **find_outcome_losses(outcome, network.bins, rows, correction),
    }


def ask_frames(network: FrameCCDN, rows: TensorDict) -> tuple[Tensor, ...]:
    """What `network` says of transitions, in the order of `ensemble.Opinions`."""
    pixels = network.find_pixels(rows["observation"], rows["action"])
    log_prob = find_log_prob(pixels, rows["next", "observation"][:, -1].flatten().float())
    log_prob = log_prob.view(rows.shape[0], -1)
    return (
        log_prob.sum(-1),
        log_prob.amin(-1),
        torch.zeros(rows.shape[0]),
        *read_outcome(network.judge(rows), network.bins),
    )


def _to_float(pictures: Tensor) -> Tensor:
    return pictures.float() * (1.0 / 255.0)


def _cut(pictures: Tensor) -> Tensor:
    """[N, C, H, W] -> [N, C * 16, H / 4, W / 4], channels last in memory."""
    patches = functional.pixel_unshuffle(pictures, PATCH)
    return patches.contiguous(memory_format=torch.channels_last)
