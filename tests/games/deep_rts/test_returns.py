"""Scripted games of the scenarios, whose returns are known exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.tables import GOLD_TILE, LUMBER_TILE, PEASANT, TOWN_HALL
from marl_cair.games.deep_rts.views.planes import FIRST_KIND, FIRST_TILE, HAS_ORDER, SELECTED
from marl_cair.games.engine import BatchedEngine

Play = Callable[[BatchedEngine, np.ndarray], str]


def play_out(scenario: str, play: Play | str) -> tuple[BatchedEngine, np.ndarray]:
    """Play a whole game; returns the engine and the rewards [T, P].

    `play` names an action of seat 0, or is the name of its bot; the other seats do nothing.
    """
    engine = make_engine("deep_rts", scenario)
    engine.reset(0)
    numbers = {name: number for number, name in enumerate(engine.spec.action_names)}
    bot = engine.game.bot(play, engine.scenario) if isinstance(play, str) else None
    if bot is not None:
        bot.seed(0)
    rewards = []
    while not (engine.terminated[0] or engine.truncated[0]):
        planes, mask = engine.observe("planes")[0], engine.action_mask()[0]
        actions = np.full((1, engine.num_players), engine.spec.noop_action)
        if bot is not None:
            actions[0, 0] = bot.act(planes[:1], mask[:1])[0]
        else:
            action = numbers[play(engine, planes[0])]
            actions[0, 0] = action if mask[0, action] else numbers["next_unit"]
        engine.step(actions)
        rewards.append(engine.rewards[0].copy())
    return engine, np.array(rewards)


def gather(tile: int) -> Play:
    """Send every idle peasant to the nearest tile of a kind."""

    def play(engine: BatchedEngine, planes: np.ndarray) -> str:
        place = tuple(np.argwhere(planes[SELECTED] > 0)[:1].ravel().tolist())
        if not place or not planes[FIRST_KIND + PEASANT][place] or planes[HAS_ORDER][place]:
            return "next_unit"
        tiles = np.argwhere(planes[FIRST_TILE + tile - 1] > 0)
        row, column = tiles[np.abs(tiles - place).max(axis=1).argmin()]
        return f"go_r{row}_c{column}"

    return play


def make_a_peasant(engine: BatchedEngine, planes: np.ndarray) -> str:
    """One more peasant, then nothing."""
    if (planes[FIRST_KIND + PEASANT] > 0).sum() > 3 or planes[HAS_ORDER].any():
        return "noop"
    names = engine.representation("vector").plane_names
    if engine.observe("vector")[0, 0][names.index("own food used")] > 3:
        return "noop"
    is_hall = (planes[FIRST_KIND + TOWN_HALL] > 0)[planes[SELECTED] > 0].any()
    return "make_peasant" if is_hall else "next_unit"


@pytest.mark.parametrize("size", ["15x15", "31x31"])
@pytest.mark.parametrize(
    ("scenario", "tile"),
    [("GoldCollect", GOLD_TILE), ("LumberCollect", LUMBER_TILE), ("LavaMaze", GOLD_TILE)],
)
def test_race_pays_its_shares_and_one_in_all(scenario, tile, size):
    engine, rewards = play_out(f"{scenario}-{size}", gather(tile))
    assert engine.terminated[0]
    assert engine.winner[0] == 0
    assert rewards.sum() == pytest.approx(1.0, abs=1e-6)
    assert rewards.min() >= 0.0
    # A worker takes one unit of the tile at a time, which yields two; the goal cuts the last off.
    units = rewards[:-1] * engine.scenario.goal_amount / 2
    np.testing.assert_allclose(units, units.round(), atol=1e-4)


def test_economy_pays_the_score():
    """A peasant is two points when it is made and one while it lives; nothing else happens."""
    engine, rewards = play_out("Economy-15x15", make_a_peasant)
    assert engine.terminated[0]
    assert len(rewards) == 600
    assert rewards[rewards != 0].tolist() == pytest.approx([0.03])


@pytest.mark.parametrize("scenario", ["Economy-15x15", "Army-15x15", "GoldCollect-15x15"])
def test_doing_nothing_pays_nothing(scenario):
    engine, rewards = play_out(scenario, lambda *_: "noop")
    assert not rewards.any()
    assert engine.truncated[0] == (engine.scenario.goal != "score")


def test_army_pays_a_fifth_for_each_soldier():
    engine, rewards = play_out("Army-15x15", "rusher")
    assert engine.terminated[0]
    assert rewards.sum() == pytest.approx(1.0, abs=1e-6)
    assert set((5 * rewards).round().ravel().tolist()) <= {0, 1, 2}


@pytest.mark.parametrize("scenario", ["1v1-15x15", "Skirmish-15x15", "FFA-3-15x15"])
def test_conquest_pays_one_to_the_last_and_takes_one_from_the_others(scenario):
    """A bot against seats that do nothing."""
    engine, rewards = play_out(scenario, "rusher")
    assert engine.terminated[0]
    expected = np.full(engine.num_players, -1.0)
    expected[engine.winner[0]] = 1.0
    assert rewards.sum(axis=0).tolist() == expected.tolist()
