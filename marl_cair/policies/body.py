"""What every network body has: planes or a vector in, features out, and honest refusals."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

MIN_SIDE = 8
IMAGE_MIN_SIDE = 64  # pixels: from here an input is an image,
IMAGE_MAX_CHANNELS = 12  # if it has no more channels, those of four colour pictures
_FLAT = 1e-6  # variance below which an image shows nothing


class Body(nn.Module, ABC):
    """Observations float32 [N, *observation_shape] -> features float32 [N, num_features].

    Raises ValueError where the body cannot read that shape.
    """

    DEFAULT_HIDDEN_WIDTH: ClassVar[int]
    DEFAULT_ACTION_EMBEDDING: ClassVar[int]

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__()
        self.observation_shape = tuple(observation_shape)
        self.num_features = config.resolve_hidden_width()

    @abstractmethod
    def forward(self, observation: Tensor) -> Tensor: ...


def is_image(shape: Sequence[int]) -> bool:
    """Whether an observation of `shape` is an image, and no board (of more planes) or vector."""
    return len(shape) == 3 and shape[0] <= IMAGE_MAX_CHANNELS and min(shape[1:]) >= IMAGE_MIN_SIDE


def standardise(images: Tensor) -> Tensor:
    """Images float32 [N, C, H, W] less the mean of each, over its standard deviation.

    Of a picture's light most is background, beside which a bird of forty pixels is not seen: from
    grey frames of Flappy Bird its velocity is known to 74 % (of its variance) after 1,000 updates
    of 32, and not at all without this.
    """
    return functional.layer_norm(images, images.shape[1:], eps=_FLAT)


def standardise_changes(frames: Tensor) -> Tensor:
    """Stacked frames float32 [N, F, H, W], the oldest first -> as many planes: the newest frame,
    then the change from each frame to the next, the latest first; each plane less its mean, over
    its standard deviation.

    What moves is then as bright as what stands: of the oracle's choices in Flappy Bird, shown for
    1,000 updates of 32, `conv` and `capsule` miss 6 %, from the frames themselves 7.3 %
    (`python -m benchmarks.frames`).
    """
    changes = torch.unbind(frames[:, 1:] - frames[:, :-1], 1)
    planes = torch.stack([frames[:, -1], *reversed(changes)], 1)
    return functional.layer_norm(planes, planes.shape[2:], eps=_FLAT)


def require_planes(body: str, shape: Sequence[int]) -> tuple[int, int, int]:
    """Return `shape` as (C, H, W); raise ValueError where it is no stack of planes large enough."""
    if len(shape) == 1:
        raise ValueError(
            f"body {body!r} needs planes [C, H, W], but the observation is a vector of shape "
            f"{tuple(shape)}: use body='mlp', or the representation 'planes'"
        )
    if len(shape) != 3 or shape[0] < 1 or min(shape[1:]) < MIN_SIDE:
        raise ValueError(
            f"body {body!r} needs planes [C, H, W] with C >= 1 and H, W >= {MIN_SIDE}, but the "
            f"observation shape is {tuple(shape)}: put channels first, or use a larger board"
        )
    return shape[0], shape[1], shape[2]


def require_vector(body: str, shape: Sequence[int]) -> int:
    """Return V of the shape (V,); raise ValueError where the observation is no vector."""
    if len(shape) != 1 or shape[0] < 1:
        raise ValueError(
            f"body {body!r} needs a vector [V] with V >= 1, but the observation shape is "
            f"{tuple(shape)}: use body='conv' or body='capsule' for planes [C, H, W]"
        )
    return shape[0]
