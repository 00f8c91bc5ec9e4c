"""Values of actions that point at a cell of the board or are given at each, from nearby cells."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from marl_cair.policies.config import NAF, NO_CELL, QNetworkConfig

NUM_CHANNELS = 32


class _CellReader(nn.Module):
    """Values of cells, from planes float32 [N, C, H, W] and features [N, F].

    The same kernels read every cell (5 x 5 cells around it) and the features of the whole board, as
    in AlphaStar (Vinyals et al. 2019) and GridNet (Han et al. 2019).
    """

    def __init__(self, num_planes: int, num_features: int, num_values: int) -> None:
        super().__init__()
        self.near = nn.Sequential(
            nn.Conv2d(num_planes, NUM_CHANNELS, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(NUM_CHANNELS, NUM_CHANNELS, 3, padding=1),
        )
        self.far = nn.Linear(num_features, NUM_CHANNELS)
        self.values = nn.Conv2d(NUM_CHANNELS, num_values, 1)
        with torch.no_grad():
            for weight in self.values.parameters():
                weight.zero_()

    def read(self, planes: Tensor, features: Tensor, is_reduced: bool) -> Tensor:
        """Values float32 [N, num_values, H, W], 0 initially. With `is_reduced` the kernels compute
        in autocast's precision.
        """
        with torch.autocast(planes.device.type, enabled=is_reduced):
            near = self.near(planes.contiguous(memory_format=torch.channels_last))
        seen = torch.relu(near.float() + self.far(features)[:, :, None, None])
        values: Tensor = self.values(seen)
        return values


class CellValues(_CellReader):
    """Planes float32 [N, C, H, W], features [N, F] and values [N, A] -> values [N, A]; quantiles
    [N, A, K] in place of values are shifted.

    A dense head learns the value of a tower or an order separately for each cell. Here actions of
    one kind share weights. The result is added to the head's values, and is 0 initially. Values of
    actions without a cell do not change. The planes are those of the observation, without those of
    `DistanceMaps`. See `check_cells`.
    """

    actions: Tensor
    places: Tensor

    def __init__(
        self,
        shape: Sequence[int],
        num_features: int,
        action_cells: Sequence[int],
        action_kinds: Sequence[int],
    ) -> None:
        num_cells = shape[1] * shape[2]
        cells, kinds = np.array(action_cells, np.int64), np.array(action_kinds, np.int64)
        pointing = np.flatnonzero(cells != NO_CELL)
        pointing_kinds, which = np.unique(kinds[pointing], return_inverse=True)
        super().__init__(shape[0], num_features, len(pointing_kinds))
        self.register_buffer("actions", torch.from_numpy(pointing), persistent=False)
        places = torch.from_numpy(which * num_cells + cells[pointing])
        self.register_buffer("places", places, persistent=False)

    def forward(
        self, planes: Tensor, features: Tensor, values: Tensor, is_reduced: bool = False
    ) -> Tensor:
        found = self.read(planes, features, is_reduced).flatten(1).index_select(1, self.places)
        if values.ndim > found.ndim:
            found = found.unsqueeze(-1).expand(-1, -1, values.shape[-1])
        return values.index_add(1, self.actions, found)


class PlaceValues(_CellReader):
    """Planes float32 [N, C, H, W] and features [N, F] -> values float32 [N, H, W, A]: of each of A
    actions at each cell, for games with an action at every cell (GridNet, Han et al. 2019).

    Dueling: the value of the state and, at each cell, advantages less their mean; all 0 initially.
    The value of a whole action is the mean over the places that act (`actor.average_places`).
    Raises ValueError unless the observation is a board whose cells are the places.
    """

    def __init__(
        self, shape: Sequence[int], action_shape: Sequence[int], num_features: int, num_actions: int
    ) -> None:
        if tuple(shape[1:]) != tuple(action_shape):
            raise ValueError(
                f"actions have a place at each cell of {list(action_shape)}, but the observation "
                f"has shape {tuple(shape)}: take representation=planes"
            )
        super().__init__(shape[0], num_features, num_actions)
        self.state_value = nn.Linear(num_features, 1)
        with torch.no_grad():
            for weight in self.state_value.parameters():
                weight.zero_()

    def forward(self, planes: Tensor, features: Tensor, is_reduced: bool = False) -> Tensor:
        advantage = self.read(planes, features, is_reduced).permute(0, 2, 3, 1)
        values: Tensor = self.state_value(features)[:, None, None] + advantage
        return values - advantage.mean(-1, keepdim=True)


def check_cells(config: QNetworkConfig, shape: Sequence[int], num_actions: int) -> None:
    """Raise ValueError unless a network that reads the cells of actions suits the game: the
    observation is a board, there are a cell and a kind for each action, some action points at a
    cell, and none beyond the board.
    """
    asked, instead = f"head is {NAF!r}", f"take another head than {NAF!r}"
    if config.cell_values:
        asked, instead = "cell_values is True", "set cell_values to False"
    cells, kinds = config.action_cells, config.action_kinds
    if len(shape) != 3:
        raise ValueError(
            f"{asked}, which reads boards [C, H, W], but the observation has shape "
            f"{tuple(shape)}: take representation=planes, or {instead}"
        )
    if not len(cells) == len(kinds) == num_actions:
        raise ValueError(
            f"{asked} for {num_actions} actions, but action_cells has {len(cells)} entries and "
            f"action_kinds {len(kinds)}: give one for each action, as "
            "`QNetworkConfig.with_actions` does"
        )
    if max(cells) == NO_CELL:
        raise ValueError(f"{asked}, but none of the actions points at a cell: {instead}")
    if max(cells) >= shape[1] * shape[2]:
        raise ValueError(
            f"an action points at cell {max(cells)}, but the observation has the cells "
            f"0..{shape[1] * shape[2] - 1}: take representation=planes, or {instead}"
        )
