"""The conditional convolution-deconvolution network of the thesis: state and action to next state.

    84 x 84 grey ── convolutions ── FC ── FC ──┐
                                               × ── FC ── deconvolutions ── next state
    action ─────────────────────── FC ── FC ──┘

Two forms: `published` is a reconstruction with the published numbers of parameters (13 million at
hidden 32, 67 million at 512), which do not determine the layers; `code` is that of the released
program (2.6 and 33 million). Both are trained on the mean squared error of pixels.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.lookup import find_by_name

SIDE = 84  # pixels of a frame


class _Form(NamedTuple):
    """Layers of a form: (channels, kernel, stride, padding) of the encoder, (channels, kernel) of
    the decoder.
    """

    encoder: tuple[tuple[int, int, int, int], ...]
    encoded: int  # side of its last map
    seed: int  # channels of the decoder's first map, 21 x 21
    decoder: tuple[tuple[int, int], ...]


FORMS = {
    "published": _Form(
        ((256, 8, 2, 3), (192, 8, 2, 3), (128, 8, 1, 0)), 21, 128, ((192, 8), (256, 8), (1, 8))
    ),
    "code": _Form(
        ((256, 4, 2, 0), (128, 3, 2, 0), (64, 1, 2, 0)), 10, 128, ((128, 3), (64, 3), (1, 3))
    ),
}


class ThesisCCDN(nn.Module):
    """Frames float32 [N, 1, 84, 84] of 0..1 and actions int64 [N] -> next frames, 0 or more.

    hidden: units of the fully connected layers, 32 to 512 in the thesis.
    Raises UnknownNameError for another form.
    """

    def __init__(self, num_actions: int, hidden: int = 32, form: str = "published") -> None:
        super().__init__()
        chosen = find_by_name("form of the thesis's CCDN", form, FORMS)
        self.num_actions = num_actions
        channels = 1
        self.encoder = nn.ModuleList()
        for width, kernel, stride, padding in chosen.encoder:
            self.encoder.append(nn.Conv2d(channels, width, kernel, stride, padding))
            channels = width
        self.of_state = nn.Sequential(
            nn.Linear(channels * chosen.encoded**2, hidden), nn.ReLU(), nn.Linear(hidden, hidden)
        )
        self.of_action = nn.Sequential(
            nn.Linear(num_actions, hidden), nn.ReLU(), nn.Linear(hidden, hidden)
        )
        self.seed = nn.Linear(hidden, chosen.seed * (SIDE // 4) ** 2)
        channels = chosen.seed
        self.decoder = nn.ModuleList()
        for width, kernel in chosen.decoder:
            self.decoder.append(nn.Conv2d(channels, width, kernel))
            channels = width
        self.doubles = (1, 2) if form == "published" else (0, 1)  # layers after an upsampling

    def forward(self, frames: Tensor, action: Tensor) -> Tensor:
        board = frames
        for layer in self.encoder:
            board = functional.relu(_convolve(layer, board))
        of_action = self.of_action(functional.one_hot(action, self.num_actions).float())
        both = functional.relu(self.of_state(board.flatten(1))) * functional.relu(of_action)
        side = SIDE // 4
        board = functional.relu(self.seed(both)).view(len(frames), -1, side, side)
        for number, layer in enumerate(self.decoder):
            if number in self.doubles:
                board = functional.interpolate(board, scale_factor=2.0)
            board = functional.relu(_convolve(layer, board))
        return board

    def compute_loss(self, frames: Tensor, action: Tensor, following: Tensor) -> Tensor:
        """Mean squared error of the next frames."""
        return functional.mse_loss(self(frames, action), following)


def _convolve(layer: nn.Module, board: Tensor) -> Tensor:
    """A convolution of stride 1 keeps the size: an even kernel needs one more pixel at the end."""
    if isinstance(layer, nn.Conv2d) and layer.stride == (1, 1):
        size = layer.kernel_size[0] - 1
        board = functional.pad(board, (size // 2, size - size // 2) * 2)
    convolved: Tensor = layer(board)
    return convolved


def to_frames(observation: Tensor) -> Tensor:
    """uint8 [N, 1, 84, 84] -> float32 of 0..1."""
    return observation.float() * (1.0 / 255.0)


def to_observation(frames: Tensor) -> Tensor:
    """The inverse of `to_frames`."""
    return (frames.clamp(0.0, 1.0) * 255.0).round().to(torch.uint8)
