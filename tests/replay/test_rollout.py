"""An invalid rollout is refused whole; the error names the place and the fix."""

import numpy as np
import pytest
import torch

from marl_cair.replay.rollout import Rollout
from marl_cair.replay.storage import EpisodeStorage
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


def take_finals(steps: list[int]) -> dict[str, torch.Tensor]:
    """Final observations of these steps."""
    rollout, num = make_sound_rollout(), len(steps)
    return {
        "final_step": torch.tensor(steps, dtype=torch.int64),
        "final_observation": rollout.final_observation.repeat(num, 1, 1, 1),
        "final_action_mask": rollout.final_action_mask.repeat(num, 1),
    }


FAULTS = [
    (change_entry("action", (1, 1), 11), "t=1, stream 1: action is 11, expected 0..10"),
    (change_entry("action", (1, 0), -1), "t=1, stream 0: action is -1, expected 0..10"),
    (change_entry("expert_action", (1, 1), 11), r"stream 1: expert_action 11 is not legal .*\["),
    (change_entry("action_mask", (3, 0), False), r"t=3, .* is not legal .*; legal are \[\]"),
    (change_entry("observation", (2, 0, 4, 1, 2), 7), "t=2, .* last 2 planes .* not constant"),
    (change_entry("final_observation", (0, 3, 0, 1), 7), "t=2, .* last 2 planes .* not constant"),
    (change_entry("final_action_mask", (0,), False), "t=2, .*: final_action_mask allows no action"),
    (take_finals([]), "t=2, stream 1: ends its episode but has no final observation"),
    ({"final_step": torch.tensor([4])}, "final_step holds 4, a step that is neither terminated"),
    ({"final_step": torch.tensor([8])}, r"final_step holds 8, expected t \* S \+ s in 0..7"),
    (take_finals([5, 5]), "final_step holds a step twice"),
    ({"reward": torch.zeros(4, 2).double()}, r"rollout.reward is float64 \[4, 2\], .* float32"),
    ({"action_mask": torch.ones(4, 2, 12).bool()}, r"action_mask is bool \[4, 2, 12\], .*11\]"),
    ({"action": torch.zeros(8, dtype=torch.int64)}, r"shape \[8\], expected \[T"),
]


def test_after_a_terminated_step_no_action_need_be_legal():
    rollout = make_sound_rollout()
    changes = {
        "terminated": rollout.truncated,
        "final_action_mask": torch.zeros_like(rollout.final_action_mask),
    }
    storage = EpisodeStorage(SMALL, 20)
    slots = storage.append(Rollout(**{**vars(rollout), **changes}))
    assert not storage.get(slots[5:6])["next", "action_mask"].any()


@pytest.mark.parametrize(("changes", "message"), FAULTS)
def test_an_invalid_rollout_is_refused_and_nothing_is_stored(changes, message):
    storage = EpisodeStorage(SMALL, 20)
    with pytest.raises(ValueError, match=message):
        storage.append(Rollout(**{**vars(make_sound_rollout()), **changes}))
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
        if value is not None and not name.startswith("final")
    }
    plain, viewed = EpisodeStorage(SMALL, 20), EpisodeStorage(SMALL, 20)
    plain.append(rollout)
    viewed.append(Rollout(**{**vars(rollout), **turned}))
    slots = plain.sampleable_slots()
    assert torch.equal(viewed.get(slots)["observation"], plain.get(slots)["observation"])
    assert torch.equal(viewed.get(slots)["action"], plain.get(slots)["action"])
