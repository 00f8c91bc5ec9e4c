"""Base class of network bodies, input checks and scaling, and the `mlp` body."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

MIN_SIDE = 8
IMAGE_MIN_SIDE = 64  # pixels
IMAGE_MAX_CHANNELS = 12  # four colour images
_MIN_VARIANCE = 1e-6  # of an image


class Body(nn.Module, ABC):
    """Observations float32 [N, *observation_shape] -> features float32 [N, num_features].

    Raises ValueError for a shape that the body does not support.
    """

    DEFAULT_HIDDEN_WIDTH: ClassVar[int] = 256  # `num_features`, unless the configuration has one
    READS_CHANNELS_LAST: ClassVar[bool] = False  # memory format of boards and images

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__()
        self.observation_shape = tuple(observation_shape)
        self.num_features = config.resolve_hidden_width()

    @abstractmethod
    def forward(self, observation: Tensor) -> Tensor: ...


def is_image(shape: Sequence[int]) -> bool:
    """Whether an observation of `shape` is an image, not a board (more planes) or vector."""
    return len(shape) == 3 and shape[0] <= IMAGE_MAX_CHANNELS and min(shape[1:]) >= IMAGE_MIN_SIDE


def standardise(images: Tensor) -> Tensor:
    """Standardise each image of float32 [N, C, H, W] to mean 0 and standard deviation 1.

    The background dominates an image's brightness: from grey frames of Flappy Bird, a regression
    explains 74 % of the variance of the bird's velocity after 1,000 updates of 32, none without.
    """
    return functional.layer_norm(images, images.shape[1:], eps=_MIN_VARIANCE)


def standardise_changes(frames: Tensor) -> Tensor:
    """Stacked frames float32 [N, F, H, W], the oldest first -> standardised planes, as many: the
    newest frame, then the change from each frame to the next, the latest first.

    Moving objects become as bright as static ones: of the oracle's actions in Flappy Bird, shown
    for 1,000 updates of 32, `conv` and `capsule` miss 6 %, from plain frames 7.3 %
    (`python -m benchmarks.frames`).
    """
    changes = torch.unbind(frames[:, 1:] - frames[:, :-1], 1)
    planes = torch.stack([frames[:, -1], *reversed(changes)], 1)
    return functional.layer_norm(planes, planes.shape[2:], eps=_MIN_VARIANCE)


def require_planes(body: str, shape: Sequence[int]) -> tuple[int, int, int]:
    """Return `shape` as (C, H, W); raise ValueError unless it is planes of at least 8 x 8."""
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
    """Return V of the shape (V,); raise ValueError for another shape."""
    if len(shape) != 1 or shape[0] < 1:
        raise ValueError(
            f"body {body!r} needs a vector [V] with V >= 1, but the observation shape is "
            f"{tuple(shape)}: use body='conv' or body='capsule' for planes [C, H, W]"
        )
    return shape[0]


def make_dense(num_inputs: int, num_outputs: int, norm: str) -> nn.Sequential:
    """Return a dense layer, a LayerNorm if `norm` is "layer", and a ReLU."""
    normalise = [nn.LayerNorm(num_outputs)] if norm == "layer" else []
    return nn.Sequential(nn.Linear(num_inputs, num_outputs), *normalise, nn.ReLU())


class MlpBody(Body):
    """Vector float32 [N, V] -> features float32 [N, F]."""

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_inputs = require_vector("mlp", observation_shape)
        self.layers = nn.Sequential(
            *make_dense(num_inputs, self.num_features, config.norm),
            *make_dense(self.num_features, self.num_features, config.norm),
        )

    def forward(self, observation: Tensor) -> Tensor:
        features: Tensor = self.layers(observation)
        return features
