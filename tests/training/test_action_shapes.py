"""Learning an action at each cell of the board (`grid` of Deep RTS): values, draws, whole runs."""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.cli.compose import compose_config
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.policies.actor import (
    MaskedEpsilonGreedy,
    average_places,
    find_values,
    masked_argmax,
)
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.replay.transition import NO_ACTION
from marl_cair.training.newest_steps import DoubleValues, make_rows
from marl_cair.training.run import TrainingRun
from tests.training.runs import collect, train_whole_and_in_parts

SHAPE, NUM_ACTIONS = (8, 9), 5
FRAMES = 256


def make_config(folder, *words):
    """A run on a short game of Deep RTS."""
    small = ("policy.hidden_width=16", "policy.conv_channels=[8,8]", "collector.num_worlds=4")
    brief = ("collector.steps_per_batch=16", "collector.stagger_steps=0", "torch_threads=1")
    rated = ("evaluation.every_frames=128", "evaluation.games=2", "game.options.max_ticks=200")
    checkpoint = ("checkpoint.every_frames=128", f"total_frames={FRAMES}", f"out={folder}")
    return compose_config(["recipe=deep_rts_grid", *small, *brief, *rated, *checkpoint, *words])


def make_values(num_rows=6):
    generator = torch.Generator().manual_seed(0)
    values = torch.randn(num_rows, *SHAPE, NUM_ACTIONS, generator=generator)
    mask = torch.rand(values.shape, generator=generator) < 0.15
    mask[..., 0] = True
    mask[0, ..., 1:] = False  # no place of the first row acts
    return values, mask


def test_the_value_of_an_action_is_the_mean_over_the_places_that_act():
    values, mask = make_values()
    chosen, best = values[..., 2], find_values(values, masked_argmax(values, mask), mask)
    found = average_places(chosen, mask)
    torch.testing.assert_close(found[0], chosen[0].mean())
    for row in range(1, len(values)):
        acts = [place for place in np.ndindex(*SHAPE) if mask[row][place].sum() > 1]
        assert 0 < len(acts) < mask[row, ..., 0].numel()
        wanted = np.mean([float(chosen[row][place]) for place in acts])
        assert float(found[row]) == pytest.approx(wanted, abs=1e-6)
        wanted = np.mean([float(values[row][place][mask[row][place]].max()) for place in acts])
        assert float(best[row]) == pytest.approx(wanted, abs=1e-6)


def test_each_place_explores_for_itself():
    values, mask = make_values()
    greedy = MaskedEpsilonGreedy(0)(values, mask, 0.0)
    assert torch.equal(greedy, values.masked_fill(~mask, -torch.inf).argmax(-1))
    explore = MaskedEpsilonGreedy(1)
    drawn = torch.stack([explore(values, mask, torch.tensor([0.0, *[0.5] * 5])) for _ in range(50)])
    assert mask.expand(50, *mask.shape).gather(-1, drawn.unsqueeze(-1)).all()
    assert torch.equal(drawn[:, 0], greedy[:1].expand(50, -1, -1))
    changes = (drawn != greedy)[:, 1:].double().mean((0, 1))
    assert ((changes > 0.0) & (changes < 0.5)).any()
    assert not torch.equal(drawn[0], drawn[1])


def test_values_at_each_cell_are_dueling():
    config = QNetworkConfig(hidden_width=16).with_actions([], [], SHAPE)
    network = make_q_network(config, (3, *SHAPE), NUM_ACTIONS, seed=0)
    torch.nn.init.normal_(network.head.values.weight)
    seen = torch.rand(2, 3, *SHAPE)
    values = network(seen)
    assert values.shape == (2, *network.values_shape) == (2, *SHAPE, NUM_ACTIONS)
    state_value = network.head.state_value(network.body(seen))
    torch.testing.assert_close(values.mean(-1), state_value[:, None].expand(2, *SHAPE))
    moved = seen.clone()
    moved[:, :, 0, 0] += 1.0
    advantage = [network(one) - network(one).mean(-1, keepdim=True) for one in (seen, moved)]
    assert (advantage[0] - advantage[1]).abs()[:, 0, 0].max() > 1e-3


def test_the_places_are_the_cells_of_the_observation():
    config = QNetworkConfig().with_actions([], [], SHAPE)
    with pytest.raises(
        ValueError, match=r"cell of \[8, 9\], but .* \(3, 9, 9\): take representation"
    ):
        make_q_network(config, (3, 9, 9), NUM_ACTIONS, seed=0)


def test_only_places_that_act_are_learned_and_counted(tmp_path):
    run = TrainingRun(make_config(tmp_path / "run", "exploration.epsilon_start=1.0"))
    data = collect(run, 2)
    rows = make_rows(data, DoubleValues(run.actor, run.newest), run.config.learner)
    acts = rows["action_mask"].sum(-1) > 1
    assert (acts.flatten(1).sum(1) > 0).all()
    assert (acts.flatten(1).sum(1) < 20).all()
    assert (rows["action"][~acts] == 0).all()
    assert (run.router.taken.actions == NO_ACTION).any()
    report = run.statistics.report(run.book.name, run.spec.action_group_names)
    shares = {name: value for name, value in report.items() if name.startswith("actions/")}
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares["actions/noop"] < 0.5
    # Other actions where no unit stands change nothing.
    other = rows.clone()
    other["action"] = torch.where(acts, other["action"], 1)
    found = [
        run.learner.loss(run.learner.network, run.learner.network, one) for one in (rows, other)
    ]
    assert torch.equal(found[0].td_error, found[1].td_error)
    errors = []
    for _ in range(80):
        run.learner.update(batch := rows.clone())
        errors.append(float(batch["td_error"].abs().mean()))
    assert errors[-1] < 0.8 * errors[0]
    run.close()


@pytest.mark.parametrize(
    "memory",
    [
        pytest.param((), marks=pytest.mark.slow, id="none"),
        pytest.param(("policy.memory=gru", "policy.memory_width=8"), id="gru"),
    ],
)
def test_a_run_resumes_to_the_same_bits_and_its_agent_plays(tmp_path, memory):
    whole, _ = train_whole_and_in_parts(
        tmp_path, lambda folder: make_config(folder, *memory), until=FRAMES // 2
    )
    agent, game = load_agent(whole / "latest"), GAMES["deep_rts"]
    scenario = game.scenario("1v1-15x15", actions="grid", max_ticks=200)
    result = play_match(agent, game.bot("random", scenario), game, scenario, 2, 0)
    assert result.games == 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("learner.algorithm=dqn",),
            r"each cell of \[15, 15\]: set recipe=pqn",
        ),
        (("generator=ccdn",), "learner.algorithm=pqn generator=none"),
        (("policy.cell_values=true",), "a head of its own: use head='dueling', cell_values=False"),
        (("policy.head=plain",), "a head of its own: use head='dueling'"),
        (("evaluation.bots=[rusher]",), "cannot play the action space 'grid'"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_what_cannot_learn_actions_at_cells_is_refused(tmp_path, words, message):
    with pytest.raises(ValueError, match=message):
        TrainingRun(make_config(tmp_path / "run", *words))


def test_the_default_learner_says_what_to_set(tmp_path):
    config = make_config(tmp_path / "run")
    learner = dataclasses.replace(config.learner, algorithm="dqn")
    with pytest.raises(ValueError, match=r"action at each cell of \[15, 15\]: set recipe=pqn"):
        dataclasses.replace(config, learner=learner)
