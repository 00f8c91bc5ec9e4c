"""When a run generates rows, and how long they are."""

import dataclasses
import math

import pytest
import torch

from marl_cair.generative import CCDNGenerator
from marl_cair.generative.gate import Acceptance, GateReport
from marl_cair.generative.metrics import Certainty
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import GeneratorSettings, ReplaySettings
from marl_cair.training.trainer import Timers, iterate, train
from tests.training.runs import digest, tiny

LENIENT = Acceptance(
    min_log_prob=-math.inf,
    min_worst_log_prob=-math.inf,
    max_reward_spread=math.inf,
    certainty=Certainty(end=0.0, going_on=1.0),
    may_end=True,
    may_be_rare=True,
)


def generating(out, rollout_steps, n_steps, rows, every):
    """A run of 1,024 decisions that makes so many rows every so many decisions."""
    settings = GeneratorSettings(
        frames_per_update=64,
        evaluate_every_frames=256,
        refill_every_frames=every,
        rows_per_refill=rows,
        rollout_steps=rollout_steps,
    )
    config = tiny(out, 1_024, generator=settings)
    return dataclasses.replace(config, learner=dataclasses.replace(config.learner, n_steps=n_steps))


def test_while_the_gate_is_open_rows_are_generated_and_the_generator_learns_less_often(
    tmp_path, monkeypatch
):
    settings = GeneratorSettings(
        frames_per_update=64,
        open_frames_per_update=256,
        evaluate_every_frames=512,
        refill_every_frames=128,
    )
    config = tiny(tmp_path / "a", generator=settings)
    one_step = dataclasses.replace(config.learner, n_steps=1)
    run = TrainingRun(dataclasses.replace(config, learner=one_step))
    looks = iter([True, True, False])
    made, learned = [], []

    def update(rows):
        learned.append(run.frames)
        return {}

    def look():
        return GateReport(next(looks), ())

    def generate(starts, num_rows):
        made.append(run.frames)
        return starts[:0]

    monkeypatch.setattr(run.generator, "update", update)
    monkeypatch.setattr(run.generator, "evaluate", look)
    monkeypatch.setattr(run.generator, "generate", generate)
    steps = iterate(run, Timers())
    while run.frames < 1_920:
        next(steps)
    assert made == list(range(512, 1536, 128))
    assert [at for at in learned if at > 384] == [
        *(512, 512, 768, 1024, 1280, 1536),
        *(1664, 1664, 1792, 1792, 1920, 1920),
    ]
    run.close()


def test_a_long_round_refills_for_all_its_intervals(tmp_path, monkeypatch):
    settings = GeneratorSettings(
        evaluate_every_frames=512, refill_every_frames=64, rows_per_refill=10
    )
    config = tiny(tmp_path / "a", generator=settings)
    one_step = dataclasses.replace(config.learner, n_steps=1)
    run = TrainingRun(dataclasses.replace(config, learner=one_step))
    asked = []

    def generate(starts, num_rows):
        asked.append(num_rows)
        return starts[:0]

    monkeypatch.setattr(run.generator, "update", lambda rows: {})
    monkeypatch.setattr(run.generator, "evaluate", lambda: GateReport(True, ()))
    monkeypatch.setattr(run.generator, "generate", generate)
    steps = iterate(run, Timers())
    while run.frames < 768:
        next(steps)
    assert asked == [20, 20, 20]  # two intervals in each round of 128 decisions
    run.close()


def test_a_replay_without_room_for_more_is_learned_from(tmp_path):
    """Its newest steps start no transition, so that there were never as many as asked for."""
    run = TrainingRun(tiny(tmp_path / "a", replay=ReplaySettings(300, 300, min_transitions=300)))
    for _ in iterate(run, Timers()):
        if run.frames >= 640:
            break
    assert run.replay.real.num_sampleable < 300 == len(run.replay.real)
    assert run.learner.updates > 0
    run.close()


@pytest.mark.parametrize(
    ("rollout_steps", "n_steps", "asked"), [(1, 8, 1), (3, 8, 3), (8, 2, 1), (1, 1, 0)]
)
def test_generated_rows_have_as_many_decisions_as_real_ones_and_as_may_be(
    tmp_path, monkeypatch, rollout_steps, n_steps, asked
):
    run = TrainingRun(generating(tmp_path / "a", rollout_steps, n_steps, rows=100, every=256))

    def make(num):  # real rows in place of those of a generator that has learned
        return run.replay.real.sample_steps(num)

    monkeypatch.setattr(run.generator, "evaluate", lambda: GateReport(True, ()))
    monkeypatch.setattr(run.generator, "generate", lambda _, num: make(num))

    def predict(starts):
        if len(starts) > 50:  # not those few whose game was over at once
            asked_at.append(run.frames)
        return make(len(starts)), torch.ones(len(starts), dtype=torch.bool)

    asked_at = []
    monkeypatch.setattr(run.generator, "predict", predict)
    steps = iterate(run, Timers())
    while run.frames < 1_024:
        next(steps)
    rows = run.replay.generated.sample(300)
    assert int(rows["steps_to_next_obs"].max()) == n_steps
    assert asked_at.count(512) == asked  # how many decisions it was to go on with
    batch = run.replay.sample()
    assert batch["is_generated"].any()
    assert run.learner.update(batch)["loss/all"].isfinite()
    run.close()


@pytest.mark.parametrize("rollout_steps", [1, 4])
def test_a_resumed_run_generates_the_same_rows(tmp_path, monkeypatch, rollout_steps):
    """What has learned for seconds generates no sound row; here all that it makes is taken."""

    def look(generator):
        generator.last_report = GateReport(True, (), {}, LENIENT)
        return generator.last_report

    def find_nothing_broken(rows, spec):
        return torch.zeros(len(rows), dtype=torch.bool)

    monkeypatch.setattr(CCDNGenerator, "evaluate", look)
    monkeypatch.setattr("marl_cair.generative.gate.find_broken_structure", find_nothing_broken)
    whole = generating(tmp_path / "whole", rollout_steps, n_steps=4, rows=50, every=128)
    train(whole, show_progress=False)
    parts = dataclasses.replace(whole, out=str(tmp_path / "parts"))
    train(dataclasses.replace(parts, total_frames=640), show_progress=False)
    train(parts, resume=True, show_progress=False)
    assert digest(tmp_path / "whole") == digest(tmp_path / "parts")
    for name in ("whole", "parts"):
        assert read_log(tmp_path / name / "log.csv")[-1]["generator/steps"] > 1
