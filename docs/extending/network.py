"""A Q-network body: three convolutions and a mean over the board.

Copy it to `marl_cair/policies/pooled.py` and add one line to `NETWORKS` of
`marl_cair/policies/__init__.py`:
`"pooled": "marl_cair.policies.pooled:PooledBody"`. Then `marl-cair train policy=pooled` trains it.
"""

from typing import ClassVar

from torch import nn

from marl_cair.policies.body import Body, require_planes


class PooledBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F]. Works on every board size."""

    DEFAULT_HIDDEN_WIDTH: ClassVar[int] = 64  # F, if policy.hidden_width is not set
    DEFAULT_ACTION_EMBEDDING: ClassVar[int] = 0  # a linear layer gives the action values

    def __init__(self, observation_shape, config):
        super().__init__(observation_shape, config)
        planes, _, _ = require_planes("pooled", observation_shape)
        width = self.num_features
        self.layers = nn.Sequential(
            nn.Conv2d(planes, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ReLU(),
            nn.AdaptiveAvgPool2d(1),
            nn.Flatten(),
        )

    def forward(self, observation):
        return self.layers(observation)
