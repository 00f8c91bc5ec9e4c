"""When a run generates rows, and how long they are."""

import dataclasses
import math

import pytest
import torch

from marl_cair.generative.gate import Acceptance, GateReport
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import GeneratorSettings, ReplaySettings
from marl_cair.training.trainer import Timers, iterate
from tests.training.runs import SMALL_GENERATOR, tiny, train_whole_and_in_parts

LENIENT = Acceptance(min_surety=-math.inf, certain=0.0, may_end=True, may_be_rare=True)


def generating(out, n_steps=1, **settings):
    """A run of 1,024 steps that evaluates its gate every 256 or 512."""
    config = tiny(out, 1_024, generator=GeneratorSettings(**settings))
    return dataclasses.replace(config, learner=dataclasses.replace(config.learner, n_steps=n_steps))


def open_gate(monkeypatch, run, looks=None):
    """Let the gate pass without any training; returns the frames and row numbers of `generate`."""
    made = []

    def generate(starts, num_rows):
        made.append((run.frames, num_rows))
        return starts[:0]

    def look():
        return GateReport(looks.pop(0) if looks else True, ())

    monkeypatch.setattr(run.generator, "update", lambda rows: {})
    monkeypatch.setattr(run.generator, "evaluate", look)
    monkeypatch.setattr(run.generator, "generate", generate)
    return made


def run_until(run, frames):
    steps = iterate(run, Timers())
    while run.frames < frames:
        next(steps)


@pytest.mark.slow
def test_while_the_gate_is_open_rows_are_generated_and_the_generator_learns_less_often(
    tmp_path, monkeypatch
):
    settings = {"frames_per_update": 64, "open_frames_per_update": 256}
    settings |= {"evaluate_every_frames": 512, "refill_every_frames": 128}
    run = TrainingRun(generating(tmp_path / "a", **settings))
    made = open_gate(monkeypatch, run, [True, True, False])
    learned = []
    monkeypatch.setattr(run.generator, "update", lambda rows: learned.append(run.frames) or {})
    noted = []
    monkeypatch.setattr(run.log, "note", lambda frames, *_: noted.append(frames))
    run_until(run, 1_920)
    assert noted == [512, 1536]  # it opens, stays open, and is shut
    assert [frames for frames, _ in made] == list(range(512, 1536, 128))
    assert [at for at in learned if at > 384] == [
        *(512, 512, 768, 1024, 1280, 1536),
        *(1664, 1664, 1792, 1792, 1920, 1920),
    ]
    run.close()


def test_a_long_round_refills_for_all_its_intervals(tmp_path, monkeypatch):
    settings = {"evaluate_every_frames": 512, "refill_every_frames": 64, "rows_per_refill": 10}
    run = TrainingRun(generating(tmp_path / "a", **settings))
    made = open_gate(monkeypatch, run)
    run_until(run, 768)
    assert [rows for _, rows in made] == [20, 20, 20]  # two intervals in each round of 128 steps
    run.close()


def test_in_the_warm_up_no_rows_are_generated(tmp_path, monkeypatch):
    settings = {"evaluate_every_frames": 256, "refill_every_frames": 128, "warmup_frames": 768}
    run = TrainingRun(generating(tmp_path / "a", **settings))
    made = open_gate(monkeypatch, run)
    run_until(run, 640)
    assert run.gate_is_open
    assert not run.replay.generated_open
    run_until(run, 896)
    assert run.replay.generated_open
    assert [frames for frames, _ in made] == [768, 896]
    run.close()


def test_a_replay_without_room_for_more_is_learned_from(tmp_path):
    """Its newest steps start no transition, so it never has as many as required."""
    run = TrainingRun(tiny(tmp_path / "a", replay=ReplaySettings(300, 300, min_transitions=300)))
    run_until(run, 640)
    assert run.replay.real.num_sampleable < 300 == len(run.replay.real)
    assert run.learner.updates > 0
    run.close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rollout_steps", "n_steps", "asked"), [(1, 8, 1), (3, 8, 3), (8, 2, 1), (1, 1, 0)]
)
def test_generated_rows_have_as_many_steps_as_real_ones(
    tmp_path, monkeypatch, rollout_steps, n_steps, asked
):
    settings = {"evaluate_every_frames": 256, "refill_every_frames": 256, "rows_per_refill": 100}
    settings["rollout_steps"] = rollout_steps
    run = TrainingRun(generating(tmp_path / "a", n_steps, **settings))

    def make(num):  # real rows in place of those of a trained generator
        return run.replay.real.sample_steps(num)

    open_gate(monkeypatch, run)
    monkeypatch.setattr(run.generator, "generate", lambda _, num: make(num))

    def predict(starts):
        if len(starts) > 50:  # not the few whose game ended at once
            asked_at.append(run.frames)
        return make(len(starts)), torch.ones(len(starts), dtype=torch.bool)

    asked_at = []
    monkeypatch.setattr(run.generator, "predict", predict)
    run_until(run, 768)
    rows = run.replay.generated.sample(300)
    assert int(rows["steps_to_next_obs"].max()) == n_steps
    assert asked_at.count(512) == asked  # generated steps after the first
    batch = run.replay.sample()
    assert batch["is_generated"].any()
    assert run.learner.update(batch)["loss/all"].isfinite()
    run.close()


def accept_everything(monkeypatch):
    """A generator trained for seconds generates no sound row; here all rows are accepted."""

    def look(generator):
        generator.last_report = GateReport(True, (), {}, LENIENT)
        return generator.last_report

    def find_nothing_broken(rows, spec):
        return torch.zeros(len(rows), dtype=torch.bool)

    monkeypatch.setattr(CCDNGenerator, "evaluate", look)
    monkeypatch.setattr("marl_cair.generative.generator.find_broken_structure", find_nothing_broken)


OFTEN = {"frames_per_update": 64, "evaluate_every_frames": 256, "refill_every_frames": 128}
OFTEN |= {"rows_per_refill": 50, "model": SMALL_GENERATOR}


@pytest.mark.parametrize("rollout_steps", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_a_resumed_run_generates_the_same_rows(tmp_path, monkeypatch, rollout_steps):
    accept_everything(monkeypatch)
    settings = {**OFTEN, "rollout_steps": rollout_steps}
    folders = train_whole_and_in_parts(
        tmp_path, lambda to: generating(to, n_steps=4, **settings), until=640
    )
    for folder in folders:
        assert read_log(folder / "log.csv")[-1]["generator/steps"] > 1


@pytest.mark.parametrize("priority_alpha", [0.6, pytest.param(0.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("branch_steps", [3, pytest.param(0, marks=pytest.mark.slow)])
def test_a_network_with_memory_learns_from_generated_sequences(
    tmp_path, monkeypatch, priority_alpha, branch_steps
):
    accept_everything(monkeypatch)

    def make(to):
        config = generating(to, n_steps=2, **OFTEN, branch_steps=branch_steps)
        window = {"sequence_steps": 4, "burn_in_steps": 2, "priority_alpha": priority_alpha}
        return dataclasses.replace(
            config,
            policy=QNetworkConfig(hidden_width=16, memory="lstm", memory_width=6),
            replay=ReplaySettings(3_000, 300, min_transitions=300, **window),
        )

    for folder in train_whole_and_in_parts(tmp_path, make, until=640):
        last = read_log(folder / "log.csv")[-1]
        assert 1 <= last["generator/steps"] <= (branch_steps or 4)
        assert last["td_error/generated"] > 0.0
        # One of the five sequences of a batch, whose learned steps may be fewer.
        assert 0.05 < last["batch/generated_share"] <= 0.25
