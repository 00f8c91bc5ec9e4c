"""Whole games of `grid`: each order is the one of `unit` for that unit; bots, determinism."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.orders.cursor_orders import obey_cursors
from marl_cair.games.deep_rts.orders.grid import obey_grids
from marl_cair.games.deep_rts.rules.rulebook import COLUMN_STEP, ROW_STEP, SEAT_FRAME
from marl_cair.games.engine import BatchedEngine
from marl_cair.league.play.match import play_match, record_game
from tests.games.deep_rts.skirmish import call, draw_actions

STAGES = [
    {},
    {"fog": True, "preset": "original"},
    {"army": (3, 3, 3, 2), "goal": "score", "map": "10x10-2p-clearing", "fog": True},
    {"map": "31x31-4p-quarters", "num_players": 4, "teams": (0, 1, 1, 0), "fog": True},
]
ORDERS_PER_UNIT = 3


def copy_state(source: BatchedEngine, target: BatchedEngine) -> None:
    for field, saved in zip(target._worlds, source._worlds, strict=True):
        field[:] = saved


def commandable(engine: BatchedEngine) -> list[tuple[int, int, int, int]]:
    """Player, unit, and row and column of the own view, of all units on the board."""
    found = []
    world, rules = engine._worlds, engine._rules
    for player in range(engine.num_players):
        frame = rules.seats[world.clock[0, s.MAP_INDEX], player, SEAT_FRAME]
        for unit in world.roster[0, player, : world.players[0, player, s.NUM_UNITS]].tolist():
            cell = world.units[0, unit, s.UNIT_CELL]
            if world.board[0, s.OCCUPANT, cell] == unit:
                found.append((player, unit, *rules.own_place[frame, cell].tolist()))
    return found


def unit_actions_of(engine: BatchedEngine, name: str, row: int, column: int) -> list[int]:
    """The actions of `unit` that mean what an order of `grid` says, the first legal one counts."""
    names = {name: index for index, name in enumerate(engine.spec.action_names)}
    rows, columns = engine.scenario.rows, engine.scenario.columns

    def at(order: str, there: tuple[int, int]) -> list[int]:
        is_inside = 0 <= there[0] < rows and 0 <= there[1] < columns
        return [names[f"{order}_r{there[0]}_c{there[1]}"]] if is_inside else []

    if name.startswith("go"):
        away = [int(part[1:]) for part in name.split("_")[1:]]
        return at("go", (row + away[0], column + away[1]))
    if name.startswith("advance"):
        ways = ("up", "right", "down", "left", "up_right", "down_right", "down_left", "up_left")
        way = ways.index(name.removeprefix("advance_"))
        steps = [(ROW_STEP[way] * n, COLUMN_STEP[way] * n) for n in (4, 3, 2, 1)]
        return [action for r, c in steps for action in at("advance", (row + r, column + c))]
    return [names[name]]


def assert_same_but_scratch(first: BatchedEngine, second: BatchedEngine) -> None:
    for name, field in first._worlds._asdict().items():
        own, other = field.copy(), getattr(second._worlds, name).copy()
        if name == "board":
            own[0, s.FRONTIER] = other[0, s.FRONTIER] = 0
        if name == "players":
            own[..., s.CURSOR] = other[..., s.CURSOR] = 0
        np.testing.assert_array_equal(own, other, err_msg=name)


@pytest.mark.parametrize("options", STAGES if is_compiling() else STAGES[:3], ids=str)
def test_masks_and_orders_are_those_of_the_unit_space(options):
    """Whatever stands where: a unit can be told what it could be told under the cursor."""
    grid, unit = (
        make_engine("deep_rts", actions=actions, **options) for actions in ("grid", "unit")
    )
    stage = make_engine("deep_rts", actions="grid", **options)
    luck = np.random.default_rng(5)
    for engine in (grid, unit, stage):
        engine.reset(5)
    names = grid.spec.action_names
    num_legal = 0
    for _ in range(6):
        for _ in range(12):
            stage.step(draw_actions(stage, luck))
        copy_state(stage, grid)
        mask = grid.action_mask()[0]
        for player, slot, row, column in commandable(grid):
            copy_state(stage, unit)
            unit._worlds.players[0, player, s.CURSOR] = slot
            known = unit.action_mask()[0, player]
            meant = [unit_actions_of(unit, name, row, column) for name in names]
            expected = [bool(known[actions].any()) for actions in meant]
            assert mask[player, row, column].tolist() == expected
            legal = np.flatnonzero(expected[1:]) + 1
            for order in luck.permutation(legal)[:ORDERS_PER_UNIT]:
                num_legal += 1
                told = np.zeros((unit.num_players,), np.int32)
                told[player] = next(action for action in meant[order] if known[action])
                copy_state(stage, unit)
                unit._worlds.players[0, player, s.CURSOR] = slot
                call(obey_cursors, call(s.world_at, unit._worlds, 0), unit._rules, told)
                told = np.zeros((grid.num_players, *grid.spec.action_shape), np.int32)
                told[player, row, column] = order
                copy_state(stage, grid)
                call(obey_grids, call(s.world_at, grid._worlds, 0), grid._rules, told)
                assert_same_but_scratch(grid, unit)
                assert (grid._worlds.illegal == stage._worlds.illegal).all()
    assert num_legal > 50


@pytest.mark.parametrize("options", STAGES[1:3], ids=str)
def test_a_world_plays_the_same_alone_in_a_batch_and_after_restore(options):
    batch = make_engine("deep_rts", num_worlds=3, num_threads=2, actions="grid", **options)
    alone = make_engine("deep_rts", actions="grid", **options)
    luck = np.random.default_rng(6)
    batch.reset(np.arange(3, dtype=np.uint64))
    alone.reset(1)
    for decision in range(40):
        actions = draw_actions(batch, luck)
        batch.step(actions)
        alone.step(actions[[1]])
        for name, value in alone.state_dict().items():
            np.testing.assert_array_equal(value[0], batch.state_dict()[name][1], err_msg=name)
        np.testing.assert_array_equal(alone.action_mask()[0], batch.action_mask(worlds=[1])[0])
        if decision == 20:
            other = make_engine("deep_rts", actions="grid", **options)
            other.restore(alone.snapshot())
            alone = other


# --- bots ----------------------------------------------------------------------------------------


def test_the_random_bot_tells_every_unit_something_legal():
    engine = make_engine("deep_rts", num_worlds=2, actions="grid", army=(3, 2, 2, 1))
    bot = engine.game.bot("random", engine.scenario)
    engine.reset(np.arange(2, dtype=np.uint64))
    planes, masks = engine.observe("planes"), engine.action_mask()
    told = np.zeros((2, 2, 15, 15), int)
    for seed in range(20):
        bot.seed(seed)
        for seat in range(2):
            orders = bot.act(planes[:, seat], masks[:, seat])
            assert orders.shape == (2, 15, 15)
            assert np.take_along_axis(masks[:, seat], orders[..., None], axis=-1).all()
            told[:, seat] += orders > 0
    assert ((told > 0) == masks[..., 1:].any(axis=-1)).all()


def test_bots_with_a_plan_refuse_the_grid():
    scenario = make_engine("deep_rts", actions="grid").scenario
    message = (
        "the bot rusher cannot play the action space 'grid'; make the game with actions='unit'"
    )
    with pytest.raises(ValueError, match=message):
        make_engine("deep_rts").game.bot("rusher", scenario)


def test_random_bots_play_matches_of_the_grid():
    game = make_engine("deep_rts").game
    scenario = game.scenario("Skirmish-15x15", actions="grid", max_ticks=100)
    first, second = (game.bot("random", scenario) for _ in range(2))
    match = play_match(first, second, game, scenario, 2, seed=0)
    assert match.games == 2
    assert record_game(first, second, game, scenario, seed=0).shape[1:] == (2, 15, 15)
