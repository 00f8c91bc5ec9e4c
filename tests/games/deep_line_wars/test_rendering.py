"""Pictures show what is there, to each seat from its own side, and nothing hidden."""

import numpy as np
import pytest

import marl_cair
from marl_cair.games.deep_line_wars import rendering
from marl_cair.games.deep_line_wars.rendering import PALETTES, TOWER_SPRITES, UNIT_SPRITES

BUILD_BASIC_R4_C3 = 5 + 4 * 6 + 2


@pytest.fixture
def engine():
    engine = marl_cair.make_engine("deep_line_wars", "10x15")
    engine.reset(0)
    return engine


def play(engine, first, second):
    engine.step(np.array([[first, second]], np.int32))


def test_the_picture_has_one_size_on_every_board():
    for scenario in ("10x15", "17x17", "30x11"):
        engine = marl_cair.make_engine("deep_line_wars", scenario)
        engine.reset(0)
        assert engine.render(0).shape == (600, 800, 3)
        assert engine.observe("image").shape == (1, 2, 3, 600, 800)


def test_a_mirrored_position_looks_alike_from_both_seats(engine):
    play(engine, BUILD_BASIC_R4_C3, BUILD_BASIC_R4_C3)
    for representation in ("image", "gray"):
        seen = engine.observe(representation)[0]
        assert np.array_equal(seen[0], seen[1])


def test_a_tower_changes_the_picture_only_in_its_cell_and_the_bars(engine):
    before = engine.observe("gray")[0, 0, 0].astype(int)
    rules, worlds = engine._rules, engine._worlds
    play(engine, BUILD_BASIC_R4_C3, 0)
    after = engine.observe("gray")[0, 0, 0].astype(int)
    board = (before != after)[rendering.GRAY_BARS :]
    rows, columns = np.nonzero(board)
    height = rendering.GRAY_SIDE - rendering.GRAY_BARS
    assert set(rows) == set(range(4 * height // rules.rows, 5 * height // rules.rows))
    side = rendering.GRAY_SIDE
    assert set(columns) == set(range(3 * side // rules.columns, 4 * side // rules.columns))
    assert worlds.num_towers[0].tolist() == [1, 0]


def test_every_kind_has_its_own_picture_in_both_colours():
    for sprites in (UNIT_SPRITES, TOWER_SPRITES):
        assert sprites.shape[1:] == (12, 12)
        assert len({sprite.tobytes() for sprite in sprites}) == len(sprites)
    assert not np.array_equal(PALETTES[0], PALETTES[1])
