"""Who is out, who has won, what that pays: conquest, teams, the races, the clock, the shaping."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.views.other_views import VECTOR_NAMES
from marl_cair.games.game import NO_WINNER
from tests.games.deep_rts.skirmish import Skirmish, draw_actions

FOUR = """
...............G
.1..........3...
................
................
................
................
................
................
................
................
................
................
................
................
.2............4.
................
"""


def conquest(text: str | None = None, **options) -> Skirmish:
    """A game to the end in which every seat has one peasant and an empty store."""
    chosen = {"goal": "conquest", "army": (1, 0, 0, 0)} | options
    skirmish = Skirmish(text, **chosen) if text else Skirmish(**chosen)
    for player in range(skirmish.engine.num_players):
        skirmish.fill_store(player, 0, 0, 0, 0)
    return skirmish


def kill(skirmish: Skirmish, *players: int) -> None:
    """Everybody of the players who walks falls in the next tick."""
    for player in players:
        for unit in skirmish.units_of(player):
            skirmish.set(unit, s.UNIT_HEALTH, 0)
            skirmish.world.clock[s.NUM_FALLEN] += 1


def bury(skirmish: Skirmish, *players: int) -> None:
    """The players' units fall now; whoever is left without means is out in the next tick."""
    goal = skirmish.engine.scenario.goal
    assert goal == "conquest"
    kill(skirmish, *players)
    skirmish.wait()


def outcome(skirmish: Skirmish) -> tuple[bool, bool, int, list[float]]:
    engine = skirmish.engine
    rewards = np.round(engine.rewards[0], 5).tolist()
    return bool(engine.terminated[0]), bool(engine.truncated[0]), int(engine.winner[0]), rewards


# --- conquest ------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(("loser", "rewards"), [(0, [-1.0, 1.0]), (1, [1.0, -1.0])])
def test_the_last_player_wins(loser, rewards):
    skirmish = conquest()
    bury(skirmish, loser)
    skirmish.wait()
    assert outcome(skirmish) == (True, False, 1 - loser, rewards)


def test_losing_in_one_tick_is_a_draw():
    skirmish = conquest()
    bury(skirmish, 0, 1)
    skirmish.wait()
    assert outcome(skirmish) == (True, False, NO_WINNER, [0.0, 0.0])


def test_a_finished_game_stays_as_it_is_and_pays_nothing():
    skirmish = conquest()
    bury(skirmish, 1)
    skirmish.wait()
    before = skirmish.engine.state_dict()
    skirmish.play("go_r5_c5", "noop")
    after = skirmish.engine.state_dict()
    assert after.pop("outcome.rewards").tolist() == [[0.0, 0.0]]
    for name, value in after.items():
        np.testing.assert_array_equal(value, before[name])


@pytest.mark.parametrize(
    ("kind", "gold", "goes_on"),
    [
        (t.FARM, 10_000, False),
        (t.SMITHY, 10_000, False),
        (t.TOWN_HALL, 49, False),
        (t.TOWN_HALL, 50, True),
        (t.BARRACKS, 79, False),
        (t.BARRACKS, 80, True),
    ],
)
def test_who_cannot_train_anybody_is_out_though_buildings_stand(kind, gold, goes_on):
    skirmish = conquest()
    house = skirmish.put(1, kind, 8, 8)
    skirmish.world.players[1, 2] = 5  # FOOD_MADE
    skirmish.fill_store(1, gold, 0, 10_000, 0)
    worker = skirmish.units_of(1)[0]
    skirmish.set(worker, s.UNIT_HEALTH, 0)
    skirmish.world.clock[s.NUM_FALLEN] += 1
    skirmish.wait(2)
    assert bool(skirmish.world.players[1, s.IS_ALIVE]) == goes_on
    assert skirmish.is_alive(house) == goes_on
    assert outcome(skirmish)[0] != goes_on


def test_who_has_gold_but_no_food_is_out():
    skirmish = conquest()
    skirmish.put(1, t.BARRACKS, 8, 8)
    skirmish.fill_store(1, 10_000)
    bury_workers(skirmish, 1)
    skirmish.wait()
    assert outcome(skirmish) == (True, False, 0, [1.0, -1.0])


def bury_workers(skirmish: Skirmish, player: int) -> None:
    skirmish.set(skirmish.units_of(player)[0], s.UNIT_HEALTH, 0)
    skirmish.world.clock[s.NUM_FALLEN] += 1
    skirmish.wait()


def test_who_trains_somebody_is_not_out_with_an_empty_store():
    skirmish = conquest()
    hall = skirmish.put(1, t.TOWN_HALL, 8, 8)
    skirmish.world.players[1, 2] = 5  # FOOD_MADE
    skirmish.fill_store(1, 50)
    skirmish.make(hall, t.PEASANT)
    bury_workers(skirmish, 1)
    skirmish.wait(50)
    assert outcome(skirmish) == (False, False, NO_WINNER, [0.0, 0.0])
    skirmish.wait(80)
    assert len(skirmish.units_of(1)) == 2


def test_each_of_four_is_paid_as_it_falls_and_the_winner_at_the_end():
    skirmish = conquest(FOUR, num_players=4)
    bury(skirmish, 2)
    skirmish.wait()
    assert outcome(skirmish) == (False, False, NO_WINNER, [0.0, 0.0, -1.0, 0.0])
    skirmish.wait()
    assert outcome(skirmish) == (False, False, NO_WINNER, [0.0] * 4)
    assert skirmish.engine.action_mask()[0, 2].sum() == 1
    bury(skirmish, 0, 3)
    skirmish.wait()
    assert outcome(skirmish) == (True, False, 1, [-1.0, 1.0, 0.0, -1.0])


@pytest.mark.parametrize("survivors", [(0, 3), (0,), (3,)])
def test_a_team_wins_together(survivors):
    skirmish = conquest(FOUR, num_players=4, teams=(7, 2, 2, 7))
    bury(skirmish, *({0, 3} - set(survivors)))
    skirmish.wait()
    assert not outcome(skirmish)[0]
    bury(skirmish, 1, 2)
    skirmish.wait()
    assert outcome(skirmish) == (True, False, 0, [1.0, -1.0, -1.0, 1.0])


def test_team_mates_do_not_fight():
    skirmish = conquest(FOUR, num_players=4, teams=(0, 0, 1, 1))
    skirmish.put(0, t.FOOTMAN, 8, 8)
    mate = skirmish.put(1, t.PEASANT, 8, 9)
    skirmish.wait(60)
    assert skirmish.get(mate, s.UNIT_HEALTH) == 30


# --- the clock -----------------------------------------------------------------------------------


def test_time_is_over_at_its_very_tick():
    skirmish = conquest(max_ticks=20)
    skirmish.wait(19)
    assert outcome(skirmish) == (False, False, NO_WINNER, [0.0, 0.0])
    skirmish.wait()
    assert outcome(skirmish) == (False, True, NO_WINNER, [0.0, 0.0])


def test_out_of_time_nobody_has_won_and_nobody_is_paid():
    skirmish = conquest(max_ticks=20)
    skirmish.world.players[1, s.DAMAGE_DONE] = 10
    skirmish.wait(20)
    assert outcome(skirmish) == (False, True, NO_WINNER, [0.0, 0.0])


def test_a_league_counts_as_a_win_what_the_reward_pays_for():
    """Whatever ends a game of two: who is named the winner has +1, and a draw 0."""
    for best in (None, 0, 1):
        skirmish = conquest(max_ticks=20)
        skirmish.world.players[0, s.DAMAGE_DONE] = 10
        if best is not None:
            bury(skirmish, 1 - best)
        total = skirmish.engine.rewards[0].copy()
        while not (skirmish.engine.terminated | skirmish.engine.truncated)[0]:
            skirmish.wait()
            total += skirmish.engine.rewards[0]
        winner = int(skirmish.engine.winner[0])
        assert winner == (NO_WINNER if best is None else best)
        expected = [0.0, 0.0] if best is None else [1.0 - 2.0 * abs(best - seat) for seat in (0, 1)]
        assert total.tolist() == expected


def test_a_win_in_the_last_tick_counts():
    skirmish = conquest(max_ticks=20)
    skirmish.wait(18)
    bury(skirmish, 1)
    skirmish.wait()
    assert outcome(skirmish) == (True, False, 0, [1.0, -1.0])


SCORED = {"goal": "score", "max_ticks": 20}


def test_equal_team_mates_with_the_best_score_win():
    skirmish = conquest(FOUR, num_players=4, teams=(0, 0, 1, 1), **SCORED)
    skirmish.world.players[:2, s.DAMAGE_DONE] = 10
    skirmish.wait(20)
    assert outcome(skirmish)[:3] == (True, False, 0)


def test_out_of_time_a_team_is_ranked_by_its_sum():
    skirmish = conquest(FOUR, num_players=4, teams=(0, 1, 1, 0), **SCORED)
    skirmish.world.players[0, s.GATHERED + t.GOLD] = 100
    skirmish.world.players[[1, 2], s.GATHERED + t.GOLD] = 60
    skirmish.wait(20)
    assert outcome(skirmish)[:3] == (True, False, 1)


# --- races ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("goal", "column"),
    [
        ("gold", s.GATHERED + t.GOLD),
        ("lumber", s.GATHERED + t.LUMBER),
        ("army", s.NUM_CREATED + t.FOOTMAN),
    ],
)
def test_a_race_ends_as_its_goal_is_reached(goal, column):
    skirmish = Skirmish(goal=goal, goal_amount=8, army=(1, 0, 0, 0))
    for progress in range(8):
        skirmish.world.players[0, column] = progress
        skirmish.wait()
        assert outcome(skirmish) == (False, False, NO_WINNER, [0.0, 0.0])
    skirmish.world.players[0, column] = 8
    skirmish.wait()
    assert outcome(skirmish)[:3] == (True, False, 0)


@pytest.mark.parametrize("seed", range(2))
def test_the_rewards_of_a_gold_race_sum_to_the_share_that_was_gathered(seed):
    engine = make_engine("deep_rts", goal="gold", goal_amount=30, num_players=2, max_ticks=3_000)
    engine.reset(seed)
    luck = np.random.default_rng(seed)
    paid = np.zeros(2)
    while not (engine.terminated[0] or engine.truncated[0]):
        engine.step(draw_actions(engine, luck))
        paid += engine.rewards[0]
    gathered = engine._worlds.players[0, :, s.GATHERED + t.GOLD]
    np.testing.assert_allclose(paid, np.minimum(1, gathered / 30), atol=1e-5)
    if engine.terminated[0] and engine.winner[0] >= 0:
        assert paid[engine.winner[0]] == pytest.approx(1.0)


def test_the_whole_reward_of_a_race_is_exactly_one():
    skirmish = Skirmish(goal="gold", goal_amount=7, is_empty=False, max_ticks=10_000)
    worker = next(u for u in skirmish.units_of(0) if skirmish.get(u, 0) == t.PEASANT)
    skirmish.order(worker, 2, 0, 15)  # HARVEST
    paid = np.zeros(2)
    while not skirmish.engine.terminated[0]:
        skirmish.wait()
        paid += skirmish.engine.rewards[0]
    assert paid.tolist() == pytest.approx([1.0, 0.0])
    assert outcome(skirmish)[:3] == (True, False, 0)


def test_reaching_the_goal_in_one_tick_is_a_draw():
    skirmish = Skirmish(goal="army", goal_amount=3, army=(1, 0, 0, 0))
    skirmish.world.players[:, s.NUM_CREATED + t.FOOTMAN] = 3
    skirmish.wait()
    assert outcome(skirmish)[:3] == (True, False, NO_WINNER)


def test_a_race_goes_on_for_one_and_ends_with_nobody():
    skirmish = Skirmish(goal="gold", goal_amount=50, army=(1, 0, 0, 0))
    for player in (0, 1):
        skirmish.fill_store(player, 0)
    kill(skirmish, 0)
    skirmish.wait(3)
    assert not outcome(skirmish)[0]
    kill(skirmish, 1)
    skirmish.wait(3)
    assert outcome(skirmish)[:3] == (True, False, NO_WINNER)


def test_a_race_out_of_time_is_truncated():
    skirmish = Skirmish(goal="gold", goal_amount=50, army=(1, 0, 0, 0), max_ticks=10)
    skirmish.world.players[0, s.GATHERED + t.GOLD] = 49
    skirmish.wait(10)
    assert outcome(skirmish)[:3] == (False, True, NO_WINNER)


def test_the_score_pays_a_hundredth_for_each_point_and_terminates_in_time():
    """0.5 x 2 x 40 gold + 0.5 x 30 lumber + 2 x 3 created + 1 unit."""
    skirmish = Skirmish(army=(1, 0, 0, 0), max_ticks=5)
    skirmish.world.players[0, s.GATHERED + t.GOLD] = 40
    skirmish.world.players[0, s.GATHERED + t.LUMBER] = 30
    skirmish.world.players[0, s.NUM_CREATED + t.FOOTMAN] = 3
    vector = skirmish.engine.observe("vector")[0, 0]
    assert vector[VECTOR_NAMES.index("own score")] == 40 + 15 + 6 + 1
    skirmish.wait(5)
    assert outcome(skirmish) == (True, False, 0, [0.0, 0.0])


def test_alone_one_can_race():
    skirmish = Skirmish(goal="gold", goal_amount=5, num_players=1, army=(1, 0, 0, 0))
    skirmish.order(skirmish.units_of(0)[0], 2, 0, 15)  # HARVEST
    skirmish.wait(400)
    assert outcome(skirmish)[:3] == (True, False, 0)


# --- shaping -------------------------------------------------------------------------------------


def test_shaped_rewards_sum_to_the_sparse_ones_less_the_first_potential():
    """With a discount of 1; the potential weighs units by their price and health."""
    skirmish = conquest(reward="shaped", shaping_discount=1.0)
    soldier = skirmish.put(0, t.FOOTMAN, 12, 12)
    victim = skirmish.units_of(1)[0]
    skirmish.set(victim, s.UNIT_HEALTH, 1)
    first, second = 50 + 80, 50 / 30
    potentials = [0.8 * (2 * worth / (1 + first + second) - 1) for worth in (first, second)]
    skirmish.attack(soldier, victim)
    paid = np.zeros(2)
    for _ in range(60):
        skirmish.wait()
        paid += skirmish.engine.rewards[0]
    assert outcome(skirmish)[:3] == (True, False, 0)
    assert paid.tolist() == pytest.approx([1 - potentials[0], -1 - potentials[1]], abs=1e-5)


def test_sparse_games_pay_only_at_the_end():
    skirmish = conquest()
    skirmish.attack(skirmish.put(0, t.FOOTMAN, 12, 13), skirmish.units_of(1)[0])
    while not skirmish.engine.terminated[0]:
        assert skirmish.engine.rewards[0].tolist() == [0.0, 0.0]
        skirmish.wait()
    assert skirmish.engine.rewards[0].tolist() == [1.0, -1.0]


def test_team_mates_who_reach_the_goal_in_one_tick_win():
    options = {"num_players": 4, "teams": (1, 0, 0, 1), "army": (1, 0, 0, 0)}
    skirmish = Skirmish(FOUR, goal="army", goal_amount=3, **options)
    skirmish.world.players[1:3, s.NUM_CREATED + t.FOOTMAN] = 3
    skirmish.wait()
    assert outcome(skirmish)[:3] == (True, False, 1)
