"""What a run begins with, and what it draws: networks of others, prioritised rows."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
import torch

from marl_cair.checkpoint import (
    CheckpointError,
    load_network,
    load_tensors,
    read_description,
    save_tensors,
)
from marl_cair.cli import main
from marl_cair.generative.settings import GeneratorConfig
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.generators import GENERATOR_FILE
from marl_cair.training.initial_network import can_begin_as
from marl_cair.training.population.league_slice import MemberRecord, _begin, make_member
from marl_cair.training.run import RESUME_FOLDER, TrainingRun
from marl_cair.training.settings.config import GameSettings, GeneratorSettings, ReplaySettings
from marl_cair.training.settings.learner import NfspSettings
from marl_cair.training.trainer import train
from tests.damage import forget_checksums
from tests.training.runs import digest, make_batch, make_learner, tiny


def test_a_resumed_run_with_priorities_equals_one_that_was_never_stopped(tmp_path):
    replay = ReplaySettings(2_000, 300, min_transitions=300, priority_alpha=0.6)
    train(tiny(tmp_path / "whole", 1_280, replay=replay), show_progress=False)
    train(tiny(tmp_path / "parts", 1_280, replay=replay), show_progress=False, until_frames=640)
    train(tiny(tmp_path / "parts", 1_280, replay=replay), resume=True, show_progress=False)
    assert digest(tmp_path / "whole") == digest(tmp_path / "parts")
    train(tiny(tmp_path / "even", 1_280), show_progress=False)
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
                "game": GameSettings(scenario="11x11", representation="gray"),
                "synthetic_fraction": 0.0,
            },
            "whose representation is planes, but this run's is gray",
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


def test_a_run_begins_with_what_the_generator_of_another_has_learned(tmp_path):
    train(tiny(tmp_path / "first", 1_280), show_progress=False)
    source = str(tmp_path / "first")
    saved = load_tensors(tmp_path / "first" / GENERATOR_FILE)["ensemble"]
    run = TrainingRun(tiny(tmp_path / "next", initial_generator=source, seed=5))
    own = run.generator.state_dict()
    assert own["ensemble"]["num_updates"] == saved["num_updates"] >= 7
    for name in ("members", "averages"):
        for ours, theirs in zip(own["ensemble"][name], saved[name], strict=True):
            assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
    # Rows of this run alone judge it.
    assert own["report"] is None
    assert own["heldout"]["num_rows"] == 0
    assert not run.gate_is_open
    run.close()
    train(tiny(tmp_path / "next", initial_generator=source, seed=5), True, show_progress=False)
    learned = load_tensors(tmp_path / "next" / GENERATOR_FILE)["ensemble"]
    assert learned["num_updates"] > saved["num_updates"]


def test_a_resumed_run_needs_no_initial_generator_any_more(tmp_path):
    train(tiny(tmp_path / "first", 512), show_progress=False)
    config = tiny(tmp_path / "parts", initial_generator=str(tmp_path / "first"))
    whole = dataclasses.replace(config, out=str(tmp_path / "whole"))
    train(whole, show_progress=False)
    train(config, show_progress=False, until_frames=1_280)
    (tmp_path / "first" / GENERATOR_FILE).unlink()
    train(config, resume=True, show_progress=False)
    assert digest(tmp_path / "whole") == digest(tmp_path / "parts")
    knowledge = [load_tensors(tmp_path / run / GENERATOR_FILE) for run in ("whole", "parts")]
    assert repr(knowledge[0]) == repr(knowledge[1])


def test_what_the_generator_has_learned_is_on_disk_once_and_stays_when_the_state_goes(
    tmp_path, monkeypatch
):
    train(tiny(tmp_path / "run", 512), show_progress=False)
    published, kept = tmp_path / "run" / GENERATOR_FILE, tmp_path / "run" / RESUME_FOLDER
    assert published.samefile(kept / GENERATOR_FILE)

    def refuse(self, target):
        raise OSError("no second names")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    train(tiny(tmp_path / "run", 640), resume=True, show_progress=False)
    assert not published.samefile(kept / GENERATOR_FILE)
    assert published.read_bytes() == (kept / GENERATOR_FILE).read_bytes()
    shutil.rmtree(kept)
    run = TrainingRun(tiny(tmp_path / "next", initial_generator=str(tmp_path / "run")))
    assert run.generator.state_dict()["ensemble"]["num_updates"] > 0
    run.close()


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        (
            {"game": GameSettings(scenario="10x15")},
            ValueError,
            r"observation_shape is \[28, 11, 11",
        ),
        (
            {"generator": GeneratorSettings(model=GeneratorConfig(num_members=3))},
            ValueError,
            "its num_members is 2, but this run's is 3",
        ),
        ({"synthetic_fraction": 0.0}, ValueError, "this run has no generator: leave it out, or"),
        ({"initial_generator": "nowhere"}, CheckpointError, "nowhere, where no generator.pt is"),
    ],
)
def test_an_initial_generator_of_something_else_is_refused(tmp_path, changes, error, message):
    train(tiny(tmp_path / "first", 128), show_progress=False)
    config = tiny(tmp_path / "next", initial_generator=str(tmp_path / "first"))
    with pytest.raises(error, match=message):
        TrainingRun(dataclasses.replace(config, **changes))
    assert not (tmp_path / "next").exists()


def test_a_learner_of_a_league_that_begins_anew_keeps_its_generator(tmp_path):
    member, shared = tmp_path / "member", tmp_path / "shared"
    record = MemberRecord("main_exploiter_0", "main_exploiter", ("main_0",), 1.0, False, 0, 0)
    make_member(member, record, tiny(member))
    assert _begin(member, shared, record, False).initial_generator is None
    train(tiny(member / "000", 128), show_progress=False)
    anew = _begin(member, shared, dataclasses.replace(record, generation=1), False)
    assert anew.initial_generator == str(member / "000")
    assert anew.initial_agent is None


def test_a_damaged_generator_is_named(tmp_path):
    train(tiny(tmp_path / "first", 128), show_progress=False)
    path = tmp_path / "first" / GENERATOR_FILE
    config = tiny(tmp_path / "next", initial_generator=str(tmp_path / "first"))
    knowledge = dict(load_tensors(path))
    del knowledge["ensemble"]["steps"]
    save_tensors(knowledge, path)
    with pytest.raises(CheckpointError, match=r"first/generator.pt is damaged \(KeyError"):
        TrainingRun(config)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(CheckpointError, match=r"generator.pt is cut short"):
        TrainingRun(config)


def test_agents_carry_the_sum_of_their_training(tmp_path):
    words = ["scenario=11x11", "collector.num_worlds=16", "collector.steps_per_batch=8"]
    words += ["policy.hidden_width=16", "replay.min_transitions=200", "learner.batch_size=16"]
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["train", *words, "total_frames=512", f"out={first}"]) == 0
    more = [f"initial_agent={first / 'latest'}", "total_frames=256", f"out={second}"]
    assert main(["train", *words, *more]) == 0
    one, two = (read_description(folder / "latest") for folder in (first, second))
    assert (one.frames, one.frames_total) == (512, 512)
    assert (two.frames, two.frames_total) == (256, 768)
    assert two.updates_total == one.updates + two.updates
    assert main(["train", f"resume={second}", "total_frames=512"]) == 0
    assert read_description(second / "latest").frames_total == 1_024
    file = first / "latest" / "agent.json"
    old = json.loads(file.read_text("utf-8"))
    del old["frames_total"], old["updates_total"]
    file.write_text(json.dumps(old), "utf-8")
    forget_checksums(first)
    assert read_description(first / "latest").frames_total == 512
