"""Frames that are painted: a copy at first, then what moves, more than a pixel in a step."""

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from marl_cair.generative import GENERATORS
from marl_cair.generative.networks.boards import is_picture
from marl_cair.generative.networks.ccdn import CCDN
from marl_cair.generative.networks.frames import (
    FrameCCDN,
    FramePainter,
    find_painting_loss,
    round_shades,
)
from marl_cair.generative.quality import Imagined, measure_rows
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec, NetworkSize
from marl_cair.replay.transition import UNKNOWN_ACTION

SIDE, SIZE = 64, NetworkSize(channels=8, depth=2, hidden=16)
SPEC = GeneratorSpec((2, SIDE, SIDE), 2, num_uniform=0, noop_action=0, num_frames=2, tolerance=8)


def draw_rows(num, generator):
    """A bright square that action 1 moves three pixels to the right, action 0 to the left."""
    place = torch.randint(10, SIDE - 20, (num,), generator=generator)
    action = torch.randint(2, (num,), generator=generator)
    columns = torch.arange(SIDE)

    def paint(left):
        inside = (columns >= left[:, None]) & (columns < left[:, None] + 8)
        frames = torch.full((num, SIDE, SIDE), 40, dtype=torch.uint8)
        frames[:, 20:28] = torch.where(inside, 200, 40).to(torch.uint8)[:, None]
        return frames

    now, then = paint(place), paint(place + 6 * action - 3)
    seen = torch.stack([now, now], 1)
    following = torch.stack([now, then], 1)  # the newest replaces the newest
    mask, zeros = torch.ones(num, 2, dtype=torch.bool), torch.zeros(num, 1)
    ends = torch.zeros(num, 1, dtype=torch.bool)
    after = {"observation": following, "action_mask": mask, "reward": zeros, "terminated": ends}
    return TensorDict(
        {"observation": seen, "action_mask": mask, "action": action, "next": after}, [num]
    )


def make_network():
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return FrameCCDN(SPEC, SIZE)


def test_at_first_the_frame_is_copied():
    rows = draw_rows(4, torch.Generator().manual_seed(0))
    following, surety, _ = make_network().decode(rows, torch.zeros(4, 0, dtype=torch.int64), None)
    assert torch.equal(following, rows["observation"])
    assert surety.isfinite().all()


def test_moves_of_three_pixels_are_learned():
    network, random = make_network(), torch.Generator().manual_seed(0)
    optimizer = torch.optim.Adam(network.parameters(), 4e-3)
    others = torch.zeros(32, 0, dtype=torch.int64)
    for _ in range(250):
        losses = network.compute_losses(draw_rows(32, random), others, torch.ones(32), 0.0)
        optimizer.zero_grad()
        losses["cells"].backward()
        optimizer.step()
    rows = draw_rows(32, torch.Generator().manual_seed(1))
    drawn = network.decode(rows, others, None)[0][:, -1].int()
    now, then = (part[:, -1].int() for part in (rows["observation"], rows["next", "observation"]))
    changed = (now - then).abs() > 8
    assert ((drawn - then).abs() < 80)[changed].float().mean() > 0.8  # of 160 shades
    assert ((drawn - then).abs() <= 8)[~changed].float().mean() > 0.95


def test_changed_pixels_weigh_more_and_doubt_follows_the_error():
    painter = FramePainter(3, 1, 2)
    now = torch.zeros(1, 1, 4, 4, dtype=torch.uint8)
    painting = painter(torch.rand(1, 3, 2, 2), now)
    assert torch.equal(round_shades(painting)[0], now)
    one, far = now.clone(), now.clone()
    one[..., 0, 0], far[..., 0, 0] = 8, 9
    losses = [find_painting_loss(painting, now, later, SPEC).item() for later in (now, one, far)]
    assert losses[2] - losses[0] > 8 * (losses[1] - losses[0]) > 0
    sure = painting._replace(scale=torch.full_like(painting.scale, 0.01))
    wrong = torch.full_like(now, 255)
    doubts = [find_painting_loss(each, now, wrong, SPEC) for each in (painting, sure)]
    assert doubts[1] > doubts[0]  # to be sure and wrong costs more
    assert round_shades(sure)[1] > round_shades(painting)[1]


def test_boards_are_no_pictures_however_large():
    board = GeneratorSpec((3, 64, 64), 2, num_uniform=1, noop_action=0)
    assert not is_picture(board)
    assert is_picture(GeneratorSpec((1, 84, 84), 2, num_uniform=0, noop_action=0))


def test_pictures_and_boards_have_networks_of_their_own():
    board = GeneratorSpec((3, 64, 64), 2, num_uniform=1, noop_action=0)
    for spec, network in ((board, CCDN), (SPEC, FrameCCDN)):
        made = GENERATORS.make("ccdn", GeneratorConfig(size=SIZE), spec)
        assert isinstance(made.network, network)


@pytest.mark.parametrize(
    ("spec", "size"),
    [
        (SPEC, replace(SIZE, distances=True)),
        (replace(SPEC, action_cells=(5, -1)), SIZE),
    ],
)
def test_options_of_boards_are_refused_for_pictures(spec, size):
    with pytest.raises(ValueError, match="are of boards, but these rows are pictures"):
        FrameCCDN(spec, size)


def test_other_players_actions_change_the_frame_and_may_be_unknown():
    spec = replace(SPEC, num_others=2)
    network, rows = FrameCCDN(spec, SIZE), draw_rows(3, torch.Generator().manual_seed(0))
    torch.nn.init.constant_(network.painter.change.weight, 0.1)
    known, unknown = torch.zeros(3, 2, dtype=torch.int64), torch.full((3, 2), UNKNOWN_ACTION)
    one, other = (network(rows, others)[0].shades for others in (known, unknown))
    assert one.isfinite().all()
    assert other.isfinite().all()
    assert not torch.equal(one, other)


def test_the_share_of_explained_change_is_that_of_the_newest_frame():
    rows = draw_rows(4, torch.Generator().manual_seed(0))
    now, later = rows["observation"], rows["next", "observation"]
    zeros = torch.zeros(4)

    def measure(guess):
        made = Imagined(guess, rows["action_mask"], zeros, zeros, zeros)
        return measure_rows(rows, made, SPEC)

    assert measure(later)["cells/change_explained"] == 1.0
    assert measure(now)["cells/change_explained"] == 0.0
    rows["observation"][:, 0] = 0  # older frames are known, however much they differ
    half = ((now.float() + later.float()) / 2).round().to(torch.uint8)
    assert measure(half)["cells/change_explained"] == pytest.approx(0.75, abs=0.02)
    rows["next", "terminated"][0] = True  # what is seen after an end is never used
    half[0] = 255
    assert measure(half)["cells/change_explained"] == pytest.approx(0.75, abs=0.02)
    rows["next", "terminated"][:] = True
    assert "cells/change_explained" not in measure(half)
    rows["next", "terminated"][:], rows["next", "observation"] = False, rows["observation"]
    assert "cells/change_explained" not in measure(now)  # nothing moves


def test_the_adversarial_generator_refuses_pictures():
    with pytest.raises(ValueError, match="ccgan, which judges boards, but these rows are pictures"):
        GENERATORS.make("ccgan", GeneratorConfig(size=SIZE), SPEC)


def test_a_frame_after_the_end_of_a_game_is_not_learned():
    rows, network = draw_rows(4, torch.Generator().manual_seed(0)), make_network()
    rows["next", "terminated"][:2] = True
    others = torch.zeros(4, 0, dtype=torch.int64)
    losses = network.compute_losses(rows, others, torch.ones(4), 0.0)
    rows["next", "observation"][:2] = 255
    other = network.compute_losses(rows, others, torch.ones(4), 0.0)
    assert torch.equal(losses["cells"], other["cells"])
    rows["next", "observation"][2:] = 255
    assert network.compute_losses(rows, others, torch.ones(4), 0.0)["cells"] > losses["cells"]
