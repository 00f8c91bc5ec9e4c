"""Scripted opponents: legal on every board, repeatable, memoryless, and stronger than random."""

import numpy as np
import pytest

from benchmarks._matches import play_match
from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import plans, purchases, sight
from marl_cair.games.deep_rts.bots.bots import BOTS
from marl_cair.games.deep_rts.bots.doctrines import DOCTRINES
from marl_cair.games.deep_rts.orders.orders import FIRST_PRODUCT, GO_THERE, NOOP, SELECT_THERE
from marl_cair.games.deep_rts.views.observation import log_level
from marl_cair.games.deep_rts.views.planes import FIRST_KIND, HAS_ORDER, IS_FIGHTING, TIME_LEFT
from tests.games import bot_play
from tests.games.bot_play import make_bot, play

CASES = [
    {},
    {"fog": True},
    {"preset": "thesis"},
    {"army": (0, 3, 3, 2)},
    {"map": "31x31-4p-quarters", "num_players": 4, "fog": True},
]


def make_game(num_worlds=2, **options):
    engine = make_engine("deep_rts", num_worlds=num_worlds, **options)
    engine.reset(np.arange(3, 3 + num_worlds, dtype=np.uint64))
    return engine


def read_start(name="mixed", **options):
    """What a bot sees from the first seat at the start of a game."""
    engine = make_game(1, **options)
    seen = sight.make_sight(engine.scenario, DOCTRINES[name])
    sight.read_sight(engine.observe("planes")[0, 0], seen)
    return seen


@pytest.fixture(scope="module")
def positions():
    """Planes and masks of both seats in games of two scripted players, after 120 steps."""
    engine = make_game(4)
    bots = [make_bot(engine, "mixed"), make_bot(engine, "random", 2)]
    return bot_play.find_positions(engine, bots, 120)


def play_legally(engine, names, num_steps):
    bots = [make_bot(engine, name, seat) for seat, name in enumerate(names)]
    for _, mask, actions in play(engine, bots, num_steps):
        assert np.take_along_axis(mask, actions[:, :, None], 2).all()
    assert (engine.illegal_actions == 0).all()


@pytest.mark.parametrize("options", CASES)
def test_every_bot_only_gives_legal_actions(options):
    for name in BOTS:
        engine = make_game(1, **options)
        others = ["random"] * (engine.spec.num_players - 1)
        play_legally(engine, [name, *others], 80 if is_compiling() else 10)


def test_of_all_bots_only_random_plays_the_classic_actions():
    engine = make_game(2, actions="classic")
    play_legally(engine, ["random", "random"], 80)
    for name in DOCTRINES:
        with pytest.raises(ValueError, match=rf"{name} cannot play .*'classic'.*actions='unit'"):
            make_bot(engine, name)


@pytest.mark.parametrize("name", BOTS)
def test_a_bot_repeats_with_its_seed_and_leaves_what_it_sees_as_it_is(name, positions):
    bot_play.assert_repeats_and_continues(name, positions)
    bot_play.assert_leaves_what_it_sees(name, positions)
    if name == "random":
        assert (positions.answers(name, 1) != positions.answers(name, 2)).any()
    else:
        bot_play.assert_answers_each_row_on_its_own(name, positions)


@pytest.mark.parametrize("name", DOCTRINES)
def test_every_scripted_bot_beats_random(name):
    engine = make_game(4)
    result = play_match(engine, make_bot(engine, name), make_bot(engine, "random"), seed=11)
    assert result.wins == result.games


class PeasantRush:
    """All peasants attack the hall, or the nearest peasant; the own hall trains more of them."""

    def __init__(self, engine, aims_at_hall):
        self.seen = sight.make_sight(engine.scenario, DOCTRINES["rusher"])
        self.aims_at_hall = aims_at_hall

    def seed(self, seed):
        """It has no chance."""

    def act(self, observation, mask):
        pairs = zip(observation, mask, strict=True)
        return np.array([self.choose(planes, legal) for planes, legal in pairs])

    def choose(self, planes, legal):
        seen = self.seen
        sight.read_sight(planes, seen)
        halls = np.flatnonzero(seen.kind == t.TOWN_HALL)
        own, other = halls[seen.side[halls] == sight.MINE], halls[seen.side[halls] == sight.FOE]
        people = seen.people[: seen.facts[sight.NUM_PEOPLE]]
        waiting = [cell for cell in people if not sight.shows(planes, seen, HAS_ORDER, cell)]
        action = NOOP
        if len(own) and seen.store[t.GOLD] >= 50 and sight.is_idle(planes, seen, own[0]):
            action = plans.give_order(planes, legal, seen, own[0], FIRST_PRODUCT + t.PEASANT)
        elif waiting:
            goal = sight.nearest_foe(seen, waiting[0], t.NUM_MOBILE_KINDS)
            if goal == sight.NO_CELL or (self.aims_at_hall and len(other)):
                goal = other[0] if len(other) else seen.facts[sight.TARGET]
            action = plans.send(planes, legal, seen, waiting[0], GO_THERE, goal)
        return action if legal[action] else NOOP


@pytest.mark.parametrize("name", DOCTRINES)
@pytest.mark.parametrize("aims_at_hall", [True, False])
def test_every_scripted_bot_holds_against_a_rush_of_peasants(name, aims_at_hall):
    engine = make_game(4)
    rush = PeasantRush(engine, aims_at_hall)
    result = play_match(engine, make_bot(engine, name), rush, seed=11)
    assert result.wins >= (4 if aims_at_hall else 3)


def test_peasants_of_close_neighbours_do_not_take_each_other_for_raiders():
    engine = make_game(2, scenario="FFA-6-15x15")
    bots = [make_bot(engine, name) for name in DOCTRINES]
    for planes, _, _ in play(engine, bots, 100):
        assert not np.any(planes[:, :, FIRST_KIND + t.PEASANT] & planes[:, :, IS_FIGHTING])


def test_a_store_is_read_off_its_level_to_three_in_a_hundred():
    for amount in (0, 1, 40, 100, 150, 200, 1_000, 50_000):
        assert abs(sight.stored(log_level(amount)) - amount) <= 0.03 * amount
    assert sight.stored(log_level(100)) >= 100
    assert sight.stored(log_level(200)) >= 200


def test_the_start_is_read_off_the_planes():
    seen = read_start()
    assert seen.own[t.PEASANT] == seen.facts[sight.NUM_PEOPLE] == 3
    assert seen.own[t.TOWN_HALL] == seen.foes[t.TOWN_HALL] == 1
    assert (seen.facts[sight.FOOD_USED], seen.facts[sight.FOOD_MADE]) == (3, 5)
    assert abs(seen.store[t.GOLD] - 200) <= 6
    assert abs(seen.store[t.LUMBER] - 100) <= 3
    assert seen.facts[sight.HOME] == 4 * seen.rules.columns + 4
    assert seen.facts[sight.THREAT] == sight.NO_CELL


def test_in_the_fog_the_enemy_is_expected_opposite():
    seen = read_start(map="31x31-4p-quarters", num_players=4, fog=True)
    assert seen.facts[sight.TARGET] == len(seen.kind) - 1 - seen.facts[sight.HOME]


def test_a_site_may_not_cut_a_way_and_a_farm_is_better_in_a_corner():
    seen = read_start()
    columns = seen.rules.columns
    # Around (4, 8) five cells wide there would be the hall on one side and water on another.
    assert purchases.keeps_ways_open(seen, 7 * columns + 3, 0)
    assert not purchases.keeps_ways_open(seen, 4 * columns + 8, 2)
    corner, meadow = 2 * columns + 1, 8 * columns + 5
    assert purchases.num_free_around(seen, corner) < purchases.num_free_around(seen, meadow)


def give(seen, **counts):
    """Stores of all resources, and units of each kind by the name of the array that counts them."""
    seen.store[:] = 1_000
    for name, units in counts.items():
        for kind, count in units.items():
            getattr(seen, name)[kind] = count


@pytest.mark.parametrize(
    ("enemy", "answer"), [(t.ARCHER, t.CAVALRY), (t.CAVALRY, t.FOOTMAN), (t.FOOTMAN, t.ARCHER)]
)
def test_mixed_trains_what_beats_the_soldiers_in_sight(enemy, answer):
    seen = read_start()
    give(seen, own={t.FOOTMAN: 2, t.ARCHER: 2, t.CAVALRY: 2}, foes={enemy: 6})
    seen.facts[sight.NUM_SOLDIERS] = 6
    assert purchases.choose_soldier(seen) == answer


def test_a_bot_of_cavalry_builds_a_well_and_trains_footmen_until_there_is_oil():
    seen = read_start("economist")
    give(seen, own={t.BARRACKS: 1, t.PEASANT: 8, t.FOOTMAN: 1})
    seen.facts[sight.NUM_SOLDIERS] = 1
    seen.facts[sight.FOOD_MADE] = 20
    assert purchases.wanted_building(seen) == t.OIL_WELL
    assert purchases.choose_soldier(seen) == t.CAVALRY
    seen.store[t.OIL] = 0
    assert purchases.choose_soldier(seen) in (t.FOOTMAN, t.ARCHER)


def test_the_turtle_equips_an_army_by_turns():
    seen = read_start("turtle")
    give(seen, own={t.BARRACKS: 1, t.PEASANT: 8, t.ARCHER: purchases.ENOUGH_SOLDIERS})
    seen.facts[sight.NUM_SOLDIERS] = purchases.ENOUGH_SOLDIERS
    seen.facts[sight.FOOD_MADE] = 30
    assert purchases.wanted_building(seen) == t.SMITHY
    give(seen, own={t.SMITHY: 1, t.OIL_WELL: 1})
    seen.facts[sight.FREE_SMITHY] = 0
    assert purchases.wanted_building(seen) == t.FIRST_UPGRADE + t.BLADES
    seen.level[t.BLADES] = 1
    assert purchases.wanted_building(seen) == t.FIRST_UPGRADE + t.PLATES
    seen.level[:] = seen.doctrine.upgrades
    assert purchases.wanted_building(seen) == t.BARRACKS


def test_without_a_hall_gold_goes_to_soldiers_until_there_is_enough_for_one():
    seen = read_start()
    give(seen, own={t.TOWN_HALL: 0, t.BARRACKS: 1, t.FOOTMAN: 1})
    assert purchases.wanted_building(seen) == t.TOWN_HALL
    seen.store[t.GOLD] = 100
    assert purchases.wanted_building(seen) == t.NO_KIND


def test_mixed_sends_the_foremost_peasant_where_it_does_not_see_the_enemy():
    engine, seen = make_game(1, fog=True), read_start(fog=True)
    planes, mask = engine.observe("planes")[0, 0], engine.action_mask()[0, 0]
    planes[TIME_LEFT] = 0
    assert plans.scout(planes, mask, seen) == NOOP  # it has three peasants only
    seen.own[t.PEASANT] = plans.SCOUT_WORKERS
    target = int(seen.facts[sight.TARGET])
    foremost = purchases.nearest_person(seen, target)
    is_selected = foremost == seen.facts[sight.SELECTED_CELL]
    order = (GO_THERE, target) if is_selected else (SELECT_THERE, foremost)
    assert plans.scout(planes, mask, seen) == plans.cell_action(seen, *order)
    seen.side[target], seen.kind[target] = sight.MINE, t.FOOTMAN  # it sees the enemy
    assert plans.scout(planes, mask, seen) == NOOP
