"""The `capsule` body (GridCapsQ): parts on a fixed grid, routed to a few entities."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from marl_cair.policies.body import Body, is_image, require_planes
from marl_cair.policies.capsule_layers import (
    EntityRouting,
    GridPooling,
    PartCapsules,
    measure_presence,
)
from marl_cair.policies.conv import ConvLayer, stack_convolutions

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

LARGE_BOARD_MIN_SIDE = 20  # tiles


class Entities(NamedTuple):
    """What the network found, for the read-out and for a person to look at."""

    pose: Tensor  # float32 [N, K, O], any length
    presence: Tensor  # float32 [N, K] in [0, 1)
    part_presence: Tensor  # float32 [N, T, G*G] in (0, 1)
    routing: Tensor  # float32 [K, N, T*G*G], sums to K over the entities


class CapsuleBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F].

    The thesis's capsules had one capsule for each action whose length was its value, so the values
    lay in [0, 1), and the weights grew with board and actions. Here K entity capsules serve all
    actions, poses are read out unsquashed by the head, and neither board size nor actions change
    the number of weights after the first layers.
    """

    DEFAULT_HIDDEN_WIDTH: ClassVar[int] = 128
    DEFAULT_ACTION_EMBEDDING: ClassVar[int] = 32

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_planes, num_rows, num_columns = require_planes("capsule", observation_shape)
        sizes = config.capsule
        layers = choose_trunk(observation_shape, sizes.trunk_channels)
        self.num_routing_passes = sizes.num_routing_passes
        self.trunk = stack_convolutions(num_planes, layers)
        self.parts = PartCapsules(sizes.trunk_channels, sizes.num_part_types, sizes.part_pose_size)
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
        self.read_out = nn.Sequential(nn.Linear(num_read, self.num_features), nn.ReLU())

    def forward(self, observation: Tensor) -> Tensor:
        entities = self.find_entities(observation)
        read = torch.cat([entities.pose.flatten(1), entities.presence], dim=1)
        features: Tensor = self.read_out(read)
        return features

    def find_entities(self, observation: Tensor) -> Entities:
        """Planes float32 [N, C, H, W] -> the entity capsules, and what they were made of."""
        planes = self.trunk(observation.contiguous(memory_format=torch.channels_last))
        poses, presences = self.parts(planes)
        poses, part_presence = self.pooling(poses, presences)
        pose, weights = self.routing(poses.flatten(2), self.num_routing_passes)
        return Entities(pose, measure_presence(pose), part_presence, weights)


def choose_trunk(shape: Sequence[int], channels: int) -> tuple[ConvLayer, ConvLayer]:
    """Return the two convolutions before the capsules, for a board or image [C, H, W]: larger ones
    get larger strides.
    """
    side = min(shape[1:])
    if is_image(shape):
        return ConvLayer(channels, 8, 4, 0), ConvLayer(channels, 4, 2, 0)
    second_stride = 2 if side >= LARGE_BOARD_MIN_SIDE else 1
    return ConvLayer(channels, 3, 1, 1), ConvLayer(channels, 3, second_stride, 1)
