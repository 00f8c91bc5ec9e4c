"""First networks and generators of a run, taken over from others; prioritised rows."""

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
import torch

from benchmarks._networks import save_network
from marl_cair.checkpoint import (
    CheckpointError,
    load_network,
    load_tensors,
    read_description,
    save_tensors,
)
from marl_cair.generative.settings import GeneratorConfig
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.generating.generators import GENERATOR_FILE
from marl_cair.training.initial_network import can_begin_as
from marl_cair.training.population.league_slice import MemberRecord, _begin, make_member
from marl_cair.training.run import RESUME_FOLDER, TrainingRun
from marl_cair.training.settings.config import (
    CollectorSettings,
    GameSettings,
    GeneratorSettings,
    ReplaySettings,
    TrainConfig,
)
from marl_cair.training.settings.learner import NfspSettings
from tests.damage import forget_checksums
from tests.training import runs
from tests.training.runs import digest, make_batch, make_learner, tiny, train

GRAY = GameSettings(scenario="11x11", representation="gray")
NO_GENERATOR = {"synthetic_fraction": 0.0}


@pytest.mark.slow
def test_a_resumed_run_with_priorities_equals_one_that_was_never_stopped(tmp_path):
    replay = ReplaySettings(2_000, 300, min_transitions=300, priority_alpha=0.6)
    changes = {"frames": 768, "replay": replay, **NO_GENERATOR}
    whole, _ = runs.train_whole_and_in_parts(tmp_path, lambda to: tiny(to, **changes), until=512)
    changes["replay"] = dataclasses.replace(replay, priority_alpha=0.0)
    train(tiny(tmp_path / "even", **changes))
    assert digest(whole) != digest(tmp_path / "even")


def test_a_run_begins_with_the_network_of_an_agent(finished, tmp_path):
    kept, _ = load_network(finished / "latest")
    run = TrainingRun(tiny(tmp_path / "next", initial_agent=str(finished / "latest"), seed=5))
    new = TrainingRun(tiny(tmp_path / "new", seed=5))
    for name, weights in kept.state_dict().items():
        for network in (run.learner.network, run.learner.target, run.learner.average):
            assert torch.equal(network.state_dict()[name], weights), name
    pairs = zip(new.learner.network.parameters(), kept.parameters(), strict=True)
    assert any(not torch.equal(a, b) for a, b in pairs)
    run.close()
    new.close()


@pytest.mark.parametrize("strides", [(), (2, 1)])
def test_a_capsule_agent_of_a_large_board_is_begun_with_whatever_its_strides(tmp_path, strides):
    """From before, the stride of large boards was in the second convolution."""
    channels = (32, 32) if strides else ()
    sizes = {"body": "capsule", "conv_channels": channels, "conv_strides": strides}
    games = GameSettings("deep_maze", "25x25-deterministic")
    agent = save_network(
        tmp_path / "agent", games.scenario, "planes", QNetworkConfig(**sizes), rules=games.name
    )
    config = TrainConfig(
        out=str(tmp_path / "run"),
        game=games,
        policy=QNetworkConfig(body="capsule"),
        initial_agent=agent,
        generator=GeneratorSettings("none"),
        replay=ReplaySettings(1_000, min_transitions=100),
        collector=CollectorSettings(num_worlds=2),
    )
    run = TrainingRun(config)
    assert run.learner.network.config.conv_strides == strides
    run.close()
    new = TrainingRun(dataclasses.replace(config, out=str(tmp_path / "new"), initial_agent=None))
    assert new.learner.network.config.conv_strides == (2, 1)
    new.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"policy": QNetworkConfig(hidden_width=33)}, "whose policy is .*hidden_width=32"),
        ({"game": GameSettings(scenario="10x15")}, r"observation shape is \(28, 11, 11\), but"),
        ({"game": GRAY, **NO_GENERATOR}, "representation is planes, but this run's is gray"),
    ],
)
def test_an_initial_agent_of_something_else_is_refused(finished, tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        TrainingRun(tiny(tmp_path / "next", initial_agent=str(finished / "latest"), **changes))
    assert not (tmp_path / "next").exists()
    with pytest.raises(CheckpointError, match="is no agent checkpoint"):
        TrainingRun(tiny(tmp_path / "next", initial_agent=str(tmp_path)))


def test_rows_count_in_the_loss_by_their_weights():
    batch, learner = make_batch(), make_learner()
    batch["priority_weight"] = torch.tensor([0.5, 0.0, 0.0, 0.25])
    loss = learner.update(batch)["loss/all"]
    error = batch["td_error"].abs()
    losses = torch.where(error < 1.0, error.square() / 2, error - 0.5)
    assert float(loss) == pytest.approx(float((2.0 * losses[0] + losses[3]) / 3.0), rel=1e-5)
    assert float(loss) != pytest.approx(float(losses.mean()), rel=1e-2)


def test_logits_of_an_average_policy_are_no_values_to_begin_with(tmp_path):
    nfsp = NfspSettings(enabled=True)
    agent = str(train(tiny(tmp_path / "first", 128, nfsp=nfsp)).folder / "latest")
    assert not can_begin_as(agent)
    with pytest.raises(ValueError, match="logits of an average policy"):
        TrainingRun(tiny(tmp_path / "next", initial_agent=agent))


def test_a_state_that_another_process_saved_while_this_one_began_is_taken_up(tmp_path, monkeypatch):
    make = TrainingRun._make_collector

    def make_late(run):
        monkeypatch.setattr(TrainingRun, "_make_collector", make)
        train(tiny(tmp_path / "run", 128))
        make(run)

    monkeypatch.setattr(TrainingRun, "_make_collector", make_late)
    run = TrainingRun(tiny(tmp_path / "run", 128), resume=True)
    assert run.frames == 128
    run.close()


@pytest.mark.slow
def test_a_run_begins_with_the_generator_of_another_and_trains_it_on(finished, tmp_path):
    """A resumed run does not read it again."""
    source = Path(shutil.copytree(finished, tmp_path / "first"))
    saved = load_tensors(source / GENERATOR_FILE)["network"]

    def make(folder):
        return tiny(folder, 768, initial_generator=str(source), seed=5)

    run = TrainingRun(make(tmp_path / "next"))
    own = run.generator.state_dict()
    assert own["network"]["num_updates"] == saved["num_updates"] >= 2
    for name in ("network", "average"):
        ours, theirs = own["network"][name], saved[name]
        assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
    # Rows of this run alone judge it.
    assert own["report"] is None
    assert own["heldout"]["num_rows"] == 0
    assert not run.gate_is_open
    run.close()
    train(make(tmp_path / "whole"))
    train(make(tmp_path / "parts"), until_frames=512)
    (source / GENERATOR_FILE).unlink()
    train(make(tmp_path / "parts"), resume=True)
    assert digest(tmp_path / "whole") == digest(tmp_path / "parts")
    learned = [load_tensors(tmp_path / run / GENERATOR_FILE) for run in ("whole", "parts")]
    assert repr(learned[0]) == repr(learned[1])
    assert learned[0]["network"]["num_updates"] > saved["num_updates"]


@pytest.mark.slow
def test_the_generators_file_is_on_disk_once_and_stays_when_the_state_is_deleted(
    finished_copy, tmp_path, monkeypatch
):
    train(tiny(finished_copy, 641), resume=True)
    published, kept = finished_copy / GENERATOR_FILE, finished_copy / RESUME_FOLDER
    assert published.samefile(kept / GENERATOR_FILE)

    def refuse(self, target):
        raise OSError("no hard links")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    train(tiny(finished_copy, 769), resume=True)
    assert not published.samefile(kept / GENERATOR_FILE)
    assert published.read_bytes() == (kept / GENERATOR_FILE).read_bytes()
    shutil.rmtree(kept)
    run = TrainingRun(tiny(tmp_path / "next", initial_generator=str(finished_copy)))
    assert run.generator.state_dict()["network"]["num_updates"] > 0
    run.close()


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"game": GameSettings(scenario="10x15")}, ValueError, "137 actions, this run 185"),
        (
            {"game": dataclasses.replace(GRAY, options={"max_ticks": 300})},
            ValueError,
            r"shape is \[28, 11, 11\], but this run's is \[1, 84, 84\]",
        ),
        (
            {"generator": GeneratorSettings(model=GeneratorConfig())},
            ValueError,
            r"its size is \{'channels': 8, .*, but this run's is \{'channels': 16",
        ),
        (NO_GENERATOR, ValueError, "this run has no generator: leave it out, or"),
        ({"initial_generator": "nowhere"}, CheckpointError, "nowhere, which has no generator.pt"),
    ],
)
def test_an_initial_generator_of_something_else_is_refused(
    finished, tmp_path, changes, error, message
):
    config = tiny(tmp_path / "next", initial_generator=str(finished))
    with pytest.raises(error, match=message):
        TrainingRun(dataclasses.replace(config, **changes))
    assert not (tmp_path / "next").exists()


def test_a_learner_of_a_league_that_is_reset_keeps_its_generator(finished, tmp_path):
    member, shared = tmp_path / "member", tmp_path / "shared"
    record = MemberRecord("main_exploiter_0", "main_exploiter", ("main_0",), 1.0, False, 0, 0)
    make_member(member, record, tiny(member))
    assert _begin(member, shared, record, False).initial_generator is None
    shutil.copytree(finished, member / "000")
    reset = _begin(member, shared, dataclasses.replace(record, generation=1), False)
    assert reset.initial_generator == str(member / "000")
    assert reset.initial_agent is None


def test_a_damaged_generator_is_named(finished_copy, tmp_path):
    path = finished_copy / GENERATOR_FILE
    config = tiny(tmp_path / "next", initial_generator=str(finished_copy))
    knowledge = dict(load_tensors(path))
    del knowledge["network"]["average"]
    save_tensors(knowledge, path)
    with pytest.raises(CheckpointError, match=r"first/generator.pt is damaged \(KeyError"):
        TrainingRun(config)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(CheckpointError, match=r"generator.pt is cut short"):
        TrainingRun(config)


def test_agents_carry_the_sum_of_their_training(finished_copy, tmp_path):
    first = finished_copy / "latest"
    second = tiny(tmp_path / "second", 256, initial_agent=str(first), **NO_GENERATOR)
    train(second)
    one, two = read_description(first), read_description(tmp_path / "second" / "latest")
    assert (one.frames, one.frames_total) == (640, 640)
    assert (two.frames, two.frames_total) == (256, 896)
    assert two.updates_total == one.updates + two.updates
    elsewhere = finished_copy.rename(tmp_path / "elsewhere")  # a resume does not need it
    train(dataclasses.replace(second, total_frames=384), resume=True)
    elsewhere.rename(finished_copy)
    assert read_description(tmp_path / "second" / "latest").frames_total == 1_024
    old = json.loads((first / "agent.json").read_text("utf-8"))
    del old["frames_total"], old["updates_total"]
    (first / "agent.json").write_text(json.dumps(old), "utf-8")
    forget_checksums(finished_copy)
    assert read_description(first).frames_total == 640
