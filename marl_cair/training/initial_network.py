"""The network that learning begins with: a new one, or that of an agent."""

from __future__ import annotations

import dataclasses

from marl_cair.checkpoint import load_network, read_description
from marl_cair.files import shorten_value
from marl_cair.games.game import GameSpec, Representation
from marl_cair.league.agents.load import is_checkpoint
from marl_cair.policies import GREEDY
from marl_cair.policies.q_network import QNetwork, QNetworkConfig, make_q_network
from marl_cair.training.settings.config import TrainConfig

# A learner that knows how to play loses it within minutes where it goes on as one that does not:
# with large steps of an optimiser that has seen nothing yet, on the first few games alone.
KNOWING_EPSILON = 0.05  # exploration to begin with
KNOWING_RATE = 0.3  # of the usual learning rate
KNOWING_SHARE = 8  # one part in so many of the replay, or of a shorter run, comes before learning
Seen = tuple[str, str, tuple[int, ...], int]  # game, representation, its shape, number of actions


def fit_policy(policy: QNetworkConfig, seen: Representation, spec: GameSpec) -> QNetworkConfig:
    """The settings of a network with what only the game knows: bounds of a vector's entries, and
    cells and kinds of the actions.

    Raises ValueError where actions are to be valued by cells and `seen` does not show them.
    """
    policy = policy.with_bounds(seen.low, seen.high)
    board = spec.representations.get("planes")
    if policy.cell_values and board is not None and seen.shape[1:] != board.shape[1:]:
        raise ValueError(
            f"policy.cell_values is True, but representation {seen.name!r} {seen.shape} does not "
            f"show the {' x '.join(map(str, board.shape[1:]))} cells that actions point at: take "
            "representation=planes, or set policy.cell_values=false"
        )
    return policy.with_actions(spec.action_cells.tolist(), spec.action_groups.tolist())


def can_begin_as(agent: str) -> bool:
    """Whether `agent` is the folder of a network whose outputs are values of actions; those of an
    average policy (NFSP) are logits.
    """
    return is_checkpoint(agent) and read_description(agent).plays == GREEDY


def begin_as(agent: str, config: TrainConfig) -> TrainConfig:
    """The settings of a run that begins with the network of the agent in folder `agent`, explores
    little, learns in small steps and from many games at once, and meets its opponents from the
    first game on.

    Raises CheckpointError where `agent` is no agent's folder.
    """
    about = read_description(agent)
    exploration, replay, learner = config.exploration, config.replay, config.learner
    start = min(KNOWING_EPSILON, exploration.epsilon_start)
    end = learner.learning_rate_end
    first = min(
        replay.capacity_transitions, config.total_frames, config.opponent.snapshot_every_frames
    )
    return dataclasses.replace(
        config,
        initial_agent=agent,
        policy=QNetworkConfig.from_dict(about.network),
        game=dataclasses.replace(config.game, representation=about.representation),
        opponent=dataclasses.replace(config.opponent, warmup_frames=0),
        exploration=dataclasses.replace(
            exploration, epsilon_start=start, epsilon_end=min(start, exploration.epsilon_end)
        ),
        learner=dataclasses.replace(
            learner,
            learning_rate=KNOWING_RATE * learner.learning_rate,
            learning_rate_end=None if end is None else KNOWING_RATE * end,
        ),
        replay=dataclasses.replace(
            replay, min_transitions=max(replay.min_transitions, first // KNOWING_SHARE)
        ),
    )


def make_initial_network(
    source: str | None, policy: QNetworkConfig, seen: Seen, seed: int
) -> QNetwork:
    """That of the agent in folder `source`, or a new one from `seed` where that is None.

    Raises:
        CheckpointError: `source` is no agent's folder.
        ValueError: the agent is of another game, sees or does something else, has another policy,
            or plays an average policy.
    """
    _, _, shape, num_actions = seen
    if source is None:
        return make_q_network(policy, shape, num_actions, seed=seed)
    network, about = load_network(source)
    if about.plays != GREEDY:
        raise ValueError(
            f"initial_agent is {source}, which plays {about.plays}: what its network gives are "
            "logits of an average policy and no values of actions; give a greedy agent"
        )
    names = ("game", "representation", "observation shape", "number of actions")
    there = (about.game, about.representation, about.observation_shape, len(about.action_names))
    compared = zip(names, there, seen, strict=True)
    differing: list[tuple[str, object, object]] = [it for it in compared if it[1] != it[2]]
    if network.config != policy:
        differing.append(("policy", *_tell_differences(network.config, policy)))
    if differing:
        name, its, own = differing[0]
        raise ValueError(
            f"initial_agent is {source}, whose {name} is {its}, but this run's is {own}: give "
            "an agent that was trained with the same, or change the run's"
        )
    return network.train()


def count_training(source: str | None) -> tuple[int, int]:
    """Frames and updates of the agent in folder `source` and of all that it went on from; none
    where that is None. Raises CheckpointError where `source` is no agent's folder.
    """
    if source is None:
        return 0, 0
    about = read_description(source)
    return about.frames_total, about.updates_total


def _tell_differences(its: QNetworkConfig, own: QNetworkConfig) -> tuple[str, str]:
    """The settings in which two policies differ, in words for each."""
    first, second = its.to_dict(), own.to_dict()
    names = [name for name in first if first[name] != second[name]]
    its_words, own_words = (
        ", ".join(f"{name}={shorten_value(values[name])}" for name in names)
        for values in (first, second)
    )
    return its_words, own_words
