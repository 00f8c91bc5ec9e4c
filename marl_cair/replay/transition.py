"""Keys, shapes and dtypes of a transition, and checks of a batch of them."""

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

Key = str | tuple[str, ...]

OBSERVATION: Key = "observation"
ACTION_MASK: Key = "action_mask"
ACTION: Key = "action"
NEXT_OBSERVATION: Key = ("next", "observation")
NEXT_ACTION_MASK: Key = ("next", "action_mask")
NEXT_REWARD: Key = ("next", "reward")
NEXT_TERMINATED: Key = ("next", "terminated")
NEXT_DONE: Key = ("next", "done")
STEPS_TO_NEXT_OBS: Key = "steps_to_next_obs"
IS_GENERATED: Key = "is_generated"
EXPERT_ACTION: Key = "expert_action"
OPPONENT: Key = "opponent"
INDEX: Key = "index"
OTHER_ACTIONS: Key = "other_actions"  # of the other seats, from the next one on; optional

EXPERIENCE_KEYS: tuple[Key, ...] = (
    *(OBSERVATION, ACTION_MASK, ACTION, NEXT_OBSERVATION, NEXT_ACTION_MASK),
    *(NEXT_REWARD, NEXT_TERMINATED, NEXT_DONE),
)
LABEL_KEYS: tuple[Key, ...] = (STEPS_TO_NEXT_OBS, IS_GENERATED, EXPERT_ACTION, OPPONENT, INDEX)
TRANSITION_KEYS: tuple[Key, ...] = EXPERIENCE_KEYS + LABEL_KEYS

NO_ACTION = -1  # of EXPERT_ACTION: no demonstration
NO_OPPONENT = -1  # the opponent has no number, or there are several
UNKNOWN_ACTION = -1  # of OTHER_ACTIONS
NO_INDEX = -1  # the row is in no ring of real transitions


@dataclass(frozen=True)
class TransitionSpec:
    """Shapes and dtypes of the transitions of one game.

    observation_shape: planes first, [C, H, W], or [V] of a vector.
    num_actions: A.
    num_uniform: how many of the last planes are constant over the board (uint8 only).
    observation_dtype: dtype of the observation as the game gives it.
    state_size: numbers of the recurrent state before a step.
    num_others: other seats whose actions are stored too; 0: the transitions have no such column.
    Raises ValueError for sizes out of range.
    """

    observation_shape: tuple[int, ...]
    num_actions: int
    num_uniform: int = 0
    observation_dtype: torch.dtype = torch.uint8
    state_size: int = 0
    num_others: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "observation_shape", tuple(int(n) for n in self.observation_shape))
        if not self.observation_shape or min(self.observation_shape) < 1:
            raise ValueError(
                f"observation_shape is {self.observation_shape}, expected one or more sizes >= 1"
            )
        if self.num_actions < 1:
            raise ValueError(f"num_actions is {self.num_actions}, expected 1 or more")
        most = self.observation_shape[0] if self.observation_dtype == torch.uint8 else 0
        if not 0 <= self.num_uniform <= most:
            raise ValueError(
                f"num_uniform is {self.num_uniform}, expected 0..{most} for observations of "
                f"{_describe(self.observation_dtype, self.observation_shape)}: only uint8 planes "
                "can be stored as one byte each"
            )

    @property
    def num_cells(self) -> int:
        """Cells of one plane, H * W."""
        return math.prod(self.observation_shape[1:])

    @property
    def board_bytes(self) -> int:
        """Bytes of the planes that are stored cell by cell."""
        num_boards = self.observation_shape[0] - self.num_uniform
        return num_boards * self.num_cells * self.observation_dtype.itemsize

    @property
    def row_bytes(self) -> int:
        """Bytes of one stored observation: the boards, then one byte per uniform plane."""
        return self.board_bytes + self.num_uniform

    @property
    def mask_bytes(self) -> int:
        """Bytes of one stored action mask: one bit per action."""
        return (self.num_actions + 7) // 8

    def fields(self) -> dict[Key, tuple[torch.dtype, tuple[int, ...]]]:
        """Return dtype and shape of one row for each transition key."""
        observation = (self.observation_dtype, self.observation_shape)
        mask = (torch.bool, (self.num_actions,))
        others = {OTHER_ACTIONS: (torch.int64, (self.num_others,))} if self.num_others else {}
        return {
            OBSERVATION: observation,
            ACTION_MASK: mask,
            ACTION: (torch.int64, ()),
            NEXT_OBSERVATION: observation,
            NEXT_ACTION_MASK: mask,
            NEXT_REWARD: (torch.float32, (1,)),
            NEXT_TERMINATED: (torch.bool, (1,)),
            NEXT_DONE: (torch.bool, (1,)),
            STEPS_TO_NEXT_OBS: (torch.int64, (1,)),
            IS_GENERATED: (torch.bool, (1,)),
            EXPERT_ACTION: (torch.int64, ()),
            OPPONENT: (torch.int16, ()),
            INDEX: (torch.int64, ()),
            **others,
        }


def check_transitions(
    transitions: TensorDict, spec: TransitionSpec, keys: Iterable[Key] = TRANSITION_KEYS
) -> None:
    """Raise ValueError unless `transitions` [N] holds `keys` as `spec` says and only legal actions.

    A row whose action is illegal, or that continues without a legal next action, would make a
    masked loss infinite.
    """
    if transitions.batch_dims != 1:
        raise ValueError(
            f"transitions have batch size {list(transitions.batch_size)}, expected [N]: "
            "flatten them with .reshape(-1)"
        )
    keys = tuple(keys)
    fields = spec.fields()
    for key in keys:
        value = transitions.get(key, None)
        if value is None:
            raise ValueError(f"transitions lack {key!r}; they need {', '.join(map(repr, keys))}")
        dtype, shape = fields[key]
        check_tensor(f"transitions[{key!r}]", value, dtype, (len(transitions), *shape))
    if not len(transitions):
        return
    if ACTION in keys and ACTION_MASK in keys:
        check_actions(transitions[ACTION], transitions[ACTION_MASK])
    if NEXT_ACTION_MASK in keys and NEXT_TERMINATED in keys:
        has_no_action = ~transitions[NEXT_ACTION_MASK].any(1)
        stuck = has_no_action & ~transitions[NEXT_TERMINATED].squeeze(1)
        if stuck.any():
            raise ValueError(
                f"row {int(stuck.nonzero()[0])}: ('next', 'action_mask') allows no action although "
                "the row is not terminated: allow at least the no-op"
            )


def check_tensor(
    name: str, value: torch.Tensor, dtype: torch.dtype, shape: tuple[int, ...]
) -> None:
    """Raise ValueError unless `value` has this dtype and shape."""
    if value.dtype != dtype or tuple(value.shape) != shape:
        raise ValueError(
            f"{name} is {_describe(value.dtype, value.shape)}, expected {_describe(dtype, shape)}"
        )


def make_array(num_rows: int, dtype: torch.dtype, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an array [num_rows, *shape] that is not filled.

    By NumPy: torch.empty would write every page under deterministic algorithms.
    """
    return np.empty((num_rows, *shape), _find_numpy_dtype(dtype))


@functools.cache
def _find_numpy_dtype(dtype: torch.dtype) -> np.dtype[Any]:
    return torch.empty((), dtype=dtype).numpy().dtype


def make_tensordict(fields: Mapping[Key, torch.Tensor]) -> TensorDict:
    """Make TensorDict [N] of fields [N, ...] by transition key."""
    batch = [len(fields[ACTION])]
    following = {key[1]: value for key, value in fields.items() if isinstance(key, tuple)}
    current = {key: value for key, value in fields.items() if isinstance(key, str)}
    return TensorDict({**current, "next": TensorDict(following, batch)}, batch)


def check_actions(action: torch.Tensor, action_mask: torch.Tensor) -> None:
    """Raise ValueError for an action int64 [N] outside of its mask bool [N, A]."""
    num_actions = action_mask.shape[-1]
    outside = (action < 0) | (action >= num_actions)
    if outside.any():
        row = int(outside.nonzero()[0])
        raise ValueError(f"row {row}: action is {int(action[row])}, expected 0..{num_actions - 1}")
    illegal = ~action_mask.gather(1, action.unsqueeze(1)).squeeze(1)
    if illegal.any():
        row = int(illegal.nonzero()[0])
        raise ValueError(
            f"row {row}: action {int(action[row])} is not legal by its action_mask; legal are "
            f"{action_mask[row].nonzero().flatten().tolist()}: choose the action under the mask"
        )


def _describe(dtype: torch.dtype, shape: Iterable[int]) -> str:
    return f"{str(dtype).removeprefix('torch.')} {list(shape)}"


def mark_generated(rows: TensorDict) -> None:
    """Change the labels of real `rows` to those of generated ones."""
    rows[IS_GENERATED].fill_(True)
    rows[EXPERT_ACTION].fill_(NO_ACTION)
    rows[INDEX].fill_(NO_INDEX)
    rows[OPPONENT].fill_(NO_OPPONENT)
