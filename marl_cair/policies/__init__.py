"""Q-networks, exploration, inference; no game. A new network is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from marl_cair.lookup import LazyTable

if TYPE_CHECKING:
    from torch import nn

    from marl_cair.policies.actor import MaskedEpsilonGreedy
    from marl_cair.policies.body import Body

# Torch takes seconds: it is imported with the first network, and not to list their names.
NETWORKS: LazyTable[type[Body]] = LazyTable(
    {
        "conv": "marl_cair.policies.conv:ConvBody",
        "capsule": "marl_cair.policies.capsule:CapsuleBody",
        "mlp": "marl_cair.policies.mlp:MlpBody",
    }
)
HEADS: LazyTable[Callable[[int, int, int], nn.Module]] = LazyTable(
    {
        "dueling": "marl_cair.policies.heads:DuelingHead",
        "plain": "marl_cair.policies.heads:make_plain",
    }
)
# How a network's outputs become actions; a checkpoint names one.
GREEDY, SAMPLED = "greedy", "sampled"
PLAYS: LazyTable[type[MaskedEpsilonGreedy]] = LazyTable(
    {
        GREEDY: "marl_cair.policies.actor:MaskedEpsilonGreedy",
        SAMPLED: "marl_cair.policies.actor:MaskedSampling",
    }
)
