"""Matches: balanced, repeatable, and the same in parts as in one go."""

import pytest
from PIL import Image

from marl_cair.games.replays import replay_steps
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.film import save_film
from marl_cair.league.play.match import BLOCKS_PER_CHUNK, play_chunks, play_match, record_game
from tests.league.players import GAME, save_network

GAMES_PER_CHUNK = 2 * BLOCKS_PER_CHUNK


@pytest.fixture(scope="module")
def scenario():
    return GAME.scenario("11x11", max_ticks=1_500)


def bot(name, scenario):
    return GAME.bot(name, scenario)


def play(first, second, scenario, num_games, seed=3):
    return play_match(bot(first, scenario), bot(second, scenario), GAME, scenario, num_games, seed)


def test_the_same_seed_gives_the_same_match(scenario):
    matches = [play("random", "rusher", scenario, 8) for _ in range(2)]
    assert matches[0] == matches[1]
    assert matches[0].distinct_games == 8


def test_another_seed_gives_another_match(scenario):
    matches = [play("random", "rusher", scenario, 8, seed) for seed in (3, 4)]
    assert matches[0] != matches[1]


def test_a_network_that_explores_plays_the_same_in_any_company(scenario, tmp_path):
    agent = load_agent(save_network(tmp_path / "net"), GAME.name, scenario, epsilon=0.5)
    rival = bot("random", scenario)
    whole = play_chunks(agent, rival, GAME, scenario, 3, (0, 1, 2)).results
    alone = play_chunks(agent, rival, GAME, scenario, 3, (1,)).results
    assert whole[GAMES_PER_CHUNK : 2 * GAMES_PER_CHUNK] == alone
    assert len({result.fingerprint for result in whole}) == len(whole)


def test_a_match_is_the_same_from_both_sides(scenario):
    one, two = (
        play(*names, scenario, 16) for names in (("random", "zigzag"), ("zigzag", "random"))
    )
    games = {(r.block, r.first_seat): r.fingerprint for r in one.results}
    assert games == {(r.block, 1 - r.first_seat): r.fingerprint for r in two.results}
    assert one.score == 1.0 - two.score


def test_an_agent_draws_differently_against_each_rival_and_in_each_chunk(scenario):
    noise = [
        play_match(
            bot("random", scenario), bot("random", scenario), GAME, scenario, 16, 3, identities
        )
        for identities in (("a", "b"), ("a", "c"))
    ]
    assert {r.fingerprint for r in noise[0].results}.isdisjoint(
        r.fingerprint for r in noise[1].results
    )
    assert noise[0].distinct_games == 16


@pytest.mark.parametrize("num_games", [0, 5, -2])
def test_an_odd_number_of_games_is_refused(scenario, num_games):
    with pytest.raises(ValueError, match=f"num_games is {num_games}, it must be even and 2 or"):
        play("random", "turtle", scenario, num_games)


def test_a_recorded_game_is_the_first_of_the_match(scenario):
    replay = record_game(bot("economist", scenario), bot("random", scenario), GAME, scenario, 3)
    actions = replay.actions
    first = play("economist", "random", scenario, 2).results[0]
    assert actions.shape == (first.decisions, 2)
    for step, engine in enumerate(replay_steps(replay)):
        assert (engine.terminated[0] | engine.truncated[0]) == (step == len(actions))
    assert engine.winner[0] == first.winner == replay.winner
    assert replay.players == ("economist", "random")
    assert engine.truncated[0] == first.is_truncated


def test_a_game_is_filmed(tmp_path):
    scenario = GAME.scenario("11x11", max_ticks=300)
    first, second = bot("economist", scenario), bot("turtle", scenario)
    frames = save_film(tmp_path / "game.gif", record_game(first, second, GAME, scenario, 0))
    with Image.open(tmp_path / "game.gif") as film:
        assert film.format == "GIF"
        assert 2 <= film.n_frames <= frames == 31
