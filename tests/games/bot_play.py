"""Games between scripted players, and what holds for the bots of every game."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Agent


def make_bot(engine: BatchedEngine, name: str, seed: int = 0) -> Agent:
    bot = engine.game.bot(name, engine.scenario)
    bot.seed(seed)
    return bot


def play(
    engine: BatchedEngine, bots: Sequence[Agent], num_steps: int
) -> Iterator[tuple[NDArray, NDArray, NDArray]]:
    """Seat k is played by bot k; yields what each step was: planes, mask, actions."""
    for _ in range(num_steps):
        planes, mask = engine.observe("planes"), engine.action_mask()
        actions = np.stack([bot.act(planes[:, s], mask[:, s]) for s, bot in enumerate(bots)], 1)
        yield planes, mask, actions
        engine.step(actions)


class Positions(NamedTuple):
    """What N seats see in the middle of games."""

    engine: BatchedEngine
    planes: NDArray[np.uint8]  # [N, C, H, W]
    mask: NDArray[np.bool_]  # [N, A]

    def answers(self, name: str, seed: int = 0) -> NDArray[np.int64]:
        return make_bot(self.engine, name, seed).act(self.planes, self.mask)


def find_positions(engine: BatchedEngine, bots: Sequence[Agent], num_steps: int) -> Positions:
    """All seats at the last of `num_steps` decisions between the bots."""
    planes, mask, _ = list(play(engine, bots, num_steps))[-1]
    return Positions(engine, planes.reshape(-1, *planes.shape[2:]), mask.reshape(-1, mask.shape[2]))


def assert_repeats_and_continues(name: str, positions: Positions) -> None:
    """The same seed gives the same actions, and a saved state goes on."""
    engine, planes, mask = positions
    first, second = make_bot(engine, name, seed=5), make_bot(engine, name, seed=5)
    np.testing.assert_array_equal(first.act(planes, mask), second.act(planes, mask))
    saved = first.state_dict()
    expected = first.act(planes, mask)
    fresh = make_bot(engine, name, seed=99)
    fresh.load_state_dict(saved)
    np.testing.assert_array_equal(fresh.act(planes, mask), expected)


def assert_answers_each_row_on_its_own(name: str, positions: Positions) -> None:
    engine, planes, mask = positions
    bot = make_bot(engine, name)
    together = bot.act(planes, mask)
    backwards = bot.act(planes[::-1], mask[::-1])[::-1]
    alone = np.concatenate([bot.act(planes[i : i + 1], mask[i : i + 1]) for i in range(8)])
    np.testing.assert_array_equal(backwards, together)
    np.testing.assert_array_equal(alone, together[:8])


def assert_leaves_what_it_sees(name: str, positions: Positions) -> None:
    engine, planes, mask = positions
    seen, allowed = planes.copy(), mask.copy()
    make_bot(engine, name).act(seen, allowed)
    np.testing.assert_array_equal(seen, planes)
    np.testing.assert_array_equal(allowed, mask)
