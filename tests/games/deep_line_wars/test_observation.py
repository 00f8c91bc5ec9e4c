"""What players see: every plane at its place, from the own side, and nothing that is hidden."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.games.deep_line_wars import tables as t
from marl_cair.games.deep_line_wars.observation import (
    LOG_LEVELS,
    PLANE_NAMES,
    UNIFORM_NAMES,
    VECTOR_NAMES,
)
from marl_cair.games.deep_line_wars.tables import BASIC, FASTER, FOOTMAN, GRUNT, MILITIA
from tests.games.cases import Luck, choose_actions
from tests.games.deep_line_wars.board import Board


def see(board: Board, player: int = 0) -> dict[str, np.ndarray]:
    """The planes [H, W] by name."""
    planes = board.engine.observe("planes")[0, player]
    return dict(zip(PLANE_NAMES, planes, strict=True))


def level(board: Board, plane: str, player: int = 0) -> int:
    """The value of a uniform plane."""
    values = np.unique(see(board, player)[plane])
    assert len(values) == 1
    return int(values[0])


def places(plane: np.ndarray) -> list[tuple[int, int]]:
    return list(zip(*(axis.tolist() for axis in np.nonzero(plane)), strict=True))


def test_there_are_28_planes_of_which_the_last_ten_are_uniform():
    board = Board()
    planes = board.engine.representation("planes")
    assert planes.shape == (28, 10, 15)
    assert planes.num_uniform == len(UNIFORM_NAMES) == 10
    assert planes.plane_names[16] == "terrain"
    assert planes.plane_names[17] == "own cursor"


@pytest.mark.plain_python
@pytest.mark.parametrize("kind", range(t.NUM_TOWER_KINDS))
def test_towers_stand_in_the_plane_of_their_kind_mirrored_for_the_enemy(kind):
    board = Board()
    board.put_tower(0, kind, row=3, column=5)
    name = t.TOWER_NAMES[kind]
    own, enemy = see(board, 0), see(board, 1)
    assert places(own[f"own {name} towers"]) == [(3, 5)]
    assert places(enemy[f"enemy {name} towers"]) == [(3, 9)]
    assert own[f"own {name} towers"][3, 5] == 255
    for seen in (own, enemy):
        assert sum("towers" in plane and bool(seen[plane].any()) for plane in seen) == 1


@pytest.mark.plain_python
@pytest.mark.parametrize("kind", range(t.NUM_UNIT_KINDS))
def test_units_stand_in_the_plane_of_their_kind_mirrored_for_the_enemy(kind):
    board = Board()
    board.put_unit(1, kind, row=7, column=2, progress=50)
    name = t.UNIT_NAMES[kind]
    own, enemy = see(board, 1), see(board, 0)
    assert places(own[f"own {name} units"]) == [(7, 2)]
    assert places(enemy[f"enemy {name} units"]) == [(7, 12)]
    assert own[f"own {name} units"][7, 2] == 64
    assert own["own unit progress"][7, 2] == enemy["enemy unit progress"][7, 12] == 127
    assert not own["enemy unit progress"].any()


@pytest.mark.parametrize(
    ("kind", "health", "shown"),
    # 64 / 140, of a grunt's last hit point, is below 1.
    [*((MILITIA, *one) for one in ((40, 64), (39, 62), (20, 32), (1, 1), (0, 0))), (GRUNT, 1, 1)],
)
def test_a_unit_shows_its_share_of_health_and_at_least_1(kind, health, shown):
    board = Board()
    slot = board.put_unit(0, kind, row=0, column=4)
    board.world.unit_health[0, slot] = health
    assert see(board)[f"own {t.UNIT_NAMES[kind]} units"][0, 4] == shown


def test_units_of_one_kind_in_a_cell_add_up_and_saturate():
    board = Board()
    expected = [64, 128, 192, 255, 255]
    for count in range(5):
        board.put_unit(0, GRUNT, row=1, column=1, progress=count)
        assert see(board)["own grunt units"][1, 1] == expected[count]
    assert see(board)["own unit progress"][1, 1] == 255 * 4 // 100


def test_terrain_shows_the_halves_the_centre_and_the_spawn_columns():
    for player in range(2):
        terrain = see(Board(), player)["terrain"]
        assert (terrain == terrain[0]).all()
        assert terrain[0].tolist() == [50] + [100] * 6 + [150] + [200] * 6 + [250]
    even = see(Board("30x11"))["terrain"][0].tolist()
    assert even == [50] + [100] * 13 + [150] * 2 + [200] * 13 + [250]


def test_the_own_cursor_shows_with_the_classic_actions_only():
    assert not see(Board())["own cursor"].any()
    board = Board(actions="classic")
    board.world.cursor[:] = [(2, 3), (4, 5)]
    assert places(see(board, 0)["own cursor"]) == [(2, 3)]
    assert places(see(board, 1)["own cursor"]) == [(4, 5)]


@pytest.mark.plain_python
def test_uniform_planes_show_each_player_its_own_and_the_enemys_economy():
    board = Board()
    board.world.health[:] = (25, -3)
    board.world.gold[:] = (7, 1_000)
    board.world.lumber[:] = (3, 300)
    board.world.income[:] = (20, 22)
    shown = {name: level(board, name) for name in UNIFORM_NAMES}
    mirrored = {name: level(board, name, player=1) for name in UNIFORM_NAMES}
    assert [shown[f"own {name}"] for name in ("health", "gold", "lumber")] == [127, 7, 3]
    assert [shown[f"enemy {name}"] for name in ("health", "gold", "lumber")] == [0, 255, 255]
    assert shown["own income"] < shown["enemy income"]
    for name in ("health", "gold", "lumber", "income"):
        assert shown[f"own {name}"] == mirrored[f"enemy {name}"]
        assert shown[f"enemy {name}"] == mirrored[f"own {name}"]


def test_clocks_run_down_by_the_tick():
    board = Board(max_ticks=200)
    assert level(board, "time to next income") == level(board, "time left") == 255
    board.wait(99)
    assert level(board, "time to next income") == 255 // 100
    assert level(board, "time left") == 255 * 101 // 200
    board.wait(1)
    assert level(board, "time to next income") == 255
    board.wait(100)
    assert level(board, "time left") == 0


def test_every_purchase_of_a_game_shows_in_the_income_plane():
    """Each step of 2 shows at first; later incomes differ by steps that still show."""
    assert len(np.unique(LOG_LEVELS[20:62:2])) == len(LOG_LEVELS[20:62:2])
    assert (np.diff(LOG_LEVELS.astype(int)) >= 0).all()
    assert LOG_LEVELS[1_500] > LOG_LEVELS[1_400]
    board = Board()
    board.world.income[0] = 1_000_000  # beyond the scale
    assert level(board, "own income") == LOG_LEVELS[-1]


def test_the_vector_gives_the_economy_in_its_own_units():
    board = Board(max_ticks=500)
    board.wait(30)
    board.world.health[:] = (25, -3)
    board.world.gold[:] = (7, 1_000)
    board.world.income[:] = (20, 22)
    own, enemy = board.engine.observe("vector")[0]
    assert own.tolist() == [25, 7, 0, 20, 0, 1_000, 0, 22, 70, 470]
    assert enemy[:4].tolist() == own[4:8].tolist()
    assert enemy[4:8].tolist() == own[:4].tolist()


@pytest.mark.plain_python
def test_the_classic_layers_hold_terrain_units_and_towers():
    board = Board()
    board.put_unit(0, GRUNT, row=2, column=3)
    board.put_unit(1, FOOTMAN, row=2, column=3)
    board.put_tower(0, FASTER, row=5, column=6)
    board.put_tower(1, BASIC, row=5, column=6)
    terrain, *units_and_towers = board.engine.observe("classic")[0, 0]
    assert terrain[0].tolist() == [1] + [0] * 6 + [2] + [0] * 6 + [1]
    units, towers = np.array(units_and_towers[:2]), np.array(units_and_towers[:1:-1])
    assert units[:, 2, [3, 11]].tolist() == [[3, 2], [1, 2]]  # kinds, owners
    assert towers[:, 5, [6, 8]].tolist() == [[3, 1], [1, 2]]
    assert all(np.count_nonzero(plane) == 2 for plane in (*units, *towers))


def test_the_classic_layers_show_the_oldest_enemy_unit_of_a_cell():
    board = Board()
    board.put_unit(0, MILITIA, row=2, column=7)
    board.put_unit(1, GRUNT, row=2, column=7)
    board.put_unit(1, FOOTMAN, row=2, column=7)
    _, kind, owner, *_ = board.engine.observe("classic")[0, 0]
    assert (kind[2, 7], owner[2, 7]) == (3, 2)
    board.world.unit_health[1, 0] = 0
    assert board.engine.observe("classic")[0, 0, 1, 2, 7] == 2
    board.world.unit_health[1, 1] = 0
    assert board.engine.observe("classic")[0, 0, 1:3, 2, 7].tolist() == [1, 1]


@pytest.mark.plain_python
def test_the_heat_map_paints_own_towers_enemy_units_and_the_own_cursor():
    board = Board(actions="classic")
    board.world.cursor[0] = (9, 1)
    board.put_tower(0, BASIC, row=1, column=2)
    board.put_tower(0, BASIC, row=3, column=4)
    board.put_unit(1, MILITIA, row=3, column=board.mirrored(4))
    board.put_unit(0, MILITIA, row=0, column=0)
    board.put_tower(1, BASIC, row=0, column=1)
    colour = board.engine.observe("heatmap")[0, 0]
    gray = board.engine.observe("heatmap_gray")[0, 0, 0]
    assert colour[:, 1, 2].tolist() == [255, 0, 0]
    assert colour[:, 3, 4].tolist() == [0, 255, 0]
    assert colour[:, 9, 1].tolist() == [0, 255, 255]
    assert np.count_nonzero(colour.any(axis=0)) == 3
    for row, column in ((1, 2), (3, 4), (9, 1)):
        luma = np.array([0.299, 0.587, 0.114]) @ colour[:, row, column]
        assert gray[row, column] == round(luma)
    assert np.count_nonzero(gray) == 3
    assert not Board().engine.observe("heatmap").any()  # spatial actions have no cursor


@pytest.mark.slow
@settings(max_examples=6)
@given(
    actions=st.sampled_from(["spatial", "classic"]),
    player=st.integers(0, 1),
    seed=st.integers(0, 2**32 - 1),
    cursor=st.tuples(st.integers(0, 9), st.integers(1, 13)),
    word=st.integers(1, 2**64 - 1),
)
def test_no_representation_shows_the_enemys_cursor_or_the_random_words(
    actions, player, seed, cursor, word
):
    """The same bytes whatever is hidden; the own cursor, which is not, shows."""
    board = Board(seed=seed, actions=actions, ticks_per_step=10)
    engine = board.engine
    for numbers in Luck.draw(40, 1, 2, seed).numbers:
        engine.step(choose_actions(engine, numbers))
    names = list(engine.spec.representations)
    before = {name: engine.observe(name)[0, player].copy() for name in names}
    mask = engine.action_mask()[0, player].copy()

    board.world.cursor[1 - player] = cursor
    board.world.random[:] ^= np.uint64(word)
    board.world.illegal[:] += 1
    for name in names:
        seen = engine.observe(name)[0, player]
        np.testing.assert_array_equal(seen, before[name], err_msg=name)
    np.testing.assert_array_equal(engine.action_mask()[0, player], mask)

    board.world.cursor[player, 0] = (board.world.cursor[player, 0] + 1) % 10
    changed = not np.array_equal(engine.observe("planes")[0, player], before["planes"])
    assert changed == (actions == "classic")


def high_of(board: Board) -> dict[str, float]:
    shown = board.engine.spec.representations["vector"]
    assert shown.low == (0.0,) * len(VECTOR_NAMES)
    return dict(zip(VECTOR_NAMES, shown.high, strict=True))


def test_each_number_of_the_vector_has_its_own_bound():
    high = high_of(Board(preset="balanced"))
    assert high["own health"] == 50
    assert high["own lumber"] == 8 + 25  # one at the end of each interval
    assert (high["ticks to next income"], high["ticks left"]) == (100, 2_500)
    assert high_of(Board(preset="2018"))["own lumber"] == 1  # always 0
    for name in ("health", "gold", "lumber", "income"):
        assert high[f"own {name}"] == high[f"enemy {name}"]


def test_the_bounds_of_a_short_game_are_what_it_can_bring():
    """One decision: one unit bought, one killed, and no income is paid."""
    board = Board(preset="balanced", ticks_per_step=10, max_ticks=10)
    high = high_of(board)
    assert (high["own gold"], high["own income"]) == (200 + 10, 100 + 20)
    board.play("buy_armoured_grunt", "noop")
    seen = dict(zip(VECTOR_NAMES, board.engine.observe("vector")[0, 0].tolist(), strict=True))
    assert 100 < seen["own income"] <= high["own income"]
    # Ten purchases before the only payment, for which there are 300 gold with ten bounties.
    high = high_of(Board(preset="balanced", ticks_per_step=10, max_ticks=100))
    assert (high["own gold"], high["own income"]) == (300 + 100, 100 + 300 * 20 // 100)


@pytest.mark.parametrize("preset", ["2017", "2018", "balanced"])
@pytest.mark.parametrize("ticks_per_step", [1, 7, 10])
def test_who_only_invests_and_who_saves_in_time_stay_below_the_bounds(preset, ticks_per_step):
    """And come near: within a few times of what they reach, bounties and fractions left out."""
    board = Board(preset=preset, ticks_per_step=ticks_per_step, max_ticks=1_000)
    high, most = high_of(board), np.zeros(len(VECTOR_NAMES))
    while not board.engine.truncated[0]:
        buys = "noop"
        for unit in ("footman", "armoured_grunt"):
            buys = f"buy_{unit}" if board.is_legal(0, f"buy_{unit}") else buys
        saves = board.world.tick[0] >= 500 or not board.is_legal(1, "buy_footman")
        board.play(buys, "noop" if saves else "buy_footman")
        board.world.health[:] = 50  # no player loses
        most = np.maximum(most, board.engine.observe("vector")[0].max(axis=0))
    reached = dict(zip(VECTOR_NAMES, most.tolist(), strict=True))
    for name, value in reached.items():
        assert value <= high[name], name
    assert reached["own gold"] > high["own gold"] / 30
    assert reached["own income"] > high["own income"] / 30


def test_the_public_state_holds_all_but_the_random_words():
    board = Board()
    before = board.engine.public_state(0)
    board.world.random[:] += np.uint64(1)
    np.testing.assert_array_equal(board.engine.public_state(0), before)
    for name, field in board.world._asdict().items():
        if name != "random":
            field.flat[-1] += 1
            assert (board.engine.public_state(0) != before).sum() == 1, name
            field.flat[-1] -= 1
