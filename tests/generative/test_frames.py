"""A generator that learns from stacks of pictures: a small film that it goes on with."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative import CCDNGenerator, GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.generative.coded import CodedGenerator, FrameCodec
from marl_cair.replay.transition import TransitionSpec, check_transitions
from tests.generative.rows import pack_rows

SIDE, FRAMES = 16, 2
SHAPE = (FRAMES, SIDE, SIDE)
LEFT, RIGHT = range(2)
SPEC = GeneratorSpec(SHAPE, 2, num_uniform=0, noop_action=LEFT, num_frames=FRAMES, tolerance=8)


def paint(place: Tensor) -> Tensor:
    """Pictures uint8 [N, 16, 16] of a bar, two pixels wide, whose left edge is at `place` float
    [N], over a sky that is lighter below: pixels are shades of how much of them it covers.
    """
    column = torch.arange(SIDE).float()
    covered = torch.minimum(column + 1, place[:, None] + 2) - torch.maximum(column, place[:, None])
    sky = 40.0 + 4.0 * torch.arange(SIDE).float()[None, :, None]
    return (sky + covered.clamp(0.0, 1.0)[:, None] * (220.0 - sky)).round().to(torch.uint8)


def make_rows(num: int, generator: torch.Generator) -> TensorDict:
    """The bar drifts by half a pixel, to and fro by a whole one more as the action says. Beyond
    pixel 11 it pays, and at the left edge the film is over.
    """
    before = 14.0 * torch.rand(num, generator=generator)
    drift = torch.where(torch.rand(num, generator=generator) < 0.5, -0.5, 0.5)
    now = (before + drift).clamp(0.0, 14.0)
    action = torch.randint(2, (num,), generator=generator)
    later = (now + 1.5 * (2.0 * action - 1.0)).clamp(0.0, 14.0)
    return pack_rows(
        torch.stack([paint(before), paint(now)], 1),
        action,
        torch.stack([paint(now), paint(later)], 1),
        (later > 11.0).float(),
        later <= 0.0,
    )


def make_generator() -> CodedGenerator:
    size = NetworkSize(frame_channels=16, hidden=32)
    config = GeneratorConfig(num_members=1, size=size, heldout_capacity=800)
    return CodedGenerator(CCDNGenerator(config, SPEC), FrameCodec())


def test_of_a_later_stack_only_the_newest_picture_is_kept_and_it_comes_back() -> None:
    rows = make_rows(50, torch.Generator().manual_seed(0))
    now, later = rows["observation"], rows["next", "observation"]
    encoded = FrameCodec().encode(now, later)
    assert torch.equal(encoded[1][:, 0], now[:, 0])
    assert torch.equal(encoded[1][:, 1], later[:, 1])
    decoded = FrameCodec().decode(*encoded)
    assert torch.equal(decoded[0], now)
    assert torch.equal(decoded[1], later)


def test_a_film_is_learned_and_goes_on() -> None:
    draws = torch.Generator().manual_seed(1)
    generator = make_generator()
    rows = make_rows(4000, draws)
    generator.observe(rows)
    assert len(generator.generate(rows[:5], 10)) == 0  # nothing before the gate has looked
    for _ in range(500):
        generator.update(rows[torch.randint(4000, (64,), generator=draws)])
    report = generator.evaluate()
    assert report.passed, report.reasons
    made = generator.generate(rows[:500], 200)
    check_transitions(made, TransitionSpec(SHAPE, num_actions=2))
    assert len(made) > 100
    assert torch.equal(made["next", "observation"][:, 0], made["observation"][:, 1])
    # Where the bar is, by its light; and where it should be.
    place, after = (find_place(made[key][:, 1]) for key in ("observation", ("next", "observation")))
    expected = (place + 1.5 * (2.0 * made["action"] - 1.0)).clamp(0.0, 14.0)
    error = (after - expected).abs()
    assert float(error.mean()) < 0.25
    pays = (made["next", "reward"].squeeze(-1) > 0.5).float()
    sure = (after - 11.0).abs() > 0.5
    assert float((pays == (after > 11.0).float())[sure].float().mean()) > 0.95
    new = make_rows(400, draws)
    predicted, accepted = generator.predict(new.select("observation", "action_mask", "action"))
    assert torch.equal(predicted["observation"], new["observation"])
    assert torch.equal(predicted["next", "observation"][:, 0], new["observation"][:, 1])
    drawn, real = (find_place(part["next", "observation"][:, 1]) for part in (predicted, new))
    assert float(accepted.float().mean()) > 0.5
    assert float((drawn - real)[accepted].abs().mean()) < 0.25


def find_place(pictures: Tensor) -> Tensor:
    light = (pictures.float() - paint(torch.full((1,), -5.0)).float()).clamp_min(0.0).sum(1)
    column = torch.arange(SIDE).float() + 0.5
    return (light * column).sum(1) / light.sum(1).clamp_min(1.0) - 1.0


def test_the_state_goes_on_with_the_same_bits() -> None:
    rows = make_rows(400, torch.Generator().manual_seed(2))
    one, other = make_generator(), make_generator()
    one.observe(rows)
    one.update(rows[:64])
    other.load_state_dict(one.state_dict())
    assert one.update(rows[64:128]) == other.update(rows[64:128])


def test_pictures_that_cannot_be_cut_into_patches_are_refused() -> None:
    spec = GeneratorSpec((2, 18, 16), 2, num_uniform=0, noop_action=0, num_frames=2)
    with pytest.raises(ValueError, match="pictures are 18 x 16, but both sides must be multiples"):
        CCDNGenerator(GeneratorConfig(), spec)


def test_planes_that_are_no_pictures_are_refused() -> None:
    with pytest.raises(ValueError, match="num_frames is 2, num_uniform 1: each of the 3 planes"):
        GeneratorSpec((3, 16, 16), 2, num_uniform=1, noop_action=0, num_frames=2)
