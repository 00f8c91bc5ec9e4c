"""Recurrent memories: cells between body and head that carry a state from step to step."""

from typing import ClassVar

import torch
from torch import Tensor, nn


class LstmMemory(nn.Module):
    """One LSTM cell (Hochreiter and Schmidhuber 1997), as in DRQN (Hausknecht and Stone 2015).

    Attributes:
        num_features: W, the features it returns.
        state_size: 2 W: the hidden state beside the cell state.
    """

    STATES: ClassVar[int] = 2  # of W numbers each

    def __init__(self, num_features: int, width: int) -> None:
        super().__init__()
        self.num_features, self.state_size = width, self.STATES * width
        self.cell = nn.LSTMCell(num_features, width)

    def forward(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Features float32 [N, F] and state [N, 2 W] -> features [N, W], next state [N, 2 W]."""
        hidden, cell = state.chunk(2, -1)
        hidden, cell = self.cell(features, (hidden, cell))
        return hidden, torch.cat([hidden, cell], -1)


class GruMemory(nn.Module):
    """One GRU cell (Cho et al. 2014): about three quarters of the weights of an LSTM cell.

    Attributes:
        num_features: W, the features it returns.
        state_size: W: the features are the state.
    """

    STATES: ClassVar[int] = 1

    def __init__(self, num_features: int, width: int) -> None:
        super().__init__()
        self.num_features = self.state_size = width
        self.cell = nn.GRUCell(num_features, width)

    def forward(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Features float32 [N, F] and state [N, W] -> features [N, W], next state [N, W]."""
        hidden = self.cell(features, state)
        return hidden, hidden
