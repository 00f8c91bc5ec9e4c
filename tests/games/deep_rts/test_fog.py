"""The fog of war: nothing unseen leaks, ground is remembered, sight is counted right."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import roster
from marl_cair.games.deep_rts.views.planes import PLANE_NAMES
from tests.games.deep_rts.skirmish import MEADOW, RICH, Skirmish, call, play_random

NAMES = ("planes", "classic", "vector")
ALL_NAMES = (*NAMES, "image", "gray")


def foggy(**options) -> Skirmish:
    game = Skirmish(fog=True, **options)
    game.world.known[:] = s.UNKNOWN  # the units of the start have looked around
    return game


def plane(game: Skirmish, name: str, player: int = 0) -> np.ndarray:
    return game.engine.observe("planes")[0, player, PLANE_NAMES.index(name)]


def views_of(game: Skirmish) -> list[np.ndarray]:
    """All that player 0 sees, and its mask."""
    return [*(game.engine.observe(name)[0, 0] for name in NAMES), game.engine.action_mask()[0, 0]]


# --- what is seen --------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "sight"), [(t.PEASANT, 4), (t.ARCHER, 6), (t.TOWN_HALL, 7), (t.FARM, 4)]
)
def test_unit_sees_a_round_disc(kind, sight):
    game = foggy()
    game.put(0, kind, 8, 8)
    rows, columns = np.indices((16, 16)) - 8
    expected = rows**2 + columns**2 <= sight * (sight + 1)
    np.testing.assert_array_equal(plane(game, "visible") > 0, expected)


def test_ground_is_remembered_and_units_on_it_are_not():
    game = foggy()
    game.put(1, t.PEASANT, 8, 12)
    scout = game.put(0, t.PEASANT, 8, 9)
    before = plane(game, "explored")
    assert plane(game, "enemy")[8, 12] > 0
    game.order(scout, s.MOVE, 8, 2)
    game.wait(90)
    assert plane(game, "visible")[8, 12] == 0
    assert plane(game, "explored")[8, 12] > 0
    assert plane(game, "enemy")[8, 12] == 0
    assert (plane(game, "explored") >= before).all()


def test_tile_that_changes_unseen_stays_in_memory_until_it_is_seen_again():
    game = foggy()
    game.set_tile(8, 12, t.GOLD_TILE)
    scout = game.put(0, t.PEASANT, 8, 9)
    game.order(scout, s.MOVE, 8, 3)
    game.wait(80)
    game.set_tile(8, 12, t.GRASS)
    assert plane(game, "gold")[8, 12] > 0
    game.order(scout, s.MOVE, 8, 9)
    game.wait(80)
    assert plane(game, "gold")[8, 12] == 0


def test_a_team_remembers_what_any_of_it_has_seen_last():
    text = MEADOW.replace(".1......", ".1.....3").replace("......2.", "4.....2.")
    game = foggy(text=text, num_players=4, teams=(0, 1, 0, 1))
    game.set_tile(8, 12, t.GOLD_TILE)
    for player, tile in ((0, t.GOLD_TILE), (2, t.GRASS)):
        game.set_tile(8, 12, tile)
        passer = game.put(player, t.PEASANT, 8, 9)
        call(roster.remove_unit, game.world, game.rules, passer)
    assert {plane(game, "gold", player)[8, 12] for player in (0, 2)} == {0}
    assert {plane(game, "explored", player)[8, 12] > 0 for player in (0, 2)} == {True}


@pytest.mark.parametrize("fog", [False, True])
def test_no_move_leads_off_the_board(fog):
    game = Skirmish(fog=fog, actions="classic")
    game.select(game.put(0, t.PEASANT, 0, 0))
    names, legal = game.engine.spec.action_names, game.engine.action_mask()[0, 0]
    moves = [name for name, one in zip(names, legal, strict=True) if one and "move" in name]
    assert len(moves) == 3


def test_all_is_visible_without_fog():
    game = Skirmish()
    game.put(0, t.PEASANT, 8, 8)
    assert (plane(game, "visible") == 255).all()
    assert (plane(game, "explored") == 255).all()


def test_allies_share_their_sight():
    game = foggy(teams=(4, 4))
    game.put(0, t.PEASANT, 2, 2)
    game.put(1, t.ARCHER, 12, 12)
    visible = plane(game, "visible")
    np.testing.assert_array_equal(visible, plane(game, "visible", 1)[::-1, ::-1])
    assert visible[12, 12] > 0
    assert plane(game, "ally")[12, 12] > 0


# --- what is hidden ------------------------------------------------------------------------------


def change_unseen(game: Skirmish, luck: np.random.Generator) -> int:
    """Put other tiles and units of player 1 where player 0 does not look; returns how many."""
    changes = 0
    for row, column in np.ndindex(14, 14):
        place = row + 1, column + 1
        if game.world.vision[0, game.cell(*place)] > 0 or game.occupant(*place) >= 0:
            continue
        choice = luck.integers(6)
        if choice == 0 and game.world.players[1, s.NUM_UNITS] < 20:
            game.put(1, int(luck.choice([t.PEASANT, t.FOOTMAN, t.FARM])), *place)
            changes += 1
        elif choice == 1:
            game.set_tile(*place, luck.choice([t.GRASS, t.WALL, t.GOLD_TILE]), 100)
            changes += 1
    return changes


@pytest.mark.parametrize("actions", ["unit", "classic", "grid"])
@pytest.mark.parametrize("kind", [t.PEASANT, t.FOOTMAN, t.ARCHER, t.TOWN_HALL, t.BARRACKS])
def test_fog_hides_changes_from_views_and_mask(kind, actions):
    luck = np.random.default_rng(kind)
    for _ in range(6):
        game = foggy(actions=actions)
        game.put(1, t.PEASANT, 13, 13)
        selected = game.put(0, kind, 5, 5)
        game.put(0, t.FOOTMAN, 8, 5)
        game.put(1, t.FOOTMAN, 8, 7)
        game.fill_store(0, *RICH)
        game.select(selected)
        before = views_of(game)
        assert change_unseen(game, luck) > 10
        for seen, expected in zip(views_of(game), before, strict=True):
            np.testing.assert_array_equal(seen, expected)
        game.fill_store(1, 1, 2, 3, 4)
        game.select(game.units_of(1)[-1])
        for unit in game.units_of(1):
            game.set(unit, s.UNIT_ORDER, s.ATTACK)  # the orders of others are hidden too
        np.testing.assert_array_equal(views_of(game)[0], before[0])


def test_attack_is_given_up_as_its_target_leaves_the_sight_of_the_team():
    game = foggy(preset="thesis")
    unit, other = game.put(0, t.FOOTMAN, 8, 4), game.put(1, t.PEASANT, 8, 12)
    game.attack(unit, other)
    game.wait(2)
    assert game.get(unit, s.UNIT_ORDER) == s.NO_ORDER


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
def test_only_the_owner_sees_where_a_unit_looks_and_goes(state, column, values):
    """In every representation and in the picture for people."""
    game = Skirmish(tile_pixels=8)
    unit = game.put(1, t.PEASANT, 4, 8)
    game.set(unit, s.UNIT_STATE, state)
    game.world.due[unit] = 60
    game.world.clock[s.TICK] = 10
    game.set(unit, s.UNIT_FACING, 1)
    seen = []
    for value in values:
        game.set(unit, column, value)
        seen.append({name: game.engine.observe(name)[0] for name in ALL_NAMES})
    for name in ALL_NAMES:
        assert np.array_equal(seen[0][name][0], seen[1][name][0]), name
    assert not np.array_equal(seen[0]["image"][1], seen[1]["image"][1])


@pytest.mark.parametrize(
    "options",
    [{}, {"army": (2, 5, 3, 1), "goal": "score"}, {"preset": "original", "actions": "classic"}],
    ids=str,
)
def test_known_tiles_in_sight_are_the_real_ones(options):
    """That vision counts the units that see a cell is a condition in test_invariants."""
    engine = make_engine("deep_rts", fog=True, **options)
    for _ in play_random(engine, 250, seed=1):
        known, seen = engine._worlds.known[0], engine._worlds.vision[0] > 0
        board = np.broadcast_to(engine._worlds.board[0, s.TILE], known.shape)
        np.testing.assert_array_equal(known[seen], board[seen])
