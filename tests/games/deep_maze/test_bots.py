"""The scripted players: as short as can be where all is seen, home in the end where it is not."""

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.randomness import episode_seeds
from tests.games.bot_play import (
    assert_answers_each_row_on_its_own,
    assert_leaves_what_it_sees,
    assert_repeats_and_continues,
    find_positions,
    make_bot,
    play,
)
from tests.games.deep_maze.table import Table

BOTS = ("random", "wall_follower", "oracle")


def start(scenario, num_worlds=8, **options):
    engine = make_engine("deep_maze", scenario, num_worlds, **options)
    engine.reset(episode_seeds(3, np.arange(num_worlds), np.zeros(num_worlds, np.int64)))
    return engine


def play_out(engine, *names):
    """Play on until all games are over; the moves of each."""
    bots = [make_bot(engine, name, seed) for seed, name in enumerate(names)]
    for _ in play(engine, bots, engine.spec.max_ticks):
        if (engine.terminated | engine.truncated).all():
            break
    return engine.info()["step_count"][:, 0]


@pytest.mark.parametrize("scenario", ["9x9-stochastic", "15x15-loops", "9x9-sequence"])
def test_the_oracle_takes_the_optimal_number_of_moves(scenario):
    engine = start(scenario)
    moves = play_out(engine, "oracle")
    assert engine.terminated.all()
    np.testing.assert_array_equal(moves, engine.info()["optimal_steps"][:, 0])
    assert engine.illegal_actions.sum() == 0


@pytest.mark.parametrize("scenario", ["9x9-square", "15x15-line_of_sight", "9x9-timed_square"])
def test_the_oracle_finds_the_goal_in_the_fog(scenario):
    engine = start(scenario)
    moves = play_out(engine, "oracle")
    assert engine.terminated.all()
    optimal = engine.info()["optimal_steps"][:, 0]
    assert (moves >= optimal).all()
    assert moves.sum() > optimal.sum()


@pytest.mark.parametrize("scenario", ["9x9-stochastic", "15x15-square"])
def test_the_wall_follower_finds_every_goal_of_a_maze_without_loops(scenario):
    engine = start(scenario)
    moves = play_out(engine, "wall_follower")
    assert engine.terminated.all()
    assert engine.illegal_actions.sum() == 0
    walls = engine._worlds.walls
    assert (moves <= 2 * (walls == 0).sum(1)).all()  # each passage twice at most


def test_the_oracle_ends_a_race_first():
    engine = start("15x15-race-2p")
    play_out(engine, "random", "oracle")
    assert (engine.winner == 1).all()


@pytest.mark.parametrize(
    ("bots", "winner", "share"), [(("oracle", "random"), 0, 0.7), (("random", "oracle"), 1, 0.75)]
)
def test_the_oracle_wins_most_chases_against_random(bots, winner, share):
    engine = start("15x15-chase-2p", 16)
    play_out(engine, *bots)
    assert (engine.winner == winner).mean() > share


def test_the_wall_follower_keeps_its_right_hand_on_the_wall():
    table = Table(board=".....\n.###.\n0#..G\n.###.\n.....")
    bot = make_bot(table.engine, "wall_follower")
    way = []
    while not table.engine.terminated[0]:
        mask = table.engine.action_mask()[:, 0]
        table.engine.step(bot.act(table.engine.observe("planes")[:, 0], mask)[:, None])
        way.append(table.place())
    assert way == [(3, 0), (4, 0), (4, 1), (4, 2), (4, 3), (4, 4), (3, 4), (2, 4)]


@pytest.mark.parametrize("name", BOTS)
def test_a_bot_repeats_continues_and_answers_each_row_on_its_own(name):
    engine = start("15x15-chase-3p-line_of_sight", 6)
    bots = [make_bot(engine, "random", seed) for seed in range(3)]
    positions = find_positions(engine, bots, 15)
    assert_repeats_and_continues(name, positions)
    if name != "random":  # which draws for the rows of a batch one after another
        assert_answers_each_row_on_its_own(name, positions)
    assert_leaves_what_it_sees(name, positions)
