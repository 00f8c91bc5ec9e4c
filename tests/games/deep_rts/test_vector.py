"""The bounds of the vector's numbers, and the rules on which they rest."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

import marl_cair
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
    assert high_of(preset="wealthy")["own gold"] == 2000 + high["gathered gold"]
    rich = high_of("FFA-6-31x31", preset="original")  # stores hold no more than the rules allow
    assert max(value for name, value in rich.items() if "gold" in name) <= MAX_RESOURCE


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
    alone = high_of("Economy-15x15")
    assert alone["own damage done"] == 1  # no damage
    assert alone["own score"] < high["own score"]


@pytest.mark.parametrize("preset", PRESETS)
def test_health_is_never_for_free(preset):
    """Otherwise damage had no bound."""
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
    for place in product((7, 8, 9), (9, 10, 11)):
        if place != (8, 10):
            skirmish.order(put_worker(skirmish, *place), HARVEST, 8, 10)
    skirmish.wait(6)
    assert skirmish.gathered(0)[GOLD] == 1 + 7


def test_a_preset_with_something_free_has_the_bounds_of_its_numbers(monkeypatch):
    free = replace(PRESETS["balanced"], cost_gold=(0, *PRESETS["balanced"].cost_gold[1:]))
    monkeypatch.setitem(PRESETS, "free", free)
    high = high_of(preset="free")
    assert high["own damage taken"] == high["own score"] == NEVER


def test_wealth_multiplies_the_first_stores_of_all_players_alike():
    engine = marl_cair.make_engine("deep_rts", num_worlds=200, preset="wealthy")
    engine.reset(np.arange(200, dtype=np.uint64))
    seen = dict(zip(VECTOR_NAMES, engine.observe("vector").transpose(2, 0, 1), strict=True))
    gold, lumber = seen["own gold"], seen["own lumber"]
    assert set(gold[:, 0]) == {200 * wealth for wealth in range(1, 11)}
    assert (gold == gold[:, :1]).all()
    assert (lumber == gold / 2).all()
