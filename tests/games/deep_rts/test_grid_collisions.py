"""`grid`: orders of one step that cannot all be carried out."""

from __future__ import annotations

import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import RICH, Skirmish, feed, of

FARM_PRICE = (60, 40)  # gold, lumber
BARRACKS_PRICE = (150, 100)
PLAYERS = pytest.mark.parametrize("player", [0, 1])


def meadow(**options) -> Skirmish:
    """Both are rich. Player 0 sees the map's text; for player 1 up is right and left is down."""
    game = Skirmish(**({"actions": "grid", "preset": "balanced"} | options))
    for player in (0, 1):
        game.fill_store(player, *RICH)
        feed(game, player)
    return game


def put_workers(game: Skirmish, *places: tuple[int, int], player: int = 0) -> list[int]:
    return [game.put(player, t.PEASANT, *place) for place in places]


def kinds_at(game: Skirmish, *places: tuple[int, int]) -> list[int]:
    return [game.get(game.occupant(*place), s.UNIT_KIND) for place in places]


# --- one player ----------------------------------------------------------------------------------


@pytest.mark.plain_python
@PLAYERS
@pytest.mark.parametrize("is_older_first", [True, False])
def test_money_for_one_goes_to_the_first_cell_of_the_own_view(player, is_older_first):
    game = meadow()
    places = [(4, 4), (12, 10)]
    workers = put_workers(game, *places[:: 1 if is_older_first else -1], player=player)
    game.fill_store(player, 2 * FARM_PRICE[0] - 1, 2 * FARM_PRICE[1])
    assert all(game.may(worker, "make_farm") for worker in workers)
    game.command(dict.fromkeys(workers, "make_farm"))
    built = [t.FARM, t.PEASANT] if player == 0 else [t.PEASANT, t.FARM]
    assert kinds_at(game, *places) == built
    assert game.store(player)[:2] == [FARM_PRICE[0] - 1, FARM_PRICE[1]]
    assert game.illegal() == [0, 0]
    assert not game.world.board[s.CLAIM].any()


def test_queues_and_sites_are_paid_in_one_order():
    game = meadow()
    first, last = put_workers(game, (2, 2), (12, 12))
    house = game.put(0, t.BARRACKS, 6, 6)
    game.fill_store(0, 60 + 80, 80)
    game.command({first: "make_farm", house: "make_footman", last: "make_farm"})
    assert kinds_at(game, (2, 2), (12, 12)) == [t.FARM, t.PEASANT]
    assert game.queue(house) == [t.FOOTMAN]
    assert game.store(0)[:2] == [0, 40]


def test_order_without_money_does_not_stop_later_ones():
    game = meadow()
    places = [(2, 4), (7, 4), (12, 4)]
    game.fill_store(0, 200, 200)
    names = ("make_farm", "make_barracks", "make_farm")
    game.command(dict(zip(put_workers(game, *places), names, strict=True)))
    assert kinds_at(game, *places) == [t.FARM, t.PEASANT, t.FARM]
    assert game.store(0)[:2] == [80, 120]


@pytest.mark.parametrize(
    ("kind", "product", "name", "column", "value"),
    [
        (t.BARRACKS, t.FOOTMAN, "make_footman", s.FOOD_MADE, 1),  # food for one
        (t.SMITHY, t.FIRST_UPGRADE + t.BLADES, "make_blades", s.UPGRADES + t.BLADES, 1),
    ],
)
def test_first_of_two_buildings_gets_the_last_food_or_level(kind, product, name, column, value):
    game = meadow()
    put_workers(game, (8, 8))  # a player without units that walk is out
    houses = [game.put(0, kind, row, 4) for row in (4, 12)]
    game.world.players[0, column] = value + (column == s.FOOD_MADE) * of(game, 0, s.FOOD_USED)
    game.command(dict.fromkeys(houses, name))
    assert [game.queue(house) for house in houses] == [[product], []]
    assert game.illegal() == [0, 0]


def test_last_unit_slot_takes_one_site():
    game = meadow(unit_capacity=3)
    game.command(dict.fromkeys(put_workers(game, (4, 4), (12, 4)), "make_farm"))
    assert kinds_at(game, (4, 4), (12, 4)) == [t.FARM, t.PEASANT]
    assert of(game, 0, s.NUM_UNITS) == 3
    assert game.store(0)[0] == 5_000 - FARM_PRICE[0]


@PLAYERS
def test_only_one_of_two_overlapping_own_sites_is_begun(player):
    game = meadow()
    places = [(8, 6), (8, 8)]
    game.command(dict.fromkeys(put_workers(game, *places, player=player), "make_barracks"))
    built = [t.BARRACKS, t.PEASANT] if player == 0 else [t.PEASANT, t.BARRACKS]
    assert kinds_at(game, *places) == built
    assert game.store(player)[:2] == [5_000 - cost for cost in BARRACKS_PRICE]
    assert game.illegal() == [0, 0]


def test_two_workers_beside_one_pool_build_one_well():
    game = meadow()
    game.set_tile(8, 8, t.OIL_TILE)
    workers = put_workers(game, (8, 7), (8, 9))
    game.command(dict.fromkeys(workers, "make_oil_well"))
    assert kinds_at(game, (8, 8)) == [t.OIL_WELL]
    assert [game.get(worker, s.UNIT_STATE) == s.INSIDE for worker in workers] == [True, False]


def test_money_returned_in_the_same_step_makes_no_order_legal():
    game = meadow()
    (worker,) = put_workers(game, (8, 8))
    house = game.put(0, t.BARRACKS, 2, 2)
    game.command({house: "make_footman"})
    game.fill_store(0, 0, 40)
    game.command({house: "cancel", worker: "make_farm"})
    assert game.queue(house) == []
    assert game.get(worker, s.UNIT_STATE) != s.INSIDE
    assert game.store(0)[0] == 80
    assert game.illegal() == [1, 0]


# --- two players ---------------------------------------------------------------------------------


@PLAYERS
def test_orders_do_not_know_of_sites_of_the_same_step(player):
    """A soldier that is sent to the ground of a new site of any player walks there."""
    game = meadow(preset="thesis")
    (builder,) = put_workers(game, (8, 8))
    soldier = game.put(player, t.FOOTMAN, 8, 11)
    toward = "go_r+0_c-2" if player == 0 else "go_r+2_c+0"  # to (8, 9)
    assert game.may(soldier, toward)
    game.command({builder: "make_barracks", soldier: toward})
    assert game.illegal() == [0, 0]
    assert kinds_at(game, (8, 9)) == [t.BARRACKS]
    assert game.get(soldier, s.UNIT_ORDER, s.UNIT_TARGET) == (s.MOVE, s.NO_UNIT)


def test_site_that_two_players_want_is_refused_to_both_and_costs_nothing():
    game = meadow()
    places, others = [(8, 6), (8, 8)], [(2, 8), (12, 8)]
    orders = {}
    for player in (0, 1):
        rival, other = put_workers(game, places[player], others[player], player=player)
        orders |= {rival: "make_barracks", other: "make_farm"}
    game.command(orders)
    assert kinds_at(game, *places, *others) == [t.PEASANT, t.PEASANT, t.FARM, t.FARM]
    assert game.store(0)[:2] == game.store(1)[:2] == [4_940, 4_960]
    assert game.illegal() == [0, 0]
    assert not game.world.board[s.CLAIM].any()


@pytest.mark.parametrize("rival_place", [(8, 8), (2, 4)])
def test_player_with_money_for_one_site_claims_only_the_first(rival_place):
    """The second stands in no way of others, and is not built if the first is refused."""
    game = meadow()
    workers = put_workers(game, (2, 2), (8, 6)) + put_workers(game, rival_place, player=1)
    game.fill_store(0, *BARRACKS_PRICE)
    game.command(dict.fromkeys(workers, "make_barracks"))
    built = kinds_at(game, (2, 2), (8, 6), rival_place)
    if rival_place == (8, 8):
        assert built == [t.BARRACKS, t.PEASANT, t.BARRACKS]
        assert game.store(0)[:2] == [0, 0]
    else:
        assert built == [t.PEASANT] * 3
        assert game.store(0)[:2] == list(BARRACKS_PRICE)


def test_eliminated_player_gives_no_orders():
    game = meadow()
    (worker,) = put_workers(game, (8, 8))
    game.world.players[0, s.IS_ALIVE] = 0
    mask = game.engine.action_mask()[0, 0]
    assert mask[..., 0].all()
    assert not mask[..., 1:].any()
    game.command({worker: "make_farm"})
    assert game.illegal() == [0, 0]
    assert kinds_at(game, (8, 8)) == [t.PEASANT]
    assert of(game, 0, s.CURSOR) == s.NO_UNIT
