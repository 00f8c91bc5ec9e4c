"""Curves and the likelihood of a board, and their gradients, against plain PyTorch."""

import torch
from torch.nn import functional

from marl_cair.generative.networks.boards import stack_sources
from marl_cair.generative.networks.gradients import apply_curves, score_board
from tests.generative.networks.test_decoding import (
    LAYER_OF,
    LAYERS,
    NUM_SOURCES,
    SHIFTS,
    make_planes,
)

NUM_CHOICES = len(LAYERS) * NUM_SOURCES


def score_plainly(logits, planes, later):
    """As `score_board`."""
    sources = logits[:, :NUM_CHOICES].unflatten(1, (len(LAYERS), -1))
    values = stack_sources(planes, SHIFTS)
    match = values == later[:, None]
    explained = torch.stack([match[:, :, layer].sum(2) for layer in LAYERS], 1)
    kept = sources.masked_fill(explained != explained.amax(2, keepdim=True), -torch.inf)
    nll = (sources.logsumexp(2) - kept.logsumexp(2)).flatten(1).sum(1)
    base = values.gather(1, kept.argmax(2)[:, LAYER_OF][:, None]).squeeze(1)
    edited = base != later
    edits = functional.binary_cross_entropy_with_logits(
        logits[:, NUM_CHOICES:], edited.float(), reduction="none"
    )
    return nll + edits.flatten(1).sum(1), base, edited


def test_a_board_is_scored_as_in_plain_pytorch():
    logits = torch.randn(8, NUM_CHOICES + 4, 5, 6, generator=torch.Generator().manual_seed(2))
    planes, weights = make_planes(8), torch.arange(1.0, 9.0)
    later = planes.roll(1, 3)
    later[::2] = make_planes(8, seed=1)[::2]  # what no source explains
    gradients = []
    for score in (
        score_plainly,
        lambda *arguments: score_board(*arguments, LAYER_OF, SHIFTS),
    ):
        leaf = logits.clone().requires_grad_()
        nll, base, edited = score(leaf, planes, later)
        (nll * weights).sum().backward()
        gradients.append((nll.detach(), leaf.grad, base, edited))
    (nll, grad, base, edited), (our_nll, our_grad, our_base, our_edited) = gradients
    torch.testing.assert_close(our_nll, nll, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(our_grad, grad, rtol=1e-4, atol=1e-4)
    assert torch.equal(our_base, base)
    assert torch.equal(our_edited, edited)
    assert edited.any()


def test_curves_are_looked_up_for_each_plane_and_learn():
    planes, weights = make_planes(3), torch.rand(3, 4, 5, 6)
    places = planes.long() + 256 * torch.arange(4)[:, None, None]
    curve = torch.rand(4 * 256, requires_grad=True)
    values = apply_curves(planes, curve)
    assert torch.equal(values, curve[places])
    (values * weights).sum().backward()
    ours, curve.grad = curve.grad, None
    (curve[places] * weights).sum().backward()
    torch.testing.assert_close(ours, curve.grad)
