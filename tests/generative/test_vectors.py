"""A generator that learns from vectors: what is lost in bytes, and a small world that it learns."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from marl_cair.generative import CCDNGenerator, GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.generative.coded import CodedGenerator
from marl_cair.generative.rollouts import Rollouts
from marl_cair.generative.vectors import LEVELS, VectorCodec
from marl_cair.replay.transition import TransitionSpec, check_transitions
from tests.generative.rows import pack_rows

LOW, HIGH = (-1.0, 0.0), (1.0, 10.0)
SPEC = TransitionSpec((2,), num_actions=2, observation_dtype=torch.float32)


def make_rows(num: int, generator: torch.Generator) -> TensorDict:
    """A ball that falls by half a unit and can be thrown up by two: it pays where it is high and
    the game is over at the ground.
    """
    now = torch.rand(num, 2, generator=generator) * torch.tensor([2.0, 10.0]) + torch.tensor(LOW)
    action = torch.randint(2, (num,), generator=generator)
    height = (now[:, 1] - 0.5 + 2.5 * action).clamp(0.0, 10.0)
    later = torch.stack([now[:, 0], height], 1)
    return pack_rows(now, action, later, (height > 5.0).float(), height <= 0.0)


def make_generator() -> CodedGenerator:
    codec = VectorCodec(LOW, HIGH)
    spec = GeneratorSpec(
        codec.shape, 2, num_uniform=codec.num_uniform, noop_action=0, reward_range=(-1.0, 1.0)
    )
    size = NetworkSize(channels=4, hidden=32)
    return CodedGenerator(CCDNGenerator(GeneratorConfig(num_members=1, size=size), spec), codec)


def test_a_vector_comes_back_to_within_half_a_level() -> None:
    codec = VectorCodec(LOW, HIGH)
    vectors = make_rows(500, torch.Generator().manual_seed(0))["observation"]
    planes = codec.encode(vectors, vectors.flip(0))
    for part in planes:
        assert part.shape == (500, *codec.shape)
        assert part.dtype == torch.uint8
        assert (part[:, 0] == 0).all()
    assert torch.equal(planes[1], planes[0].flip(0))
    known = codec.decode(*planes)
    error = (known[0] - vectors).abs().amax(0)
    assert (error <= torch.tensor([2.0, 10.0]) / (2 * LEVELS) * 1.001).all()
    for part, again in zip(planes, codec.encode(*known), strict=True):
        assert torch.equal(part, again)
    outside = torch.tensor([[-7.0, 99.0]])
    came_back = codec.decode(*codec.encode(outside, outside))[1]
    torch.testing.assert_close(came_back, torch.tensor([[-1.0, 10.0]]))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ((0.0,), (1.0, 1.0), "low has 1 bounds, high 2"),
        ((0.0, 1.0), (1.0, 1.0), r"entry 1 is said to lie in 1.0..1.0: both bounds must be finite"),
        ((-float("inf"),), (1.0,), "entry 0 is said to lie in -inf..1.0"),
    ],
)
def test_bounds_that_hold_nothing_are_refused(
    low: tuple[float, ...], high: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        VectorCodec(low, high)


def test_a_falling_ball_is_learned_and_made() -> None:
    draws = torch.Generator().manual_seed(1)
    generator = make_generator()
    rows = make_rows(6000, draws)
    generator.observe(rows)
    empty = generator.generate(rows[:5], 10)
    assert len(empty) == 0  # nothing before the gate has looked
    for _ in range(500):
        generator.update(rows[torch.randint(6000, (128,), generator=draws)])
    report = generator.evaluate()
    assert report.passed, report.reasons
    assert generator.last_report == report
    made = generator.generate(rows[:500], 200)
    check_transitions(made, SPEC)
    assert len(made) > 100
    assert generator.last_generation["acceptance"] > 0.3
    fallen = made["next", "observation"][:, 1] - made["observation"][:, 1]
    expected = (-0.5 + 2.5 * made["action"]).float()
    free = (made["observation"][:, 1] > 0.6) & (made["observation"][:, 1] < 7.9)
    error = (fallen - expected)[free].abs()
    assert error.mean() < 0.1
    torch.testing.assert_close(
        made["next", "observation"][:, 0], made["observation"][:, 0], atol=0.02, rtol=0.0
    )
    begun = made["observation"].clone()
    rollouts = Rollouts(generator, lambda _, mask: mask[:, 1].long(), 0, 2, 0.9, 4)
    longer = rollouts.extend(made, 1)
    check_transitions(longer, SPEC)
    assert torch.equal(longer["observation"], begun)
    steps = longer["steps_to_next_obs"].squeeze(1)
    assert float((steps == 2).float().mean()) > 0.3
    fallen = (longer["next", "observation"] - longer["observation"])[:, 1]
    pushed = longer["action"] + (steps - 1)  # the second decision is always a push
    expected = (-0.5 * steps + 2.5 * pushed).float()
    free = (longer["observation"][:, 1] > 0.6) & (longer["observation"][:, 1] < 5.4)
    assert float((fallen - expected)[free].abs().mean()) < 0.15


def test_the_state_goes_on_with_the_same_bits() -> None:
    draws = torch.Generator().manual_seed(2)
    rows = make_rows(1000, draws)
    one, other = make_generator(), make_generator()
    one.observe(rows)
    one.update(rows[:64])
    other.load_state_dict(one.state_dict())
    assert one.update(rows[64:128]) == other.update(rows[64:128])
