"""Compiled loops over the ring of steps: check and append rollouts, build n-step transitions.

Encoding of one entry's observation (a `row` of bytes) and of its action mask:

    row:  | planes 0 ... C-U-1, cell by cell | uniform planes C-U ... C-1, one byte each |
    mask: | actions 0..7, action 0 in the lowest bit | actions 8..15 | ... |

Entries lie in time order: entry number n (counted from the first one ever written) is in slot
n % capacity. A step's successor is always written after it, so it is overwritten after it as well:
from an entry that is still there every chain of successors leads to entries that are still there.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

NO_ENTRY = -1
NUM_WRITTEN, NUM_SAMPLEABLE = range(2)  # what `Ring.counters` counts
SOUND, UNIFORM_FAULT, ACTION_FAULT, LEGAL_FAULT, EXPERT_FAULT, MASK_FAULT, TAIL_FAULT = range(7)
SAVED_FAULTS = (
    "",
    "has a successor, but no action",
    "has an action that its mask does not allow",
    "leads to an entry without a legal action, but is not terminated",
)


class Ring(NamedTuple):
    """The stored steps; the first axis of all but `counters` is the slot."""

    rows: NDArray[np.uint8]  # [capacity, row_bytes]
    masks: NDArray[np.uint8]  # [capacity, mask_bytes]
    action: NDArray[np.int32]
    reward: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    done: NDArray[np.bool_]
    expert_action: NDArray[np.int32]  # the demonstrator's, or NO_ENTRY
    opponent: NDArray[np.int16]
    successor: NDArray[np.int64]  # slot of the stream's next entry, or NO_ENTRY
    sampleable: NDArray[np.bool_]  # has a successor; never true for a tail
    counters: NDArray[np.int64]  # [2]: NUM_WRITTEN, NUM_SAMPLEABLE


class Steps(NamedTuple):
    """A rollout of T * S steps, time first, with the final observations of steps that end."""

    observation: NDArray[np.uint8]  # [T * S, C * H * W * itemsize]
    action_mask: NDArray[np.bool_]  # [T * S, A]
    action: NDArray[np.int64]  # [T * S]
    reward: NDArray[np.float32]  # [T * S]
    terminated: NDArray[np.bool_]  # [T * S]
    truncated: NDArray[np.bool_]  # [T * S]
    learned: NDArray[np.bool_]  # [T * S]
    expert_action: NDArray[np.int64]  # [T * S]
    opponent: NDArray[np.int16]  # [T * S]
    final_row: NDArray[np.int64]  # [T * S] row in the two fields below, or NO_ENTRY
    final_observation: NDArray[np.uint8]  # [K, C * H * W * itemsize]
    final_action_mask: NDArray[np.bool_]  # [K, A]


class Rows(NamedTuple):
    """Transitions of a batch of N rows, which `gather_transitions` fills."""

    observation: NDArray[np.uint8]  # [N, C * H * W * itemsize]
    action_mask: NDArray[np.bool_]  # [N, A]
    action: NDArray[np.int64]  # [N]
    next_observation: NDArray[np.uint8]  # [N, C * H * W * itemsize]
    next_action_mask: NDArray[np.bool_]  # [N, A]
    next_reward: NDArray[np.float32]  # [N, 1]
    next_terminated: NDArray[np.bool_]  # [N, 1]
    next_done: NDArray[np.bool_]  # [N, 1]
    steps_to_next_obs: NDArray[np.int64]  # [N, 1]
    expert_action: NDArray[np.int64]  # [N]
    opponent: NDArray[np.int16]  # [N]


@njit(cache=True, nogil=True)
def find_fault(steps: Steps, board_bytes: int, num_cells: int) -> tuple[int, int]:
    """Return (fault, step) of the first step that cannot be stored, or (SOUND, NO_ENTRY)."""
    for k in range(steps.action.shape[0]):
        if not steps.learned[k]:
            continue
        action = steps.action[k]
        if action < 0 or action >= steps.action_mask.shape[1]:
            return ACTION_FAULT, k
        if not steps.action_mask[k, action]:
            return LEGAL_FAULT, k
        expert = steps.expert_action[k]
        if expert != NO_ENTRY and not is_legal(steps.action_mask[k], expert):
            return EXPERT_FAULT, k
        if not has_uniform_planes(steps.observation[k], board_bytes, num_cells):
            return UNIFORM_FAULT, k
        if steps.truncated[k] or steps.terminated[k]:
            row = steps.final_row[k]
            if row == NO_ENTRY:
                return TAIL_FAULT, k
            if not steps.terminated[k] and not steps.final_action_mask[row].any():
                return MASK_FAULT, k
            if not has_uniform_planes(steps.final_observation[row], board_bytes, num_cells):
                return UNIFORM_FAULT, k
    return SOUND, NO_ENTRY


@njit(cache=True, nogil=True)
def is_legal(action_mask: Any, action: int) -> bool:
    """Whether the action is in the action space and legal."""
    return bool(0 <= action < action_mask.shape[0] and action_mask[action])


@njit(cache=True, nogil=True)
def has_uniform_planes(observation: Any, board_bytes: int, num_cells: int) -> bool:
    """Whether each plane after the boards holds one value in all its cells."""
    for number in range((observation.shape[0] - board_bytes) // num_cells):
        start = board_bytes + number * num_cells
        plane = observation[start : start + num_cells]
        difference = np.uint8(0)
        for cell in range(num_cells):  # no early exit: so the loop runs on vectors
            difference |= plane[cell] ^ plane[0]
        if difference != 0:
            return False
    return True


@njit(cache=True, nogil=True)
def append_steps(
    ring: Ring, steps: Steps, open_ends: Any, slots: Any, board_bytes: int, num_cells: int
) -> None:
    """Write the learned steps into the ring and link each to its stream's step before.

    open_ends [S] int64: entry number of the newest step of each running stream, or NO_ENTRY;
    updated. slots [T * S] int64: filled with the slot of each step, NO_ENTRY where not learned.
    """
    num_streams = open_ends.shape[0]
    for k in range(steps.action.shape[0]):
        stream = k % num_streams
        slots[k] = NO_ENTRY
        if not steps.learned[k]:
            open_ends[stream] = NO_ENTRY  # a gap: later steps do not follow it
            continue
        number = ring.counters[NUM_WRITTEN]
        slot = write_entry(ring, steps.observation[k], steps.action_mask[k], board_bytes, num_cells)
        link_entries(ring, open_ends[stream], slot)
        slots[k] = slot
        done = steps.terminated[k] or steps.truncated[k]
        ring.action[slot] = steps.action[k]
        ring.reward[slot] = steps.reward[k]
        ring.expert_action[slot] = steps.expert_action[k]
        ring.opponent[slot] = steps.opponent[k]
        ring.terminated[slot] = steps.terminated[k]
        ring.done[slot] = done
        open_ends[stream] = NO_ENTRY if done else number
        if done:
            row = steps.final_row[k]
            observation, mask = steps.final_observation[row], steps.final_action_mask[row]
            tail = write_entry(ring, observation, mask, board_bytes, num_cells)
            link_entries(ring, number, tail)


@njit(cache=True, nogil=True)
def write_entry(
    ring: Ring, observation: Any, action_mask: Any, board_bytes: int, num_cells: int
) -> int:
    """Overwrite the oldest entry with one that has no successor yet; return its slot."""
    slot: int = ring.counters[NUM_WRITTEN] % ring.successor.shape[0]
    if ring.sampleable[slot]:
        ring.counters[NUM_SAMPLEABLE] -= 1
    ring.counters[NUM_WRITTEN] += 1
    ring.sampleable[slot] = False
    ring.successor[slot] = NO_ENTRY
    ring.action[slot] = NO_ENTRY
    ring.reward[slot] = 0.0
    ring.expert_action[slot] = NO_ENTRY
    ring.opponent[slot] = NO_ENTRY
    ring.terminated[slot] = False
    ring.done[slot] = False
    row = ring.rows[slot]
    for i in range(board_bytes):
        row[i] = observation[i]
    for plane in range(row.shape[0] - board_bytes):
        row[board_bytes + plane] = observation[board_bytes + plane * num_cells]
    pack_mask(action_mask, ring.masks[slot])
    return slot


@njit(cache=True, nogil=True)
def link_entries(ring: Ring, number: int, successor: int) -> None:
    """Make slot `successor`, the newest, follow entry `number` if that is still in the ring."""
    capacity = ring.successor.shape[0]
    if number == NO_ENTRY or number < ring.counters[NUM_WRITTEN] - capacity:
        return
    slot = number % capacity
    ring.successor[slot] = successor
    ring.sampleable[slot] = True
    ring.counters[NUM_SAMPLEABLE] += 1


@njit(cache=True, nogil=True)
def pack_mask(action_mask: Any, packed: Any) -> None:
    """Pack bools [A] into bits."""
    num_actions = action_mask.shape[0]
    for byte in range(packed.shape[0]):
        bits = 0
        for bit in range(min(8, num_actions - 8 * byte)):
            bits |= int(action_mask[8 * byte + bit]) << bit
        packed[byte] = bits


@njit(cache=True, nogil=True)
def gather_transitions(
    ring: Ring, index: Any, discounts: Any, rows: Rows, board_bytes: int, num_cells: int
) -> int:
    """Fill `rows` with the transitions that start at slots `index` [N]; return NO_ENTRY.

    discounts [n] float64: gamma^0 .. gamma^(n-1). Rewards are summed in float64 in time order and
    rounded once. If a slot cannot be sampled, returns its row instead; `rows` is then invalid.
    """
    for n in range(index.shape[0]):
        first = index[n]
        if first < 0 or first >= ring.successor.shape[0] or not ring.sampleable[first]:
            return n
        last = first
        num_steps = 1
        total = float(ring.reward[first])
        while num_steps < discounts.shape[0] and not ring.done[last]:
            following = ring.successor[last]
            if not ring.sampleable[following]:
                break
            last = following
            total += discounts[num_steps] * float(ring.reward[last])
            num_steps += 1
        rows.action[n] = ring.action[first]
        rows.next_reward[n, 0] = total
        rows.next_terminated[n, 0] = ring.terminated[last]
        rows.next_done[n, 0] = ring.done[last]
        rows.steps_to_next_obs[n, 0] = num_steps
        rows.expert_action[n] = ring.expert_action[first]
        rows.opponent[n] = ring.opponent[first]
        read_entry(ring, first, rows.observation[n], rows.action_mask[n], board_bytes, num_cells)
        observation, mask = rows.next_observation[n], rows.next_action_mask[n]
        read_entry(ring, ring.successor[last], observation, mask, board_bytes, num_cells)
    return NO_ENTRY


@njit(cache=True, nogil=True)
def read_entry(
    ring: Ring, slot: int, observation: Any, action_mask: Any, board_bytes: int, num_cells: int
) -> None:
    """Unpack the observation and action mask of one entry."""
    row = ring.rows[slot]
    for i in range(board_bytes):
        observation[i] = row[i]
    for plane in range(row.shape[0] - board_bytes):
        start = board_bytes + plane * num_cells
        # Assigning a slice is 12 times as fast as a loop over its cells.
        observation[start : start + num_cells] = row[board_bytes + plane]
    packed = ring.masks[slot]
    num_actions = action_mask.shape[0]
    for byte in range(packed.shape[0]):
        for bit in range(min(8, num_actions - 8 * byte)):
            action_mask[8 * byte + bit] = (packed[byte] >> bit) & 1 == 1


@njit(cache=True, nogil=True)
def find_saved_fault(ring: Ring, size: int) -> tuple[int, int]:
    """Return the first of `size` slots with an invalid step and its fault, or (NO_ENTRY, SOUND).

    The range of each field is checked before (`EpisodeStorage.load`).
    """
    for slot in range(size):
        following = ring.successor[slot]
        if ring.action[slot] == NO_ENTRY:
            if following != NO_ENTRY:
                return slot, 1
            continue
        masks = ring.masks[slot]
        if not has_bit(masks, ring.action[slot]):
            return slot, 2
        if ring.expert_action[slot] != NO_ENTRY and not has_bit(masks, ring.expert_action[slot]):
            return slot, 2
        if following != NO_ENTRY and not ring.terminated[slot] and not ring.masks[following].any():
            return slot, 3
    return NO_ENTRY, SOUND


@njit(cache=True, nogil=True)
def has_bit(packed: Any, number: int) -> bool:
    """Whether bit `number` of packed bytes is set."""
    return bool((packed[number // 8] >> (number % 8)) & 1)
