"""Makes the first network of a run, a new one or that of an agent, and its empty replay."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

import numpy as np
import torch

from marl_cair.checkpoint import load_network, read_description, read_network_config
from marl_cair.files import shorten_value
from marl_cair.games.game import GameSpec, Representation
from marl_cair.league.agents.load import is_checkpoint
from marl_cair.policies import GREEDY
from marl_cair.policies.capsule import stride_first
from marl_cair.policies.config import NAF, QUANTILE
from marl_cair.policies.q_network import QNetwork, QNetworkConfig, make_q_network
from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay, GeneratedSequences
from marl_cair.replay.mixed import MixedReplay
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.generating.generators import count_others
from marl_cair.training.outside_trials import try_sampler
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.exploration import EPSILON_GREEDY, NOISY
from marl_cair.training.settings.learner import DQN
from marl_cair.training.settings.replay import REPLAY_SAMPLERS, TD_ERROR

# A learner with a trained network unlearns within minutes at the usual settings: with large steps
# of a new optimiser, on the first few games alone.
KNOWING_EPSILON = 0.05  # exploration to begin with
KNOWING_RATE = 0.3  # of the usual learning rate
KNOWING_SHARE = 8  # one part in so many of the replay, or of a shorter run, comes before learning
Seen = tuple[str, str, tuple[int, ...], int]  # game, representation, its shape, number of actions


def fit_policy(
    policy: QNetworkConfig, seen: Representation, spec: GameSpec, source: str | None = None
) -> QNetworkConfig:
    """Complete a network's settings by the game's numbers: strides for the board's size unless the
    agent `source`, whose weights it gets, has none, bounds of a vector's entries, and cells and
    kinds of the actions.

    Raises ValueError if actions are to be valued by cells and `seen` does not show them.
    """
    policy = policy.with_bounds(seen.low, seen.high)
    if source is None or read_network_config(read_description(source), source).conv_channels:
        policy = stride_first(policy, seen.shape)
    board = spec.representations.get("planes")
    if policy.reads_cells and board is not None and seen.shape[1:] != board.shape[1:]:
        asked = "policy.cell_values is True" if policy.cell_values else f"policy.head is {NAF!r}"
        raise ValueError(
            f"{asked}, but representation {seen.name!r} {seen.shape} does not show the "
            f"{' x '.join(map(str, board.shape[1:]))} cells that actions point at: take "
            f"representation=planes, or policy.cell_values=false and another head than {NAF!r}"
        )
    cells, kinds = spec.action_cells.tolist(), spec.action_groups.tolist()
    return policy.with_actions(cells, kinds, spec.action_shape)


def describe_rows(
    config: TrainConfig, policy: QNetworkConfig, seen: Representation, spec: GameSpec
) -> TransitionSpec:
    """Shapes and types of the transitions that a run stores."""
    dtype = torch.uint8 if seen.dtype is np.uint8 else torch.float32
    state_size = policy.resolve_state_size() if config.learner.learns_from_replay else 0
    others = count_others(config, spec)
    return TransitionSpec(seen.shape, spec.num_actions, seen.num_uniform, dtype, state_size, others)


def make_replay(config: TrainConfig, spec: TransitionSpec, seeds: Sequence[int]) -> MixedReplay:
    """The empty replay of a run. seeds: of the real and of the generated rows."""
    replay, learner = config.replay, config.learner
    own = replay.sampler == TD_ERROR
    settings = ReplayConfig(
        capacity_transitions=replay.capacity_transitions,
        batch_size=learner.batch_size,
        n_steps=learner.n_steps,
        gamma=learner.gamma,
        scratch_dir=replay.scratch_dir,
        priority_alpha=replay.priority_alpha,
        priority_beta=replay.priority_beta,
        seed=seeds[0],
        sequence_steps=replay.sequence_steps if spec.state_size else 1,
        burn_in_steps=replay.burn_in_steps if spec.state_size else 0,
        make_sampler=None if own else partial(REPLAY_SAMPLERS.make, replay.sampler),
    )
    if REPLAY_SAMPLERS.is_outside(replay.sampler):
        try_sampler(replay.sampler, settings, spec)
    real, capacity = make_replay_buffer(settings, spec), replay.generated_capacity_transitions
    if settings.sequence_steps == 1:
        generated = GeneratedReplay(spec, capacity, seeds[1])
    else:
        entries = settings.burn_in_steps + settings.sequence_steps + 1
        num_sequences = max(1, capacity // settings.sequence_steps)
        generated = GeneratedSequences(spec, entries, num_sequences, seeds[1])
    shares = config.synthetic_fraction, config.generator.loss_weight
    return MixedReplay(real, generated, *shares, generated_open=False)


def can_begin_as(agent: str) -> bool:
    """Whether `agent` is the folder of a Q-network; an average policy (NFSP) gives logits."""
    return is_checkpoint(agent) and read_description(agent).plays == GREEDY


def begin_as(agent: str, config: TrainConfig) -> TrainConfig:
    """The settings of a run that begins with the network of the agent in folder `agent`, explores
    little, learns in small steps and from many games at once, and has no warm-up opponents. Loss
    and exploration are those that its head and noisy layers need.

    Raises CheckpointError if `agent` is no agent's folder.
    """
    about, change = read_description(agent), dataclasses.replace
    exploration, replay, learner = config.exploration, config.replay, config.learner
    start, end = min(KNOWING_EPSILON, exploration.epsilon_start), learner.learning_rate_end
    snapshots = config.opponent.snapshot_every_frames
    first = min(replay.capacity_transitions, config.total_frames, snapshots) // KNOWING_SHARE
    low = min(start, exploration.epsilon_end)
    policy = read_network_config(about, agent)
    kind, algorithm = exploration.kind, learner.algorithm
    if policy.noisy or kind == NOISY:
        kind = NOISY if policy.noisy else EPSILON_GREEDY
    if QUANTILE in (policy.head, algorithm):
        algorithm = QUANTILE if policy.head == QUANTILE else DQN
    return change(
        config,
        initial_agent=agent,
        policy=policy,
        game=change(config.game, representation=about.representation),
        opponent=change(config.opponent, warmup_frames=0),
        exploration=change(exploration, kind=kind, epsilon_start=start, epsilon_end=low),
        learner=change(
            learner,
            algorithm=algorithm,
            learning_rate=KNOWING_RATE * learner.learning_rate,
            learning_rate_end=None if end is None else KNOWING_RATE * end,
        ),
        replay=change(replay, min_transitions=max(replay.min_transitions, first)),
    )


def make_initial_network(
    source: str | None, policy: QNetworkConfig, seen: Seen, seed: int
) -> QNetwork:
    """The network of the agent in folder `source`, or a new one from `seed` if that is None.

    Raises:
        CheckpointError: `source` is no agent's folder.
        ValueError: the agent has another game, representation, action space or policy, or is an
            average policy.
    """
    _, _, shape, num_actions = seen
    if source is None:
        return make_q_network(policy, shape, num_actions, seed=seed)
    network, about = load_network(source)
    if about.plays != GREEDY:
        raise ValueError(
            f"initial_agent is {source}, which plays {about.plays}: its network gives logits of an "
            "average policy and no values of actions; give a greedy agent"
        )
    names = ("game", "representation", "observation shape", "number of actions")
    there = (about.game, about.representation, about.observation_shape, len(about.action_names))
    compared = zip(names, there, seen, strict=True)
    differing: list[tuple[str, object, object]] = [it for it in compared if it[1] != it[2]]
    if network.config != policy:
        its, own = network.config.to_dict(), policy.to_dict()
        changed = [name for name in its if its[name] != own[name]]
        words = [
            ", ".join(f"{name}={shorten_value(values[name])}" for name in changed)
            for values in (its, own)
        ]
        differing.append(("policy", words[0], words[1]))
    if differing:
        name, theirs, ours = differing[0]
        raise ValueError(
            f"initial_agent is {source}, whose {name} is {theirs}, but this run's is {ours}: give "
            "an agent that was trained with the same, or change the run's"
        )
    return network.train()


def count_training(source: str | None) -> tuple[int, int]:
    """Frames and updates of the agent in folder `source` and of all agents that it began as; 0 for
    None. Raises CheckpointError if `source` is no agent's folder.
    """
    if source is None:
        return 0, 0
    about = read_description(source)
    return about.frames_total, about.updates_total
