"""Elimination, winners and rewards: conquest, teams, the time limit, races, shaping."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.views.other_views import VECTOR_NAMES
from marl_cair.games.game import NO_WINNER
from tests.games.deep_rts.skirmish import MEADOW, Skirmish

FOUR = MEADOW.replace(".1..............", ".1..........3...").replace(
    "..............2.", ".2............4."
)
ONE_PEASANT = {"army": (1, 0, 0, 0)}  # for each player
RUNNING = (False, False, NO_WINNER)


def conquest(text: str = MEADOW, **options) -> Skirmish:
    """A game of conquest in which every seat has one peasant and an empty store."""
    game = Skirmish(text, **({"goal": "conquest"} | ONE_PEASANT | options))
    for player in range(game.engine.num_players):
        game.fill_store(player, 0, 0, 0, 0)
    return game


def eliminate(game: Skirmish, *players: int) -> None:
    """The players lose all units in this tick and are out in the next, which is played too."""
    game.kill(*(unit for player in players for unit in game.units_of(player)))
    game.wait(2)


def outcome(game: Skirmish) -> tuple[bool, bool, int]:
    engine = game.engine
    return bool(engine.terminated[0]), bool(engine.truncated[0]), int(engine.winner[0])


def rewards(game: Skirmish) -> list[float]:
    return np.round(game.engine.rewards[0], 5).tolist()


def play_to_end(game: Skirmish) -> np.ndarray:
    """The sum of the rewards until the game ends."""
    paid = game.engine.rewards[0].copy()
    while not (game.engine.terminated | game.engine.truncated)[0]:
        game.wait()
        paid += game.engine.rewards[0]
    return paid


# --- conquest ------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("losers", "winner", "paid"),
    [([0], 1, [-1.0, 1.0]), ([1], 0, [1.0, -1.0]), ([0, 1], NO_WINNER, [0.0, 0.0])],
)
def test_last_player_wins_and_falling_together_is_a_draw(losers, winner, paid):
    game = conquest()
    eliminate(game, *losers)
    assert outcome(game) == (True, False, winner)
    assert rewards(game) == paid


def test_finished_game_stays_as_it_is_and_pays_nothing():
    game = conquest()
    eliminate(game, 1)
    before = game.engine.state_dict()
    game.play("go_r5_c5", "noop")
    after = game.engine.state_dict()
    assert after.pop("outcome.rewards").tolist() == [[0.0, 0.0]]
    for name, value in after.items():
        np.testing.assert_array_equal(value, before[name])


@pytest.mark.parametrize(
    ("kind", "gold", "food", "is_in"),
    [
        (t.FARM, 10_000, 5, False),
        (t.SMITHY, 10_000, 5, False),
        (t.TOWN_HALL, 49, 5, False),
        (t.TOWN_HALL, 50, 5, True),
        (t.BARRACKS, 79, 5, False),
        (t.BARRACKS, 80, 5, True),
        (t.BARRACKS, 10_000, 0, False),
    ],
)
def test_player_that_cannot_train_a_unit_is_out_though_buildings_stand(kind, gold, food, is_in):
    game = conquest()
    house = game.put(1, kind, 8, 8)
    game.world.players[1, s.FOOD_MADE] = food
    game.fill_store(1, gold, 0, 10_000, 0)
    game.kill(game.units_of(1)[0])
    game.wait(2)
    assert bool(game.world.players[1, s.IS_ALIVE]) == is_in
    assert game.is_alive(house) == is_in
    assert outcome(game) == (RUNNING if is_in else (True, False, 0))
    assert rewards(game) == ([0.0, 0.0] if is_in else [1.0, -1.0])


def test_player_with_a_unit_in_training_is_not_out_with_an_empty_store():
    game = conquest()
    hall = game.put(1, t.TOWN_HALL, 8, 8)
    game.world.players[1, s.FOOD_MADE] = 5
    game.fill_store(1, 50)
    game.make(hall, t.PEASANT)
    game.kill(game.units_of(1)[0])
    game.wait(51)
    assert outcome(game) == RUNNING
    assert rewards(game) == [0.0, 0.0]
    game.wait(80)
    assert len(game.units_of(1)) == 2


@pytest.mark.parametrize("survivors", [(0, 3), (0,), (3,)])
def test_team_wins_together(survivors):
    game = conquest(FOUR, num_players=4, teams=(7, 2, 2, 7))
    eliminate(game, *({0, 3} - set(survivors)))
    assert outcome(game) == RUNNING
    eliminate(game, 1, 2)
    assert (outcome(game), rewards(game)) == ((True, False, 0), [1.0, -1.0, -1.0, 1.0])


def test_team_mates_do_not_fight():
    game = conquest(FOUR, num_players=4, teams=(0, 0, 1, 1))
    game.put(0, t.FOOTMAN, 8, 8)
    mate = game.put(1, t.PEASANT, 8, 9)
    game.wait(60)
    assert game.get(mate, s.UNIT_HEALTH) == 30


# --- the time limit ------------------------------------------------------------------------------


def test_conquest_at_the_time_limit_has_no_winner_and_no_reward():
    game = conquest(max_ticks=20)
    game.world.players[1, s.DAMAGE_DONE] = 10
    game.wait(19)
    assert (outcome(game), rewards(game)) == (RUNNING, [0.0, 0.0])
    game.wait()
    assert (outcome(game), rewards(game)) == ((False, True, NO_WINNER), [0.0, 0.0])


@pytest.mark.parametrize("best", [None, 0, 1])
def test_named_winner_is_the_one_that_the_reward_pays(best):
    """A league counts wins by the winner."""
    game = conquest(max_ticks=20)
    game.world.players[0, s.DAMAGE_DONE] = 10
    if best is not None:
        game.kill(*game.units_of(1 - best))
    paid = play_to_end(game).tolist()
    assert outcome(game)[2] == (NO_WINNER if best is None else best)
    assert paid == ([0.0, 0.0] if best is None else [1.0 - 2.0 * abs(best - p) for p in (0, 1)])


def test_win_in_the_last_tick_counts():
    game = conquest(max_ticks=20)
    game.wait(18)
    eliminate(game, 1)
    assert (outcome(game), rewards(game)) == ((True, False, 0), [1.0, -1.0])


@pytest.mark.parametrize(
    ("teams", "gathered", "winner"),
    [
        ((0, 0, 1, 1), [10, 10, 0, 0], 0),  # equal team mates
        ((0, 1, 1, 0), [100, 60, 60, 0], 1),  # the sum of a team counts
        ((0, 1, 1, 0), [60, 0, 60, 0], NO_WINNER),
    ],
)
def test_best_score_of_a_team_wins_at_the_time_limit(teams, gathered, winner):
    game = conquest(FOUR, num_players=4, teams=teams, goal="score", max_ticks=20)
    game.world.players[:, s.GATHERED + t.GOLD] = gathered
    game.wait(20)
    assert outcome(game) == (True, False, winner)


# --- races ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "column"),
    [
        ("gold", s.GATHERED + t.GOLD),
        ("lumber", s.GATHERED + t.LUMBER),
        ("army", s.NUM_CREATED + t.FOOTMAN),
    ],
)
def test_race_ends_as_its_goal_is_reached(goal, column):
    game = Skirmish(goal=goal, goal_amount=8, **ONE_PEASANT)
    for progress in range(8):
        game.world.players[0, column] = progress
        game.wait()
        assert (outcome(game), rewards(game)) == (RUNNING, [0.0, 0.0])
    game.world.players[0, column] = 8
    game.wait()
    assert outcome(game) == (True, False, 0)


@pytest.mark.parametrize("players", [1, 2])
def test_whole_reward_of_a_race_is_one(players):
    game = Skirmish(
        goal="gold", goal_amount=7, num_players=players, max_ticks=10_000, **ONE_PEASANT
    )
    game.order(game.units_of(0)[0], s.HARVEST, 0, 15)
    assert play_to_end(game).tolist() == pytest.approx([1.0, 0.0][:players])
    assert outcome(game) == (True, False, 0)


@pytest.mark.parametrize(
    ("teams", "players", "winner"),
    [((), [0, 1], NO_WINNER), ((1, 0, 0, 1), [1, 2], 1)],
)
def test_two_at_the_goal_in_one_tick_draw_unless_they_are_a_team(teams, players, winner):
    options = {"num_players": 4, "teams": teams} | ONE_PEASANT
    game = Skirmish(FOUR, goal="army", goal_amount=3, **options)
    game.world.players[players, s.NUM_CREATED + t.FOOTMAN] = 3
    game.wait()
    assert outcome(game) == (True, False, winner)


def test_race_continues_with_one_player_and_ends_with_none():
    game = Skirmish(goal="gold", goal_amount=50, **ONE_PEASANT)
    for player in (0, 1):
        game.fill_store(player, 0)
    eliminate(game, 0)
    assert outcome(game) == RUNNING
    eliminate(game, 1)
    assert outcome(game) == (True, False, NO_WINNER)


def test_race_is_truncated_at_the_time_limit():
    game = Skirmish(goal="gold", goal_amount=50, max_ticks=10, **ONE_PEASANT)
    game.world.players[0, s.GATHERED + t.GOLD] = 49
    game.wait(10)
    assert outcome(game) == (False, True, NO_WINNER)


def test_score_is_the_original_formula():
    """0.5 x 2 x 40 gold + 0.5 x 30 lumber + 2 x 3 created + 1 unit."""
    game = Skirmish(max_ticks=5, **ONE_PEASANT)
    game.world.players[0, [s.GATHERED + t.GOLD, s.GATHERED + t.LUMBER]] = 40, 30
    game.world.players[0, s.NUM_CREATED + t.FOOTMAN] = 3
    vector = game.engine.observe("vector")[0, 0]
    assert vector[VECTOR_NAMES.index("own score")] == 40 + 15 + 6 + 1
    game.wait(5)
    assert (outcome(game), rewards(game)) == ((True, False, 0), [0.0, 0.0])


# --- shaping -------------------------------------------------------------------------------------


def test_shaped_rewards_sum_to_the_sparse_ones_less_the_first_potential():
    """With a discount of 1; the potential weighs units by their price and health."""
    game = conquest(reward="shaped", shaping_discount=1.0)
    soldier, victim = game.put(0, t.FOOTMAN, 12, 12), game.units_of(1)[0]
    game.set(victim, s.UNIT_HEALTH, 1)
    first, second = 50 + 80, 50 / 30
    potentials = [0.8 * (2 * worth / (1 + first + second) - 1) for worth in (first, second)]
    game.attack(soldier, victim)
    paid = play_to_end(game).tolist()
    assert outcome(game) == (True, False, 0)
    assert paid == pytest.approx([1 - potentials[0], -1 - potentials[1]], abs=1e-5)


def test_gains_pay_the_win_and_the_share_that_was_gained():
    game = conquest(reward="gains", shaping_discount=0.5)  # the discount does not count
    soldier, victim = game.put(0, t.FOOTMAN, 12, 12), game.units_of(1)[0]
    game.set(victim, s.UNIT_HEALTH, 1)
    first, second = 50 + 80, 50 / 30
    before = [0.8 * (2 * worth / (1 + first + second) - 1) for worth in (first, second)]
    after = 0.8 * (2 * first / (1 + first) - 1)  # of the winner; who has fallen owns nothing
    game.attack(soldier, victim)
    paid = play_to_end(game).tolist()
    assert paid == pytest.approx([1 + after - before[0], -1 - before[1]], abs=1e-5)
