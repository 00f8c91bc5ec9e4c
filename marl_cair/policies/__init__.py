"""Q-networks, exploration, inference; no game. A new network is one file and one line here."""

from marl_cair.policies.body import Body
from marl_cair.policies.capsule import CapsuleBody
from marl_cair.policies.conv import ConvBody
from marl_cair.policies.mlp import MlpBody

NETWORKS: dict[str, type[Body]] = {
    "conv": ConvBody,
    "capsule": CapsuleBody,
    "mlp": MlpBody,
}
