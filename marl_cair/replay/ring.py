"""Compiled loops over the ring of steps: append rollouts, build transitions and sequences.

Encoding of one entry's observation (a `row` of bytes) and of its action mask:

    row:  | planes 0 ... C-U-1, cell by cell | uniform planes C-U ... C-1, one byte each |
    mask: | actions 0..7, action 0 in the lowest bit | actions 8..15 | ... |

Entries lie in time order: entry number n (counted from the first one ever written) is in slot
n % capacity. A step's successor is always written after it, so it is overwritten after it as well:
from an entry that is still there every chain of successors leads to entries that are still there.

A run is a chain of entries of one stream; it goes on through ends of episodes, whose tails are
entries of it, until a step is not learned. Windows of K entries, of which the loss is, tile each
run: window i is at its entries i * K .. i * K + K - 1. It is sampled by the slot of its start, B
entries before it; window 0 starts at its first entry, if an episode begins there. It can be sampled
when the entry after it has been written, or when its run has ended. Transitions are windows of
K = 1, B = 0.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

NO_ENTRY = -1
NO_START, ZERO_STATE, FIRST = -3, -2, -1  # `state_row` of: no start, state 0, first of a run
NUM_WRITTEN, NUM_SAMPLEABLE, NUM_STATES = range(3)  # what `Ring.counters` counts
SOUND, UNIFORM_FAULT, ACTION_FAULT, LEGAL_FAULT, EXPERT_FAULT, MASK_FAULT, TAIL_FAULT = range(7)
SAVED_FAULTS = (
    "",
    "can be sampled, but starts no sequence with this state",
    "has an action that its mask does not allow",
    "leads to an entry without a legal action, but is not terminated",
)


class Ring(NamedTuple):
    """The stored steps; the first axis is the slot, of the last three fields another."""

    rows: NDArray[np.uint8]  # [capacity, row_bytes]
    masks: NDArray[np.uint8]  # [capacity, mask_bytes]
    action: NDArray[np.int32]
    reward: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    done: NDArray[np.bool_]
    expert_action: NDArray[np.int32]  # the demonstrator's, or NO_ENTRY
    opponent: NDArray[np.int16]
    other_actions: NDArray[np.int32]  # [capacity, O]
    successor: NDArray[np.int64]  # slot of the stream's next entry, or NO_ENTRY
    state_row: NDArray[np.int32]  # row in `states` of a start, or NO_START, ZERO_STATE, FIRST
    sampleable: NDArray[np.bool_]  # is the start of a window that can be sampled
    counters: NDArray[np.int64]  # [3]: NUM_WRITTEN, NUM_SAMPLEABLE, NUM_STATES
    states: NDArray[np.float32]  # [R, S] recurrent states before starts, the newest R
    state_owner: NDArray[np.int64]  # [R] entry number of the start


class Streams(NamedTuple):
    """Where each of S streams is."""

    open_ends: NDArray[np.int64]  # [S] entry number of the run's newest entry, or NO_ENTRY
    positions: NDArray[np.int64]  # [S] its place in the run, from 0
    starts: NDArray[np.int64]  # [S, 2] entry numbers of the starts of windows i, at i % 2


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
    other_actions: NDArray[np.int64]  # [T * S, O]
    state: NDArray[np.float32]  # [T * S, state size]
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
    other_actions: NDArray[np.int64]  # [N, O]


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
    ring: Ring, steps: Steps, streams: Streams, slots: Any, window: Any, sizes: Any
) -> None:
    """Write the learned steps into the ring and link each to its stream's entry before.

    streams: updated. slots [T * S] int64: filled with the slot of each step, NO_ENTRY where not
    learned. window: (K, B), sizes: (board_bytes, num_cells).
    """
    num_streams = streams.open_ends.shape[0]
    no_state = np.zeros(ring.states.shape[1], np.float32)
    for k in range(steps.action.shape[0]):
        stream = k % num_streams
        slots[k] = NO_ENTRY
        if not steps.learned[k]:
            end_run(ring, streams, stream, window[0])  # a gap: later steps do not follow it
            continue
        observation, mask = steps.observation[k], steps.action_mask[k]
        slot = write_entry(ring, observation, mask, sizes[0], sizes[1])
        place_entry(ring, streams, stream, steps.state[k], False, window)
        slots[k] = slot
        done = steps.terminated[k] or steps.truncated[k]
        ring.action[slot] = steps.action[k]
        ring.reward[slot] = steps.reward[k]
        ring.expert_action[slot] = steps.expert_action[k]
        ring.opponent[slot] = steps.opponent[k]
        ring.other_actions[slot] = steps.other_actions[k]
        ring.terminated[slot] = steps.terminated[k]
        ring.done[slot] = done
        if done:
            row = steps.final_row[k]
            observation, mask = steps.final_observation[row], steps.final_action_mask[row]
            write_entry(ring, observation, mask, sizes[0], sizes[1])
            place_entry(ring, streams, stream, no_state, True, window)


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
    ring.other_actions[slot] = NO_ENTRY
    ring.terminated[slot] = False
    ring.done[slot] = False
    ring.state_row[slot] = NO_START
    row = ring.rows[slot]
    for i in range(board_bytes):
        row[i] = observation[i]
    for plane in range(row.shape[0] - board_bytes):
        row[board_bytes + plane] = observation[board_bytes + plane * num_cells]
    pack_mask(action_mask, ring.masks[slot])
    return slot


@njit(cache=True, nogil=True)
def place_entry(
    ring: Ring, streams: Streams, stream: int, state: Any, is_tail: bool, window: Any
) -> None:
    """Make the newest entry the next one of its stream's run, or the first of a new run.

    state: float32 [S], recurrent, before the entry; of tails 0: their episode is over.
    """
    length, burn_in = window
    number = ring.counters[NUM_WRITTEN] - 1
    before, starts = streams.open_ends[stream], streams.starts[stream]
    streams.open_ends[stream] = number
    position = 0 if before == NO_ENTRY else streams.positions[stream] + 1
    streams.positions[stream] = position
    if position == 0:
        starts[:] = NO_ENTRY
    else:
        if is_stored(ring, before):
            ring.successor[before % ring.successor.shape[0]] = number % ring.successor.shape[0]
        if position % length == 0:
            open_window(ring, starts[(position // length - 1) % 2])
    if position > 0 and (position + burn_in) % length != 0:
        return
    is_zero = not state.any()
    is_start = (position > 0 or is_zero) and not (is_tail and length == 1)
    starts[(position + burn_in) // length % 2] = number if is_start else NO_ENTRY
    if is_start:
        write_state(ring, number, state, is_zero, position == 0)


@njit(cache=True, nogil=True)
def write_state(ring: Ring, number: int, state: Any, is_zero: bool, is_first: bool) -> None:
    """Write the state of the start `number`, if it is not 0, over the oldest one."""
    slot = number % ring.successor.shape[0]
    if is_zero:
        ring.state_row[slot] = FIRST if is_first else ZERO_STATE
        return
    row = ring.counters[NUM_STATES] % ring.states.shape[0]
    if ring.counters[NUM_STATES] >= ring.states.shape[0] and is_stored(ring, ring.state_owner[row]):
        last = ring.state_owner[row] % ring.successor.shape[0]
        ring.counters[NUM_SAMPLEABLE] -= ring.sampleable[last]
        ring.sampleable[last] = False
    ring.counters[NUM_STATES] += 1
    ring.states[row] = state
    ring.state_owner[row] = number
    ring.state_row[slot] = row


@njit(cache=True, nogil=True)
def open_window(ring: Ring, start: int) -> None:
    """Let the window of entry number `start` be sampled, if that is still in the ring."""
    if start == NO_ENTRY or not is_stored(ring, start):
        return
    slot = start % ring.successor.shape[0]
    row = ring.state_row[slot]
    if row == NO_START or (row >= 0 and ring.state_owner[row] != start):
        return
    ring.sampleable[slot] = True
    ring.counters[NUM_SAMPLEABLE] += 1


@njit(cache=True, nogil=True)
def end_run(ring: Ring, streams: Streams, stream: int, length: int) -> None:
    """Let the last window be sampled if one of its steps is sure to have a successor."""
    position, last = streams.positions[stream], streams.open_ends[stream]
    streams.open_ends[stream] = NO_ENTRY
    if last == NO_ENTRY:
        return
    is_tail = ring.action[last % ring.successor.shape[0]] == NO_ENTRY
    if position % length > (0 if is_tail else 1):
        open_window(ring, streams.starts[stream, position // length % 2])


@njit(cache=True, nogil=True)
def is_stored(ring: Ring, number: int) -> bool:
    """Whether entry `number` has not been overwritten."""
    return bool(number >= ring.counters[NUM_WRITTEN] - ring.successor.shape[0])


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
    rounded once. If a slot starts none, returns its row instead; `rows` is then invalid.
    """
    for n in range(index.shape[0]):
        first = index[n]
        if first < 0 or not is_followed(ring, first):
            return n
        last = first
        num_steps = 1
        total = float(ring.reward[first])
        while num_steps < discounts.shape[0] and not ring.done[last]:
            following = ring.successor[last]
            if not is_followed(ring, following):
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
        rows.other_actions[n] = ring.other_actions[first]
        read_entry(ring, first, rows.observation[n], rows.action_mask[n], board_bytes, num_cells)
        observation, mask = rows.next_observation[n], rows.next_action_mask[n]
        read_entry(ring, ring.successor[last], observation, mask, board_bytes, num_cells)
    return NO_ENTRY


@njit(cache=True, nogil=True)
def is_followed(ring: Ring, slot: int) -> bool:
    """Whether the slot holds a step whose next entry is stored: a transition of one step."""
    size = min(ring.counters[NUM_WRITTEN], ring.successor.shape[0])
    return bool(slot < size and ring.action[slot] != NO_ENTRY and ring.successor[slot] != NO_ENTRY)


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
        following, row = ring.successor[slot], ring.state_row[slot]
        if ring.sampleable[slot]:
            if following == NO_ENTRY or row == NO_START:
                return slot, 1
            if row >= 0 and ring.state_owner[row] % ring.successor.shape[0] != slot:
                return slot, 1
        if ring.action[slot] == NO_ENTRY:
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
