"""Scripted play-throughs of the scenarios, whose returns are known exactly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.tables import GOLD_TILE, LUMBER_TILE, PEASANT, TOWN_HALL
from marl_cair.games.deep_rts.views.planes import FIRST_KIND, FIRST_TILE, HAS_ORDER, SELECTED
from marl_cair.games.engine import BatchedEngine

Play = Callable[[BatchedEngine, np.ndarray, np.ndarray], str]


def play_out(scenario: str, play: Play, **options) -> tuple[BatchedEngine, list[float]]:
    """Play a whole game: `play` names an action of seat 0, all others do nothing."""
    engine = make_engine("deep_rts", scenario, **options)
    engine.reset(0)
    numbers = {name: number for number, name in enumerate(engine.spec.action_names)}
    rewards = []
    while not (engine.terminated[0] or engine.truncated[0]):
        planes, mask = engine.observe("planes")[0, 0], engine.action_mask()[0, 0]
        action = numbers[play(engine, planes, mask)]
        actions = np.full((1, engine.num_players), engine.spec.noop_action)
        actions[0, 0] = action if mask[action] else numbers["next_unit"]
        engine.step(actions)
        rewards.append(float(engine.rewards[0, 0]))
    return engine, rewards


def selected_place(planes: np.ndarray) -> tuple[int, int] | None:
    """Where the selected unit stands, a building at one of its cells."""
    places = np.argwhere(planes[SELECTED] > 0)
    return tuple(places[0].tolist()) if len(places) else None


def gather(tile: int) -> Play:
    """Send every peasant that has nothing to do to the nearest tile of a kind."""

    def play(engine: BatchedEngine, planes: np.ndarray, mask: np.ndarray) -> str:
        place = selected_place(planes)
        if place is None or not planes[FIRST_KIND + PEASANT][place] or planes[HAS_ORDER][place]:
            return "next_unit"
        tiles = np.argwhere(planes[FIRST_TILE + tile - 1] > 0)
        row, column = tiles[np.abs(tiles - place).max(axis=1).argmin()]
        return f"go_r{row}_c{column}"

    return play


def make_a_peasant(engine: BatchedEngine, planes: np.ndarray, mask: np.ndarray) -> str:
    """One peasant more, then nothing."""
    place = selected_place(planes)
    if (planes[FIRST_KIND + PEASANT] > 0).sum() > 3 or planes[HAS_ORDER].any():
        return "noop"
    is_training = engine.observe("vector")[0, 0][engine_vector(engine, "own food used")] > 3
    if is_training:
        return "noop"
    return "make_peasant" if planes[FIRST_KIND + TOWN_HALL][place] else "next_unit"


def engine_vector(engine: BatchedEngine, name: str) -> int:
    return engine.representation("vector").plane_names.index(name)


@pytest.mark.parametrize("size", ["15x15", "31x31"])
@pytest.mark.parametrize(
    ("scenario", "tile"),
    [("GoldCollect", GOLD_TILE), ("LumberCollect", LUMBER_TILE), ("LavaMaze", GOLD_TILE)],
)
def test_a_race_pays_its_shares_and_one_in_all(scenario, tile, size):
    engine, rewards = play_out(f"{scenario}-{size}", gather(tile))
    assert engine.terminated[0]
    assert engine.winner[0] == 0
    assert sum(rewards) == pytest.approx(1.0, abs=1e-6)
    assert min(rewards) >= 0.0
    # A worker takes one unit of the tile at a time, which yields two; the goal cuts the last off.
    units = np.array(rewards[:-1]) * engine.scenario.goal_amount / 2
    np.testing.assert_allclose(units, units.round(), atol=1e-4)


def test_the_economy_pays_the_score_that_was_made():
    """A peasant is two points when it is made and one while it lives; nothing else happens."""
    engine, rewards = play_out("Economy-15x15", make_a_peasant)
    assert engine.terminated[0]
    assert len(rewards) == 600
    assert [reward for reward in rewards if reward != 0] == pytest.approx([0.03])


def test_who_does_nothing_is_paid_nothing():
    for scenario in ("Economy-15x15", "Army-15x15", "GoldCollect-15x15"):
        engine, rewards = play_out(scenario, lambda *_: "noop")
        assert not any(rewards)
        assert engine.truncated[0] == (engine.scenario.goal != "score")


def test_an_army_pays_a_fifth_for_each_soldier():
    engine = make_engine("deep_rts", "Army-15x15")
    engine.reset(0)
    bot = engine.game.bot("rusher", engine.scenario)
    bot.seed(0)
    rewards = []
    while not (engine.terminated[0] or engine.truncated[0]):
        engine.step(bot.act(engine.observe("planes")[0], engine.action_mask()[0])[None])
        rewards.append(float(engine.rewards[0, 0]))
    assert engine.terminated[0]
    assert sum(rewards) == pytest.approx(1.0, abs=1e-6)
    assert {round(5 * reward) for reward in rewards} <= {0, 1, 2}


@pytest.mark.parametrize("scenario", ["1v1-15x15", "Skirmish-15x15", "FFA-3-15x15"])
def test_conquest_pays_one_to_the_last_and_takes_one_from_the_others(scenario):
    """A bot against seats that do nothing."""
    engine = make_engine("deep_rts", scenario)
    engine.reset(0)
    bot = engine.game.bot("rusher", engine.scenario)
    bot.seed(0)
    total = np.zeros(engine.num_players)
    while not (engine.terminated[0] or engine.truncated[0]):
        actions = np.full((1, engine.num_players), engine.spec.noop_action)
        actions[0, 0] = bot.act(engine.observe("planes")[0, :1], engine.action_mask()[0, :1])[0]
        engine.step(actions)
        total += engine.rewards[0]
    assert engine.terminated[0]
    expected = np.full(engine.num_players, -1.0)
    expected[engine.winner[0]] = 1.0
    assert total.tolist() == expected.tolist()
