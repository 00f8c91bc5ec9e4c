"""When a run generates rows, and how long they are."""

import dataclasses

import pytest
import torch

from marl_cair.generative.gate import GateReport
from marl_cair.training.config import GeneratorSettings
from marl_cair.training.run import TrainingRun
from marl_cair.training.trainer import Timers, iterate
from tests.training.runs import tiny


def test_while_the_gate_is_open_rows_are_generated_and_the_generator_learns_less_often(
    tmp_path, monkeypatch
):
    settings = GeneratorSettings(
        frames_per_update=64,
        open_frames_per_update=256,
        evaluate_every_frames=512,
        refill_every_frames=128,
    )
    run = TrainingRun(tiny(tmp_path / "a", generator=settings))
    looks = iter([True, True, False])
    made, learned = [], []

    def update(rows):
        learned.append(run.frames)
        return {}

    def look():
        return GateReport(next(looks), ())

    def generate(starts, num_rows):
        made.append(run.frames)  # several times: more is asked for where too few are made
        return starts[:0]

    monkeypatch.setattr(run.generator, "update", update)
    monkeypatch.setattr(run.generator, "evaluate", look)
    monkeypatch.setattr(run.generator, "generate", generate)
    steps = iterate(run, Timers())
    while run.frames < 1_920:
        next(steps)
    assert sorted(set(made)) == list(range(512, 1536, 128))
    assert [at for at in learned if at > 384] == [
        *(512, 512, 768, 1024, 1280, 1536),
        *(1664, 1664, 1792, 1792, 1920, 1920),
    ]
    run.close()


@pytest.mark.parametrize(
    ("rollout_steps", "n_steps", "asked"), [(1, 8, 1), (3, 8, 3), (8, 2, 1), (1, 1, 0)]
)
def test_generated_rows_have_as_many_decisions_as_real_ones_and_as_may_be(
    tmp_path, monkeypatch, rollout_steps, n_steps, asked
):
    settings = GeneratorSettings(
        frames_per_update=64,
        evaluate_every_frames=256,
        refill_every_frames=256,
        rows_per_refill=100,
        rollout_steps=rollout_steps,
    )
    config = tiny(tmp_path / "a", generator=settings)
    learner = dataclasses.replace(config.learner, n_steps=n_steps)
    run = TrainingRun(dataclasses.replace(config, learner=learner))

    def make(num):  # real rows in place of those of a generator that has learned
        return run.replay.real.sample_steps(num)

    monkeypatch.setattr(run.generator, "evaluate", lambda: GateReport(True, ()))
    monkeypatch.setattr(run.generator, "generate", lambda _, num: make(num))

    def predict(starts):
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
