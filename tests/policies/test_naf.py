"""The head `naf`: its formula, actions as points, learning, refusals."""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.games import GAMES
from marl_cair.games.action_forms import ContinuousActions
from marl_cair.games.game import NO_CELL
from marl_cair.policies.heads import NafHead, find_points
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.training import trainer
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import GeneratorSettings
from marl_cair.training.settings.learner import LearnerSettings
from tests.training.runs import tiny

KINDS, CELLS, BOARD = (0, 1, 2, 2, 2), (NO_CELL, NO_CELL, 0, 7, 11), (3, 4)
THIRD, QUARTER = 2 / 3, 1 / 4
POINTS = [
    [-THIRD, 0, 0],
    [0, 0, 0],
    [THIRD, -THIRD, -3 * QUARTER],
    [THIRD, 0, 3 * QUARTER],
    [THIRD, THIRD, 3 * QUARTER],
]


def make_head():
    torch.manual_seed(3)
    return NafHead(6, 5, 0, find_points(KINDS, CELLS, BOARD))


def test_points_are_centres():
    torch.testing.assert_close(find_points(KINDS, CELLS, BOARD), torch.tensor(POINTS))


@pytest.mark.parametrize(
    ("game", "scenario"), [("deep_line_wars", "10x15"), ("deep_rts", "1v1-15x15")]
)
def test_environments_read_the_points_of_all_actions(game, scenario):
    spec = GAMES[game].make_spec(GAMES[game].scenario(scenario))
    board = spec.representations["planes"].shape[-2:]
    points = find_points(spec.action_groups.tolist(), spec.action_cells.tolist(), board)
    read = ContinuousActions(game, spec).to_engine(points.numpy(), 0)
    np.testing.assert_array_equal(read, np.arange(spec.num_actions))


def test_values_are_those_of_the_formula_in_float64():
    head, features = make_head(), torch.randn(4, 6, generator=torch.Generator().manual_seed(1))
    found = head(features).detach()
    weights = {
        name: value.detach().numpy().astype(np.float64) for name, value in head.named_parameters()
    }
    for row, seen in enumerate(features.numpy().astype(np.float64)):
        value, best, factor = (
            weights[f"{name}.weight"] @ seen + weights[f"{name}.bias"]
            for name in ("state_value", "best", "factor")
        )
        lower = np.diag(0.1 * np.exp(factor[:3]))
        lower[[1, 2, 2], [0, 0, 1]] = factor[3:]
        for action, point in enumerate(POINTS):
            away = np.array(point) - np.tanh(best)
            wanted = value[0] - 0.5 * away @ (lower @ lower.T) @ away
            assert float(found[row, action]) == pytest.approx(wanted, rel=1e-4, abs=1e-5)


def test_the_best_action_is_at_the_best_point():
    head = make_head()
    with torch.no_grad():
        for layer in (head.best, head.factor):
            layer.weight.zero_()
        for action, point in enumerate(POINTS):
            head.best.bias.copy_(torch.tensor(point).clamp(-0.99, 0.99).atanh())
            assert head(torch.randn(8, 6)).argmax(-1).tolist() == [action] * 8


def test_the_td_error_falls_with_the_points_of_a_game(tmp_path):
    policy = QNetworkConfig(hidden_width=32, head="naf")
    learner = LearnerSettings(batch_size=32, learning_rate=3e-3, loss="l2")
    config = tiny(
        tmp_path / "run", policy=policy, learner=learner, generator=GeneratorSettings("none")
    )
    run = TrainingRun(config)
    assert run.learner.network.head.points.shape == (run.spec.num_actions, 3)
    steps = trainer.iterate(run, Timers())
    while run.replay.real.num_sampleable < 300:
        next(steps)
    batch = run.replay.sample()
    errors = [float(run.learner.update(batch.clone())["td_error/real"]) for _ in range(60)]
    assert np.mean(errors[-5:]) < 0.7 * np.mean(errors[:5])
    run.close()


def test_pictures_do_not_show_the_cells(tmp_path):
    config = tiny(tmp_path / "run", policy=QNetworkConfig(head="naf"))
    game = dataclasses.replace(config.game, representation="image")
    with pytest.raises(ValueError, match="policy.head is 'naf', but representation 'image'"):
        TrainingRun(dataclasses.replace(config, game=game))


def test_only_actions_that_point_at_cells_of_a_board_are_points():
    policy = QNetworkConfig(head="naf")
    with pytest.raises(ValueError, match="head is 'naf', but none of the actions points at a cell"):
        make_q_network(policy.with_actions([NO_CELL] * 3, [0, 1, 2]), (4, 8, 8), 3, seed=0)
    vector = QNetworkConfig(body="mlp", head="naf").with_actions([0, 1], [0, 1])
    with pytest.raises(ValueError, match="head is 'naf', which reads boards"):
        make_q_network(vector, (4,), 2, seed=0)
    with pytest.raises(ValueError, match="'naf' for 3 actions, but action_cells has 2 entries"):
        make_q_network(policy.with_actions([0, 1], [0, 1]), (4, 8, 8), 3, seed=0)
    with pytest.raises(ValueError, match="cell 64, but the observation has the cells 0..63"):
        make_q_network(policy.with_actions([0, 64], [0, 1]), (4, 8, 8), 2, seed=0)
