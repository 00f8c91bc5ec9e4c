"""Weak bots: how often they decide, names, determinism, and what a table of bots holds."""

import numpy as np
import pytest

import marl_cair
from marl_cair.games.players.weak_bot import STRENGTHS, WeakBot, list_strengths
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.lookup import UnknownNameError
from tests.recurrent_agents import Counting

GAME = marl_cair.GAMES["deep_line_wars"]
SCENARIO = GAME.scenario("11x11")


def watch(name, seed=0, num_steps=60):
    """Actions [T, N] of a bot of that name in N games, and those of the bot at full strength."""
    engine = marl_cair.make_engine("deep_line_wars", "11x11", num_worlds=16)
    engine.reset(np.arange(16, dtype=np.uint64))
    plain, weak = (GAME.bot(one, SCENARIO) for one in (name.partition("@")[0], name))
    for bot in (plain, weak):
        bot.seed(seed)
    played = []
    for _ in range(num_steps):
        seen = engine.observe(plain.representation)[:, 0], engine.action_mask()[:, 0]
        actions = np.stack([plain.act(*seen), weak.act(*seen)])
        played.append(actions)
        engine.step(np.stack([actions[0], np.zeros(16, np.int64)], 1))
    return np.stack(played, 1)


def test_a_share_of_the_decisions_is_the_bots_and_the_others_do_nothing():
    full, weak = watch("rusher@0.3")
    is_bots = weak == full
    noop = GAME.make_spec(SCENARIO).noop_action
    assert set(weak[~is_bots]) == {noop}
    acts = full != noop
    assert is_bots[acts].mean() == pytest.approx(0.3, abs=4 * np.sqrt(0.21 / acts.sum()))


def test_a_seed_gives_the_same_decisions_and_a_state_continues_them():
    assert (watch("rusher@0.3", 5)[1] == watch("rusher@0.3", 5)[1]).all()
    assert (watch("rusher@0.3", 5)[1] != watch("rusher@0.3", 6)[1]).any()
    first, second = (GAME.bot("rusher@0.5", SCENARIO) for _ in range(2))
    engine = marl_cair.make_engine("deep_line_wars", "11x11", num_worlds=64)
    engine.reset(np.arange(64, dtype=np.uint64))
    seen = engine.observe(first.representation)[:, 0], engine.action_mask()[:, 0]
    first.act(*seen)
    second.load_state_dict(first.state_dict())
    assert (first.act(*seen) == second.act(*seen)).all()


def test_a_stronger_bot_beats_a_weaker_one():
    weak, strong = (load_agent(f"rusher@{x}", GAME.name, SCENARIO) for x in (0.05, 0.5))
    assert (weak.name, strong.name) == ("rusher@0.05", "rusher@0.5")
    assert play_match(strong, weak, GAME, SCENARIO, 40, 0).score > 0.9


@pytest.mark.parametrize("name", ["rusher@0", "rusher@1", "rusher@x", "rusher@", "@0.5"])
def test_other_strengths_are_refused(name):
    assert name not in GAME.bots
    with pytest.raises(UnknownNameError, match="rusher"):
        GAME.bot(name, SCENARIO)


def test_strengths_are_names_that_are_not_listed():
    assert GAME.bot("rusher@0.30", SCENARIO).name == "rusher@0.30"
    assert not any("@" in name for name in GAME.bots)
    assert list_strengths("random") == ["random"]
    names = list_strengths("rusher")
    assert names[-1] == "rusher"
    assert len(names) == len(STRENGTHS) + 1
    assert all(name in GAME.bots for name in names)


def test_a_recurrent_bot_keeps_its_states():
    """Also in decisions in which it does nothing."""
    weak = WeakBot(Counting(), "counting@0.5", 0.5, noop=0)
    seen, mask = np.zeros((50, 1), np.float32), np.ones((50, 4), np.bool_)
    states, played = np.zeros((50, weak.state_size), np.float32), []
    for _ in range(4):
        actions, states = weak.act(seen, mask, states)
        played.append(actions)
    assert (states == [4, -12]).all()
    # Counting plays 0 and 1 in turn.
    assert not np.any(played[::2])
    assert 0 < np.mean(played[1::2]) < 1
