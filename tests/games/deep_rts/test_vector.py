"""The bounds of the vector's numbers, and the rules on which they rest."""

from dataclasses import replace

import pytest

from marl_cair.games import GAMES
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.deep_rts.state import HARVEST, NEVER
from marl_cair.games.deep_rts.tables import GOLD, MAX_RESOURCE, PRESETS
from marl_cair.games.deep_rts.views.other_views import VECTOR_NAMES
from tests.games.deep_rts.skirmish import Skirmish
from tests.games.deep_rts.test_harvest import FIELD, put_worker


def high_of(scenario="1v1-15x15", **options):
    game = GAMES["deep_rts"]
    shown = game.make_spec(game.scenario(scenario, **options)).representations["vector"]
    assert shown.low == (0.0,) * len(VECTOR_NAMES)
    return dict(zip(VECTOR_NAMES, shown.high, strict=True))


def test_stores_are_bounded_by_what_lies_on_the_ground():
    """Ten tiles of gold on this map, of 500 units each; a worker brings home two for one."""
    (board,) = Scenario().maps
    assert [(board.tiles == tile).sum() for tile in (5, 6, 7, 8)] == [30, 10, 8, 2]
    high = high_of()
    assert high["gathered gold"] == 10 * (500 + 7) * 2
    assert high["own gold"] == 200 + high["gathered gold"]
    assert high["own lumber"] == 100 + 30 * (300 + 7) * 2
    assert high["gathered oil"] == 2 * (300 + 7)


def test_no_store_holds_more_than_the_rules_let_it():
    most = [
        value for name, value in high_of("FFA-6-31x31", preset="original").items() if "gold" in name
    ]
    assert max(most) <= MAX_RESOURCE


def test_units_are_bounded_by_food_and_slots_and_enemies_by_their_number():
    high = high_of()
    assert (high["own food used"], high["own food limit"]) == (100, 100)
    assert (high["own peasant"], high["own cavalry"], high["own farm"]) == (56, 50, 56)
    assert high["enemy footman in sight"] == 56
    assert high_of("FFA-6-15x15")["enemy footman in sight"] == 5 * 56
    assert high_of("Teams-2v2-15x15")["enemy footman in sight"] == 2 * 56
    assert high_of("Economy-15x15")["enemy footman in sight"] == 1  # there is none
    assert (high["own blades"], high["own plates"]) == (2, 2)
    assert high_of(army=(1, 0, 0, 55))["own food used"] == 1 + 2 * 55
    assert (high["ticks played"], high["ticks left"]) == (10_000, 10_000)


def test_who_is_alone_does_no_damage():
    high = high_of("Economy-15x15")
    assert high["own damage done"] == 1
    assert high["own score"] < high_of()["own score"]


@pytest.mark.parametrize("preset", PRESETS)
def test_health_is_never_for_free(preset):
    """Else there were no bound of damage: it is bought, with gold, of which there is so much."""
    numbers = PRESETS[preset]
    bought = zip(numbers.is_enabled, numbers.cost_gold, numbers.health, strict=True)
    assert min(gold for made, gold, _ in bought if made) > 0
    assert numbers.repair_percent > 0
    for gold, health in zip(numbers.cost_gold, numbers.health, strict=True):
        lost_by_cancelling = gold - gold * 3 // 4
        assert lost_by_cancelling / max(1, health // 10) >= gold / health


def test_all_who_stand_around_a_tile_take_its_last_unit():
    """Seven more than there is, for which the bound of a store leaves room."""
    skirmish = Skirmish(FIELD, preset="thesis")
    skirmish.set_amount(8, 10, 1)
    around = [
        (row, column) for row in (7, 8, 9) for column in (9, 10, 11) if (row, column) != (8, 10)
    ]
    for place in around:
        skirmish.order(put_worker(skirmish, *place), HARVEST, 8, 10)
    skirmish.wait(6)
    assert skirmish.gathered(0)[GOLD] == 1 + 7


def test_a_preset_with_something_free_has_the_bounds_of_its_numbers(monkeypatch):
    free = replace(PRESETS["balanced"], cost_gold=(0, *PRESETS["balanced"].cost_gold[1:]))
    monkeypatch.setitem(PRESETS, "free", free)
    high = high_of(preset="free")
    assert high["own damage taken"] == high["own score"] == NEVER
