"""Q-networks, exploration, inference. Tables are open to classes from outside the package."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from marl_cair.lookup import LazyTable

if TYPE_CHECKING:
    from torch import nn

    from marl_cair.policies.actor import MaskedEpsilonGreedy
    from marl_cair.policies.body import Body
    from marl_cair.policies.memory import GruMemory, LstmMemory

# Importing torch takes seconds: tables import an entry when it is looked up.
NETWORKS: LazyTable[type[Body]] = LazyTable(
    {
        "conv": "marl_cair.policies.conv:ConvBody",
        "capsule": "marl_cair.policies.capsule:CapsuleBody",
        "mlp": "marl_cair.policies.body:MlpBody",
        "residual": "marl_cair.policies.residual:ResidualBody",
        "thesis_capsule": "marl_cair.policies.thesis:ThesisCapsuleBody",
        "thesis_conv": "marl_cair.policies.thesis:ThesisConvBody",
    },
    group="marl_cair.networks",
    base="marl_cair.policies.body:Body",
)
HEADS: LazyTable[Callable[[int, int, int], nn.Module]] = LazyTable(
    {
        "dueling": "marl_cair.policies.heads:DuelingHead",
        "plain": "marl_cair.policies.heads:PlainHead",
        "quantile": "marl_cair.policies.heads:QuantileHead",
        "naf": "marl_cair.policies.heads:NafHead",
        "length": "marl_cair.policies.thesis:LengthHead",
    },
    group="marl_cair.heads",
    base="torch.nn:Module",
)
NO_MEMORY = "none"
MEMORIES: LazyTable[type[LstmMemory | GruMemory]] = LazyTable(
    {
        "lstm": "marl_cair.policies.memory:LstmMemory",
        "gru": "marl_cair.policies.memory:GruMemory",
    }
)
# How a network's outputs become actions; stored in checkpoints.
GREEDY, SAMPLED = "greedy", "sampled"
PLAYS: LazyTable[type[MaskedEpsilonGreedy]] = LazyTable(
    {
        GREEDY: "marl_cair.policies.actor:MaskedEpsilonGreedy",
        SAMPLED: "marl_cair.policies.actor:MaskedSampling",
    }
)
