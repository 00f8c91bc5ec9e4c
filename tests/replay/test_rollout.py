"""An invalid rollout is refused whole; the error names the place and the fix."""

import numpy as np
import pytest
import torch

from marl_cair.replay import EpisodeStorage, Rollout
from tests.replay.streams import SMALL, make_rollout


def make_sound_rollout() -> Rollout:
    rollout = make_rollout(np.random.default_rng(3), 4, 2, end_rate=0.0, learned_rate=1.1)
    truncated = torch.zeros(4, 2, dtype=torch.bool)
    truncated[2, 1] = True
    return Rollout(
        **{
            **vars(rollout),
            "truncated": truncated,
            "final_step": torch.tensor([5]),
            "final_observation": rollout.observation[3, 1].unsqueeze(0),
            "final_action_mask": rollout.action_mask[3, 1].unsqueeze(0),
        }
    )


def change_entry(name: str, place: tuple[int, ...], value: object) -> dict[str, torch.Tensor]:
    changed = getattr(make_sound_rollout(), name).clone()
    changed[place] = value
    return {name: changed}


def no_finals() -> dict[str, torch.Tensor]:
    rollout = make_sound_rollout()
    names = ("final_step", "final_observation", "final_action_mask")
    return {name: getattr(rollout, name)[:0] for name in names}


def two_finals(steps: list[int]) -> dict[str, torch.Tensor]:
    rollout = make_sound_rollout()
    return {
        "final_step": torch.tensor(steps),
        "final_observation": rollout.final_observation.repeat(2, 1, 1, 1),
        "final_action_mask": rollout.final_action_mask.repeat(2, 1),
    }


FAULTS = {
    "action": (
        lambda: change_entry("action", (1, 1), 11),
        r"t=1, stream 1: action is 11, expected 0..10",
    ),
    "negative action": (
        lambda: change_entry("action", (1, 0), -1),
        r"t=1, stream 0: action is -1, expected 0..10",
    ),
    "expert's action": (
        lambda: change_entry("expert_action", (1, 1), 11),
        r"t=1, stream 1: expert_action 11 is not legal by its action_mask; legal are \[",
    ),
    "illegal": (
        lambda: change_entry("action_mask", (3, 0), False),
        r"t=3, stream 0: action \d+ is not legal by its action_mask; legal are \[\]",
    ),
    "uniform": (
        lambda: change_entry("observation", (2, 0, 4, 1, 2), 7),
        r"t=2, stream 0: one of the last 2 planes .* not constant",
    ),
    "uniform final": (
        lambda: change_entry("final_observation", (0, 3, 0, 1), 7),
        r"t=2, stream 1: one of the last 2 planes .* not constant",
    ),
    "final mask": (
        lambda: change_entry("final_action_mask", (0,), False),
        r"t=2, stream 1: final_action_mask allows no action",
    ),
    "no final": (
        no_finals,
        r"t=2, stream 1: ends its episode but has no final observation: add it to final_step",
    ),
    "final of a running step": (
        lambda: {"final_step": torch.tensor([4])},
        r"final_step holds 4, a step that is neither terminated nor truncated",
    ),
    "final outside": (
        lambda: {"final_step": torch.tensor([8])},
        r"final_step holds 8, expected t \* S \+ s in 0..7",
    ),
    "final twice": (lambda: two_finals([5, 5]), r"final_step holds a step twice"),
    "dtype": (
        lambda: {"reward": torch.zeros(4, 2, dtype=torch.float64)},
        r"rollout.reward is float64 \[4, 2\], expected float32 \[4, 2\]",
    ),
    "shape": (
        lambda: {"action_mask": torch.ones(4, 2, 12, dtype=torch.bool)},
        r"rollout.action_mask is bool \[4, 2, 12\], expected bool \[4, 2, 11\]",
    ),
    "flat": (lambda: {"action": torch.zeros(8, dtype=torch.int64)}, r"shape \[8\], expected \[T"),
}


def test_after_a_terminated_step_no_action_need_be_legal():
    rollout = make_sound_rollout()
    changes = {
        "terminated": rollout.truncated,
        "final_action_mask": torch.zeros_like(rollout.final_action_mask),
    }
    storage = EpisodeStorage(SMALL, 20)
    slots = storage.append(Rollout(**{**vars(rollout), **changes}))
    assert not storage.get(slots[5:6])["next", "action_mask"].any()


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_rollout_is_refused_and_nothing_is_stored(name):
    make_change, message = FAULTS[name]
    storage = EpisodeStorage(SMALL, 20)
    with pytest.raises(ValueError, match=message):
        storage.append(Rollout(**{**vars(make_sound_rollout()), **make_change()}))
    assert storage.num_written == 0
    storage.append(make_sound_rollout())
    assert storage.num_written == 9


def test_steps_that_are_not_learned_are_not_looked_at():
    learned = torch.ones(4, 2, dtype=torch.bool)
    learned[1, 1] = False
    change = {"learned": learned, **change_entry("action", (1, 1), 999)}
    storage = EpisodeStorage(SMALL, 20)
    storage.append(Rollout(**{**vars(make_sound_rollout()), **change}))
    assert storage.num_written == 8


def test_rollouts_that_are_views_of_world_first_tensors_are_stored_alike():
    rollout = make_sound_rollout()
    turned = {
        name: value.transpose(0, 1).contiguous().transpose(0, 1)
        for name, value in vars(rollout).items()
        if not name.startswith("final")
    }
    plain, viewed = EpisodeStorage(SMALL, 20), EpisodeStorage(SMALL, 20)
    plain.append(rollout)
    viewed.append(Rollout(**{**vars(rollout), **turned}))
    slots = plain.sampleable_slots()
    assert torch.equal(viewed.get(slots)["observation"], plain.get(slots)["observation"])
    assert torch.equal(viewed.get(slots)["action"], plain.get(slots)["action"])
