"""`grid`: orders of one decision that cannot all be had, and what all of them are judged by."""

from __future__ import annotations

import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import RICH, Skirmish, feed, of

FARM_PRICE = (60, 40)  # gold, lumber
BARRACKS_PRICE = (150, 100)


def meadow(**options) -> Skirmish:
    """Both are rich. Player 0 sees the map's text; for player 1 up is right and left is down."""
    skirmish = Skirmish(**({"actions": "grid", "preset": "balanced"} | options))
    for player in (0, 1):
        skirmish.fill_store(player, *RICH)
        feed(skirmish, player)
    return skirmish


def kinds_at(skirmish: Skirmish, *places: tuple[int, int]) -> list[int]:
    """What stands at places of the map."""
    return [skirmish.get(skirmish.occupant(*place), s.UNIT_KIND) for place in places]


# --- what one player cannot have all at once -----------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize("player", [0, 1])
@pytest.mark.parametrize("is_older_first", [True, False])
def test_money_for_one_goes_to_the_first_cell_of_the_own_view(player, is_older_first):
    skirmish = meadow()
    places = [(4, 4), (12, 10)]
    workers = {
        place: skirmish.put(player, t.PEASANT, *place)
        for place in (places if is_older_first else places[::-1])
    }
    skirmish.fill_store(player, 2 * FARM_PRICE[0] - 1, 2 * FARM_PRICE[1])
    orders = dict.fromkeys(workers.values(), "make_farm")
    assert all(skirmish.may(worker, "make_farm") for worker in orders)
    skirmish.tell(orders)
    built = [t.FARM, t.PEASANT] if player == 0 else [t.PEASANT, t.FARM]
    assert kinds_at(skirmish, *places) == built
    assert skirmish.store(player)[:2] == [FARM_PRICE[0] - 1, FARM_PRICE[1]]
    assert skirmish.illegal() == [0, 0]
    assert not skirmish.world.board[s.CLAIM].any()


def test_queues_and_sites_are_paid_in_one_order():
    skirmish = meadow()
    first = skirmish.put(0, t.PEASANT, 2, 2)
    house = skirmish.put(0, t.BARRACKS, 6, 6)
    last = skirmish.put(0, t.PEASANT, 12, 12)
    orders = {first: "make_farm", house: "make_footman", last: "make_farm"}
    skirmish.fill_store(0, 60 + 80, 80)
    skirmish.tell(orders)
    assert kinds_at(skirmish, (2, 2), (12, 12)) == [t.FARM, t.PEASANT]
    assert skirmish.queue(house) == [t.FOOTMAN]
    assert skirmish.store(0)[:2] == [0, 40]


def test_what_a_later_order_lacks_is_left_for_those_after_it():
    skirmish = meadow()
    workers = [skirmish.put(0, t.PEASANT, row, 4) for row in (2, 7, 12)]
    skirmish.fill_store(0, 200, 200)
    names = ("make_farm", "make_barracks", "make_farm")
    skirmish.tell(dict(zip(workers, names, strict=True)))
    assert kinds_at(skirmish, (2, 4), (7, 4), (12, 4)) == [t.FARM, t.PEASANT, t.FARM]
    assert skirmish.store(0)[:2] == [80, 120]


def test_food_for_one_feeds_the_first():
    skirmish = meadow()
    houses = [skirmish.put(0, t.BARRACKS, row, 4) for row in (4, 12)]
    skirmish.world.players[0, s.FOOD_MADE] = of(skirmish, 0, s.FOOD_USED) + 1
    skirmish.tell(dict.fromkeys(houses, "make_footman"))
    assert [skirmish.queue(house) for house in houses] == [[t.FOOTMAN], []]
    assert skirmish.illegal() == [0, 0]


def test_the_last_level_of_an_upgrade_is_bought_once():
    skirmish = meadow()
    smithies = [skirmish.put(0, t.SMITHY, row, 4) for row in (4, 12)]
    skirmish.put(0, t.PEASANT, 8, 8)  # who has nobody that walks is out
    skirmish.world.players[0, s.UPGRADES + t.BLADES] = 1
    skirmish.tell(dict.fromkeys(smithies, "make_blades"))
    assert [skirmish.queue(smithy) for smithy in smithies] == [[t.FIRST_UPGRADE + t.BLADES], []]


def test_the_last_unit_slot_takes_one_site():
    skirmish = meadow(unit_capacity=3)
    workers = [skirmish.put(0, t.PEASANT, row, 4) for row in (4, 12)]
    skirmish.tell(dict.fromkeys(workers, "make_farm"))
    assert kinds_at(skirmish, (4, 4), (12, 4)) == [t.FARM, t.PEASANT]
    assert of(skirmish, 0, s.NUM_UNITS) == 3
    assert skirmish.store(0)[0] == 5_000 - FARM_PRICE[0]


@pytest.mark.parametrize("player", [0, 1])
def test_two_own_sites_on_one_cell_are_one(player):
    skirmish = meadow()
    places = [(8, 6), (8, 8)]
    workers = [skirmish.put(player, t.PEASANT, *place) for place in places]
    skirmish.tell(dict.fromkeys(workers, "make_barracks"))
    built = [t.BARRACKS, t.PEASANT] if player == 0 else [t.PEASANT, t.BARRACKS]
    assert kinds_at(skirmish, *places) == built
    assert skirmish.store(player)[:2] == [5_000 - cost for cost in BARRACKS_PRICE]
    assert skirmish.illegal() == [0, 0]


def test_two_workers_beside_one_pool_build_one_well():
    skirmish = meadow()
    skirmish.world.board[s.TILE, skirmish.cell(8, 8)] = t.OIL_TILE
    workers = [skirmish.put(0, t.PEASANT, 8, column) for column in (7, 9)]
    skirmish.tell(dict.fromkeys(workers, "make_oil_well"))
    assert kinds_at(skirmish, (8, 8)) == [t.OIL_WELL]
    assert [skirmish.get(worker, s.UNIT_STATE) == s.INSIDE for worker in workers] == [True, False]


# --- what all orders are judged by ---------------------------------------------------------------


def test_money_that_comes_back_in_the_same_decision_makes_nothing_legal():
    skirmish = meadow()
    house, worker = skirmish.put(0, t.BARRACKS, 2, 2), skirmish.put(0, t.PEASANT, 8, 8)
    skirmish.tell({house: "make_footman"})
    skirmish.fill_store(0, 0, 40)
    skirmish.tell({house: "cancel", worker: "make_farm"})
    assert skirmish.queue(house) == []
    assert skirmish.get(worker, s.UNIT_STATE) != s.INSIDE
    assert skirmish.store(0)[0] == 80
    assert skirmish.illegal() == [1, 0]


@pytest.mark.parametrize("player", [0, 1])
def test_nobody_knows_of_sites_of_the_same_decision(player):
    """A soldier who is sent to the ground of a new site walks there, whoever builds it."""
    skirmish = meadow(preset="thesis")
    builder = skirmish.put(0, t.PEASANT, 8, 8)
    soldier = skirmish.put(player, t.FOOTMAN, 8, 11)
    toward = "go_r+0_c-2" if player == 0 else "go_r+2_c+0"  # to (8, 9)
    before = skirmish.engine.snapshot()
    skirmish.tell({builder: "make_barracks", soldier: toward})
    assert skirmish.illegal() == [0, 0]
    site = skirmish.occupant(8, 9)
    assert skirmish.get(site, s.UNIT_KIND) == t.BARRACKS
    assert (skirmish.get(soldier, s.UNIT_ORDER), skirmish.get(soldier, s.UNIT_TARGET)) == (
        s.MOVE,
        s.NO_UNIT,
    )
    skirmish.engine.restore(before)
    assert skirmish.may(soldier, toward)


# --- what two players want -----------------------------------------------------------------------


def test_a_site_that_two_players_want_is_refused_to_both_and_costs_nothing():
    skirmish = meadow()
    rivals = [skirmish.put(player, t.PEASANT, 8, 6 + 2 * player) for player in (0, 1)]
    others = [skirmish.put(player, t.PEASANT, 2 + 10 * player, 8) for player in (0, 1)]
    skirmish.tell(dict.fromkeys(rivals, "make_barracks") | dict.fromkeys(others, "make_farm"))
    assert kinds_at(skirmish, (8, 6), (8, 8), (2, 8), (12, 8)) == [
        t.PEASANT,
        t.PEASANT,
        t.FARM,
        t.FARM,
    ]
    assert skirmish.store(0)[:2] == skirmish.store(1)[:2] == [4_940, 4_960]
    assert skirmish.illegal() == [0, 0]
    assert not skirmish.world.board[s.CLAIM].any()


def test_a_site_that_cannot_be_paid_stands_in_nobodys_way():
    skirmish = meadow()
    first, second = skirmish.put(0, t.PEASANT, 2, 2), skirmish.put(0, t.PEASANT, 8, 6)
    rival = skirmish.put(1, t.PEASANT, 8, 8)
    skirmish.fill_store(0, *BARRACKS_PRICE)
    skirmish.tell(dict.fromkeys((first, second, rival), "make_barracks"))
    assert kinds_at(skirmish, (2, 2), (8, 6), (8, 8)) == [t.BARRACKS, t.PEASANT, t.BARRACKS]
    assert skirmish.store(0)[:2] == [0, 0]


def test_money_that_a_refused_site_held_is_not_spent_by_others():
    """Who asks for two sites with money for one does not get the second where the first fails."""
    skirmish = meadow()
    first, second = skirmish.put(0, t.PEASANT, 4, 6), skirmish.put(0, t.PEASANT, 12, 2)
    rival = skirmish.put(1, t.PEASANT, 4, 8)
    skirmish.fill_store(0, *BARRACKS_PRICE)
    skirmish.tell(dict.fromkeys((first, second, rival), "make_barracks"))
    assert kinds_at(skirmish, (4, 6), (12, 2), (4, 8)) == [t.PEASANT] * 3
    assert skirmish.store(0)[:2] == list(BARRACKS_PRICE)


def test_who_is_out_gives_no_orders():
    skirmish = meadow(num_players=2)
    worker = skirmish.put(0, t.PEASANT, 8, 8)
    skirmish.world.players[0, s.IS_ALIVE] = 0
    mask = skirmish.engine.action_mask()[0, 0]
    assert mask[..., 0].all()
    assert not mask[..., 1:].any()
    skirmish.tell({worker: "make_farm"})
    assert skirmish.illegal() == [0, 0]
    assert kinds_at(skirmish, (8, 8)) == [t.PEASANT]
    assert of(skirmish, 0, s.CURSOR) == s.NO_UNIT
    assert skirmish.world.board[s.OCCUPANT, skirmish.cell(8, 8)] == worker
