"""Scripted opponents: legal on every board, repeatable, memoryless, and stronger than random."""

import numpy as np
import pytest

from benchmarks._matches import play_match
from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots.bots import BOTS
from marl_cair.games.deep_rts.bots.doctrines import DOCTRINES
from marl_cair.games.deep_rts.bots.economy import cell_action
from marl_cair.games.deep_rts.bots.plans import SCOUT_WORKERS, scout
from marl_cair.games.deep_rts.bots.purchases import ENOUGH_SOLDIERS, choose_soldier, wanted_building
from marl_cair.games.deep_rts.bots.sight import (
    FOOD_MADE,
    FOOD_USED,
    FREE_SMITHY,
    HOME,
    MINE,
    NO_CELL,
    NUM_PEOPLE,
    NUM_SOLDIERS,
    SELECTED_CELL,
    TARGET,
    THREAT,
    make_knowledge,
    make_sight,
    read_sight,
    stored,
)
from marl_cair.games.deep_rts.bots.sites import keeps_ways_open, nearest_person, num_free_around
from marl_cair.games.deep_rts.orders.orders import GO_THERE, NOOP, SELECT_THERE
from marl_cair.games.deep_rts.views.observation import log_level
from marl_cair.games.deep_rts.views.planes import TIME_LEFT
from marl_cair.games.randomness import episode_seeds
from tests.games.bot_play import (
    assert_answers_each_row_on_its_own,
    assert_leaves_what_it_sees,
    assert_repeats_and_continues,
    find_positions,
    make_bot,
    play,
)

SCRIPTED = list(DOCTRINES)
CASES = [
    {},
    {"fog": True},
    {"preset": "thesis"},
    {"army": (0, 3, 3, 2)},
    {"map": "31x31-4p-quarters", "num_players": 4, "fog": True},
]


def make_game(num_worlds=2, **options):
    engine = make_engine("deep_rts", num_worlds=num_worlds, **options)
    worlds = np.arange(num_worlds)
    engine.reset(episode_seeds(3, worlds, np.zeros(num_worlds, np.int64)))
    return engine


def look_at(engine, name="mixed"):
    """What a bot knows, and what it sees from the first seat of the first world."""
    known = make_knowledge(engine.scenario, engine.spec, DOCTRINES[name])
    sight = make_sight(engine.scenario)
    read_sight(engine.observe("planes")[0, 0], known, sight)
    return known, sight


@pytest.fixture(scope="module")
def positions():
    """Planes and masks of both seats in games of two scripted players, after 120 decisions."""
    engine = make_game(4)
    bots = [make_bot(engine, "mixed"), make_bot(engine, "random", 2)]
    return find_positions(engine, bots, 120)


@pytest.mark.parametrize("options", CASES)
def test_every_bot_only_gives_legal_actions(options):
    num_decisions = 80 if is_compiling() else 10
    for name in BOTS:
        engine = make_game(1, **options)
        others = [make_bot(engine, "random", seat) for seat in range(1, engine.spec.num_players)]
        for _, mask, actions in play(engine, [make_bot(engine, name), *others], num_decisions):
            assert np.take_along_axis(mask, actions[:, :, None], 2).all()
        assert (engine.illegal_actions == 0).all()


def test_random_plays_the_classic_actions():
    engine = make_game(2, actions="classic")
    for _, mask, actions in play(engine, [make_bot(engine, "random", seed) for seed in (1, 2)], 80):
        assert np.take_along_axis(mask, actions[:, :, None], 2).all()
    assert (engine.illegal_actions == 0).all()


@pytest.mark.parametrize("name", SCRIPTED)
def test_the_others_refuse_the_classic_actions_and_name_the_mend(name):
    engine = make_game(1, actions="classic")
    with pytest.raises(ValueError, match=rf"{name} cannot play .*'classic'.*actions='unit'"):
        make_bot(engine, name)


@pytest.mark.parametrize("name", BOTS)
def test_the_same_seed_gives_the_same_actions_and_saved_state_continues(name, positions):
    assert_repeats_and_continues(name, positions)


def test_another_seed_gives_random_other_actions(positions):
    assert (positions.answers("random", 1) != positions.answers("random", 2)).any()


@pytest.mark.parametrize("name", SCRIPTED)
def test_a_scripted_bot_answers_each_row_on_its_own(name, positions):
    assert_answers_each_row_on_its_own(name, positions)


@pytest.mark.parametrize("name", BOTS)
def test_bots_leave_what_they_see_as_it_is(name, positions):
    assert_leaves_what_it_sees(name, positions)


@pytest.mark.parametrize("name", SCRIPTED)
def test_every_scripted_bot_beats_random(name):
    engine = make_game(4)
    result = play_match(engine, make_bot(engine, name), make_bot(engine, "random"), seed=11)
    assert result.wins == result.games


def test_a_store_is_read_off_its_level_to_three_in_a_hundred():
    for amount in (0, 1, 40, 100, 150, 200, 1_000, 50_000):
        assert abs(stored(log_level(amount)) - amount) <= 0.03 * amount
    assert stored(log_level(100)) >= 100
    assert stored(log_level(200)) >= 200


def test_the_start_is_read_off_the_planes():
    known, sight = look_at(make_game(1))
    columns = known.rules.columns
    assert sight.own[t.PEASANT] == sight.facts[NUM_PEOPLE] == 3
    assert sight.own[t.TOWN_HALL] == sight.foes[t.TOWN_HALL] == 1
    assert (sight.facts[FOOD_USED], sight.facts[FOOD_MADE]) == (3, 5)
    assert abs(sight.store[t.GOLD] - 200) <= 6
    assert abs(sight.store[t.LUMBER] - 100) <= 3
    assert sight.facts[HOME] == 4 * columns + 4
    assert sight.facts[THREAT] == NO_CELL


def test_in_the_fog_the_enemy_is_thought_to_be_opposite():
    known, sight = look_at(make_game(1, map="31x31-4p-quarters", num_players=4, fog=True))
    size = known.rules.rows * known.rules.columns
    assert sight.facts[TARGET] == size - 1 - sight.facts[HOME]


def test_a_site_may_not_cut_a_way():
    # Around (4, 8) five cells wide there would be the hall on one side and water on another.
    known, sight = look_at(make_game(1))
    columns = known.rules.columns
    assert keeps_ways_open(known, sight, 7 * columns + 3, 0)
    assert not keeps_ways_open(known, sight, 4 * columns + 8, 2)


def give(sight, **counts):
    """Stores of all resources, and units of each kind by the name of the array that counts them."""
    sight.store[:] = 1_000
    for name, units in counts.items():
        for kind, count in units.items():
            getattr(sight, name)[kind] = count


@pytest.mark.parametrize(
    ("seen", "answer"), [(t.ARCHER, t.CAVALRY), (t.CAVALRY, t.FOOTMAN), (t.FOOTMAN, t.ARCHER)]
)
def test_mixed_trains_what_beats_the_soldiers_in_sight(seen, answer):
    known, sight = look_at(make_game(1))
    give(sight, own={t.FOOTMAN: 2, t.ARCHER: 2, t.CAVALRY: 2}, foes={seen: 6})
    sight.facts[NUM_SOLDIERS] = 6
    assert choose_soldier(known, sight) == answer


def test_who_wants_cavalry_builds_a_well_and_trains_footmen_until_there_is_oil():
    known, sight = look_at(make_game(1), "economist")
    give(sight, own={t.BARRACKS: 1, t.PEASANT: 8, t.FOOTMAN: 1})
    sight.facts[NUM_SOLDIERS] = 1
    sight.facts[FOOD_MADE] = 20
    assert wanted_building(known, sight) == t.OIL_WELL
    assert choose_soldier(known, sight) == t.CAVALRY
    sight.store[t.OIL] = 0
    assert choose_soldier(known, sight) in (t.FOOTMAN, t.ARCHER)


def test_the_turtle_equips_an_army_by_turns():
    known, sight = look_at(make_game(1), "turtle")
    give(sight, own={t.BARRACKS: 1, t.PEASANT: 8, t.ARCHER: ENOUGH_SOLDIERS})
    sight.facts[NUM_SOLDIERS] = ENOUGH_SOLDIERS
    sight.facts[FOOD_MADE] = 30
    assert wanted_building(known, sight) == t.SMITHY
    give(sight, own={t.SMITHY: 1, t.OIL_WELL: 1})
    sight.facts[FREE_SMITHY] = 0
    assert wanted_building(known, sight) == t.FIRST_UPGRADE + t.BLADES
    sight.level[t.BLADES] = 1
    assert wanted_building(known, sight) == t.FIRST_UPGRADE + t.PLATES
    sight.level[:] = known.doctrine.upgrades
    assert wanted_building(known, sight) == t.BARRACKS


def test_without_a_hall_gold_goes_to_soldiers_until_there_is_enough_for_one():
    known, sight = look_at(make_game(1))
    give(sight, own={t.TOWN_HALL: 0, t.BARRACKS: 1, t.FOOTMAN: 1})
    assert wanted_building(known, sight) == t.TOWN_HALL
    sight.store[t.GOLD] = 100
    assert wanted_building(known, sight) == t.NO_KIND


def test_mixed_sends_the_foremost_peasant_where_it_does_not_see_the_enemy():
    engine = make_game(1, fog=True)
    known, sight = look_at(engine)
    planes, mask = engine.observe("planes")[0, 0], engine.action_mask()[0, 0]
    planes[TIME_LEFT] = 0
    assert scout(planes, mask, known, sight) == NOOP  # it has three peasants only
    sight.own[t.PEASANT] = SCOUT_WORKERS
    target = int(sight.facts[TARGET])
    foremost = nearest_person(known, sight, target)
    select, go = (cell_action(known, order, target) for order in (SELECT_THERE, GO_THERE))
    expected = go if foremost == sight.facts[SELECTED_CELL] else select - target + foremost
    assert scout(planes, mask, known, sight) == expected
    sight.side[target], sight.kind[target] = MINE, t.FOOTMAN  # who sees the enemy
    assert scout(planes, mask, known, sight) == NOOP


def test_a_farm_is_built_in_a_corner_rather_than_in_the_open():
    known, sight = look_at(make_game(1))
    columns = known.rules.columns
    corner, meadow = 2 * columns + 1, 8 * columns + 5
    assert num_free_around(known, sight, corner) < num_free_around(known, sight, meadow)
