"""What the collector hands to the replay buffer: T steps of S streams, and their check."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from marl_cair.replay.ring import (
    ACTION_FAULT,
    EXPERT_FAULT,
    LEGAL_FAULT,
    MASK_FAULT,
    NO_ENTRY,
    SOUND,
    TAIL_FAULT,
    Steps,
    find_fault,
)
from marl_cair.replay.transition import TransitionSpec


@dataclass(frozen=True)
class Rollout:
    """T consecutive steps of S streams; a stream is one seat of one world.

    Observations are those that the action was chosen on. The one after the last step is not given:
    it comes with the next rollout, as the first observation of the same stream. Only of a step that
    ends its episode is the true final observation needed, in rows that `final_step` points from.

    observation [T, S, *shape]; action_mask bool [T, S, A]; action int64 [T, S]; reward float32
    [T, S], the reward of the step; terminated, truncated bool [T, S] (both: terminated counts);
    learned bool [T, S]: steps to store, a stream that pauses without an end is not linked over the
    gap; expert_action int64 [T, S], what a demonstrator did or would do, NO_ACTION where none says;
    opponent int16 [T, S], who was met, NO_OPPONENT where nobody is known.
    final_step int64 [K]: t * S + s of K terminated or truncated steps, each once;
    final_observation [K, *shape]; final_action_mask bool [K, A], after a terminated step it may
    allow nothing. Rows of steps that are not learned are skipped.
    """

    observation: torch.Tensor
    action_mask: torch.Tensor
    action: torch.Tensor
    reward: torch.Tensor
    terminated: torch.Tensor
    truncated: torch.Tensor
    learned: torch.Tensor
    expert_action: torch.Tensor
    opponent: torch.Tensor
    final_step: torch.Tensor
    final_observation: torch.Tensor
    final_action_mask: torch.Tensor

    @property
    def num_streams(self) -> int:
        """S."""
        return int(self.action.shape[1])


def check_rollout(rollout: Rollout, spec: TransitionSpec) -> Steps:
    """Return the rollout as flat arrays (views where it is contiguous) for `append_steps`.

    Raises ValueError for a field of wrong dtype or shape, an action that is outside the space or
    illegal, an illegal expert_action, a plane that should be uniform and is not, and a step that
    ends without its final observation.
    """
    _check_fields(rollout, spec)
    num_steps = rollout.action.numel()
    num_final = rollout.final_step.numel()
    steps = Steps(
        observation=_as_bytes(rollout.observation, num_steps, spec),
        action_mask=_as_array(rollout.action_mask, num_steps, spec.num_actions),
        action=_as_array(rollout.action, num_steps),
        reward=_as_array(rollout.reward, num_steps),
        terminated=_as_array(rollout.terminated, num_steps),
        truncated=_as_array(rollout.truncated, num_steps),
        learned=_as_array(rollout.learned, num_steps),
        expert_action=_as_array(rollout.expert_action, num_steps),
        opponent=_as_array(rollout.opponent, num_steps),
        final_row=_place_final_rows(rollout),
        final_observation=_as_bytes(rollout.final_observation, num_final, spec),
        final_action_mask=_as_array(rollout.final_action_mask, num_final, spec.num_actions),
    )
    fault, step = find_fault(steps, spec.board_bytes, spec.num_cells)
    if fault != SOUND:
        place = f"rollout step t={step // rollout.num_streams}, stream {step % rollout.num_streams}"
        raise ValueError(f"{place}: {_describe_fault(fault, steps, step, spec)}")
    return steps


def _check_fields(rollout: Rollout, spec: TransitionSpec) -> None:
    if rollout.action.ndim != 2 or rollout.action.shape[1] == 0:
        raise ValueError(f"rollout.action has shape {list(rollout.action.shape)}, expected [T, S]")
    per_step = tuple(rollout.action.shape)
    per_final = (rollout.final_step.numel(),)
    expected: dict[str, tuple[torch.dtype, tuple[int, ...]]] = {
        "observation": (spec.observation_dtype, per_step + spec.observation_shape),
        "action_mask": (torch.bool, (*per_step, spec.num_actions)),
        "action": (torch.int64, per_step),
        "reward": (torch.float32, per_step),
        "terminated": (torch.bool, per_step),
        "truncated": (torch.bool, per_step),
        "learned": (torch.bool, per_step),
        "expert_action": (torch.int64, per_step),
        "opponent": (torch.int16, per_step),
        "final_step": (torch.int64, per_final),
        "final_observation": (spec.observation_dtype, per_final + spec.observation_shape),
        "final_action_mask": (torch.bool, (*per_final, spec.num_actions)),
    }
    for field in fields(rollout):
        value: torch.Tensor = getattr(rollout, field.name)
        dtype, shape = expected[field.name]
        if value.dtype != dtype or tuple(value.shape) != shape:
            raise ValueError(
                f"rollout.{field.name} is {value.dtype} {list(value.shape)}, "
                f"expected {dtype} {list(shape)}"
            )


def _as_bytes(observation: torch.Tensor, num_rows: int, spec: TransitionSpec) -> NDArray[np.uint8]:
    return _as_array(observation, num_rows, math.prod(spec.observation_shape)).view(np.uint8)


def _as_array(value: torch.Tensor, *shape: int) -> NDArray[Any]:
    # Contiguous, as numba would compile anew for each other layout of the memory.
    return np.ascontiguousarray(value.detach().reshape(shape).numpy())


def _place_final_rows(rollout: Rollout) -> NDArray[np.int64]:
    num_steps = rollout.action.numel()
    final_row = np.full(num_steps, NO_ENTRY, np.int64)
    final_step = rollout.final_step.numpy()
    if not len(final_step):
        return final_row
    if final_step.min() < 0 or final_step.max() >= num_steps:
        wrong = final_step[(final_step < 0) | (final_step >= num_steps)][0]
        raise ValueError(
            f"rollout.final_step holds {wrong}, expected t * S + s in 0..{num_steps - 1}"
        )
    ends = (rollout.truncated | rollout.terminated).reshape(-1).numpy()[final_step]
    if not ends.all():
        raise ValueError(
            f"rollout.final_step holds {final_step[~ends][0]}, a step that is neither terminated "
            "nor truncated: give final observations of ends only"
        )
    final_row[final_step] = np.arange(len(final_step))
    if np.count_nonzero(final_row != NO_ENTRY) != len(final_step):
        raise ValueError("rollout.final_step holds a step twice: give each final observation once")
    return final_row


def _describe_fault(fault: int, steps: Steps, step: int, spec: TransitionSpec) -> str:
    action = steps.action[step]
    if fault == ACTION_FAULT:
        return f"action is {action}, expected 0..{spec.num_actions - 1}"
    if fault in (LEGAL_FAULT, EXPERT_FAULT):
        legal = np.flatnonzero(steps.action_mask[step]).tolist()
        told = f"action {action}"
        if fault == EXPERT_FAULT:
            told = f"expert_action {steps.expert_action[step]}"
        return f"{told} is not legal by its action_mask; legal are {legal}"
    if fault == TAIL_FAULT:
        return "ends its episode but has no final observation: add it to final_step"
    if fault == MASK_FAULT:
        return "final_action_mask allows no action: allow at least the no-op"
    return (  # UNIFORM_FAULT
        f"one of the last {spec.num_uniform} planes of its observation is not constant over the "
        "board: give the spec the game's own num_uniform, 0 if unsure"
    )
