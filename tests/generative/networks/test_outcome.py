"""Outcome heads: planes that meet at a cell, and ends that are learned from few examples."""

import torch

from marl_cair.generative.generator import CCDNGenerator
from marl_cair.generative.networks.outcome import find_meetings
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec, NetworkSize
from tests.generative.plane_game import pack_rows

SIDE = 6
PLAYER, GOAL, CLOCK = range(3)
STEPS = torch.tensor([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
SPEC = GeneratorSpec(
    observation_shape=(3, SIDE, SIDE),
    num_actions=len(STEPS),
    num_uniform=1,
    noop_action=0,
    action_kinds=tuple(range(len(STEPS))),
    action_cells=(-1,) * len(STEPS),
    static_planes=(GOAL,),
)


def test_planes_meet_where_one_cell_has_both():
    random = torch.Generator().manual_seed(0)
    boards = torch.randint(0, 8, (40, 4, 3, 5), generator=random, dtype=torch.uint8)
    boards[torch.rand(boards.shape, generator=random) < 0.7] = 0
    found = find_meetings(boards)
    for board, meets in zip(boards, found, strict=True):
        for first in range(4):
            for second in range(4):
                both = (board[first] > 0) & (board[second] > 0)
                assert float(meets[first, second]) == float(both.any())


def play(num: int, seed: int):
    """Steps of a player at any place of a board with a goal anywhere, which ends the game."""
    random = torch.Generator().manual_seed(seed)

    def draw(most: int, *shape: int) -> torch.Tensor:
        return torch.randint(0, most, shape, generator=random)

    now, goal, action = draw(SIDE, num, 2), draw(SIDE, num, 2), draw(len(STEPS), num)
    later = (now + STEPS[action]).clamp(0, SIDE - 1)
    boards = torch.zeros(2, num, 3, SIDE, SIDE, dtype=torch.uint8)
    each = torch.arange(num)
    for board, (row, column) in zip(boards, (now.T, later.T), strict=True):
        board[each, PLAYER, row, column] = board[each, GOAL, goal[:, 0], goal[:, 1]] = 255
    ended = (later == goal).all(1)
    begins = (now != goal).any(1)
    masks = (torch.ones(num, len(STEPS), dtype=torch.bool),) * 2
    reward = torch.where(ended, 1.0, -0.01)
    return pack_rows(boards[0], action, boards[1], reward, ended, masks)[begins]


def test_an_end_is_learned_from_six_examples_anywhere_on_the_board():
    rows, others = play(4_000, 0), play(8_000, 1)
    ends = rows["next", "terminated"][:, 0]
    rows = rows[~ends | (ends.cumsum(0) <= 12)]  # half of them are held out
    config = GeneratorConfig(size=NetworkSize(channels=12, depth=2, hidden=48))
    generator = CCDNGenerator(config, SPEC)
    generator.observe(rows)
    draws = torch.Generator().manual_seed(2)
    for _ in range(300):
        generator.update(rows[torch.randint(len(rows), (64,), generator=draws)])
    ends = others["next", "terminated"][:, 0]
    made = generator.imagine(others)
    assert ends.sum() > 100
    assert (made.end[ends] > 0.5).float().mean() > 0.8
    assert (made.end[~ends] > 0.5).float().mean() < 0.005
    assert (made.reward[ends] - 1.0).abs().median() < 0.2
