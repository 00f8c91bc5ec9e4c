"""`FrameCCDN`, the network for pictures: the next grey frame as the present one and a change.

    frames in patches ┬─ trunk, steered by actions ── painter ── next frame
                      └─ strided convolutions, actions ── reward, end, next action mask

Shades of moving edges are blends of two colours: a class for each value, as boards have, learns
them hardly at all (docs/experiments/generator.md). They are learned by regression, and a gate at
every pixel keeps what stays. Rewards and ends are predicted from the frames before the step: the
frame after the end of a game is never used, and may be a picture of its own.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.boards import choose_patch
from marl_cair.generative.networks.outcome import Outcome, OutcomeHeads, OutcomeInput
from marl_cair.generative.networks.trunk import ActionReader, Trunk
from marl_cair.generative.quality import differ
from marl_cair.generative.settings import GeneratorSpec, NetworkSize

CHANGED_WEIGHT = 10.0  # of a pixel that changes, beside 1: few do
SMOOTH = 0.02  # of full white: smaller errors count squared
PICTURE_WEIGHT = 0.1  # of the sum over all pixels, against rewards and ends
LEAST_SCALE = 1.0 / 510.0  # half a shade
NUM_STRIDES = 3  # convolutions with stride 2 before what happens is read


class Painting(NamedTuple):
    """The next planes, and how sure the network is of each pixel."""

    shades: Tensor  # [N, P, H, W], 0 black, 1 white
    scale: Tensor  # [N, P, H, W], expected absolute error, above 0


class FramePainter(nn.Module):
    """Features [N, F, H / patch, W / patch] and planes now, uint8 [N, P, H, W] -> Painting."""

    def __init__(self, num_features: int, num_planes: int, patch: int) -> None:
        super().__init__()
        self.patch = patch
        self.change = nn.Conv2d(num_features, 2 * num_planes * patch**2, 1)
        self.doubt = nn.Conv2d(num_features, num_planes * patch**2, 1)
        with torch.no_grad():
            for weight in self.parameters():  # a copy of the frame
                weight.zero_()

    def forward(self, features: Tensor, now: Tensor) -> Painting:
        change, gate = functional.pixel_shuffle(self.change(features), self.patch).chunk(2, 1)
        # The doubt must not shape the features: most pixels are sure.
        doubt = functional.pixel_shuffle(self.doubt(features.detach()), self.patch)
        shades = now.float() / 255.0 + gate.sigmoid() * change
        return Painting(shades, LEAST_SCALE + functional.softplus(doubt))


def find_painting_loss(
    painting: Painting, now: Tensor, later: Tensor, spec: GeneratorSpec
) -> Tensor:
    """Loss [N] of the next planes, uint8 [N, P, H, W] as `now`: Huber, with more weight where
    they differ visibly from `now`, and the negative log likelihood of Laplace errors for the scale.
    """
    wanted = later.float() / 255.0
    weight = 1.0 + CHANGED_WEIGHT * differ(now, later, spec).float()
    huber = functional.smooth_l1_loss(painting.shades, wanted, beta=SMOOTH, reduction="none")
    error = (painting.shades.detach() - wanted).abs()
    doubt = error / painting.scale + (2.0 * painting.scale).log()
    return (weight * huber).flatten(1).sum(1) + doubt.flatten(1).mean(1)


def round_shades(painting: Painting) -> tuple[Tensor, Tensor]:
    """Planes uint8 [N, P, H, W], and the log density [N] of the painting under its own scale."""
    planes = (painting.shades * 255.0).round().clamp(0.0, 255.0).to(torch.uint8)
    return planes, -(2.0 * painting.scale).log().flatten(1).sum(1)


class FrameCCDN(nn.Module):
    """A distribution over (next frame, reward, end, mask) for frames uint8 [N, C, H, W].

    Actions are as in `CCDN`. Raises ValueError for options that read boards.
    """

    moving: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        if size.distances or spec.action_cells is not None:
            raise ValueError(
                "size.distances and action_cells are of boards, but these rows are pictures: set "
                "generator.model.size.distances=false, or game.representation=planes"
            )
        self.spec = spec
        self.patch = choose_patch(spec.num_rows, spec.num_columns)
        channels, hidden, patch = size.channels, size.hidden, self.patch
        self.register_buffer("moving", torch.tensor(spec.moving_planes), persistent=False)
        self.actions = ActionReader(spec, size)
        self.enter = nn.Linear(self.actions.num_features, hidden)
        rows, columns = spec.num_rows // patch, spec.num_columns // patch
        num_inputs = spec.num_planes * patch**2
        self.see = nn.Conv2d(num_inputs, channels, 3, padding=1)
        self.position = nn.Parameter(torch.zeros(channels, rows, columns))
        self.trunk = Trunk(size)
        self.painter = FramePainter(channels, len(spec.moving_planes), patch)
        # Layers of their own: rewards and ends depend on positions, painting is local.
        widths = [num_inputs, channels] + (NUM_STRIDES - 1) * [2 * channels]
        self.strides = nn.ModuleList(
            nn.Conv2d(before, after, 3, stride=2, padding=1) for before, after in pairwise(widths)
        )
        for _ in range(NUM_STRIDES):
            rows, columns = (rows + 1) // 2, (columns + 1) // 2
        num_known = widths[-1] * rows * columns + hidden
        self.outcome = OutcomeHeads(spec, size, num_known)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, rows: TensorDict, others: Tensor) -> tuple[Painting, Outcome]:
        """The next frame, and what happens, of `rows` with the other seats' actions [N, O]."""
        frames = rows["observation"]
        patches = functional.pixel_unshuffle(frames.float() / 255.0, self.patch)
        patches = patches.contiguous(memory_format=torch.channels_last)
        means = functional.relu(self.enter(self.actions(rows["action"], others)))
        board = self.trunk(self.see(patches) + self.position, means)
        seen = patches
        for conv in self.strides:
            seen = functional.relu(conv(seen))
        known = torch.cat([seen.flatten(1), means], 1)
        outcome = self.outcome(OutcomeInput(board, known, (frames, frames), rows["action_mask"]))
        return self.painter(board, frames[:, self.moving]), outcome

    def compute_losses(
        self, rows: TensorDict, others: Tensor, weights: Tensor, end_log_odds: float
    ) -> dict[str, Tensor]:
        """Mean losses of `rows` by head; arguments as of `CCDN.compute_losses`."""
        painting, outcome = self(rows, others)
        now, later = (part["observation"][:, self.moving] for part in (rows, rows["next"]))
        going_on = 1.0 - rows["next", "terminated"][:, 0].float()
        loss = find_painting_loss(painting, now, later, self.spec)
        losses = {"cells": (loss * going_on * weights).mean() * PICTURE_WEIGHT}
        return losses | self.outcome.compute_losses(outcome, rows, end_log_odds)

    @torch.no_grad()
    def judge(self, rows: TensorDict, others: Tensor) -> Outcome:
        """As `CCDN.judge`; the next frame is not read."""
        outcome: Outcome = self(rows, others)[1]
        return outcome

    @torch.no_grad()
    def decode(
        self, rows: TensorDict, others: Tensor, generator: torch.Generator | None
    ) -> tuple[Tensor, Tensor, Outcome]:
        """As `CCDN.decode`; a picture has one likeliest form, which is not drawn at random."""
        painting, outcome = self(rows, others)
        following = rows["observation"].clone()
        following[:, self.moving], surety = round_shades(painting)
        return following, surety, outcome
