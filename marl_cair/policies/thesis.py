"""The thesis's networks: the body `thesis_capsule` with the head `length`, and `thesis_conv`."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import torch
from torch import Tensor, nn

from marl_cair.policies.body import Body, make_dense, require_planes
from marl_cair.policies.capsule_layers import DenseCapsules, PrimaryCapsules
from marl_cair.policies.conv import ConvLayer, stack_convolutions

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

NUM_PLANES = 256  # of the convolution before the capsules
NUM_TYPES, POSE_SIZE = 32, 8  # of the primary capsules
ACTION_POSE_SIZE, NUM_PASSES = 16, 3  # of the capsules of actions
MIN_KERNEL, MAX_KERNEL, MIN_MAP_SIDE = 3, 9, 3
POINTWISE = (ConvLayer(32, 1, 1, 0),) * 3


class ThesisCapsuleBody(Body):
    """Planes float32 [N, C, H, W] -> poses of I primary capsules, float32 [N, I * 8].

    The body of the thesis's parameter table: a convolution 9x9 of 256 planes, and primary capsules
    9x9 of stride 2, 32 types of 8 numbers; the head is `length`. Both kernels are k x k without
    padding, with k the largest odd number from 3 to 9 whose last map has at least 3 x 3 cells (3 on
    boards of side 8, with 2 x 2): 9 from side 21 on, 3 at side 10.
    """

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_planes, *sides = require_planes("thesis_capsule", observation_shape)
        kernel = choose_kernel(min(sides))
        layers = ConvLayer(NUM_PLANES, kernel, 1, 0), ConvLayer(NUM_TYPES * POSE_SIZE, kernel, 2, 0)
        self.convolution = stack_convolutions(num_planes, layers[:1])
        self.primary = PrimaryCapsules(NUM_PLANES, NUM_TYPES, POSE_SIZE, kernel, stride=2)
        self.num_features = NUM_TYPES * POSE_SIZE
        for side in sides:
            self.num_features *= layers[1].shrink(layers[0].shrink(side))

    def forward(self, observation: Tensor) -> Tensor:
        poses: Tensor = self.primary(self.convolution(observation))
        return poses.flatten(1)


def choose_kernel(side: int) -> int:
    """Return the kernel of both convolutions for a board or image whose smaller side is `side`."""
    largest = (side - MIN_MAP_SIDE) // 2  # (side - (k - 1) - k) // 2 + 1 >= 3
    return max(MIN_KERNEL, min(MAX_KERNEL, largest - 1 + largest % 2))


class LengthHead(nn.Module):
    """Poses of primary capsules [N, I * 8] -> action values [N, A], the lengths of A capsules.

    A capsule of 16 numbers for each action, by three dynamic routings (`DenseCapsules`): values are
    in [0, 1), returns outside it cannot be learned, and each action adds I * 8 * 16 weights.
    """

    def __init__(self, num_features: int, num_actions: int, embedding_size: int = 0) -> None:
        super().__init__()
        self.capsules = DenseCapsules(
            num_features // POSE_SIZE, POSE_SIZE, num_actions, ACTION_POSE_SIZE, NUM_PASSES
        )

    def forward(self, features: Tensor) -> Tensor:
        poses = self.capsules(features.view(features.shape[0], -1, POSE_SIZE))
        values: Tensor = torch.linalg.vector_norm(poses, dim=-1)
        return values


class ThesisConvBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F], 512 by default.

    The network of the thesis's released code: three convolutions 1x1 (each cell alone), and one
    dense layer over all cells: 115.6 M weights at 84 x 84. Only the last one's 32 planes are known;
    32 in the others is an assumption. The thesis's text has "three convolutions, dense, output"
    without sizes, which is `conv`.
    """

    DEFAULT_HIDDEN_WIDTH: ClassVar[int] = 512

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_planes, num_rows, num_columns = require_planes("thesis_conv", observation_shape)
        self.convolutions = stack_convolutions(num_planes, POINTWISE, config.norm)
        num_inputs = POINTWISE[-1].channels * num_rows * num_columns
        self.dense = make_dense(num_inputs, self.num_features, config.norm)

    def forward(self, observation: Tensor) -> Tensor:
        features: Tensor = self.dense(self.convolutions(observation).flatten(1))
        return features
