"""Tries losses, replay samplers and generators from outside the package on zeros."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.checkpoint import load_tensors, save_tensors
from marl_cair.games.game import GameSpec, Representation
from marl_cair.generative import GENERATORS
from marl_cair.generative.gate import GateReport
from marl_cair.generative.generator import Generator
from marl_cair.outside import OutsideCodeError, outside_call
from marl_cair.policies.q_network import QNetwork
from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT, TransitionSpec, make_tensordict
from marl_cair.training.generating.generators import make_generator
from marl_cair.training.losses import Loss, LossResult
from marl_cair.training.settings.config import GeneratorSettings, TrainConfig
from marl_cair.training.settings.learner import LOSSES, LearnerSettings

_NUM_ROWS, _NUM_STEPS = 2, 3  # of a batch, and of its sequences
_NUM_OBSERVED = 512  # transitions that a generator is shown
_NUM_DRAWN = 20  # batches of a replay sampler


def try_parts(
    config: TrainConfig,
    network: QNetwork,
    seen: Representation,
    spec: GameSpec,
    rows: TransitionSpec,
) -> None:
    """Try the loss and the generator of a run, where they are from outside. Raises
    OutsideCodeError as `try_loss` and `try_generator`.
    """
    try_loss(config.learner, network, rows)
    is_outside = GENERATORS.is_outside(config.generator.name)
    generator = make_generator(config, seen, spec, 0, None) if is_outside else None
    if generator is not None:
        try_generator(config.generator, generator, rows)


def try_loss(settings: LearnerSettings, network: QNetwork, spec: TransitionSpec) -> None:
    """Call a loss from outside once, with copies of `network`, on two rows or sequences of zeros,
    but for one reward or target: a loss may divide by how rows differ.

    Raises OutsideCodeError with the class's name if it fails, or does not return a `LossResult` as
    `Loss` describes it, or one that is not finite. Other losses are not called.
    """
    name = settings.algorithm
    if not LOSSES.is_outside(name):
        return
    loss: Loss = LOSSES.make(name, settings)
    online = deepcopy(network).cpu()
    target = deepcopy(online).requires_grad_(False) if loss.HAS_TARGET_NETWORK else online
    batch = _make_zeros(loss, network, spec)
    shapes = (), tuple(batch.shape), (*batch.shape, *network.values_shape)
    what = f"learner.algorithm={name} failed on a batch of zeros of shape {list(batch.shape)}"
    with outside_call(what), torch.random.fork_rng(devices=[]):
        result: Any = loss(online, target, batch)
    if not isinstance(result, LossResult):
        raise OutsideCodeError(
            f"learner.algorithm={name} returned {result!r:.80}, it must be a LossResult"
        )
    for field, value, shape in zip(LossResult._fields, result, shapes, strict=True):
        if fault := _find_fault(value, shape):
            raise OutsideCodeError(
                f"learner.algorithm={name} returned {field} {fault} for a batch of zeros of shape "
                f"{list(batch.shape)}; it must be finite torch.float32 of shape {list(shape)}"
            )
    if not result.loss.requires_grad:
        raise OutsideCodeError(
            f"learner.algorithm={name} returned a loss without gradient: compute it from values of "
            "`network` outside of torch.no_grad"
        )


def _make_rows(spec: TransitionSpec, num_rows: int) -> TensorDict:
    """Transitions [N] of zeros, but for one reward; every action is legal."""
    rows = {
        key: torch.zeros(num_rows, *size, dtype=kind) for key, (kind, size) in spec.fields().items()
    }
    for key in ("action_mask", ("next", "action_mask"), "steps_to_next_obs"):
        rows[key].fill_(1)
    rows["expert_action"].fill_(NO_ACTION)
    rows["index"] = torch.arange(num_rows)
    rows["next", "reward"][-1] = 1.0
    return make_tensordict(rows)


def try_sampler(name: str, config: ReplayConfig, spec: TransitionSpec) -> None:
    """Let a replay sampler from outside draw batches from a small replay, note TD errors, and save
    and load its state.

    Raises OutsideCodeError with the class's name if it fails, or its slots are wrong.
    """
    num_steps = config.batch_size + 2 * config.sequence_steps + config.n_steps
    small = replace(config, capacity_transitions=4 * num_steps, scratch_dir=None)
    replay = make_replay_buffer(small, spec)
    what = f"replay.sampler={name} failed on a replay of zeros"
    with outside_call(what), torch.random.fork_rng(devices=[]):
        replay.extend_rollout(_make_rollout(spec, num_steps))
        for _ in range(_NUM_DRAWN):  # a few slots of the replay start nothing
            index = replay.sample()["index"]
        index = index if index.ndim == 1 else index[:, 0]
        replay.update_priority(index, torch.ones(len(index)), 0.5)
        with TemporaryDirectory() as scratch:
            replay.save(Path(scratch) / "replay")
            replay.load(Path(scratch) / "replay")
        replay.sample()


def _make_rollout(spec: TransitionSpec, num_steps: int) -> Rollout:
    """Steps [T, 2] of zeros, but for a reward in the middle, which ends the first game; every
    action is legal.
    """
    size, middle = (num_steps, _NUM_ROWS), num_steps // 2
    reward, terminated = torch.zeros(size), torch.zeros(size, dtype=torch.bool)
    reward[middle, 0], terminated[middle, 0] = 1.0, True
    others = torch.zeros(*size, spec.num_others, dtype=torch.int64) if spec.num_others else None
    return Rollout(
        observation=torch.zeros(*size, *spec.observation_shape, dtype=spec.observation_dtype),
        action_mask=torch.ones(*size, spec.num_actions, dtype=torch.bool),
        action=torch.zeros(size, dtype=torch.int64),
        reward=reward,
        terminated=terminated,
        truncated=torch.zeros(size, dtype=torch.bool),
        learned=torch.ones(size, dtype=torch.bool),
        expert_action=torch.full(size, NO_ACTION),
        opponent=torch.full(size, NO_OPPONENT, dtype=torch.int16),
        final_step=torch.tensor([middle * _NUM_ROWS]),
        final_observation=torch.zeros(1, *spec.observation_shape, dtype=spec.observation_dtype),
        final_action_mask=torch.ones(1, spec.num_actions, dtype=torch.bool),
        state=torch.zeros(*size, spec.state_size) if spec.state_size else None,
        other_actions=others,
    )


def try_generator(settings: GeneratorSettings, generator: Generator, spec: TransitionSpec) -> None:
    """Show a generator from outside, made for this alone, 512 transitions of zeros, let it learn
    from a batch and be evaluated, and save and load its state; if its gate then is open, let it
    predict.

    Raises OutsideCodeError with the class's name if a method fails, or returns another kind.
    """
    rows, name = _make_rows(spec, _NUM_OBSERVED), f"generator.name={settings.name}"
    batch = rows[: settings.batch_size]
    starts = batch.select("observation", "action_mask", "action")
    what = f"{name} failed on transitions of zeros"
    with outside_call(what), torch.random.fork_rng(devices=[]):
        generator.observe(rows)
        losses: Any = generator.update(batch)
        report: Any = generator.evaluate()
        is_open = isinstance(report, GateReport) and report.passed
        accepted: Any = generator.predict(starts)[1] if is_open else torch.zeros(len(batch)).bool()
        with TemporaryDirectory() as scratch:
            file = Path(scratch) / "generator.pt"
            save_tensors({**generator.export_knowledge(), **generator.state_dict()}, file)
            state = dict(load_tensors(file))
            generator.load_state_dict(state)
            generator.import_knowledge({key: state[key] for key in generator.export_knowledge()})
    judged = isinstance(accepted, Tensor) and accepted.dtype == torch.bool
    wanted = {
        "update": (losses, isinstance(losses, dict), "losses by name"),
        "evaluate": (report, isinstance(report, GateReport), "a GateReport"),
        "predict": (accepted, judged and len(accepted) == len(batch), "transitions, and bool [N]"),
    }
    for method, (given, is_right, kind) in wanted.items():
        if not is_right:
            raise OutsideCodeError(f"{name}: {method} gave {given!r:.80}, it must return {kind}")


def _find_fault(value: Any, shape: tuple[int, ...]) -> str:
    if not isinstance(value, Tensor):
        return f"of type {type(value).__name__}"
    if value.dtype != torch.float32 or tuple(value.shape) != shape:
        return f"of {value.dtype} and shape {list(value.shape)}"
    return "" if bool(torch.isfinite(value).all()) else "that is not finite"


def _make_zeros(loss: Loss, network: QNetwork, spec: TransitionSpec) -> TensorDict:
    """Zeros with the keys of a batch that `loss` gets for `network`, without priorities; every
    action is legal.
    """
    fields: dict[Any, tuple[torch.dtype, tuple[int, ...]]] = spec.fields()
    shape: tuple[int, ...] = (_NUM_ROWS,)
    if loss.LEARNS_FROM_REPLAY and not network.state_size:
        return _make_rows(spec, _NUM_ROWS)
    number, is_true = (torch.float32, ()), (torch.bool, ())
    places = network.values_shape[:-1]
    kept = {
        "observation": fields["observation"],
        "action": (torch.int64, places),
        "is_generated": is_true,
    }
    if loss.LEARNS_FROM_REPLAY:
        names = "action_mask", "expert_action", "opponent", "index"
        kept |= {name: fields[name] for name in names}
        kept |= {"reward": number, "terminated": is_true}
    else:
        kept["target"] = number
        if places:
            kept["action_mask"] = torch.bool, network.values_shape
    if network.state_size:
        shape = _NUM_ROWS, _NUM_STEPS
        kept["state"] = torch.float32, (network.state_size,)
        kept |= {"starts": is_true, "learned": is_true}
    batch = {key: torch.zeros(*shape, *size, dtype=kind) for key, (kind, size) in kept.items()}
    for key in {"action_mask", "learned"} & set(batch):
        batch[key].fill_(1)
    batch["reward" if loss.LEARNS_FROM_REPLAY else "target"][-1] = 1.0
    if loss.LEARNS_FROM_REPLAY:
        batch["learned"][:, -1] = False  # the last entry only gives the next value
        batch["expert_action"].fill_(NO_ACTION)
    return TensorDict(batch, shape)
