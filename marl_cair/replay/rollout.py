"""`Rollout`: T steps of S streams, as the replay buffer takes them, and their check."""

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from marl_cair.replay import ring
from marl_cair.replay.transition import TransitionSpec, check_tensor


@dataclass(frozen=True)
class Rollout:
    """T consecutive steps of S streams; a stream is one seat of one world.

    Observations are those on which the action was chosen. The observation after the last step comes
    with the next rollout, as the first one of the same stream. A step that ends its episode needs
    its true final observation, in a row that `final_step` refers to.

    observation [T, S, *shape]; action_mask bool [T, S, A]; action int64 [T, S]; reward float32
    [T, S], of the step; terminated, truncated bool [T, S] (both: terminated counts); learned bool
    [T, S]: steps to store, a stream that pauses without an end is not linked over the gap;
    expert_action int64 [T, S], the demonstrator's action or NO_ACTION; opponent int16 [T, S],
    number of the opponent or NO_OPPONENT. other_actions int64 [T, S, O]: actions of the other seats
    from the next one on, or UNKNOWN_ACTION; O = 0: None. state float32 [T, S, size], the recurrent
    state before the step, 0 when an episode begins; size 0: None.
    final_step int64 [K]: t * S + s of K terminated or truncated steps, each once;
    final_observation [K, *shape]; final_action_mask bool [K, A], which may be all false after a
    terminated step. Rows of steps that are not learned are skipped.
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
    state: torch.Tensor | None = None
    other_actions: torch.Tensor | None = None

    @property
    def num_streams(self) -> int:
        """S."""
        return int(self.action.shape[1])


def check_rollout(rollout: Rollout, spec: TransitionSpec) -> ring.Steps:
    """Return the rollout as flat arrays (views where it is contiguous) for `append_steps`.

    Raises ValueError for a field of wrong dtype or shape, an action that is outside the space or
    illegal, an illegal expert_action, a plane that should be uniform and is not, and a step that
    ends without its final observation.
    """
    _check_fields(rollout, spec)
    arrays: dict[str, NDArray[Any]] = {"final_row": _place_final_rows(rollout)}
    for name in ring.Steps._fields:
        if name == "final_row":
            continue
        value = _get_field(rollout, name)
        num_rows = len(rollout.final_step) if name.startswith("final") else rollout.action.numel()
        shape: tuple[int, ...] = (num_rows,)
        if name.endswith("observation"):
            shape = (num_rows, math.prod(spec.observation_shape))
        elif name.endswith("action_mask"):
            shape = (num_rows, spec.num_actions)
        elif name == "state":
            shape = (num_rows, spec.state_size)
        elif name == "other_actions":
            shape = (num_rows, spec.num_others)
        # Contiguous: numba would compile again for every other memory layout.
        array = np.ascontiguousarray(value.detach().reshape(shape).numpy())
        arrays[name] = array.view(np.uint8) if name.endswith("observation") else array
    steps = ring.Steps(**arrays)
    fault, step = ring.find_fault(steps, spec.board_bytes, spec.num_cells)
    if fault != ring.SOUND:
        place = f"rollout step t={step // rollout.num_streams}, stream {step % rollout.num_streams}"
        raise ValueError(f"{place}: {_describe_fault(fault, steps, step, spec)}")
    return steps


def _check_fields(rollout: Rollout, spec: TransitionSpec) -> None:
    if rollout.action.ndim != 2 or rollout.action.shape[1] == 0:
        raise ValueError(f"rollout.action has shape {list(rollout.action.shape)}, expected [T, S]")
    others = {"reward": torch.float32, "opponent": torch.int16, "state": torch.float32}
    others |= dict.fromkeys(("terminated", "truncated", "learned"), torch.bool)
    for field in fields(rollout):
        name = field.name
        shape = tuple(rollout.action.shape)
        if name.startswith("final"):
            shape = (rollout.final_step.numel(),)
        dtype = others.get(name, torch.int64)
        if name.endswith("observation"):
            dtype, shape = spec.observation_dtype, shape + spec.observation_shape
        elif name.endswith("action_mask"):
            dtype, shape = torch.bool, (*shape, spec.num_actions)
        elif name == "state":
            shape = (*shape, spec.state_size)
        elif name == "other_actions":
            shape = (*shape, spec.num_others)
        check_tensor(f"rollout.{name}", _get_field(rollout, name), dtype, shape)


def _get_field(rollout: Rollout, name: str) -> torch.Tensor:
    value: torch.Tensor | None = getattr(rollout, name)
    if value is not None:
        return value
    dtype = torch.int64 if name == "other_actions" else torch.float32
    return torch.zeros(*rollout.action.shape, 0, dtype=dtype)


def _place_final_rows(rollout: Rollout) -> NDArray[np.int64]:
    num_steps = rollout.action.numel()
    final_row = np.full(num_steps, ring.NO_ENTRY, np.int64)
    final_step = rollout.final_step.numpy()
    outside = (final_step < 0) | (final_step >= num_steps)
    if outside.any():
        raise ValueError(
            f"rollout.final_step holds {final_step[outside][0]}, expected t * S + s in "
            f"0..{num_steps - 1}"
        )
    ends = (rollout.truncated | rollout.terminated).reshape(-1).numpy()[final_step]
    if not ends.all():
        raise ValueError(
            f"rollout.final_step holds {final_step[~ends][0]}, a step that is neither terminated "
            "nor truncated: give final observations of ends only"
        )
    final_row[final_step] = np.arange(len(final_step))
    if np.count_nonzero(final_row != ring.NO_ENTRY) != len(final_step):
        raise ValueError("rollout.final_step holds a step twice: give each final observation once")
    return final_row


def _describe_fault(fault: int, steps: ring.Steps, step: int, spec: TransitionSpec) -> str:
    action, expert = steps.action[step], steps.expert_action[step]
    legal = "is not legal by its action_mask; legal are "
    legal += str(np.flatnonzero(steps.action_mask[step]).tolist())
    return {
        ring.ACTION_FAULT: f"action is {action}, expected 0..{spec.num_actions - 1}",
        ring.LEGAL_FAULT: f"action {action} {legal}",
        ring.EXPERT_FAULT: f"expert_action {expert} {legal}",
        ring.TAIL_FAULT: "ends its episode but has no final observation: add it to final_step",
        ring.MASK_FAULT: "final_action_mask allows no action: allow at least the no-op",
        ring.UNIFORM_FAULT: (
            f"one of the last {spec.num_uniform} planes of its observation is not constant over "
            "the board: give the spec the game's own num_uniform, 0 if unsure"
        ),
    }[fault]
