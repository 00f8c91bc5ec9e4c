"""The margin loss and the decoder against plain loops in float64, and digits that are read."""

import math

import pytest
import torch

from benchmarks.capsule_digits import (
    EPOCHS,
    NUM_HELD_OUT,
    Digits,
    load,
    measure,
    sweep_poses,
    train,
)
from marl_cair.policies.capsule_layers import CapsuleDecoder, margin_loss


@pytest.fixture(autouse=True)
def _seeded():
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(0)
        yield


def test_the_margin_loss():
    lengths = torch.rand(6, 4, dtype=torch.float64)
    classes = torch.tensor([0, 3, 1, 1, 2, 0])
    expected = 0.0
    for row, true in enumerate(classes.tolist()):
        for k in range(4):
            length = float(lengths[row, k])
            if k == true:
                expected += max(0.0, 0.9 - length) ** 2
            else:
                expected += 0.5 * max(0.0, length - 0.1) ** 2
    assert float(margin_loss(lengths, classes)) == pytest.approx(expected / 6)
    assert torch.autograd.gradcheck(
        lambda seen: margin_loss(seen, classes), lengths.requires_grad_()
    )
    perfect = torch.full((2, 4), 0.1).scatter(1, torch.tensor([[2], [0]]), 0.9)
    assert margin_loss(perfect, torch.tensor([2, 0])) == 0.0


def test_the_decoder():
    decoder = CapsuleDecoder(3, 2, (1, 2, 2), hidden_widths=(5, 4)).double()
    capsules = torch.randn(4, 3, 2, dtype=torch.float64)
    classes = torch.tensor([1, 0, 2, 1])
    images = decoder(capsules, classes)
    assert images.shape == (4, 1, 2, 2)
    layers = [layer for layer in decoder.layers if hasattr(layer, "weight")]
    for row, true in enumerate(classes.tolist()):
        values = [0.0] * 6
        values[2 * true : 2 * true + 2] = capsules[row, true].tolist()
        for place, layer in enumerate(layers):
            values = [
                float(bias) + sum(float(w) * v for w, v in zip(weight, values, strict=True))
                for weight, bias in zip(layer.weight.detach(), layer.bias.detach(), strict=True)
            ]
            if place < 2:
                values = [max(0.0, value) for value in values]
        expected = [1.0 / (1.0 + math.exp(-value)) for value in values]
        assert images[row].flatten().tolist() == pytest.approx(expected)
    given = capsules.requires_grad_()
    assert torch.autograd.gradcheck(lambda seen: decoder(seen, classes), given)


def test_only_the_capsule_of_the_class_is_drawn():
    decoder = CapsuleDecoder(3, 2, (4, 4))
    capsules = torch.randn(1, 3, 2, requires_grad=True)
    decoder(capsules, torch.tensor([1])).sum().backward()
    assert capsules.grad[0, 1].abs().min() > 0.0
    assert capsules.grad[0, [0, 2]].abs().max() == 0.0


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        (torch.tensor([0, 3]), "from 0 to 3, but there are 3 capsules: number them from 0 to 2"),
        (torch.tensor([-1, 0]), "from -1 to 0, but there are 3 capsules"),
        (torch.tensor([0]), r"of shape \[1\], but must be torch.int64 of shape \[2\]"),
        (torch.tensor([0.0, 1.0]), "classes are torch.float32"),
    ],
)
def test_classes_that_are_refused(classes, message):
    with pytest.raises(ValueError, match=message):
        margin_loss(torch.rand(2, 3), classes)
    with pytest.raises(ValueError, match=message):
        CapsuleDecoder(3, 2, (4, 4))(torch.rand(2, 3, 2), classes)


@pytest.mark.slow
def test_held_out_images_are_apart_and_have_all_digits():
    pytest.importorskip("sklearn", reason="extra dev")
    seen, held = load(0)
    assert len(held.images) == NUM_HELD_OUT
    assert len(seen.images) + NUM_HELD_OUT == 1797
    learned = {image.numpy().tobytes() for image in seen.images}
    assert not any(image.numpy().tobytes() in learned for image in held.images)
    assert held.classes.bincount().min() >= 43
    assert not torch.equal(load(1)[1].images, held.images)


@pytest.mark.slow
def test_a_few_steps_read_digits_and_reconstruct():
    pytest.importorskip("sklearn", reason="extra dev")
    seen, held = load(0)
    few = Digits(seen.images[:480], seen.classes[:480])
    network = train(few, 3, seed=0)
    first, last = measure(train(few, 0, seed=0), held), measure(network, held)
    assert first[0] < 0.3
    assert last[0] > 0.7  # chance: 0.1
    assert last[1] < 0.6 * first[1]
    rows = sweep_poses(network, held)
    assert len(rows) == 10
    assert {tuple(image.shape) for _, images in rows for image in images} == {(8, 8)}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_digits_are_read(seed):
    pytest.importorskip("sklearn", reason="extra dev")
    seen, held = load(seed)
    accuracy, error = measure(train(seen, EPOCHS, seed), held)
    assert accuracy >= 0.985
    assert error < 0.03
