"""Rewards and masks that depend on what stands on the next board, not on the current one."""

import pytest
import torch

from marl_cair.generative import CCDNGenerator, GeneratorConfig, GeneratorSpec
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.networks.readout import BoardReadout, compare, flatten_board

SIDE = 5
CELLS = SIDE * SIDE
WORKER, HALL, HEALTH, MARK = range(4)
NOOP = 0
PAY = 0.02  # for the whole health of a worker
SPEC = GeneratorSpec(
    observation_shape=(5, SIDE, SIDE),
    num_actions=1 + CELLS,
    num_uniform=1,
    noop_action=NOOP,
    action_kinds=(0, *(1,) * CELLS),
    action_cells=(-1, *range(CELLS)),
)


def draw_board(num, random):
    """Boards uint8 [N, 5, SIDE, SIDE]: workers and halls of any health, one of them marked."""
    things = torch.rand(num, CELLS, generator=random)
    worker, hall = things < 0.25, things > 0.75
    health = (torch.rand(num, CELLS, generator=random) * 255).ceil() * (worker | hall)
    chosen = (torch.rand(num, CELLS, generator=random) + (worker | hall)).argmax(-1)
    mark = torch.nn.functional.one_hot(chosen, CELLS)
    planes = torch.stack([worker * 255, hall * 255, health.long(), mark * 255], 1)
    board = torch.full((num, 5, CELLS), 9, dtype=torch.uint8)
    board[:, :4] = planes.to(torch.uint8)
    return board.view(num, 5, SIDE, SIDE)


def find_mask(board):
    """A marked worker goes to empty cells, a marked hall to workers."""
    worker, hall, _, mark = (board[:, plane].flatten(1) > 0 for plane in range(4))
    goes = (worker & mark).any(-1, keepdim=True) & ~worker & ~hall
    calls = (hall & mark).any(-1, keepdim=True) & worker
    return torch.cat([torch.ones(len(board), 1, dtype=torch.bool), goes | calls], -1)


def find_wealth(board):
    health = board[:, HEALTH].float() / 255.0
    return (health * (board[:, WORKER] > 0)).sum((1, 2))


def draw_rows(num, random):
    """Transitions between boards that have nothing to do with each other."""
    now, later = draw_board(num, random), draw_board(num, random)
    rows = make_empty_transitions(SPEC, num)
    rows["observation"], rows["next", "observation"] = now, later
    rows["action_mask"], rows["next", "action_mask"] = find_mask(now), find_mask(later)
    rows["next", "reward"] = (PAY * (find_wealth(later) - find_wealth(now)))[:, None]
    rows["index"] = torch.arange(num)
    return rows


@pytest.mark.slow
def test_reward_is_a_change_of_planes_and_mask_depends_on_the_marked_cell():
    random = torch.Generator().manual_seed(0)
    rows, held = draw_rows(6000, random), draw_rows(300, random)
    generator = CCDNGenerator(GeneratorConfig(num_members=1), SPEC)
    generator.observe(rows)
    for _ in range(400):
        generator.update(rows[torch.randint(len(rows), (64,), generator=random)])
    predicted = generator.ensemble.predict(held)
    rewards = held["next", "reward"].squeeze(-1)
    error = predicted.reward.mean(0) - rewards
    assert float(error.square().mean()) < 0.1 * float(rewards.var())
    right = (predicted.mask.mean(0) > 0.0) == held["next", "action_mask"]
    assert float(right.float().mean()) > 0.97


def test_equal_boards_show_no_change_and_places_do_not_count():
    random = torch.Generator().manual_seed(1)
    board = draw_board(8, random)
    readout = BoardReadout(4, num_features=6, num_factors=3)
    here = readout(flatten_board(board[:, :4]))
    turned = readout(flatten_board(board[:, :4].flip(-1)))
    change = compare(here, here)[:, readout.num_sums :]
    assert torch.equal(change, torch.zeros(8, readout.num_sums))
    assert here.sums.shape == (8, readout.num_sums)
    torch.testing.assert_close(here.sums, turned.sums)
    assert not torch.equal(here.cells, turned.cells)
