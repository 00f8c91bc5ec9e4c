"""A generator that fails is switched off and tried again; meanwhile all batches are real."""

import dataclasses
import math

import pytest
import torch

from marl_cair.generative.gate import Acceptance, GateReport
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.training.generating import use
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.config import GeneratorSettings
from marl_cair.training.trainer import Timers, iterate
from tests.training.runs import SMALL_GENERATOR, tiny, train, train_whole_and_in_parts

LENIENT = Acceptance(min_surety=-math.inf, certain=0.0, may_end=True, may_be_rare=True)


def make_config(out, frames=1_280, every=256, model=SMALL_GENERATOR):
    """The generator learns at each 64 steps and is evaluated at each `every`."""
    settings = GeneratorSettings(
        model=model,
        batch_size=16,
        frames_per_update=64,
        evaluate_every_frames=every,
        refill_every_frames=every,
    )
    return tiny(out, frames, generator=settings)


def exploding(out):
    model = dataclasses.replace(SMALL_GENERATOR, learning_rate=1e9)
    return make_config(out, 1_024, 128, model)


@pytest.fixture
def run(tmp_path):
    """A run whose generator has learned for some updates."""
    made = TrainingRun(make_config(tmp_path / "run"))
    play(made, 640)
    yield made
    made.close()


def play(run, frames):
    steps = iterate(run, Timers())
    while run.frames < frames:
        next(steps)


def read_failure(run):
    return (run.folder / use.FAILURE_FILE).read_text("utf-8")


def open_gate(monkeypatch):
    def look(generator):
        generator.last_report = GateReport(True, (), {}, LENIENT)
        return generator.last_report

    monkeypatch.setattr(CCDNGenerator, "evaluate", look)


def test_weights_that_are_nan_are_replaced_and_learn_again_after_the_next_evaluation(run):
    updates = run.learner.updates
    with torch.no_grad():
        for weights in run.generator.network.parameters():
            weights.fill_(math.nan)
    play(run, 768)
    assert (run.generator_is_on, run.generator_failures) == (False, 1)
    assert all(bool(weights.isfinite().all()) for weights in run.generator.network.parameters())
    assert run.generator.num_updates == 0
    assert not run.replay.sample()["is_generated"].any()
    play(run, 1_024)
    assert run.generator_is_on
    assert run.generator.last_report.reasons[0].startswith("only")
    held = run.generator._heldout.num_rows
    assert held > 0.05 * run.replay.real.num_sampleable  # all of replay was shown to it
    play(run, 1_280)
    assert run.generator.num_updates > 0
    assert run.generator_failures == 1
    assert run.learner.updates > updates
    assert "is nan" in read_failure(run)


def test_a_generator_that_always_explodes_is_given_up(tmp_path):
    run = TrainingRun(exploding(tmp_path / "run"))
    play(run, 1_024)
    assert (run.generator_is_on, run.generator_failures) == (False, 1 + use.MOST_RETRIES)
    assert run.learner.updates > 5
    assert all(bool(weights.isfinite().all()) for weights in run.learner.network.parameters())
    run.close()


@pytest.mark.slow
def test_a_run_with_failures_resumes_bit_for_bit(tmp_path):
    folders = train_whole_and_in_parts(tmp_path, exploding, until=768)
    rows = [read_log(folder / "log.csv")[-1] for folder in folders]
    assert [row["generator/failures"] for row in rows] == [4.0, 4.0]


def test_an_exception_of_any_part_is_caught_and_kept_with_its_place(run, monkeypatch):
    def fail(*_):
        raise ZeroDivisionError("a fault in the generator")

    monkeypatch.setattr(CCDNGenerator, "observe", fail)
    play(run, 768)  # an evaluation: it is tried again, and fails again
    assert (run.generator_is_on, run.generator_failures) == (False, 2)
    assert "a fault in the generator" in read_failure(run)
    assert "in fail" in read_failure(run)


def test_generated_rewards_that_are_not_finite_never_reach_a_batch(run, monkeypatch):
    open_gate(monkeypatch)
    play(run, 768)
    assert run.gate_is_open
    run.replay.generated.extend(run.replay.real.sample_steps(50))
    imagine = CCDNGenerator.imagine

    def break_rewards(generator, rows, random=None):
        made = imagine(generator, rows, random)
        return made._replace(reward=torch.full_like(made.reward, math.nan))

    monkeypatch.setattr(CCDNGenerator, "imagine", break_rewards)
    monkeypatch.setattr(
        "marl_cair.generative.generator.find_broken_structure",
        lambda rows, spec: torch.zeros(len(rows), dtype=torch.bool),
    )
    play(run, 1_024)
    assert not run.gate_is_open
    assert len(run.replay.generated) == 0  # those from before are dropped too
    assert "hold ('next', 'reward') that is not finite" in read_failure(run)
    assert not run.replay.sample()["is_generated"].any()


def test_metrics_that_are_not_finite_are_a_failure(run, monkeypatch):
    report = GateReport(False, ("NaN",), {"cells/changed_f1": math.nan})
    monkeypatch.setattr(CCDNGenerator, "evaluate", lambda generator: report)
    play(run, 768)
    assert run.generator_failures == 1
    assert "the metric 'cells/changed_f1' is nan" in read_failure(run)


def test_the_reason_is_printed_and_training_ends_as_planned(tmp_path, capsys):
    result = train(exploding(tmp_path / "run"), show_progress=True)
    assert result.frames == 1_024
    shown = "".join(capsys.readouterr())
    assert "the generator is off, batches are all real: its update has failed" in shown
    assert "it stays off after 4 failures" in shown
