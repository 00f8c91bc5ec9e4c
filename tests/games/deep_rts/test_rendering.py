"""Pictures and planes of each seat's own side, without what is hidden from it."""

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.art import rendering, sprites
from marl_cair.games.deep_rts.rules.rulebook import SEAT_FRAME
from marl_cair.games.deep_rts.tables import FARM, FOOTMAN, NUM_TILE_KINDS, TOWN_HALL
from tests.games.deep_rts.boards import PLAIN
from tests.games.deep_rts.skirmish import MEADOW, Skirmish, draw_actions


class Board(Skirmish):
    """A game at its start, on a meadow with gold at (0, 15), with its pictures."""

    def __init__(self, text=MEADOW, **options):
        super().__init__(text, is_empty=False, preset="balanced", **options)

    def image(self):
        return self.engine.observe("image")[0]

    def gray(self):
        return self.engine.observe("gray")[0]

    def pictures(self, player=0):
        return [self.image()[player], self.gray()[player], self.engine.render(0, player)]


@pytest.fixture
def board():
    return Board()


@pytest.fixture
def foggy():
    return Board(fog=True)


def changed_cells(before, after, side):
    """Cells (row, column) of a board [3, h, w] where two pictures differ."""
    rows, columns = np.nonzero((before != after).any(0))
    return set(zip((rows // side).tolist(), (columns // side).tolist(), strict=True))


def test_tiles_shrink_so_that_a_picture_stays_near_a_thousand_pixels(board):
    assert [rendering.tile_side(side, side) for side in (8, 24, 25, 42, 43, 64, 128)] == [
        32, 32, 24, 24, 16, 16, 8,
    ]  # fmt: skip
    heights = [board.engine.render(0, player).shape[0] for player in (None, 0, 1)]
    assert heights[0] > heights[1] == heights[2] > 16 * 32  # a row for each player that is shown


def test_a_mirrored_start_looks_alike_from_both_seats():
    board = Board(PLAIN.partition("\n")[2])
    for player in range(2):  # units look south on the board, so each in another direction
        frame = board.rules.seats[0, player, SEAT_FRAME]
        for unit in board.units_of(player):
            board.set(unit, s.UNIT_FACING, board.rules.own_direction[frame, 2])
    for pictures in (board.image(), board.gray()):
        assert np.array_equal(pictures[0], pictures[1])
        assert pictures[0].std() > 10


def test_a_unit_changes_the_image_only_in_its_cell(board):
    before = board.image()
    unit = board.put(1, FOOTMAN, 8, 7)
    assert changed_cells(before[0], board.image()[0], 8) == {(8, 7)}
    assert changed_cells(before[1], board.image()[1], 8) == {board.own_place(unit)[1:]}


def test_own_and_enemy_units_differ_in_every_picture(board):
    board.put(0, FOOTMAN, 8, 7)
    other = Board()
    other.put(1, FOOTMAN, 8, 7)
    for own, enemy in zip(board.pictures(), other.pictures(), strict=True):
        assert not np.array_equal(own, enemy)


def test_what_fog_hides_changes_no_picture_of_a_seat(foggy):
    before = foggy.pictures()
    hidden = foggy.put(1, FOOTMAN, 13, 9)
    foggy.set(hidden, s.UNIT_HEALTH, 3)
    site = foggy.put(1, FARM, 9, 12)
    foggy.set(site, s.UNIT_STATE, s.RISING)
    foggy.set_amount(0, 15, 1)
    foggy.world.board[s.TILE, foggy.cell(0, 15)] = 0
    foggy.fill_store(1, 999, 999, 999, 999)
    foggy.select(hidden)
    for first, second in zip(before, foggy.pictures(), strict=True):
        assert np.array_equal(first, second)
    assert not np.array_equal(foggy.engine.render(0, 1), before[2])


def test_fog_is_black_where_never_seen_and_dim_where_remembered(foggy):
    far = foggy.cell(7, 12)
    assert not foggy.image()[0, :, 56:64, 96:104].any()
    foggy.world.known[0, far] = foggy.world.board[s.TILE, far]
    remembered = int(foggy.image()[0, :, 56:64, 96:104].sum())
    foggy.world.vision[0, far] = 1
    assert 0 < remembered < int(foggy.image()[0, :, 56:64, 96:104].sum())


def test_training_and_selection_show_to_their_owner_alone(board):
    hall = board.units_of(1)[0]
    assert board.get(hall, s.UNIT_KIND) == TOWN_HALL
    for change in (
        lambda: (board.set(hall, s.UNIT_STATE, s.TRAINING), board.world.due.__setitem__(hall, 50)),
        lambda: board.select(hall),
    ):
        before = board.image()
        change()
        assert np.array_equal(before[0], board.image()[0])
        assert not np.array_equal(before[1], board.image()[1])


def test_damage_and_dwindling_resources_show(board):
    whole = board.image()[0]
    hall = board.units_of(0)[0]
    board.set(hall, s.UNIT_HEALTH, board.get(hall, s.UNIT_HEALTH) // 2)
    hurt = board.image()[0]
    assert not np.array_equal(whole, hurt)
    board.set_amount(0, 15, 1)
    assert changed_cells(hurt, board.image()[0], 8) == {(0, 15)}


def test_pictures_only_read(board):
    copies = [field.copy() for field in board.world]
    board.pictures()
    board.engine.render(0)
    for copy, field in zip(copies, board.world, strict=True):
        assert np.array_equal(copy, field)


@pytest.mark.parametrize("pixels", [1, 3, 5, 17, 32])
def test_every_tile_size_draws_the_base(pixels):
    board = Board(tile_pixels=pixels)
    assert len(np.unique(board.image()[0].reshape(3, -1), axis=1).T) > 5


def test_gray_bars_grow_with_the_store(board):
    bars = []
    for store in (0, 1_000, 1_000_000):
        board.fill_store(0, store, store, store, store)
        bars.append(board.gray()[0, 0, : rendering.GRAY_BARS])
    assert bars[1].sum() > bars[0].sum()
    assert (bars[2][:8, -1] > 0).all()


def test_every_kind_has_its_own_picture_in_all_colours():
    units, tiles = sprites.UNIT_SPRITES, sprites.TILE_SPRITES
    for group in (units[:, 0], sprites.GREAT_BUILDINGS, sprites.SMALL_BUILDINGS, tiles[:, 0]):
        assert len({sprite.tobytes() for sprite in group}) == len(group)
    assert len({sprite.tobytes() for sprite in units.reshape(-1, 256)}) == 12
    assert len(tiles) == NUM_TILE_KINDS
    assert len({palette.tobytes() for palette in sprites.PALETTES}) == 8


def test_planes_of_a_batch_with_maps_of_several_sizes():
    engine = make_engine("deep_rts", map="15x15-2p-crossing+21x21-2p-fords", num_worlds=8)
    engine.reset(np.arange(8, dtype=np.uint64))
    drawn = engine._worlds.clock[:, s.MAP_INDEX]
    assert set(drawn.tolist()) == {0, 1}
    walls = engine.observe("planes")[:, :, 2]  # tiles have planes but for grass, so lava is 1
    assert (walls[drawn == 0, :, 0] == 255).all()
    luck = np.random.default_rng(0)
    for _ in range(20):
        engine.step(draw_actions(engine, luck))
        again = engine.observe("planes", worlds=list(range(8)))
        np.testing.assert_array_equal(engine.observe_in_place("planes"), again)
    assert not engine.illegal_actions.any()
