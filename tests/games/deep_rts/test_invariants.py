"""Invariants of random games: the conditions for saved states always hold; masks are exact."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.checks.state import check_worlds
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules.rulebook import KIND_FOOD_CONSUMED
from marl_cair.games.deep_rts.scenarios import SCENARIOS
from marl_cair.games.engine import BatchedEngine
from tests.games.deep_rts.skirmish import draw_actions, play_random

OPTIONS = [
    {},
    {"fog": True, "preset": "wealthy"},
    {"preset": "original", "actions": "classic"},
    {"preset": "thesis", "actions": "classic", "ticks_per_step": 1},
    {"actions": "grid", "preset": "original", "fog": True, "unit_capacity": 20},
    {"preset": "original", "map": "10x10-2p-clearing", "unit_capacity": 12},
    {"army": (0, 4, 3, 2), "max_ticks": 1_500},
    {"army": (3, 3, 3, 0), "goal": "score", "map": "10x10-2p-clearing", "fog": True},
    {"map": "31x31-4p-quarters", "num_players": 4, "teams": (0, 1, 1, 0), "fog": True},
    {"map": "15x15-1p-embers", "num_players": 1, "goal": "gold", "goal_amount": 100_000},
]
FUZZED_WORLDS, FUZZED_TICKS = 8, 1_000_000


def check_state(engine: BatchedEngine) -> None:
    """The conditions for saved states hold, units stand on ground, and all food is counted."""
    worlds, food = engine._worlds, engine._rules.kinds[:, KIND_FOOD_CONSUMED]
    check_worlds("deep_rts", worlds, engine.game.state_limits(engine.scenario))
    kind, queue = worlds.units[:, :, s.UNIT_KIND], worlds.units[:, :, s.UNIT_QUEUE :]
    world, cell = np.nonzero(worlds.board[:, s.OCCUPANT] >= 0)
    tile = worlds.board[world, s.TILE, cell]
    kind_there = kind[world, worlds.board[world, s.OCCUPANT, cell]]
    is_in_pool = (tile == t.OIL_TILE) & np.isin(kind_there, (t.PEASANT, t.OIL_WELL))
    assert (np.isin(tile, t.WALKABLE_TILES) | is_in_pool).all()
    food = np.append(food, [0] * (t.NUM_UPGRADES + 1))  # of upgrades, and of -1: no kind
    is_queued = np.arange(s.QUEUE_LENGTH) < worlds.units[:, :, [s.UNIT_QUEUE_LENGTH]]
    eaten = food[kind] + np.where(is_queued, food[queue], 0).sum(axis=2)
    by_player = eaten.reshape(engine.num_worlds, engine.num_players, -1).sum(axis=2)
    np.testing.assert_array_equal(by_player, worlds.players[:, :, s.FOOD_USED])


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_legal_actions_keep_the_invariants(options):
    engine = make_engine("deep_rts", **options)
    for _ in play_random(engine, 300 if engine.num_players < 4 else 80, seed=1):
        check_state(engine)
        assert not engine.illegal_actions.any()


@pytest.mark.parametrize("options", OPTIONS[1:7], ids=str)
def test_any_actions_keep_the_invariants_and_illegal_ones_are_counted(options):
    engine = make_engine("deep_rts", **options)
    expected = np.zeros(engine.num_players, int)

    def draw(engine: BatchedEngine, luck: np.random.Generator) -> np.ndarray:
        mask = engine.action_mask()
        actions = luck.integers(0, engine.num_actions, mask.shape[:-1])
        is_legal = np.take_along_axis(mask, actions[..., None], axis=-1)[0, ..., 0]
        counts = (~is_legal).reshape(engine.num_players, -1).sum(axis=1)
        expected[:] += engine._worlds.players[0, :, s.IS_ALIVE] * counts
        return actions

    for _ in play_random(engine, 150, seed=2, draw=draw):
        check_state(engine)
        assert engine.illegal_actions[0].tolist() == expected.tolist()
        if engine.terminated[0] or engine.truncated[0]:
            expected[:] = 0


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_million_ticks_of_random_actions_keep_the_invariants(scenario):
    """Over all scenarios together; half of the worlds also try illegal actions."""
    engine = make_engine("deep_rts", scenario, FUZZED_WORLDS)
    luck = np.random.default_rng(4)
    engine.reset(luck.integers(0, 2**63, FUZZED_WORLDS).astype(np.uint64))
    ticks = FUZZED_TICKS // len(SCENARIOS) // FUZZED_WORLDS
    for step in range(ticks // engine.spec.ticks_per_step + 1):
        actions = draw_actions(engine, luck)
        wild = luck.integers(0, engine.num_actions, actions.shape)
        is_wild = (luck.random(actions.shape) < 0.2) & (np.arange(FUZZED_WORLDS) % 2 == 1)[:, None]
        engine.step(np.where(is_wild, wild, actions))
        if step % 5 == 0:
            check_state(engine)
        ended = engine.terminated | engine.truncated
        if ended.any():
            engine.reset(luck.integers(0, 2**63, FUZZED_WORLDS).astype(np.uint64), ended)
        again = engine.observe("planes", worlds=list(range(FUZZED_WORLDS)))
        np.testing.assert_array_equal(engine.observe_in_place("planes"), again)


@pytest.mark.parametrize("actions", ["unit", "classic", "grid"])
def test_illegal_action_equals_the_noop(actions):
    engine = make_engine("deep_rts", num_worlds=2, actions=actions, preset="original")
    luck = np.random.default_rng(3)
    engine.reset(np.array([3, 3], np.uint64))
    num_illegal = 0
    for step in range(150):
        mask = engine.action_mask()
        np.testing.assert_array_equal(mask[0], mask[1])
        chosen = draw_actions(engine, luck)
        chosen[1] = chosen[0]
        for player in range(2):
            if luck.random() < 0.5:
                *place, action = luck.choice(np.argwhere(~mask[0, player]))
                chosen[(0, player, *place)] = action
                chosen[(1, player, *place)] = engine.spec.noop_action
                num_illegal += 1
        engine.step(chosen)
        for name, field in engine._worlds._asdict().items():
            if name != "illegal":
                np.testing.assert_array_equal(field[0], field[1], err_msg=name)
        if engine.terminated.any():
            engine.reset(np.array([step] * 2, np.uint64))
            num_illegal = 0
    assert engine.illegal_actions[1].tolist() == [0, 0]
    assert engine.illegal_actions[0].sum() == num_illegal
