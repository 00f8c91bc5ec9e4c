"""The opponent of a learner: errors name it, and every game has a default."""

import dataclasses
import re
import sys

import gymnasium
import numpy as np
import pytest

from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.players.learner_seat import OpponentError
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.games.players.random_player import RandomPlayer
from marl_cair.league.agents.load import load_agent
from tests.games import kuhn_poker, last_standing, rock_paper_scissors
from tests.games.cases import FirstLegalAgent

GAME, SCENARIO = "deep_rts", "1v1-15x15"  # in which not all is legal at first


class Broken(FirstLegalAgent):
    """Answers what `answer` makes of the mask; in the world of the row `row` of a batch."""

    name = "broken"

    def __init__(self, answer):
        self.answer = answer

    def act(self, observation, action_mask):
        return self.answer(action_mask)


def answer_outside(mask):
    return np.full(len(mask), mask.shape[-1])


def answer_illegal_in_the_last_row(mask):
    actions = np.zeros(len(mask), np.int64)
    actions[-1] = np.flatnonzero(~mask[-1])[0]
    return actions


def crash(mask):
    raise KeyError("gold")


def make_foreign_crash(scenario, spec):
    """An agent as `module:function` names it."""
    return Broken(crash)


def make_foreign_illegal(scenario, spec):
    return Broken(answer_illegal_in_the_last_row)


ANSWERS = {
    "crashed in act: KeyError: 'gold'": (crash, 0),
    "returned float64 [2], it must be integers [2]": (lambda mask: np.zeros(len(mask)), 0),
    "returned int64 [], it must be integers [2]": (lambda mask: 0, 0),
    "played the illegal action {outside}": (answer_outside, 0),
    "played the illegal action -1": (lambda mask: np.full(len(mask), -1), 0),
    "played the illegal action {illegal}": (answer_illegal_in_the_last_row, 1),
}


@pytest.mark.parametrize("cause", ANSWERS)
def test_errors_of_an_opponent_have_the_cause(cause):
    answer, world = ANSWERS[cause]
    env = GameVectorEnv(GAME, SCENARIO, num_envs=2, opponent=Broken(answer))
    env.reset(seed=0)
    mask = env.engine.action_mask()[1, 1]
    cause = cause.format(outside=len(mask), illegal=np.flatnonzero(~mask)[0])
    message = f"{GAME}: the opponent 'broken', player 1 in world {world}, {cause}. Fix it, or"
    with pytest.raises(OpponentError, match=re.escape(message)) as raised:
        env.step(np.zeros(2, np.int64))
    assert isinstance(raised.value.__cause__, KeyError) == (answer is crash)


@pytest.mark.parametrize(
    ("function", "cause"),
    [
        ("make_foreign_crash", "crashed in act: KeyError: 'gold'"),
        ("make_foreign_illegal", "played the illegal action"),
    ],
)
def test_errors_of_a_foreign_agent_have_the_cause(function, cause):
    source = f"{__name__}:{function}"
    opponent = load_agent(source, game=GAME, scenario=SCENARIO)
    env = gymnasium.make("marl_cair/DeepRTS-1v1-15x15-v0", opponent=opponent)
    env.reset(seed=0)
    message = f"{GAME}: the opponent '{opponent.name}', player 1 in world 0, {cause}"
    with pytest.raises(OpponentError, match=re.escape(message)):
        env.step(0)


def test_errors_name_the_member_of_a_mixture():
    env = GameEnv(GAME, opponent=MixedAgent([Broken(crash)], [1.0]))
    env.reset(seed=0)
    with pytest.raises(OpponentError, match="the opponent 'broken', player 1 in world 0, crashed"):
        env.step(0)


# --- the opponent that every game has ------------------------------------------------------------


PLUG_INS = [last_standing, kuhn_poker, rock_paper_scissors]


def without_random(module, monkeypatch):
    """A plug-in game whose bots have no `random`, known by its name while a test runs."""
    bots = {name: bot for name, bot in module.GAME.bots.items() if name != "random"}
    game = dataclasses.replace(module.GAME, bots=bots)
    monkeypatch.setattr(module, "GAME", game)
    from marl_cair.games import GAMES

    monkeypatch.setitem(GAMES.modules, game.name, sys.modules[module.__name__])
    return game


@pytest.mark.parametrize("module", PLUG_INS, ids=lambda module: module.NAME)
def test_every_game_has_a_random_opponent(module, monkeypatch):
    game = without_random(module, monkeypatch)
    scenario = game.scenario()
    assert isinstance(game.bot("random", scenario), RandomPlayer)
    shown = next(iter(game.make_spec(scenario).representations))
    env = GameVectorEnv(game.name, num_envs=4, representation=shown)
    env.reset(seed=0)
    for _ in range(12):
        env.step(env.action_masks().argmax(axis=1))
    assert not env.engine.illegal_actions.any()
    assert isinstance(load_agent(f"{game.name}/random"), RandomPlayer)


def test_a_games_own_random_bot_stays():
    assert isinstance(last_standing.GAME.bot("random", last_standing.Scenario()), last_standing.Bot)


def test_random_players_draw_all_legal_actions_alike_and_the_same_of_one_seed():
    spec = last_standing.GAME.make_spec(last_standing.Scenario())
    player = RandomPlayer(None, spec)
    mask = np.zeros((9000, 5), np.bool_)
    mask[:, [0, 2, 3]] = True
    player.seed(3)
    state = player.state_dict()
    actions = player.act(np.zeros(9000), mask)
    assert (np.abs(np.bincount(actions, minlength=5) / 3000 - [1, 0, 1, 1, 0]) < 0.1).all()
    player.load_state_dict(state)
    np.testing.assert_array_equal(player.act(np.zeros(9000), mask), actions)
    player.seed(4)
    assert (player.act(np.zeros(9000), mask) != actions).any()
    places = np.repeat(mask[:6, None], 2, axis=1)
    assert player.act(np.zeros(6), places).shape == (6, 2)
