"""What a run begins with, and what it draws: an agent's network, prioritised rows."""

import pytest
import torch

from marl_cair.checkpoint import CheckpointError, load_network
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.config import GameSettings, ReplaySettings
from marl_cair.training.initial_network import can_begin_as
from marl_cair.training.nfsp_settings import NfspSettings
from marl_cair.training.run import TrainingRun
from marl_cair.training.trainer import train
from tests.training.runs import digest, make_batch, make_learner, tiny


def test_a_resumed_run_with_priorities_equals_one_that_was_never_stopped(tmp_path):
    replay = ReplaySettings(2_000, 300, min_transitions=300, priority_alpha=0.6)
    train(tiny(tmp_path / "whole", replay=replay), show_progress=False)
    train(tiny(tmp_path / "parts", replay=replay), show_progress=False, until_frames=1_280)
    train(tiny(tmp_path / "parts", replay=replay), resume=True, show_progress=False)
    assert digest(tmp_path / "whole") == digest(tmp_path / "parts")
    train(tiny(tmp_path / "even"), show_progress=False)
    assert digest(tmp_path / "whole") != digest(tmp_path / "even")


def test_a_run_begins_with_the_network_of_an_agent(tmp_path):
    train(tiny(tmp_path / "first", 640), show_progress=False)
    agent = tmp_path / "first" / "latest"
    kept, _ = load_network(agent)
    run = TrainingRun(tiny(tmp_path / "next", initial_agent=str(agent), seed=5))
    loss = dict(run.learner.state_dict()["loss"])
    new = TrainingRun(tiny(tmp_path / "new", seed=5))
    for name, weights in kept.state_dict().items():
        for network in (run.learner.network, run.learner.average):
            assert torch.equal(network.state_dict()[name], weights), name
    assert sum(torch.equal(a, b) for a in kept.parameters() for b in loss.values()) >= 2 * len(
        list(kept.parameters())
    )  # online and target
    pairs = zip(new.learner.network.parameters(), kept.parameters(), strict=True)
    assert any(not torch.equal(a, b) for a, b in pairs)
    run.close()
    new.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy": QNetworkConfig(hidden_width=33)}, "whose policy is .*hidden_width=32"),
        ({"game": GameSettings(scenario="10x15")}, r"observation shape is \(28, 11, 11\), but"),
        (
            {
                "game": GameSettings(scenario="11x11", representation="image"),
                "synthetic_fraction": 0.0,
            },
            "whose representation is planes, but this run's is image",
        ),
    ],
)
def test_an_initial_agent_of_something_else_is_refused(tmp_path, changes, message):
    train(tiny(tmp_path / "first", 128), show_progress=False)
    agent = str(tmp_path / "first" / "latest")
    with pytest.raises(ValueError, match=message):
        TrainingRun(tiny(tmp_path / "next", initial_agent=agent, **changes))
    assert not (tmp_path / "next").exists()
    with pytest.raises(CheckpointError, match="is no agent checkpoint"):
        TrainingRun(tiny(tmp_path / "next", initial_agent=str(tmp_path)))


def test_rows_count_in_the_loss_by_their_weights():
    batch, learner = make_batch(), make_learner()
    batch["priority_weight"] = torch.tensor([0.5, 0.0, 0.0, 0.25])
    loss = learner.update(batch)["loss/all"]
    error = batch["td_error"].flatten().sqrt()
    losses = torch.where(error < 1.0, error.square() / 2, error - 0.5)
    assert float(loss) == pytest.approx(float((2.0 * losses[0] + losses[3]) / 3.0), rel=1e-5)
    assert float(loss) != pytest.approx(float(losses.mean()), rel=1e-2)


def test_logits_of_an_average_policy_are_no_values_to_begin_with(tmp_path):
    nfsp = NfspSettings(enabled=True, min_rows=50, batch_size=16)
    train(tiny(tmp_path / "first", 640, nfsp=nfsp), show_progress=False)
    agent = str(tmp_path / "first" / "latest")
    assert not can_begin_as(agent)
    with pytest.raises(ValueError, match="logits of an average policy"):
        TrainingRun(tiny(tmp_path / "next", initial_agent=agent))


def test_a_state_that_another_process_saved_while_this_one_began_is_taken_up(tmp_path, monkeypatch):
    make = TrainingRun._make_collector

    def make_late(run):
        monkeypatch.setattr(TrainingRun, "_make_collector", make)
        train(tiny(tmp_path / "run", 640), show_progress=False)
        make(run)

    monkeypatch.setattr(TrainingRun, "_make_collector", make_late)
    run = TrainingRun(tiny(tmp_path / "run", 640), resume=True)
    assert run.frames == 640
    run.close()
