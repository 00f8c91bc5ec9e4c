"""What the fields of a saved ring may hold: checked before compiled loops follow its links."""

from typing import Any

from numba import njit

from marl_cair.ranges import NUMBER, Range
from marl_cair.replay.ring import NO_ENTRY

LINKED_FIELDS = ("action", "expert_action", "terminated", "done", "successor", "masks")
_SOUND, _TAIL, _ILLEGAL, _STUCK = range(4)
SAVED_FAULTS = {
    _TAIL: "has a successor, but no action",
    _ILLEGAL: "has an action that its mask does not allow",
    _STUCK: "leads to an entry without a legal action, but is not terminated",
}


def saved_ranges(num_actions: int, size: int) -> dict[str, Range]:
    """The range of each field of `size` entries; others may hold whatever their dtype does."""
    actions = Range(NO_ENTRY, num_actions - 1)
    return {
        "action": actions,
        "expert_action": actions,
        "reward": NUMBER,
        "opponent": Range(NO_ENTRY, 2**15 - 1),
        "successor": Range(NO_ENTRY, size - 1),
    }


@njit(cache=True, nogil=True)
def find_saved_fault(
    action: Any, expert_action: Any, terminated: Any, done: Any, successor: Any, masks: Any
) -> tuple[int, int]:
    """The first slot whose step no learner could take, and why, or (NO_ENTRY, 0).

    All but `masks` [N, bytes] are [N], each in its range.
    """
    for slot in range(action.shape[0]):
        following = successor[slot]
        if action[slot] == NO_ENTRY:
            if following != NO_ENTRY:
                return slot, _TAIL
            continue
        if not _has_bit(masks[slot], action[slot]):
            return slot, _ILLEGAL
        if expert_action[slot] != NO_ENTRY and not _has_bit(masks[slot], expert_action[slot]):
            return slot, _ILLEGAL
        if following != NO_ENTRY and not terminated[slot] and not masks[following].any():
            return slot, _STUCK
    return NO_ENTRY, _SOUND


@njit(cache=True, nogil=True)
def _has_bit(packed: Any, number: int) -> bool:
    return bool((packed[number // 8] >> (number % 8)) & 1)
