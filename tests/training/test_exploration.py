"""Explorations: their actions, random states over a resume, noise off where agents are rated."""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.league.agents.load import load_agent
from marl_cair.outside import OutsideCodeError
from marl_cair.policies.actor import MaskedEpsilonGreedy, PolicyActor, masked_argmax
from marl_cair.policies.heads import NoisyLinear
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.collecting.exploration import Exploration, make_exploration
from marl_cair.training.initial_network import begin_as
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.config_file import build_config, list_sources
from marl_cair.training.settings.exploration import ExplorationSettings
from marl_cair.training.settings.learner import LearnerSettings
from tests.training.runs import make_agent, small, train, train_whole_and_in_parts

GROUPS = np.array([0, 1, 1, 1, 2], np.int16)
NOISY = ExplorationSettings("noisy")


def make_values(num_rows=200):
    generator = torch.Generator().manual_seed(0)
    values = torch.randn(num_rows, 5, generator=generator)
    mask = torch.rand(num_rows, 5, generator=generator) < 0.6
    mask[:, 0] = True
    return values, mask


def test_epsilon_greedy_is_that_of_actors_at_the_epsilon_of_the_frame():
    settings = ExplorationSettings(epsilon_start=0.8, epsilon_end=0.2, anneal_frames=100)
    explore, values = make_exploration(settings, GROUPS), make_values()
    generator, actor = torch.Generator().manual_seed(3), MaskedEpsilonGreedy(3, GROUPS)
    for frames, epsilon in ((0, 0.8), (50, 0.5), (100, 0.2), (1_000, 0.2)):
        assert explore.epsilon_at(frames) == pytest.approx(epsilon)
        assert torch.equal(explore(*values, generator, frames), actor(*values, epsilon))


@pytest.mark.slow
def test_with_a_power_the_last_rows_explore_less_often():
    settings = ExplorationSettings(epsilon_start=0.4, epsilon_end=0.4, epsilon_power=7.0)
    explore, generator = make_exploration(settings, np.arange(100)), torch.Generator()
    values, mask = torch.zeros(3, 100), torch.ones(3, 100, dtype=torch.bool)
    drawn = torch.stack([explore(values, mask, generator, 0) for _ in range(4_000)])
    shares = (drawn != 0).double().mean(0)  # values are equal: action 0 without exploration
    for share, epsilon in zip(shares.tolist(), (0.4, 0.4**4.5, 0.4**8), strict=True):
        assert share == pytest.approx(0.99 * epsilon, abs=4 * (epsilon / 4_000) ** 0.5)


def test_noisy_exploration_is_greedy_and_draws_nothing():
    explore, values, generator = make_exploration(NOISY, GROUPS), make_values(), torch.Generator()
    before = generator.get_state()
    assert torch.equal(explore(*values, generator, 0), masked_argmax(*values))
    assert torch.equal(generator.get_state(), before)
    assert explore.epsilon_at(0) == 0.0


def noisy(folder, head="dueling"):
    policy = QNetworkConfig(hidden_width=16, head=head, noisy=True)
    algorithm = "quantile" if head == "quantile" else "dqn"
    learner = LearnerSettings(algorithm, batch_size=16, frames_per_update=16, n_steps=3)
    return small(folder, "duel", policy=policy, exploration=NOISY, learner=learner)


@pytest.mark.slow
@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("head", ["dueling", "quantile"])
def test_a_noisy_run_resumes_to_the_same_bits(tmp_path, head):
    whole, _ = train_whole_and_in_parts(tmp_path, lambda folder: noisy(folder, head), until=256)
    agent = load_agent(whole / "latest")
    noise = [layer for layer in agent.network.modules() if isinstance(layer, NoisyLinear)]
    assert noise
    first = float(np.sqrt(0.25 / noise[0].in_features))
    assert any(
        not torch.allclose(one.weight_noise, torch.full_like(one.weight_noise, first))
        for one in noise
    )
    seen = np.random.default_rng(0).integers(0, 256, (9, *agent.network.observation_shape))
    mask = np.ones((9, agent.network.num_actions), np.bool_)
    seen = seen.astype(np.uint8)
    np.testing.assert_array_equal(agent.values(seen, mask), agent.values(seen, mask))


@pytest.mark.usefixtures("test_game")
def test_the_collector_explores_by_noise_which_rated_networks_have_not(tmp_path):
    run = TrainingRun(noisy(tmp_path / "run"))
    data = next(iter(run.collector))
    learned = data["player", "learned"]
    seen, mask = (data["player", name][learned] for name in ("observation", "action_mask"))
    greedy = masked_argmax(run.rated.compute_values(seen), mask)
    share = (data["player", "action"][learned] != greedy).float().mean()
    assert 0.2 < share < 1.0
    assert run.router.epsilon == 0.0
    for network, has_noise in (
        (run.learner.network, True),
        (run.learner.target, True),
        (run.learner.average, False),
        (run.rated_network, False),
    ):
        values = PolicyActor(network, "learner", run.seen.name).compute_values
        assert torch.equal(values(seen), values(seen)) is not has_noise
    run.close()


@pytest.mark.parametrize(
    ("policy", "kind"), [({"noisy": True}, "epsilon_greedy"), ({}, "noisy")], ids=str
)
def test_noise_without_its_exploration_is_refused(policy, kind):
    with pytest.raises(ValueError, match=r"set policy\.noisy=true exploration\.kind=noisy, or"):
        TrainConfig(policy=QNetworkConfig(**policy), exploration=ExplorationSettings(kind))


def test_an_unknown_exploration_is_refused():
    with pytest.raises(ValueError, match=r"unknown exploration\.kind 'nosy'.*'noisy'"):
        ExplorationSettings("nosy")


@pytest.mark.usefixtures("test_game")
def test_a_run_begins_as_an_agent_with_the_loss_and_exploration_of_its_network(tmp_path):
    quantile = QNetworkConfig(hidden_width=8, head="quantile", noisy=True)
    learner = LearnerSettings("quantile")
    agents = [
        make_agent(small(tmp_path / "plain", "duel")),
        make_agent(
            small(tmp_path / "noisy", "duel", policy=quantile, exploration=NOISY, learner=learner)
        ),
    ]
    for config in (
        small(tmp_path / "a", "duel"),
        small(tmp_path / "b", "duel", policy=quantile, exploration=NOISY, learner=learner),
    ):
        for agent, algorithm, kind in zip(
            agents, ("dqn", "quantile"), ("epsilon_greedy", "noisy"), strict=True
        ):
            begun = begin_as(agent, config)
            assert (begun.learner.algorithm, begun.exploration.kind) == (algorithm, kind)


# --- from outside ----------------------------------------------------------------------------


class Softmax(Exploration):
    """Samples from the softmax over the legal values."""

    def __call__(self, values, action_mask, generator, frames):
        logits = values.masked_fill(~action_mask, -torch.inf)
        return torch.multinomial(logits.softmax(-1), 1, generator=generator).squeeze(1)


class Illegal(Exploration):
    """Plays the last action, legal or not."""

    def __call__(self, values, action_mask, generator, frames):
        return torch.full(values.shape[:1], values.shape[1] - 1)


class Floats(Exploration):
    """Returns the largest value, not its place."""

    def __call__(self, values, action_mask, generator, frames):
        return values.amax(-1)


class Failing(Exploration):
    """Raises."""

    def __call__(self, values, action_mask, generator, frames):
        raise KeyError("temperature")


HERE = "tests.training.test_exploration"


@pytest.mark.slow
@pytest.mark.usefixtures("test_game")
def test_an_exploration_from_outside_trains_and_resumes(tmp_path):
    name = f"{HERE}:Softmax"

    def make(folder):
        return small(folder, "duel", exploration=ExplorationSettings(name))

    config = make(tmp_path / "run")
    assert name in list_sources(config)
    assert build_config(dataclasses.asdict(config)) == config
    train_whole_and_in_parts(tmp_path, make, until=256)


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("Floats", r"gave torch.float32 of shape \[2\] for 2 rows"),
        ("Failing", "failed: KeyError: 'temperature'"),
        ("GROUPS", "must be a subclass of marl_cair.training.collecting.exploration.Exploration"),
        ("Nothing", "has no 'Nothing'"),
    ],
)
def test_a_wrong_exploration_is_refused_before_the_first_step(tmp_path, kind, message):
    config = small(tmp_path / "run", "duel", exploration=ExplorationSettings(f"{HERE}:{kind}"))
    with pytest.raises(OutsideCodeError, match=message):
        train(config)
    assert not (tmp_path / "run").exists()


def test_an_illegal_action_of_an_exploration_from_outside_is_an_error():
    explore = make_exploration(ExplorationSettings(f"{HERE}:Illegal"), GROUPS)
    with pytest.raises(OutsideCodeError, match=r"gave the illegal action \d+ for"):
        explore(*make_values(), torch.Generator(), 0)


class Greedy(Exploration):
    """The best legal action, at each place."""

    def __call__(self, values, action_mask, generator, frames):
        return values.masked_fill(~action_mask, -torch.inf).argmax(-1)


def test_an_exploration_from_outside_acts_at_many_places():
    explore = make_exploration(ExplorationSettings(f"{HERE}:Greedy"), GROUPS, (3, 2))
    values = torch.randn(4, 3, 2, len(GROUPS))
    mask = torch.ones_like(values, dtype=torch.bool)
    assert torch.equal(explore(values, mask, torch.Generator(), 0), values.argmax(-1))
