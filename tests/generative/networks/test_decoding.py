"""The compiled decoder against plain PyTorch, and its samples."""

import pytest
import torch
from torch.nn import functional

from marl_cair.generative.networks.boards import find_layers, stack_sources
from marl_cair.generative.networks.decoding import decode_board
from marl_cair.generative.settings import GeneratorSpec

SHIFTS = ((0, 1), (0, -1), (1, 0), (-1, 0))
SPEC = GeneratorSpec((4, 5, 6), 2, num_uniform=0, noop_action=0, event_plane_groups=((1, 3),))
LAYERS = find_layers(SPEC)
LAYER_OF = torch.tensor([1, 0, 2, 0])
NUM_SOURCES = len(SHIFTS) + 2


def decode_plainly(logits, planes):
    """As `decode_board`, from logits [N, L * K + P, H, W]."""
    num_choices = len(LAYERS) * NUM_SOURCES
    sources = logits[:, :num_choices].unflatten(1, (len(LAYERS), -1))
    values = stack_sources(planes, SHIFTS)
    base = values.gather(1, sources.argmax(2)[:, LAYER_OF][:, None]).squeeze(1)
    same = values == base[:, None]
    equal = torch.stack([same[:, :, layer].all(2) for layer in LAYERS], 1)
    kept = sources.masked_fill(~equal, -torch.inf)
    edits = logits[:, num_choices:]
    surety = (kept.logsumexp(2) - sources.logsumexp(2)).flatten(1).sum(1)
    return base, edits > 0, surety + functional.logsigmoid(edits.abs()).flatten(1).sum(1)


def make_planes(num, seed=0):
    generator = torch.Generator().manual_seed(seed)
    values = torch.randint(1, 4, (num, 4, 5, 6), generator=generator)
    return (values * (torch.rand(num, 4, 5, 6, generator=generator) < 0.3)).to(torch.uint8)


def draw(num):
    return torch.rand(num, len(LAYERS), 1 + 5 * 6)


def test_planes_of_one_event_are_one_layer():
    assert LAYERS == [[1, 3], [0], [2]]


def test_the_likeliest_board_is_that_of_plain_pytorch():
    planes = make_planes(20)
    logits = 3.0 * torch.randn(20, len(LAYERS) * NUM_SOURCES + 4, 5, 6)
    of_boards = torch.randn(20, logits.shape[1])
    found = decode_board(logits, of_boards, planes, LAYER_OF, SHIFTS)
    expected = decode_plainly(logits + of_boards[..., None, None], planes)
    assert torch.equal(found[0], expected[0])
    assert torch.equal(found[1], expected[1])
    torch.testing.assert_close(found[2], expected[2], atol=1e-3, rtol=1e-4)


def test_of_cells_with_even_odds_exactly_one_changes_in_all_planes_of_its_layer():
    """A unit that appears at one of ten cells."""
    num = 400
    logits = torch.full((num, len(LAYERS) * NUM_SOURCES + 4, 5, 6), -30.0)
    logits[:, : len(LAYERS) * NUM_SOURCES : NUM_SOURCES] = 30.0  # copies
    edits = logits[:, len(LAYERS) * NUM_SOURCES :]
    edits[:, 1, 0, :5] = edits[:, 3, 0, :5] = torch.tensor(0.1).logit()
    edits[:, 1, 3, :5] = edits[:, 3, 3, :5] = torch.tensor(0.1).logit()
    planes = torch.zeros(num, 4, 5, 6, dtype=torch.uint8)
    zeros = torch.zeros(num, logits.shape[1])
    _, edited, _ = decode_board(logits, zeros, planes, LAYER_OF, SHIFTS, draw(num))
    assert (edited.flatten(2).sum(2) == torch.tensor([0, 1, 0, 1])).float().mean() > 0.99
    assert torch.equal(edited[:, 1], edited[:, 3])
    where = edited[:, 1].flatten(1).float().mean(0)
    assert where[where > 0].numel() == 10
    assert where.max() < 0.17


def sample_walkers(chance, kinds, direction, edge=0.0):
    """Boards [400, 5, 6] of samples in which units in a row go one cell in the direction of SHIFTS
    with the same chance; also the board if they stay, and if they go.

    kinds: their values, the first one's in front. edge: the odds of all other moves.
    """
    num, (down, right) = 400, SHIFTS[direction]
    places = [(2 - down * back, 3 - right * back) for back in range(len(kinds))]
    stay, go = torch.zeros(2, 5, 6, dtype=torch.uint8)
    logits = torch.full((num, len(LAYERS) * NUM_SOURCES + 4, 5, 6), -30.0)
    sources = logits[:, : len(LAYERS) * NUM_SOURCES].view(num, len(LAYERS), NUM_SOURCES, 5, 6)
    sources[:, :, 1:-1] = torch.tensor(edge).logit().clamp_min(-30.0)
    sources[:, :, 0] = 0.0
    moves = torch.tensor(chance).logit()
    for (row, column), kind in zip(places, kinds, strict=True):
        stay[row, column] = go[row + down, column + right] = kind
        sources[:, 1, 1 + direction, row + down, column + right] = moves  # it is taken over
    sources[:, 1, NUM_SOURCES - 1, *places[-1]] = moves  # the last cell of the row becomes empty
    planes = torch.zeros(num, 4, 5, 6, dtype=torch.uint8)
    planes[:, 0] = stay
    zeros = torch.zeros(num, logits.shape[1])
    base, _, _ = decode_board(logits, zeros, planes, LAYER_OF, SHIFTS, draw(num))
    return base[:, 0], stay, go


@pytest.mark.parametrize("edge", [0.0, 1e-9])
@pytest.mark.parametrize("direction", range(4))
@pytest.mark.parametrize("kinds", [(1,), (1, 2), (1, 1), (1, 2, 3), (2, 2, 2)], ids=str)
@pytest.mark.parametrize("chance", [0.9, 0.6])
def test_units_that_may_move_are_neither_lost_nor_doubled(chance, kinds, direction, edge):
    found, stay, go = sample_walkers(chance, kinds, direction, edge)
    moved = (found == go).flatten(1).all(1)
    assert ((found == stay).flatten(1).all(1) | moved).all()
    assert float(moved.float().mean()) == pytest.approx(chance, abs=0.09)


def test_two_units_that_may_change_places_do_so_together():
    """A ring, which no unit can begin."""
    num = 200
    planes = torch.zeros(num, 4, 5, 6, dtype=torch.uint8)
    planes[:, 0, 2, 2], planes[:, 0, 2, 3] = 1, 2
    logits = torch.full((num, len(LAYERS) * NUM_SOURCES + 4, 5, 6), -30.0)
    sources = logits[:, : len(LAYERS) * NUM_SOURCES].view(num, len(LAYERS), NUM_SOURCES, 5, 6)
    sources[:, :, 0] = sources[:, 1, 1, 2, 3] = sources[:, 1, 2, 2, 2] = 0.0
    zeros = torch.zeros(num, logits.shape[1])
    base, _, _ = decode_board(logits, zeros, planes, LAYER_OF, SHIFTS, draw(num))
    pairs = base[:, 0, 2, 2:4]
    assert set(map(tuple, pairs.tolist())) == {(1, 2), (2, 1)}


def test_tiny_odds_of_many_cells_make_no_unit():
    num = 100
    logits = torch.full((num, len(LAYERS) * NUM_SOURCES + 4, 5, 6), -4.5)  # 30 cells of 1.1 %
    logits[:, : len(LAYERS) * NUM_SOURCES : NUM_SOURCES] = 30.0
    planes, zeros = torch.zeros(num, 4, 5, 6, dtype=torch.uint8), torch.zeros(num, logits.shape[1])
    _, edited, _ = decode_board(logits, zeros, planes, LAYER_OF, SHIFTS, draw(num))
    assert not edited.any()


def test_a_walker_arrives_at_one_of_its_cells():
    num = 300
    planes = torch.zeros(num, 4, 5, 6, dtype=torch.uint8)
    planes[:, 0, 2, 2] = 9
    logits = torch.full((num, len(LAYERS) * NUM_SOURCES + 4, 5, 6), -30.0)
    sources = logits[:, : len(LAYERS) * NUM_SOURCES].view(num, len(LAYERS), NUM_SOURCES, 5, 6)
    sources[:, :, 0] = 0.0
    sources[:, 1, NUM_SOURCES - 1, 2, 2] = 30.0  # it leaves
    for source, row, column in ((1, 2, 3), (2, 2, 1)):  # right or left
        sources[:, 1, source, row, column] = 0.0
    zeros = torch.zeros(num, logits.shape[1])
    base, _, _ = decode_board(logits, zeros, planes, LAYER_OF, SHIFTS, draw(num))
    walked = base[:, 0]
    assert (walked.flatten(1).sum(1) == 9).float().mean() > 0.99
    assert float((walked[:, 2, 3] == 9).float().mean()) == pytest.approx(0.5, abs=0.1)
