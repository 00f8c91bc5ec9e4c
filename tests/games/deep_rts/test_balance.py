"""Soldiers of `balanced` at equal prices, and the counting of bot tables."""

import numpy as np
import pytest

from benchmarks._bot_tables import describe_pair, play_together, seat_one
from benchmarks._matches import MatchResult, play_match
from marl_cair.games import make_engine
from marl_cair.games.deep_rts.state import ADVANCE, NO_ORDER, UNIT_ORDER
from marl_cair.games.deep_rts.tables import ARCHER, CAVALRY, FOOTMAN, PRESETS
from tests.games.deep_rts.skirmish import Skirmish

BALANCED = PRESETS["balanced"]
BUDGET = 960  # of all resources together
LIMIT_TICKS = 1_500


def number_for(kind):
    """How many of a kind the budget pays."""
    price = BALANCED.cost_gold[kind] + BALANCED.cost_lumber[kind] + BALANCED.cost_oil[kind]
    return round(BUDGET / price)


def survivors(kind, other, seed):
    """How many soldiers of each army are left after both advance on each other."""
    skirmish = Skirmish(preset="balanced", seed=seed)
    rows, goals = (3, 11), ((12, 7), (2, 7))
    for player, soldier in enumerate((kind, other)):
        for index in range(number_for(soldier)):
            row = rows[player] + (1 - 2 * player) * (index // 13)
            skirmish.put(player, soldier, row, 1 + index % 13)
    while skirmish.tick < LIMIT_TICKS and all(skirmish.units_of(player) for player in range(2)):
        for player in range(2):
            for unit in skirmish.units_of(player):
                if skirmish.get(unit, UNIT_ORDER) == NO_ORDER:
                    skirmish.order(unit, ADVANCE, *goals[player])
        skirmish.wait(20)
    return [len(skirmish.units_of(player)) for player in range(2)]


@pytest.mark.parametrize(
    ("kind", "other"), [(FOOTMAN, CAVALRY), (CAVALRY, ARCHER)], ids=("footmen", "cavalry")
)
def test_in_the_open_a_soldier_beats_its_prey_of_the_same_price(kind, other):
    for seed in range(2):
        left, others_left = survivors(kind, other, seed)
        assert left > 0 == others_left


def test_a_game_at_the_time_limit_is_a_draw():
    engine = make_engine("deep_rts", num_worlds=2, max_ticks=50)
    bots = [engine.game.bot(name, engine.scenario) for name in ("economist", "random")]
    result = play_match(engine, *bots, seed=0)
    assert (result.wins, result.losses, result.draws, result.truncations) == (0, 0, 0, 2)
    assert result.games == 2


def test_a_pair_is_described_by_its_shares_and_wilsons_interval():
    result = MatchResult(wins=8, losses=1, draws=0, truncations=1, mean_ticks=900.0)
    assert describe_pair(result) == "80-10-10 [49, 94]"


def test_a_bot_among_others_has_each_seat_equally_often():
    seats = seat_one(5, np.zeros((8, 4), np.int64))
    assert ((seats == 5).sum(axis=1) == 1).all()
    assert ((seats == 5).sum(axis=0) == 2).all()


def test_one_bot_wins_a_free_for_all_of_random_players():
    engine = make_engine("deep_rts", "FFA-3-15x15", num_worlds=1)
    bots = [engine.game.bot(name, engine.scenario) for name in ("random", "archers")]
    assert play_together(engine, bots, np.array([[0, 1, 0]]), seed=0).tolist() == [0, 1]
