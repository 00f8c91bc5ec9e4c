"""The `mlp` body: two dense layers over a vector observation."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from torch import Tensor, nn

from marl_cair.policies.body import Body, require_vector

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig


class MlpBody(Body):
    """Vector float32 [N, V] -> features float32 [N, F]."""

    DEFAULT_HIDDEN_WIDTH: ClassVar[int] = 256
    DEFAULT_ACTION_EMBEDDING: ClassVar[int] = 0

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        self.layers = nn.Sequential(
            nn.Linear(require_vector("mlp", observation_shape), self.num_features),
            nn.ReLU(),
            nn.Linear(self.num_features, self.num_features),
            nn.ReLU(),
        )

    def forward(self, observation: Tensor) -> Tensor:
        features: Tensor = self.layers(observation)
        return features
