"""The `capsule` body (GridCapsQ): parts on a fixed grid, routed to a few entities."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import torch
from torch import Tensor

from marl_cair.policies.body import Body, is_image, make_dense, require_planes
from marl_cair.policies.capsule_layers import (
    EntityRouting,
    GridPooling,
    PartCapsules,
    measure_presence,
)
from marl_cair.policies.conv import ConvLayer, replace_layers, stack_convolutions

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

LARGE_BOARD_MIN_SIDE = 20  # tiles


class CapsuleBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F].

    The thesis has one capsule for each action, whose length is its value: values are in [0, 1), and
    the weights grow with board and actions. Here K entity capsules serve all actions, the head
    reads their poses without squashing, and the number of weights after the first layers depends
    on neither board size nor actions.
    """

    DEFAULT_HIDDEN_WIDTH: ClassVar[int] = 128
    READS_CHANNELS_LAST: ClassVar[bool] = True

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_planes, num_rows, num_columns = require_planes("capsule", observation_shape)
        sizes = config.capsule
        layers = replace_layers(
            choose_trunk(observation_shape, sizes.trunk_channels),
            config.conv_channels,
            config.conv_strides,
        )
        self.num_routing_passes = sizes.num_routing_passes
        self.trunk = stack_convolutions(num_planes, layers, config.norm)
        self.parts = PartCapsules(layers[-1].channels, sizes.num_part_types, sizes.part_pose_size)
        for layer in (*layers, ConvLayer(0, 3, 2, 1)):
            num_rows, num_columns = layer.shrink(num_rows), layer.shrink(num_columns)
        self.pooling = GridPooling(num_rows, num_columns, sizes.grid_side)
        self.routing = EntityRouting(
            sizes.num_part_types * sizes.grid_side**2,
            sizes.part_pose_size,
            sizes.num_entities,
            sizes.entity_pose_size,
        )
        num_read = sizes.num_entities * (sizes.entity_pose_size + 1)
        self.read_out = make_dense(num_read, self.num_features, config.norm)

    def forward(self, observation: Tensor) -> Tensor:
        planes = self.trunk(observation.contiguous(memory_format=torch.channels_last))
        poses, _ = self.pooling(*self.parts(planes))
        pose = self.routing(poses.flatten(2), self.num_routing_passes)
        features: Tensor = self.read_out(torch.cat([pose.flatten(1), measure_presence(pose)], 1))
        return features


def stride_first(config: "QNetworkConfig", shape: Sequence[int]) -> "QNetworkConfig":
    """`config` of a new `capsule` body with the stride of large boards in its first convolution, as
    `conv` has it, which is quicker. Agents from before have it in the second, by `choose_trunk`.
    """
    is_large = len(shape) == 3 and min(shape[1:]) >= LARGE_BOARD_MIN_SIDE and not is_image(shape)
    if config.body != "capsule" or config.conv_channels or not is_large:
        return config
    return replace(config, conv_channels=(config.capsule.trunk_channels,) * 2, conv_strides=(2, 1))


def choose_trunk(shape: Sequence[int], channels: int) -> tuple[ConvLayer, ConvLayer]:
    """Return the two convolutions before the capsules, for a board or image [C, H, W]."""
    if is_image(shape):
        return ConvLayer(channels, 8, 4, 0), ConvLayer(channels, 4, 2, 0)
    second_stride = 2 if min(shape[1:]) >= LARGE_BOARD_MIN_SIDE else 1
    return ConvLayer(channels, 3, 1, 1), ConvLayer(channels, 3, second_stride, 1)
