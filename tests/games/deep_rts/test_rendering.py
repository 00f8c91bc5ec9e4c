"""Pictures show what is there, to each seat from its own side, and nothing hidden."""

import numpy as np
import pytest

from marl_cair.games.deep_rts import state
from marl_cair.games.deep_rts.art import rendering
from marl_cair.games.deep_rts.art.gray import GRAY_BARS
from marl_cair.games.deep_rts.art.sprites import (
    GREAT_BUILDINGS,
    PALETTES,
    SMALL_BUILDINGS,
    TILE_SPRITES,
    UNIT_SPRITES,
)
from marl_cair.games.deep_rts.rules import step as rules
from marl_cair.games.deep_rts.rules.roster import add_unit
from marl_cair.games.deep_rts.rules.rulebook import SEAT_FRAME, make_rules
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.deep_rts.state import (
    AMOUNT,
    CURSOR,
    GATHERED,
    RESOURCES,
    RISING,
    TILE,
    TRAINING,
    UNIT_FACING,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_STATE,
    World,
    allocate,
)
from marl_cair.games.deep_rts.tables import FARM, FOOTMAN, NUM_TILE_KINDS, TILE_NAMES, TOWN_HALL


class Board:
    """One world of a scenario to put units on, with its pictures."""

    def __init__(self, **options):
        self.scenario = Scenario(**options)
        self.rules = make_rules(self.scenario)
        self.worlds = allocate(self.scenario, 1)
        seeds, mask = np.array([5], np.uint64), np.ones(1, np.bool_)
        with np.errstate(over="ignore"):  # counters wrap around, of which plain Python warns
            rules.reset(self.worlds, self.rules, seeds, mask, 0, 1)
        self.world = World(*(field[0] for field in self.worlds))

    def cell(self, row, column):
        return (row + 1) * self.rules.stride + column + 1

    def add(self, player, kind, row, column, **fields):
        unit = add_unit(self.world, self.rules, player, kind, self.cell(row, column))
        for name, value in fields.items():
            if name == "due":
                self.world.due[unit] = value
            else:
                column = getattr(state, f"UNIT_{name.upper()}")
                self.world.units[unit, column] = value
        return unit

    def image(self):
        side = self.scenario.tile_pixels
        shape = (3, side * self.scenario.rows, side * self.scenario.columns)
        out = np.full((1, self.scenario.num_players, *shape), 7, np.uint8)
        rendering.observe_image(self.worlds, self.rules, out, 0, 1)
        return out[0]

    def gray(self):
        side = rendering.GRAY_SIDE
        out = np.full((1, self.scenario.num_players, 1, side, side), 7, np.uint8)
        rendering.observe_gray(self.worlds, self.rules, out, 0, 1)
        return out[0]

    def draw(self, player=None):
        return rendering.draw(self.worlds, self.rules, 0, player)


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


def test_tiles_shrink_so_that_a_picture_stays_near_a_thousand_pixels():
    assert [rendering.tile_side(side, side) for side in (8, 24, 25, 42, 43, 64, 128)] == [
        32, 32, 24, 24, 16, 16, 8,
    ]  # fmt: skip


def test_pictures_have_the_sizes_that_are_told(board):
    for player, num_shown in ((None, 2), (0, 1), (1, 1)):
        height, width, *_ = rendering.picture_layout(board.rules, num_shown)
        assert board.draw(player).shape == (height, width, 3)


def test_a_mirrored_start_looks_alike_from_both_seats(board):
    for player in range(2):  # units look south on the board, so each in another direction
        frame, slots = board.rules.seats[0, player, SEAT_FRAME], board.rules.slots
        units = slice(player * slots, (player + 1) * slots)
        board.world.units[units, UNIT_FACING] = board.rules.own_direction[frame, 2]
    for pictures in (board.image(), board.gray()):
        assert np.array_equal(pictures[0], pictures[1])
        assert pictures[0].std() > 10


def test_a_unit_changes_the_image_only_in_its_cell(board):
    before = board.image()
    board.add(0, FOOTMAN, 8, 7)
    assert changed_cells(before[0], board.image()[0], 8) == {(8, 7)}
    own = int(board.rules.own_cell[board.rules.seats[0, 1, SEAT_FRAME], board.cell(8, 7)])
    assert changed_cells(before[1], board.image()[1], 8) == {divmod(own, 15)}


def test_own_and_enemy_units_differ_in_every_picture(board):
    board.add(0, FOOTMAN, 8, 7)
    seen = board.image()[0], board.gray()[0]
    other = Board()
    other.add(1, FOOTMAN, 8, 7)
    assert not np.array_equal(seen[0], other.image()[0])
    assert not np.array_equal(seen[1], other.gray()[0])


def test_what_fog_hides_changes_no_picture_of_a_seat(foggy):
    before = foggy.image()[0], foggy.gray()[0], foggy.draw(0)
    hidden = foggy.add(1, FOOTMAN, 13, 12, health=3)
    foggy.add(1, FARM, 9, 12, state=RISING, due=90)
    foggy.world.board[AMOUNT, foggy.cell(14, 10)] = 1
    foggy.world.board[TILE, foggy.cell(14, 9)] = 0
    foggy.world.players[1, RESOURCES:GATHERED] = 999
    foggy.world.players[1, CURSOR] = hidden
    after = foggy.image()[0], foggy.gray()[0], foggy.draw(0)
    for first, second in zip(before, after, strict=True):
        assert np.array_equal(first, second)
    assert not np.array_equal(foggy.draw(1), before[2])


def test_fog_is_black_where_never_seen_and_dim_where_remembered(foggy):
    far = foggy.cell(7, 12)
    assert not foggy.image()[0, :, 56:64, 96:104].any()
    foggy.world.known[0, far] = foggy.world.board[TILE, far]
    remembered = int(foggy.image()[0, :, 56:64, 96:104].sum())
    foggy.world.vision[0, far] = 1
    assert 0 < remembered < int(foggy.image()[0, :, 56:64, 96:104].sum())


def test_an_enemys_training_is_its_own_secret(board):
    before = board.image()
    hall = board.world.roster[1, 0]
    assert board.world.units[hall, UNIT_KIND] == TOWN_HALL
    board.world.units[hall, UNIT_STATE], board.world.due[hall] = TRAINING, 50
    assert np.array_equal(before[0], board.image()[0])
    assert not np.array_equal(before[1], board.image()[1])


def test_damage_and_dwindling_resources_show(board):
    whole = board.image()[0]
    board.world.units[board.world.roster[0, 0], UNIT_HEALTH] //= 2
    hurt = board.image()[0]
    assert not np.array_equal(whole, hurt)
    board.world.board[AMOUNT, board.cell(0, 2)] = 1
    assert changed_cells(hurt, board.image()[0], 8) == {(0, 2)}


def test_only_the_selection_of_the_onlooker_shows(board):
    before = board.image()
    board.world.players[1, CURSOR] = board.world.roster[1, 0]
    assert np.array_equal(before[0], board.image()[0])
    assert not np.array_equal(before[1], board.image()[1])


def test_pictures_only_read(board):
    copies = [field.copy() for field in board.worlds]
    board.image(), board.gray(), board.draw(None), board.draw(1)
    for copy, field in zip(copies, board.worlds, strict=True):
        assert np.array_equal(copy, field)


@pytest.mark.parametrize("pixels", [1, 3, 5, 17, 32])
def test_every_tile_size_draws_the_base(pixels):
    board = Board(tile_pixels=pixels)
    assert len(np.unique(board.image()[0].reshape(3, -1), axis=1).T) > 5


def test_gray_bars_grow_with_the_store(board):
    board.world.players[0, RESOURCES:GATHERED] = 0
    empty = board.gray()[0, 0, :GRAY_BARS]
    board.world.players[0, RESOURCES:GATHERED] = 1000
    assert int(board.gray()[0, 0, :GRAY_BARS].sum()) > int(empty.sum())
    board.world.players[0, RESOURCES:GATHERED] = 1_000_000
    assert (board.gray()[0, 0, :8, -1] > 0).all()


def test_every_kind_has_its_own_picture_in_all_colours():
    for sprites in (UNIT_SPRITES[:, 0], GREAT_BUILDINGS, SMALL_BUILDINGS, TILE_SPRITES[:, 0]):
        assert len({sprite.tobytes() for sprite in sprites}) == len(sprites)
    assert len({sprite.tobytes() for sprite in UNIT_SPRITES.reshape(-1, 256)}) == 12
    assert len(TILE_SPRITES) == NUM_TILE_KINDS == len(TILE_NAMES)
    assert len({palette.tobytes() for palette in PALETTES}) == 8
