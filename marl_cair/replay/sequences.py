"""Sequences of a ring of steps: stored state, burn-in steps, learned steps (R2D2).

R2D2 (Kapturowski et al. 2019) never lets a sequence cross the end of an episode; these do, and the
state is 0 again there: else short episodes would fill batches with padding.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.replay import transition
from marl_cair.replay.ring import FIRST, NO_ENTRY, Ring, read_entry
from marl_cair.replay.transition import TransitionSpec

STATE, STARTS, LEARNED, REWARD, TERMINATED = "state", "starts", "learned", "reward", "terminated"
_MAX_SHARE = 0.9  # of a sequence's largest TD error in its priority, beside the mean (R2D2's eta)


def sequence_fields(spec: TransitionSpec) -> dict[str, tuple[torch.dtype, tuple[int, ...]]]:
    """Dtype and shape of one entry of a sequence, by key; "state" is the same at all entries."""
    fields = spec.fields()
    one_step = ("observation", "action_mask", "action", "expert_action", "opponent")
    return {
        **{name: fields[name] for name in one_step},
        REWARD: (torch.float32, ()),
        **dict.fromkeys((TERMINATED, STARTS, LEARNED, "is_generated"), (torch.bool, ())),
        STATE: (torch.float32, (spec.state_size,)),
    }


class Sequences(NamedTuple):
    """A batch of N sequences of T entries, which `gather_sequences` fills."""

    observation: NDArray[np.uint8]  # [N, T, C * H * W * itemsize]
    action_mask: NDArray[np.bool_]  # [N, T, A]
    action: NDArray[np.int64]  # [N, T], 0 of tails
    reward: NDArray[np.float32]  # [N, T]
    terminated: NDArray[np.bool_]  # [N, T]
    starts: NDArray[np.bool_]  # [N, T]
    learned: NDArray[np.bool_]  # [N, T]
    expert_action: NDArray[np.int64]  # [N, T]
    opponent: NDArray[np.int16]  # [N, T]
    state: NDArray[np.float32]  # [N, S]


def read_sequences(
    ring: Ring, spec: TransitionSpec, index: torch.Tensor, window: tuple[int, int]
) -> TensorDict:
    """The sequences that start at slots `index` int64 [N], as TensorDict [N, T], T = B + K + 1.

    window: (K, B), K learned steps after B of burn-in; the last entry only gives the last step's
    next value. Entries are steps, or the final observations of episodes.

    Keys: those of a transition that are of one step, "reward" float32 and "terminated" bool, both
    of the step; "starts" bool, an episode begins; "learned" bool, a step with a known next entry,
    after the burn-in; "state" float32 [N, T, S] before the first entry (the same at all T).
    What is missing before the first step of a run, or after its end, repeats the nearest entry.
    Raises IndexError for a slot that starts no sequence.
    """
    batch = len(index), window[1] + window[0] + 1
    fields = spec.fields()

    def make(key: transition.Key) -> NDArray[Any]:
        dtype, shape = fields[key]
        return transition.make_array(batch[0], dtype, (batch[1], *shape))

    observation = make(transition.OBSERVATION)
    flat = observation.reshape(*batch, math.prod(spec.observation_shape))
    rows = Sequences(
        observation=flat.view(np.uint8),
        action_mask=make(transition.ACTION_MASK),
        action=np.zeros(batch, np.int64),
        reward=np.zeros(batch, np.float32),
        terminated=np.zeros(batch, np.bool_),
        starts=np.zeros(batch, np.bool_),
        learned=np.zeros(batch, np.bool_),
        expert_action=np.full(batch, transition.NO_ACTION, np.int64),
        opponent=np.full(batch, transition.NO_OPPONENT, np.int16),
        state=np.zeros((batch[0], spec.state_size), np.float32),
    )
    slots = np.ascontiguousarray(index.numpy())
    wrong = gather_sequences(ring, slots, window[1], rows, spec.board_bytes, spec.num_cells)
    if wrong != NO_ENTRY:
        raise IndexError(f"slot {slots[wrong]} starts no sequence: take slots from a sampler")
    arrays: dict[str, NDArray[Any]] = {**rows._asdict(), "observation": observation}
    tensors = {name: torch.from_numpy(array) for name, array in arrays.items()}
    tensors[STATE] = tensors[STATE].unsqueeze(1).expand(*batch, spec.state_size)
    tensors["is_generated"] = torch.zeros(batch, dtype=torch.bool)
    return TensorDict(tensors, batch)


def find_sequence_errors(td_error: torch.Tensor, learned: torch.Tensor) -> torch.Tensor:
    """One error of each sequence, float32 [N], for its priority: 0.9 of the largest and 0.1 of the
    mean of its learned steps' |TD errors|. td_error: float32 [N, T]; learned: bool [N, T].
    """
    errors = td_error.abs().masked_fill(~learned, 0.0)
    mean = errors.sum(1) / learned.sum(1).clamp_min(1)
    return _MAX_SHARE * errors.amax(1) + (1.0 - _MAX_SHARE) * mean


def check_sequences(rows: TensorDict, spec: TransitionSpec, num_entries: int) -> None:
    """Raise ValueError unless `rows` [N, num_entries] are sequences as `spec` says, with legal
    actions at all steps that are learned, of which the last entry is none.
    """
    if rows.batch_dims != 2 or rows.shape[1] != num_entries:
        raise ValueError(
            f"sequences have batch size {list(rows.batch_size)}, expected [N, {num_entries}]"
        )
    for key, (dtype, shape) in sequence_fields(spec).items():
        value = rows.get(key, None)
        if value is None:
            raise ValueError(f"sequences lack {key!r}: give the keys of `read_sequences`")
        transition.check_tensor(f"sequences[{key!r}]", value, dtype, (*rows.shape, *shape))
    learned = rows[LEARNED]
    if bool(learned[:, -1].any()):
        raise ValueError("the last entry of a sequence is learned, but what follows is not known")
    transition.check_actions(rows["action"][learned], rows["action_mask"][learned])


@njit(cache=True, nogil=True)
def gather_sequences(
    ring: Ring, index: Any, burn_in: int, rows: Sequences, board_bytes: int, num_cells: int
) -> int:
    """Fill `rows` with the sequences that start at slots `index` [N]; return NO_ENTRY, or the row
    of a slot that cannot be sampled.
    """
    num_entries = rows.action.shape[1]
    for n in range(index.shape[0]):
        entry = index[n]
        if entry < 0 or entry >= ring.successor.shape[0] or not ring.sampleable[entry]:
            return n
        state_row = ring.state_row[entry]
        if state_row >= 0:
            rows.state[n] = ring.states[state_row]
        first = burn_in if state_row == FIRST else 0
        begins, last = state_row == FIRST, first
        for t in range(first, num_entries):
            observation, mask = rows.observation[n, t], rows.action_mask[n, t]
            read_entry(ring, entry, observation, mask, board_bytes, num_cells)
            following, is_step = ring.successor[entry], ring.action[entry] != NO_ENTRY
            rows.starts[n, t] = begins
            if is_step:
                rows.action[n, t] = ring.action[entry]
                rows.reward[n, t] = ring.reward[entry]
                rows.terminated[n, t] = ring.terminated[entry]
                rows.expert_action[n, t] = ring.expert_action[entry]
                rows.opponent[n, t] = ring.opponent[entry]
            last = t
            if following == NO_ENTRY or t == num_entries - 1:
                break
            rows.learned[n, t] = is_step and t >= burn_in
            begins, entry = not is_step, following
        for t in range(num_entries):
            nearest = min(max(t, first), last)
            if nearest != t:
                rows.observation[n, t] = rows.observation[n, nearest]
                rows.action_mask[n, t] = rows.action_mask[n, nearest]
    return NO_ENTRY
