"""Generators of frames and vectors: exact codecs, and small games that they learn."""

import pytest
import torch

from marl_cair.generative.codecs import LEVELS, FrameCodec, VectorCodec, make_coded_generator
from marl_cair.generative.gate import check_quality
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.quality import Imagined, measure_rows
from marl_cair.generative.rollouts import Rollouts
from marl_cair.generative.settings import GateConfig, GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.replay.transition import TransitionSpec, check_transitions
from tests.generative.plane_game import pack_rows

SIDE, FRAMES = 16, 2
FRAME_SHAPE = (FRAMES, SIDE, SIDE)
FRAME_SPEC = GeneratorSpec(
    FRAME_SHAPE, 2, num_uniform=0, noop_action=0, num_frames=FRAMES, tolerance=8
)
LOW, HIGH = (-1.0, 0.0), (1.0, 10.0)


def paint(place):
    """Frames uint8 [N, 16, 16] of a bar, two pixels wide, whose left edge is at `place` float [N],
    over a sky that is lighter below: shades show the covered part of a pixel.
    """
    column = torch.arange(SIDE).float()
    covered = torch.minimum(column + 1, place[:, None] + 2) - torch.maximum(column, place[:, None])
    sky = 40.0 + 4.0 * torch.arange(SIDE).float()[None, :, None]
    return (sky + covered.clamp(0.0, 1.0)[:, None] * (220.0 - sky)).round().to(torch.uint8)


def find_place(frames):
    light = (frames.float() - paint(torch.full((1,), -5.0)).float()).clamp_min(0.0).sum(1)
    column = torch.arange(SIDE).float() + 0.5
    return (light * column).sum(1) / light.sum(1).clamp_min(1.0) - 1.0


def make_frame_rows(num, generator):
    """The bar drifts by half a pixel, and by 1.5 left or right by the action. Beyond pixel 11 it
    pays, at the left edge the episode ends.
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


def make_frame_generator():
    size = NetworkSize(channels=16, depth=2, hidden=32)
    config = GeneratorConfig(size=size, heldout_capacity=800)
    return make_coded_generator(CCDNGenerator(config, FRAME_SPEC), FrameCodec())


def make_vector_rows(num, generator):
    """A ball falls by half a unit and can be thrown up by two: it pays above 5, the episode ends at
    the ground.
    """
    now = torch.rand(num, 2, generator=generator) * torch.tensor([2.0, 10.0]) + torch.tensor(LOW)
    action = torch.randint(2, (num,), generator=generator)
    height = (now[:, 1] - 0.5 + 2.5 * action).clamp(0.0, 10.0)
    later = torch.stack([now[:, 0], height], 1)
    return pack_rows(now, action, later, (height > 5.0).float(), height <= 0.0)


def make_vector_generator():
    codec = VectorCodec(LOW, HIGH)
    spec = GeneratorSpec(codec.shape, 2, num_uniform=codec.num_uniform, noop_action=0)
    config = GeneratorConfig(size=NetworkSize(channels=4, depth=1, hidden=32))
    return make_coded_generator(CCDNGenerator(config, spec), codec)


def train(generator, make_rows, num_rows, batch_size):
    """Observe and learn until the gate opens; returns the rows."""
    draws = torch.Generator().manual_seed(1)
    rows = make_rows(num_rows, draws)
    generator.observe(rows)
    assert len(generator.generate(rows[:5], 10)) == 0  # before the first evaluation
    for _ in range(500):
        generator.update(rows[torch.randint(num_rows, (batch_size,), generator=draws)])
    report = generator.evaluate()
    assert report.passed, report.reasons
    assert generator.last_report == report
    return rows


def test_a_stack_of_frames_is_decoded_exactly():
    rows = make_frame_rows(50, torch.Generator().manual_seed(0))
    now, later = rows["observation"], rows["next", "observation"]
    encoded = FrameCodec().encode(now, later)
    assert torch.equal(encoded[1], torch.stack([now[:, 0], later[:, 1]], 1))
    for part, expected in zip(FrameCodec().decode(*encoded), (now, later), strict=True):
        assert torch.equal(part, expected)


def test_the_gate_sees_that_a_vector_is_only_copied():
    codec, random = VectorCodec(LOW, HIGH), torch.Generator().manual_seed(0)
    rows = make_vector_rows(200, random)
    now, later = codec.encode(rows["observation"], rows["next", "observation"])
    spec = GeneratorSpec(codec.shape, 2, codec.num_uniform, noop_action=0)
    coded = rows.exclude("observation", ("next", "observation"))
    coded["observation"], coded["next", "observation"] = now, later
    end, mask = torch.zeros(len(rows)), rows["next", "action_mask"]
    shares = []
    for guess in (now, later):
        made = Imagined(guess, mask, rows["next", "reward"][:, 0], end, end)
        found = measure_rows(coded, made, spec)
        shares.append(found["cells/change_explained"])
        reasons = check_quality({**found, "rare/num_rewards": 0, "rare/num_ends": 0}, GateConfig())
        assert any("explained share of change" in one for one in reasons) == (guess is now)
    assert shares == [0.0, 1.0]


def test_a_vector_is_decoded_to_half_a_level():
    codec = VectorCodec(LOW, HIGH)
    vectors = make_vector_rows(500, torch.Generator().manual_seed(0))["observation"]
    planes = codec.encode(vectors, vectors.flip(0))
    for part in planes:
        assert part.shape == (500, *codec.shape)
        assert part.dtype == torch.uint8
        assert (part[:, 0] == 0).all()
    assert torch.equal(planes[1], planes[0].flip(0))
    decoded = codec.decode(*planes)
    error = (decoded[0] - vectors).abs().amax(0)
    assert (error <= torch.tensor([2.0, 10.0]) / (2 * LEVELS) * 1.001).all()
    for part, again in zip(planes, codec.encode(*decoded), strict=True):
        assert torch.equal(part, again)
    outside = torch.tensor([[-7.0, 99.0]])
    bounded = codec.decode(*codec.encode(outside, outside))[1]
    torch.testing.assert_close(bounded, torch.tensor([[-1.0, 10.0]]))


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ((0.0,), (1.0, 1.0), "low has 1 bounds, high 2"),
        ((0.0, 1.0), (1.0, 1.0), r"entry 1 has the bounds 1.0..1.0: both must be finite"),
        ((-float("inf"),), (1.0,), "entry 0 has the bounds -inf..1.0"),
    ],
)
def test_invalid_bounds_are_refused(low, high, message):
    with pytest.raises(ValueError, match=message):
        VectorCodec(low, high)


@pytest.mark.slow
def test_frames_are_learned_and_generated():
    generator = make_frame_generator()
    rows = train(generator, make_frame_rows, 4000, 64)
    made = generator.generate(rows[:500], 200)
    check_transitions(made, TransitionSpec(FRAME_SHAPE, num_actions=2))
    assert len(made) > 100
    assert torch.equal(made["next", "observation"][:, 0], made["observation"][:, 1])
    place, after = (find_place(made[key][:, 1]) for key in ("observation", ("next", "observation")))
    expected = (place + 1.5 * (2.0 * made["action"] - 1.0)).clamp(0.0, 14.0)
    assert float((after - expected).abs().mean()) < 0.25
    pays = (made["next", "reward"].squeeze(-1) > 0.5).float()
    sure = (after - 11.0).abs() > 0.5
    assert float((pays == (after > 11.0).float())[sure].float().mean()) > 0.95
    new = make_frame_rows(400, torch.Generator().manual_seed(2))
    predicted, accepted = generator.predict(new.select("observation", "action_mask", "action"))
    assert torch.equal(predicted["observation"], new["observation"])
    assert torch.equal(predicted["next", "observation"][:, 0], new["observation"][:, 1])
    drawn, real = (find_place(part["next", "observation"][:, 1]) for part in (predicted, new))
    assert float(accepted.float().mean()) > 0.5
    assert float((drawn - real)[accepted].abs().mean()) < 0.25


def test_masks_of_vectors_are_rated():
    rows = make_vector_rows(20, torch.Generator().manual_seed(0))
    assert 0.0 <= make_vector_generator().rate_masks(rows)["mask/given_next"] <= 1.0


@pytest.mark.slow
def test_vectors_are_learned_generated_and_continued():
    generator = make_vector_generator()
    rows = train(generator, make_vector_rows, 6000, 128)
    spec = TransitionSpec((2,), num_actions=2, observation_dtype=torch.float32)
    made = generator.generate(rows[:500], 200)
    check_transitions(made, spec)
    assert len(made) > 100
    torch.testing.assert_close(
        made["next", "observation"][:, 0], made["observation"][:, 0], atol=0.02, rtol=0.0
    )
    starts = made["observation"].clone()
    rollouts = Rollouts(generator, lambda _, mask: mask[:, 1].long(), 0, 2, 0.9)
    longer = rollouts.extend(made.clone(), 1)  # the second action is always a throw
    check_transitions(longer, spec)
    assert torch.equal(longer["observation"], starts)
    steps = longer["steps_to_next_obs"].squeeze(1)
    assert float((steps == 2).float().mean()) > 0.3
    for rows_, throws, highest, most in (
        (made, made["action"], 7.9, 0.1),
        (longer, longer["action"] + steps - 1, 5.4, 0.15),
    ):
        moved = (rows_["next", "observation"] - rows_["observation"])[:, 1]
        expected = -0.5 * rows_["steps_to_next_obs"].squeeze(1) + 2.5 * throws
        height = rows_["observation"][:, 1]
        free = (height > 0.6) & (height < highest)
        assert float((moved - expected)[free].abs().mean()) < most


@pytest.mark.parametrize(
    ("make_generator", "make_rows"),
    [(make_frame_generator, make_frame_rows), (make_vector_generator, make_vector_rows)],
)
def test_a_restored_generator_continues_with_the_same_bits(make_generator, make_rows):
    rows = make_rows(400, torch.Generator().manual_seed(2))
    one, other = make_generator(), make_generator()
    one.observe(rows)
    one.update(rows[:64])
    other.load_state_dict(one.state_dict())
    assert one.update(rows[64:128]) == other.update(rows[64:128])


def test_frames_of_other_sides_than_patches_are_refused():
    spec = GeneratorSpec((2, 65, 64), 2, num_uniform=0, noop_action=0, num_frames=2)
    with pytest.raises(ValueError, match="frames are 65 x 64, but both sides must be multiples"):
        CCDNGenerator(GeneratorConfig(), spec)
