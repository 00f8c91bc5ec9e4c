"""The fog of war: nothing unseen leaks, ground is remembered, sight is counted right."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules.board import sight_of
from marl_cair.games.deep_rts.views.planes import PLANE_NAMES
from tests.games.deep_rts.skirmish import Skirmish, call, draw_actions

NAMES = ("planes", "classic", "vector")
ALL_NAMES = (*NAMES, "image", "gray")
VISIBLE, EXPLORED = PLANE_NAMES.index("visible"), PLANE_NAMES.index("explored")


def foggy(**options) -> Skirmish:
    skirmish = Skirmish(fog=True, **options)
    skirmish.world.known[:] = s.UNKNOWN  # the units of the start have looked around
    return skirmish


def views_of(skirmish: Skirmish, player: int) -> list[np.ndarray]:
    seen = [skirmish.engine.observe(name)[0, player] for name in NAMES]
    return [*seen, skirmish.engine.action_mask()[0, player]]


def assert_same(first: list[np.ndarray], second: list[np.ndarray]) -> None:
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


# --- what is seen --------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "sight"), [(t.PEASANT, 4), (t.ARCHER, 6), (t.TOWN_HALL, 7), (t.FARM, 4)]
)
def test_a_unit_sees_a_round_disc(kind, sight):
    skirmish = foggy()
    skirmish.put(0, kind, 8, 8)
    visible = skirmish.engine.observe("planes")[0, 0, VISIBLE] > 0
    rows, columns = np.indices(visible.shape) - 8
    np.testing.assert_array_equal(visible, rows**2 + columns**2 <= sight * (sight + 1))


def test_ground_that_was_seen_is_remembered_and_units_there_are_not():
    skirmish = foggy()
    skirmish.put(1, t.PEASANT, 8, 12)
    scout = skirmish.put(0, t.PEASANT, 8, 9)
    before = skirmish.engine.observe("planes")[0, 0]
    assert before[PLANE_NAMES.index("enemy"), 8, 12] > 0
    skirmish.order(scout, s.MOVE, 8, 2)
    skirmish.wait(90)
    after = skirmish.engine.observe("planes")[0, 0]
    assert after[VISIBLE, 8, 12] == 0
    assert after[EXPLORED, 8, 12] > 0
    assert after[PLANE_NAMES.index("enemy"), 8, 12] == 0
    assert (after[EXPLORED] >= before[EXPLORED]).all()


def test_a_tile_that_changes_unseen_stays_in_memory_until_it_is_seen_again():
    skirmish = foggy()
    gold = skirmish.cell(8, 12)
    skirmish.world.board[s.TILE, gold] = t.GOLD_TILE
    scout = skirmish.put(0, t.PEASANT, 8, 9)
    skirmish.order(scout, s.MOVE, 8, 3)
    skirmish.wait(80)
    skirmish.world.board[s.TILE, gold] = t.GRASS
    plane = PLANE_NAMES.index("gold")
    assert skirmish.engine.observe("planes")[0, 0, plane, 8, 12] > 0
    assert skirmish.is_legal(0, "noop")
    skirmish.order(scout, s.MOVE, 8, 9)
    skirmish.wait(80)
    assert skirmish.engine.observe("planes")[0, 0, plane, 8, 12] == 0


def test_without_fog_all_is_visible():
    skirmish = Skirmish()
    skirmish.put(0, t.PEASANT, 8, 8)
    planes = skirmish.engine.observe("planes")[0, 0]
    assert (planes[VISIBLE] == 255).all()
    assert (planes[EXPLORED] == 255).all()


def test_allies_share_what_they_see():
    skirmish = foggy(goal="score", teams=(4, 4))
    skirmish.put(0, t.PEASANT, 2, 2)
    skirmish.put(1, t.ARCHER, 12, 12)
    first, second = skirmish.engine.observe("planes")[0]
    np.testing.assert_array_equal(first[VISIBLE], second[VISIBLE, ::-1, ::-1])
    assert first[VISIBLE, 12, 12] > 0
    assert first[PLANE_NAMES.index("ally"), 12, 12] > 0


# --- nothing else --------------------------------------------------------------------------------


def change_unseen(skirmish: Skirmish, luck: np.random.Generator) -> int:
    """Put other tiles and other units of player 1 where player 0 does not look; how many."""
    changes = 0
    for row in range(1, 15):
        for column in range(1, 15):
            cell = skirmish.cell(row, column)
            if skirmish.world.vision[0, cell] > 0 or skirmish.occupant(row, column) >= 0:
                continue
            choice = luck.integers(6)
            if choice == 0 and skirmish.world.players[1, s.NUM_UNITS] < 20:
                skirmish.put(1, int(luck.choice([t.PEASANT, t.FOOTMAN, t.FARM])), row, column)
                changes += 1
            elif choice == 1:
                skirmish.world.board[s.TILE, cell] = luck.choice([t.GRASS, t.WALL, t.GOLD_TILE])
                skirmish.world.board[s.AMOUNT, cell] = 100
                changes += 1
    return changes


@pytest.mark.parametrize("actions", ["unit", "classic", "grid"])
@pytest.mark.parametrize("kind", [t.PEASANT, t.FOOTMAN, t.ARCHER, t.TOWN_HALL, t.BARRACKS])
def test_what_lies_in_the_fog_changes_neither_view_nor_mask(kind, actions):
    luck = np.random.default_rng(kind)
    for _ in range(6):
        skirmish = foggy(actions=actions)
        skirmish.put(1, t.PEASANT, 13, 13)
        selected = skirmish.put(0, kind, 5, 5)
        skirmish.put(0, t.FOOTMAN, 8, 5)
        skirmish.put(1, t.FOOTMAN, 8, 7)
        skirmish.fill_store(0, 5_000, 5_000, 5_000, 5_000)
        skirmish.select(selected)
        before = views_of(skirmish, 0)
        assert change_unseen(skirmish, luck) > 10
        assert_same(views_of(skirmish, 0), before)
        skirmish.fill_store(1, 1, 2, 3, 4)
        skirmish.select(skirmish.units_of(1)[-1])
        for unit in skirmish.units_of(1):
            skirmish.set(unit, s.UNIT_ORDER, s.ATTACK)  # what others intend is hidden too
        assert_same(views_of(skirmish, 0)[:1], before[:1])


def test_an_unseen_enemy_is_no_target():
    """An attack is given up as its target goes out of the team's sight."""
    skirmish = foggy(preset="thesis")
    unit, other = skirmish.put(0, t.FOOTMAN, 8, 4), skirmish.put(1, t.PEASANT, 8, 12)
    skirmish.attack(unit, other)
    skirmish.wait(2)
    assert skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER


# --- counting ------------------------------------------------------------------------------------


def recount(engine) -> np.ndarray:
    """Who sees what, [players, cells], from the places of all units."""
    world, rules = engine._worlds, engine._rules
    vision = np.zeros(world.vision.shape[1:], int)
    rows, columns = rules.cells[:, 0].astype(int), rules.cells[:, 1].astype(int)
    is_inside = (rows >= 0) & (rows < rules.rows) & (columns >= 0) & (columns < rules.columns)
    for player in range(rules.num_players):
        for unit in world.roster[0, player, : world.players[0, player, s.NUM_UNITS]]:
            cell, kind = world.units[0, unit, s.UNIT_CELL], world.units[0, unit, s.UNIT_KIND]
            if world.board[0, s.OCCUPANT, cell] != unit:
                continue  # inside a site
            sight = call(sight_of, rules, kind)
            away = (rows - rows[cell]) ** 2 + (columns - columns[cell]) ** 2
            vision[player] += is_inside & (away <= sight * (sight + 1))
    return vision


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"army": (2, 5, 3, 1), "goal": "score"},
        {"preset": "original", "actions": "classic"},
    ],
    ids=str,
)
def test_sight_equals_a_recount_after_random_play(options):
    engine = make_engine("deep_rts", fog=True, **options)
    luck = np.random.default_rng(1)
    engine.reset(1)
    for decision in range(250):
        engine.step(draw_actions(engine, luck))
        if decision % 10 == 0:
            np.testing.assert_array_equal(engine._worlds.vision[0], recount(engine))
            known, board = engine._worlds.known[0], engine._worlds.board[0, s.TILE]
            for player in range(2):
                seen = engine._worlds.vision[0, player] > 0
                np.testing.assert_array_equal(known[player, seen], board[seen])
        if engine.terminated[0]:
            engine.reset(decision)


@pytest.mark.parametrize(
    ("state", "column", "values"),
    [
        (s.IDLE, s.UNIT_FACING, (1, 2)),
        (s.WALKING, s.UNIT_FACING, (0, 1)),
        (s.WALKING, s.UNIT_SINCE, (1, 8)),
        (s.GATHERING, s.UNIT_GOAL, (20, 160)),
        (s.REPAIRING, s.UNIT_FACING, (1, 2)),
    ],
)
def test_where_a_unit_looks_and_goes_is_its_owners_to_know(state, column, values):
    """Orders are hidden from others, in every representation and in the picture for people."""
    skirmish = Skirmish(tile_pixels=8)
    unit = skirmish.put(1, t.PEASANT, 4, 8)
    skirmish.set(unit, s.UNIT_STATE, state)
    skirmish.world.due[unit] = 60
    skirmish.world.clock[s.TICK] = 10
    skirmish.set(unit, s.UNIT_FACING, 1)
    seen = []
    for value in values:
        skirmish.set(unit, column, value)
        seen.append({name: skirmish.engine.observe(name)[0] for name in ALL_NAMES})
    for name in ALL_NAMES:
        assert np.array_equal(seen[0][name][0], seen[1][name][0]), name
    assert not np.array_equal(seen[0]["image"][1], seen[1]["image"][1])
