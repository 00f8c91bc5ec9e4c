"""No unit and no tower wins alone: a smaller run of benchmarks/balance.py with a fixed seed."""

import numpy as np
import pytest

from benchmarks.balance import (
    ITEMS,
    make_item_player,
    make_mix,
    play_against_mix,
    play_match,
    play_round_robin,
    win_interval,
    wins_against_drawn,
)
from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.bots import BOTS
from marl_cair.games.deep_line_wars.tables import CHARGE_PER_SHOT, NUM_UNIT_KINDS, PRESETS

SEED = 2018
GAMES = 160
LIMIT, SLACK = 0.60, 0.02
BALANCED = PRESETS["balanced"]


@pytest.fixture(scope="module")
def engine():
    return make_engine("deep_line_wars", "10x15", GAMES)


@pytest.fixture(scope="module")
def alone_against_each(engine):
    players = [make_item_player(engine, item) for item in range(len(ITEMS))]
    return play_round_robin(engine, players, SEED)


@pytest.fixture(scope="module")
def alone_against_mix(engine):
    return play_against_mix(engine, SEED)


@pytest.fixture(scope="module")
def bot_results(engine):
    bots = [engine.game.bot(name, engine.scenario) for name in BOTS]
    return play_round_robin(engine, bots, SEED)


def assert_within_limit(wins, games):
    assert win_interval(wins, games)[0] <= LIMIT
    assert wins / games <= LIMIT + SLACK


@pytest.mark.parametrize("item", range(len(ITEMS)), ids=ITEMS)
def test_no_item_alone_beats_one_drawn_from_the_others(item, alone_against_each):
    assert_within_limit(*wins_against_drawn(alone_against_each, item, len(ITEMS)))


@pytest.mark.parametrize("item", range(len(ITEMS)), ids=ITEMS)
def test_no_item_alone_beats_a_mix_of_the_others(item, alone_against_mix):
    assert_within_limit(alone_against_mix[item].wins, alone_against_mix[item].games)


@pytest.mark.slow
def test_the_thesis_numbers_fail_the_same_test():
    # In 2017 the first unit and few towers decide: the bound is one that can be missed.
    engine = make_engine("deep_line_wars", "10x15", 40, preset="2017", max_ticks=4_000)
    units = [make_item_player(engine, item) for item in range(NUM_UNIT_KINDS)]
    results = play_round_robin(engine, units, SEED)
    wins, games = wins_against_drawn(results, 0, NUM_UNIT_KINDS)
    assert wins == games


@pytest.mark.parametrize("unit", range(NUM_UNIT_KINDS), ids=ITEMS[:NUM_UNIT_KINDS])
def test_every_unit_alone_is_stopped_by_some_item(unit, alone_against_each):
    results = [alone_against_each[unit, other] for other in range(len(ITEMS)) if other != unit]
    assert min(result.wins for result in results) == 0


@pytest.mark.parametrize("tower", range(NUM_UNIT_KINDS, len(ITEMS)), ids=ITEMS[NUM_UNIT_KINDS:])
def test_every_tower_alone_stops_some_unit_and_fails_against_another(tower, alone_against_each):
    wins = [alone_against_each[unit, tower].wins for unit in range(NUM_UNIT_KINDS)]
    assert min(wins) == 0
    assert max(wins) == GAMES


def test_games_of_different_bots_end_by_a_winner_before_the_time_limit(bot_results):
    games = sum(result.games for result in bot_results.values())
    decided = sum(result.wins + result.losses for result in bot_results.values())
    assert decided >= 0.95 * games
    limit = make_engine("deep_line_wars").spec.max_ticks
    assert np.mean([result.mean_ticks for result in bot_results.values()]) < 0.75 * limit


@pytest.mark.slow
def test_players_who_mix_everything_come_to_an_end(engine):
    result = play_match(engine, make_mix(engine), make_mix(engine), SEED)
    assert result.wins + result.losses >= 0.9 * result.games


def test_a_projectile_lands_before_its_tower_can_fire_again():
    for reach, speed in zip(BALANCED.tower_range_tiles, BALANCED.tower_attack_speed, strict=True):
        flight = -(-reach // BALANCED.projectile_tiles_per_tick)
        assert flight <= CHARGE_PER_SHOT // speed


@pytest.mark.slow
def test_a_match_gives_the_same_result_twice(engine):
    players = make_item_player(engine, 1), make_mix(engine, 1)
    assert play_match(engine, *players, SEED) == play_match(engine, *players, SEED)


@pytest.mark.parametrize(
    ("wins", "games", "low", "high"), [(0, 100, 0.0, 0.037), (50, 100, 0.4038, 0.5962)]
)
def test_the_interval_is_wilsons(wins, games, low, high):
    assert win_interval(wins, games) == pytest.approx((low, high), abs=1e-4)
