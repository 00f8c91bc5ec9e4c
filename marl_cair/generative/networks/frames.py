"""`FramePainter`: the next grey frame as the present one and a change, learned by regression.

Shades of moving edges are blends of two colours: a class for each value, as boards have, learns
them hardly at all (docs/experiments/generator.md). A gate at every pixel keeps what stays.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.quality import differ
from marl_cair.generative.settings import GeneratorSpec

CHANGED_WEIGHT = 20.0  # of a pixel that changes, beside 1: few do
SMOOTH = 0.02  # of full white: smaller errors count squared
LEAST_SCALE = 1.0 / 510.0  # half a shade


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
