"""Runs whose networks value actions by cells: the cells are the game's, checkpoints keep them."""

import dataclasses

import pytest
import torch

from marl_cair.checkpoint import load_network
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.initial_network import begin_as
from marl_cair.training.settings.config import GameSettings, OpponentSettings
from tests.training.runs import tiny, train

POLICY = QNetworkConfig(hidden_width=16, cell_values=True)


@pytest.mark.slow
def test_cells_are_the_games_and_go_with_the_agent(tmp_path):
    config = tiny(tmp_path / "a", 640, policy=POLICY, synthetic_fraction=0.0)
    latest = train(config).folder / "latest"
    network, about = load_network(latest)
    game = GAMES["deep_line_wars"]
    spec = game.make_spec(game.scenario("11x11"))
    assert network.config.action_cells == tuple(spec.action_cells.tolist())
    assert network.config.action_kinds == tuple(spec.action_groups.tolist())
    assert about.network["cell_values"] is True
    assert network.cells.values.weight.abs().max() > 0, "nothing was learned"
    assert load_agent(latest, "deep_line_wars", game.scenario("11x11")).name == about.name

    again = begin_as(str(latest), dataclasses.replace(config, out=str(tmp_path / "b")))
    begun, _ = load_network(train(again).folder / "latest")
    assert begun.config == network.config
    assert not torch.equal(begun.cells.values.weight, network.cells.values.weight)


def test_a_game_without_cells_is_refused_before_anything_is_written(tmp_path):
    game = GameSettings("deep_maze", "15x15-race-2p")
    config = tiny(
        tmp_path / "a", game=game, policy=POLICY, opponent=OpponentSettings({"latest": 1.0})
    )
    with pytest.raises(ValueError, match="none of the actions points at a cell: set cell_values"):
        train(config)
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_pictures_do_not_show_the_cells_and_differing_policies_are_named_shortly(tmp_path):
    config = tiny(tmp_path / "a", 128, policy=POLICY, synthetic_fraction=0.0)
    game = dataclasses.replace(config.game, representation="image")
    with pytest.raises(ValueError, match=r"'image' \(3, .*\) does not show the 11 x 11 cells that"):
        train(dataclasses.replace(config, game=game))
    latest = train(config).folder / "latest"
    other = dataclasses.replace(
        config,
        out=str(tmp_path / "b"),
        policy=QNetworkConfig(hidden_width=16),
        initial_agent=str(latest),
    )
    with pytest.raises(
        ValueError, match="whose policy is cell_values=True, action_cells="
    ) as refused:
        train(other)
    assert len(str(refused.value)) < 600

    its = load_network(latest)[0].config
    kinds = (*its.action_kinds[:-1], its.action_kinds[-1] + 1)  # beyond the shown ones
    other = dataclasses.replace(other, policy=dataclasses.replace(its, action_kinds=kinds))
    with pytest.raises(ValueError, match="whose policy is action_kinds="):
        train(other)
