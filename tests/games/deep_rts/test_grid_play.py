"""Whole games of `grid`: each order equals that of `unit` for the same unit; bots."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.definition import WAYS
from marl_cair.games.deep_rts.orders.cursor import obey_cursors
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


def list_units(engine: BatchedEngine) -> list[tuple[int, int, int, int]]:
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
    """The actions of `unit` with the meaning of an order of `grid`: the first legal one counts."""
    names = {name: index for index, name in enumerate(engine.spec.action_names)}
    if name.startswith("go"):
        away = [int(part[1:]) for part in name.split("_")[1:]]
        places = [("go", row + away[0], column + away[1])]
    elif name.startswith("advance"):
        way = WAYS.index(name.removeprefix("advance_"))
        rows, columns = ROW_STEP[way], COLUMN_STEP[way]
        places = [("advance", row + rows * n, column + columns * n) for n in (4, 3, 2, 1)]
    else:
        return [names[name]]
    wanted = [f"{order}_r{r}_c{c}" for order, r, c in places]  # off the board there is none
    return [names[action] for action in wanted if action in names]


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
    """In any state, `grid` offers a unit exactly what `unit` offers it under the cursor."""
    engines = [make_engine("deep_rts", actions=a, **options) for a in ("grid", "unit", "grid")]
    grid, unit, stage = engines
    luck = np.random.default_rng(5)
    for engine in engines:
        engine.reset(5)
    num_legal = 0
    for _ in range(6):
        for _ in range(12):
            stage.step(draw_actions(stage, luck))
        copy_state(stage, grid)
        mask = grid.action_mask()[0]
        for player, slot, row, column in list_units(grid):
            copy_state(stage, unit)
            unit._worlds.players[0, player, s.CURSOR] = slot
            known = unit.action_mask()[0, player]
            names = grid.spec.action_names
            meant = [unit_actions_of(unit, name, row, column) for name in names]
            expected = [bool(known[actions].any()) for actions in meant]
            assert mask[player, row, column].tolist() == expected
            legal = np.flatnonzero(expected[1:]) + 1
            for order in luck.permutation(legal)[:ORDERS_PER_UNIT]:
                num_legal += 1
                actions = np.zeros(unit.num_players, np.int32)
                actions[player] = next(action for action in meant[order] if known[action])
                copy_state(stage, unit)
                unit._worlds.players[0, player, s.CURSOR] = slot
                call(obey_cursors, call(s.world_at, unit._worlds, 0), unit._rules, actions)
                actions = np.zeros((grid.num_players, *grid.spec.action_shape), np.int32)
                actions[player, row, column] = order
                copy_state(stage, grid)
                call(obey_grids, call(s.world_at, grid._worlds, 0), grid._rules, actions)
                assert_same_but_scratch(grid, unit)
                assert (grid._worlds.illegal == stage._worlds.illegal).all()
    assert num_legal > 50


# --- bots ----------------------------------------------------------------------------------------


def test_random_bot_gives_every_unit_a_legal_order():
    engine = make_engine("deep_rts", num_worlds=2, actions="grid", army=(3, 2, 2, 1))
    bot = engine.game.bot("random", engine.scenario)
    engine.reset(np.arange(2, dtype=np.uint64))
    planes, masks = engine.observe("planes"), engine.action_mask()
    counts = np.zeros((2, 2, 15, 15), int)
    for seed in range(20):
        bot.seed(seed)
        for seat in range(2):
            orders = bot.act(planes[:, seat], masks[:, seat])
            assert orders.shape == (2, 15, 15)
            assert np.take_along_axis(masks[:, seat], orders[..., None], axis=-1).all()
            counts[:, seat] += orders > 0
    assert ((counts > 0) == masks[..., 1:].any(axis=-1)).all()


def test_other_bots_refuse_the_grid():
    game = make_engine("deep_rts").game
    with pytest.raises(ValueError, match="rusher .*'grid'.*actions='unit'"):
        game.bot("rusher", game.scenario(actions="grid"))


def test_random_bots_play_matches_of_the_grid():
    game = make_engine("deep_rts").game
    scenario = game.scenario("Skirmish-15x15", actions="grid", max_ticks=100)
    first, second = (game.bot("random", scenario) for _ in range(2))
    assert play_match(first, second, game, scenario, 2, seed=0).games == 2
    assert record_game(first, second, game, scenario, seed=0).actions.shape[1:] == (2, 15, 15)
