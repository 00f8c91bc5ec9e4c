"""The keys, shapes and dtypes of a transition, in one place, and the check of a batch of them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import torch
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

EXPERIENCE_KEYS: tuple[Key, ...] = (
    OBSERVATION,
    ACTION_MASK,
    ACTION,
    NEXT_OBSERVATION,
    NEXT_ACTION_MASK,
    NEXT_REWARD,
    NEXT_TERMINATED,
    NEXT_DONE,
)
LABEL_KEYS: tuple[Key, ...] = (
    STEPS_TO_NEXT_OBS,
    IS_GENERATED,
    EXPERT_ACTION,
    OPPONENT,
    INDEX,
)
TRANSITION_KEYS: tuple[Key, ...] = EXPERIENCE_KEYS + LABEL_KEYS

NO_ACTION = -1  # of EXPERT_ACTION: nobody shows what to do
NO_OPPONENT = -1  # the row met nobody that is known by number, or several
NO_INDEX = -1  # the row lies in no ring of real transitions


@dataclass(frozen=True)
class TransitionSpec:
    """What one transition is made of.

    observation_shape: planes first, [C, H, W], or [V] of a vector.
    num_actions: A.
    num_uniform: how many of the last planes are constant over the board (uint8 only).
    observation_dtype: dtype of the observation as the game gives it.
    Raises ValueError for sizes that cannot be.
    """

    observation_shape: tuple[int, ...]
    num_actions: int
    num_uniform: int = 0
    observation_dtype: torch.dtype = torch.uint8

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
        }


def check_transitions(
    transitions: TensorDict, spec: TransitionSpec, keys: Iterable[Key] = TRANSITION_KEYS
) -> None:
    """Raise ValueError unless `transitions` [N] holds `keys` as `spec` says and only legal actions.

    A row whose action is illegal, or that goes on without a legal next action, would make a masked
    loss infinite, so neither is let through.
    """
    if transitions.batch_dims != 1:
        raise ValueError(
            f"transitions have batch size {list(transitions.batch_size)}, expected [N]: "
            "flatten them with .reshape(-1)"
        )
    keys = tuple(keys)
    fields = spec.fields()
    for key in keys:
        dtype, shape = fields[key]
        _check_field(transitions, key, dtype, (len(transitions), *shape), keys)
    if len(transitions) and ACTION in keys and ACTION_MASK in keys:
        _check_actions(transitions[ACTION], transitions[ACTION_MASK])
    if len(transitions) and NEXT_ACTION_MASK in keys and NEXT_TERMINATED in keys:
        _check_next_masks(transitions[NEXT_ACTION_MASK], transitions[NEXT_TERMINATED])


def _check_field(
    transitions: TensorDict,
    key: Key,
    dtype: torch.dtype,
    shape: tuple[int, ...],
    keys: tuple[Key, ...],
) -> None:
    value = transitions.get(key, None)
    if value is None:
        raise ValueError(f"transitions lack {key!r}; they need {', '.join(map(repr, keys))}")
    if value.dtype != dtype or tuple(value.shape) != shape:
        raise ValueError(
            f"transitions hold {key!r} as {_describe(value.dtype, value.shape)}, "
            f"expected {_describe(dtype, shape)}"
        )


def _check_actions(action: torch.Tensor, action_mask: torch.Tensor) -> None:
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


def _check_next_masks(next_mask: torch.Tensor, terminated: torch.Tensor) -> None:
    stuck = ~next_mask.any(dim=1) & ~terminated.squeeze(1)
    if stuck.any():
        raise ValueError(
            f"row {int(stuck.nonzero()[0])}: ('next', 'action_mask') allows no action although the "
            "row is not terminated: allow at least the no-op"
        )


def _describe(dtype: torch.dtype, shape: Iterable[int]) -> str:
    return f"{str(dtype).removeprefix('torch.')} {list(shape)}"
