"""The network that learning begins with: a new one, or that of an agent."""

from __future__ import annotations

from marl_cair.checkpoint import load_network
from marl_cair.policies.q_network import QNetwork, QNetworkConfig, make_q_network

Seen = tuple[str, str, tuple[int, ...], int]  # game, representation, its shape, number of actions


def make_initial_network(
    source: str | None, policy: QNetworkConfig, seen: Seen, seed: int
) -> QNetwork:
    """That of the agent in folder `source`, or a new one from `seed` where that is None.

    Raises:
        CheckpointError: `source` is no agent's folder.
        ValueError: the agent is of another game, sees or does something else, or has another
            policy.
    """
    _, _, shape, num_actions = seen
    if source is None:
        return make_q_network(policy, shape, num_actions, seed=seed)
    network, about = load_network(source)
    names = ("game", "representation", "observation shape", "number of actions", "policy")
    there = (about.game, about.representation, about.observation_shape, len(about.action_names))
    for name, its, own in zip(names, (*there, network.config), (*seen, policy), strict=True):
        if its != own:
            raise ValueError(
                f"initial_agent is {source}, whose {name} is {its}, but this run's is {own}: give "
                "an agent that was trained with the same, or change the run's"
            )
    return network.train()
