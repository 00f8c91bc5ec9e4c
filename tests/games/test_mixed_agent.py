"""One of several agents plays each game, all of it, as often as its weight says."""

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.players.mixed_agent import MixedAgent
from tests.games import rock_paper_scissors
from tests.games.rock_paper_scissors import PAPER, ROCK, SCISSORS, Thrower

DEEP_LINE_WARS = GAMES["deep_line_wars"]
SCENARIO = DEEP_LINE_WARS.scenario("11x11")


def make_mixture(*weights):
    throwers = [Thrower("rock", ROCK), Thrower("paper", PAPER), Thrower("scissors", SCISSORS)]
    return MixedAgent(throwers[: len(weights)], weights)


def ask(agent, rows=4):
    return agent.act(np.zeros((rows, 1), np.float32), np.ones((rows, 3), np.bool_)).tolist()


def test_each_seed_draws_one_member_that_plays_until_the_next():
    agent, thrown = make_mixture(2, 1, 1), []
    for seed in range(400):
        agent.seed(seed)
        actions = ask(agent)
        assert len(set(actions)) == 1
        assert ask(agent) == actions
        thrown.append(actions[0])
        agent.seed(seed)
        assert ask(agent) == actions
    assert np.bincount(thrown) / 400 == pytest.approx([0.5, 0.25, 0.25], abs=0.07)


def test_rows_are_played_by_the_members_that_are_drawn_for_them():
    agent = make_mixture(1, 1, 2)
    agent.seed(3)
    drawn = agent.draw(4_000)
    assert np.bincount(drawn) / 4_000 == pytest.approx([0.25, 0.25, 0.5], abs=0.03)
    masks = np.ones((4_000, 3), np.bool_)
    assert (agent.act_as(drawn, np.zeros((4_000, 1)), masks) == drawn).all()


@pytest.mark.slow
def test_it_goes_on_from_a_state_as_if_nothing_had_happened():
    bots = [DEEP_LINE_WARS.bot("random", SCENARIO) for _ in range(2)]
    agent = MixedAgent(bots, (1, 2))
    agent.seed(5)
    spec = DEEP_LINE_WARS.make_spec(SCENARIO)
    shape = spec.representations[agent.representation].shape
    rows = np.zeros((6, *shape), np.float32), np.ones((6, spec.num_actions), np.bool_)
    agent.act(*rows)
    state = agent.state_dict()
    wanted = agent.draw(9).tolist(), agent.act(*rows).tolist()
    agent.seed(6)
    agent.load_state_dict(state)
    assert (agent.draw(9).tolist(), agent.act(*rows).tolist()) == wanted


def test_a_mixture_of_mixtures_is_one_of_all_members():
    agent = MixedAgent([make_mixture(1, 3), Thrower("scissors", SCISSORS)], [1, 1])
    assert [member.name for member in agent.members] == ["rock", "paper", "scissors"]
    assert agent.weights == pytest.approx([0.125, 0.375, 0.5])


@pytest.mark.parametrize(
    ("weights", "shown"),
    [((), "0 members and 0 weights"), ((1, 0), "all must be above 0"), ((1, np.nan), "above 0")],
)
def test_bad_weights_are_refused(weights, shown):
    with pytest.raises(ValueError, match=shown):
        make_mixture(*weights)


def test_members_must_see_the_same():
    other = Thrower("other", ROCK)
    other.representation = "planes"
    with pytest.raises(ValueError, match="observe planes and vector"):
        MixedAgent([Thrower("rock", ROCK), other], (1, 1))


@pytest.fixture
def _know_the_game(monkeypatch):
    monkeypatch.setitem(GAMES.modules, rock_paper_scissors.NAME, rock_paper_scissors)


@pytest.mark.usefixtures("_know_the_game")
def test_it_is_drawn_again_for_each_game_of_an_environment():
    env = GameEnv(rock_paper_scissors.NAME, opponent=make_mixture(1, 1, 2), representation="vector")
    rewards = []
    for game in range(400):
        env.reset(seed=0 if game == 0 else None)
        rewards.append(env.step(ROCK)[1])
    shares = [rewards.count(reward) / 400 for reward in (0.0, -1.0, 1.0)]
    assert shares == pytest.approx([0.25, 0.25, 0.5], abs=0.08)


@pytest.mark.slow
@pytest.mark.usefixtures("_know_the_game")
def test_each_world_of_a_vector_environment_draws_its_own():
    env = GameVectorEnv(
        rock_paper_scissors.NAME,
        num_envs=300,
        opponent=make_mixture(1, 1, 2),
        representation="vector",
        autoreset_mode="SameStep",
    )
    env.reset(seed=1)
    first = env.step(np.full(300, ROCK))[1]
    second = env.step(np.full(300, ROCK))[1]
    for rewards in (first, second):
        shares = [(rewards == reward).mean() for reward in (0.0, -1.0, 1.0)]
        assert shares == pytest.approx([0.25, 0.25, 0.5], abs=0.09)
    assert (first != second).any()
    env.reset(seed=1)
    assert (env.step(np.full(300, ROCK))[1] == first).all()
