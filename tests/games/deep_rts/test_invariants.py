"""Whatever is played: units, board, counters and stores agree; masks are exact."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules.rulebook import KIND_FOOD_CONSUMED, KIND_HALF_SIZE, KIND_HEALTH
from marl_cair.games.deep_rts.scenarios import SCENARIOS
from marl_cair.games.engine import BatchedEngine
from tests.games.deep_rts.skirmish import call, draw_actions

OPTIONS = [
    {},
    {"fog": True},
    {"preset": "original", "actions": "classic"},
    {"preset": "thesis", "actions": "classic", "ticks_per_step": 1},
    {"actions": "grid", "preset": "original", "fog": True, "unit_capacity": 20},
    {"preset": "original", "map": "10x10-2p-clearing", "unit_capacity": 12},
    {"army": (0, 4, 3, 2), "max_ticks": 1_500},
    {"army": (3, 3, 3, 0), "goal": "score", "map": "10x10-2p-clearing", "fog": True},
    {"map": "31x31-4p-quarters", "num_players": 4, "teams": (0, 1, 1, 0), "fog": True},
    {"map": "15x15-1p-embers", "num_players": 1, "goal": "gold", "goal_amount": 100_000},
]


def check_world(engine: BatchedEngine, index: int = 0) -> None:
    """Board, rosters and counters tell the same story."""
    world, rules = call(s.world_at, engine._worlds, index), engine._rules
    occupants = np.full(world.board.shape[1], s.NO_UNIT)
    for player in range(rules.num_players):
        check_player(world, rules, player)
        for unit in world.roster[player, : world.players[player, s.NUM_UNITS]]:
            if world.units[unit, s.UNIT_STATE] == s.INSIDE:
                site = world.units[unit, s.UNIT_PARTNER]
                assert world.units[site, s.UNIT_PARTNER] == unit
                assert world.units[site, s.UNIT_STATE] == s.RISING
            else:
                cover(world, rules, unit, occupants)
    np.testing.assert_array_equal(world.board[s.OCCUPANT], occupants)
    burning = (
        world.board[s.TILE, world.units[world.units[:, s.UNIT_KIND] >= 0, s.UNIT_CELL]] == t.LAVA
    )
    assert world.clock[s.NUM_BURNING] == burning.sum()
    # What only a tick uses is clean after it.
    assert not world.board[s.CLAIM].any()
    assert not world.units[:, [s.UNIT_EXIT, s.UNIT_HURT]].any()
    assert (world.board[s.AMOUNT] >= 0).all()


def cover(world, rules, unit: int, occupants: np.ndarray) -> None:
    """Mark the unit's cells, which must be free ground."""
    kind = world.units[unit, s.UNIT_KIND]
    half = rules.kinds[kind, KIND_HALF_SIZE]
    for row in range(-half, half + 1):
        for column in range(-half, half + 1):
            cell = world.units[unit, s.UNIT_CELL] + row * rules.stride + column
            assert occupants[cell] == s.NO_UNIT
            occupants[cell] = unit
            stands_in_a_pool = kind == t.PEASANT and world.board[s.TILE, cell] == t.OIL_TILE
            is_ground = world.board[s.TILE, cell] in t.WALKABLE_TILES
            assert is_ground or kind == t.OIL_WELL or stands_in_a_pool


def check_player(world, rules, player: int) -> None:
    columns = world.players[player]
    roster = world.roster[player, : columns[s.NUM_UNITS]]
    units = world.units[roster]
    kinds = units[:, s.UNIT_KIND]
    assert len(set(roster.tolist())) == len(roster) <= rules.slots
    assert (
        world.units[player * rules.slots : (player + 1) * rules.slots, s.UNIT_KIND] >= 0
    ).sum() == len(roster)
    assert np.bincount(kinds, minlength=t.NUM_KINDS).tolist() == (
        columns[s.NUM_OWNED : s.NUM_OWNED + t.NUM_KINDS].tolist()
    )
    assert (units[:, s.UNIT_HEALTH] > 0).all()
    assert (units[:, s.UNIT_HEALTH] <= rules.kinds[kinds, KIND_HEALTH]).all()
    queued = [
        product
        for unit in units
        for product in unit[s.UNIT_QUEUE : s.UNIT_QUEUE + unit[s.UNIT_QUEUE_LENGTH]]
        if product < t.NUM_KINDS
    ]
    eaters = np.array([*kinds, *queued], int)
    assert rules.kinds[eaters, KIND_FOOD_CONSUMED].sum() == columns[s.FOOD_USED]
    store = columns[s.RESOURCES : s.RESOURCES + t.NUM_RESOURCES]
    assert (store >= 0).all()
    assert (store <= t.MAX_RESOURCE).all()
    cursor = columns[s.CURSOR]
    assert cursor == s.NO_UNIT or (
        cursor in roster and world.units[cursor, s.UNIT_STATE] != s.INSIDE
    )


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_a_game_of_legal_actions_keeps_its_books(options):
    engine = make_engine("deep_rts", **options)
    luck = np.random.default_rng(1)
    engine.reset(1)
    for decision in range(300 if engine.num_players < 4 else 80):
        engine.step(draw_actions(engine, luck))
        check_world(engine)
        assert not engine.illegal_actions.any()
        if engine.terminated[0] or engine.truncated[0]:
            engine.reset(decision)


@pytest.mark.parametrize("options", OPTIONS[1:7], ids=str)
def test_a_game_of_any_actions_counts_what_was_illegal(options):
    engine = make_engine("deep_rts", **options)
    luck = np.random.default_rng(2)
    engine.reset(2)
    expected = np.zeros(engine.num_players, int)
    for decision in range(150):
        mask = engine.action_mask()
        actions = luck.integers(0, engine.num_actions, mask.shape[:-1])
        is_legal = np.take_along_axis(mask, actions[..., None], axis=-1)[0, ..., 0]
        for player in range(engine.num_players):
            is_alive = engine._worlds.players[0, player, 0]
            expected[player] += is_alive * (~is_legal[player]).sum()
        engine.step(actions)
        check_world(engine)
        assert engine.illegal_actions[0].tolist() == expected.tolist()
        if engine.terminated[0] or engine.truncated[0]:
            engine.reset(decision)
            expected[:] = 0


FUZZED_WORLDS, FUZZED_TICKS = 8, 1_000_000


@pytest.mark.slow
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_a_million_ticks_of_random_actions_break_nothing(scenario):
    """Over all scenarios together; half of the worlds also try what is not legal."""
    engine = make_engine("deep_rts", scenario, FUZZED_WORLDS)
    luck = np.random.default_rng(4)
    engine.reset(luck.integers(0, 2**63, FUZZED_WORLDS).astype(np.uint64))
    ticks = FUZZED_TICKS // len(SCENARIOS) // FUZZED_WORLDS
    for decision in range(ticks // engine.spec.ticks_per_step + 1):
        actions = draw_actions(engine, luck)
        wild = luck.integers(0, engine.num_actions, actions.shape)
        is_wild = (luck.random(actions.shape) < 0.2) & (np.arange(FUZZED_WORLDS) % 2 == 1)[:, None]
        engine.step(np.where(is_wild, wild, actions))
        if decision % 5 == 0:
            for world in range(FUZZED_WORLDS):
                check_world(engine, world)
        ended = engine.terminated | engine.truncated
        if ended.any():
            engine.reset(luck.integers(0, 2**63, FUZZED_WORLDS).astype(np.uint64), ended)
        anew = engine.observe("planes", worlds=list(range(FUZZED_WORLDS)))
        np.testing.assert_array_equal(engine.observe_in_place("planes"), anew)


@pytest.mark.parametrize("actions", ["unit", "classic", "grid"])
def test_an_illegal_action_does_what_doing_nothing_does(actions):
    engine = make_engine("deep_rts", num_worlds=2, actions=actions, preset="original")
    luck = np.random.default_rng(3)
    engine.reset(np.array([3, 3], np.uint64))
    noop = engine.spec.noop_action
    num_illegal = 0
    for decision in range(150):
        mask = engine.action_mask()
        np.testing.assert_array_equal(mask[0], mask[1])
        chosen = draw_actions(engine, luck)
        chosen[1] = chosen[0]
        for player in range(2):
            if luck.random() < 0.5:
                *place, action = luck.choice(np.argwhere(~mask[0, player]))
                chosen[(0, player, *place)], chosen[(1, player, *place)] = action, noop
                num_illegal += 1
        engine.step(chosen)
        for name, field in engine._worlds._asdict().items():
            if name != "illegal":
                np.testing.assert_array_equal(field[0], field[1], err_msg=name)
        if engine.terminated.any():
            engine.reset(np.array([decision] * 2, np.uint64))
            num_illegal = 0
    assert engine.illegal_actions[1].tolist() == [0, 0]
    assert engine.illegal_actions[0].sum() == num_illegal
