"""Recipes of Q-networks and of the thesis: what they set, and that they train."""

import functools
import math

import pytest

from marl_cair.cli.compose import compose_config, list_choices
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from tests.training.runs import train

NETWORKS = "dqn", "double_dqn", "dueling_dqn", "dcqn", "drqn", "rcqn", "rainbow"
THESIS = [name for name in list_choices("recipe") if name.startswith("thesis/")]
SHORT = (
    *("game=last_standing", "scenario=duel", "representation=planes", "opponent=random"),
    *("game.reward=sparse", "policy.hidden_width=16", "collector.num_worlds=8"),
    *("learner.batch_size=16", "replay.capacity_transitions=3000", "replay.min_transitions=64"),
    *("generator=none", "evaluation.every_frames=256", "evaluation.games=2", "total_frames=512"),
    "torch_threads=1",
)


@functools.cache
def compose(name, *words):
    return compose_config([f"recipe={name}", *words])


@pytest.mark.parametrize("body", ["capsule", "small_capsule"])
def test_capsules_give_each_action_an_advantage_of_its_own(body):
    assert compose_config([f"policy={body}"]).policy.resolve_action_embedding() == 0


def test_recipes_set_what_their_papers_add():
    dqn, double, dueling, rainbow = map(compose, ("dqn", "double_dqn", "dueling_dqn", "rainbow"))
    assert (dqn.policy.head, dqn.learner.double, dqn.learner.n_steps) == ("plain", False, 1)
    assert (double.policy.head, double.learner.double) == ("plain", True)
    assert (dueling.policy.head, dueling.learner.double) == ("dueling", True)
    assert {one.learner.target for one in (dqn, double, dueling, rainbow)} == {"hard"}
    assert (rainbow.policy.head, rainbow.policy.noisy) == ("quantile", True)
    assert (rainbow.learner.algorithm, rainbow.learner.n_steps) == ("quantile", 3)
    assert (rainbow.replay.priority_alpha, rainbow.exploration.kind) == (0.5, "noisy")
    naf = compose("naf")
    assert (naf.policy.head, naf.learner.double, naf.learner.target) == ("naf", True, "soft")
    bodies = {name: compose(name).policy.body for name in NETWORKS}
    assert [name for name in bodies if bodies[name] == "capsule"] == ["dcqn", "rcqn"]
    memories = {name: compose(name).policy.memory for name in NETWORKS}
    assert [name for name in memories if memories[name] == "lstm"] == ["drqn", "rcqn"]


@pytest.mark.parametrize("game", GAMES)
def test_parallelised_q_learning_composes_with_each_game(game):
    assert compose("pqn", f"game={game}").game.name == game


def test_a_network_joins_the_recipe_of_a_game():
    config = compose("[deep_maze_9x9,rainbow]", "policy=capsule")
    assert (config.game.name, config.game.scenario) == ("deep_maze", "9x9-stochastic")
    assert (config.policy.body, config.policy.head) == ("capsule", "quantile")
    assert config.policy.distances
    with pytest.raises(ValueError, match="nearest are 'rainbow'"):
        compose("[deep_maze_9x9,rainbw]")


@pytest.mark.slow
def test_the_thesis_has_its_hyper_parameters():
    rates = {name.removeprefix("thesis/"): compose(name).learner.learning_rate for name in THESIS}
    slow = dict.fromkeys(("deep_line_wars", "deep_maze", "deep_rts"), 3e-5)
    assert rates == {**slow, "flappy_bird": 2e-4, "multitask": 1e-4}
    for name in THESIS:
        config = compose(name)
        learner, exploration = config.learner, config.exploration
        assert (learner.optimizer, learner.loss, learner.batch_size) == ("sgd", "smooth_l1", 16)
        assert (learner.gamma, config.replay.capacity_transitions) == (0.98, 1_000_000)
        assert (exploration.epsilon_start, exploration.epsilon_end) == (1.0, 0.1)
        assert config.game.name == {"thesis/multitask": "flash"}.get(name, name[len("thesis/") :])
        assert config.synthetic_fraction == 0.2
        assert compose(name, "policy=thesis_capsule").policy.head == "length"


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize(
    "name",
    [
        "rainbow policy=capsule",
        *(
            pytest.param(name, marks=() if name == "drqn" else pytest.mark.slow)
            for name in NETWORKS
        ),
        *(pytest.param(name, marks=pytest.mark.slow) for name in THESIS),
    ],
)
def test_a_recipe_trains_an_agent(tmp_path, name):
    config = compose(*name.split(), *SHORT, f"out={tmp_path / 'run'}")
    result = train(config)
    assert result.updates > 0
    assert math.isfinite(result.last_row["loss/all"])
    assert load_agent(tmp_path / "run").network.config.body == config.policy.body
