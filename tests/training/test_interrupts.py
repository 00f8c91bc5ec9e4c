"""What an interrupt, and what ran before in the process, leave unchanged."""

import os
import signal

import torch

from marl_cair.training import trainer
from marl_cair.training.run import TrainingRun
from marl_cair.training.run_log import read_log
from marl_cair.training.settings.replay import ReplaySettings
from tests.training.runs import tiny, train

TIMES = ("seconds/", "frames_per_second", "processor_seconds")


def test_a_resumed_run_has_the_log_of_one_that_was_not_interrupted(tmp_path, monkeypatch):
    monkeypatch.setattr(trainer, "LOG_EVERY_FRAMES", 512)

    def interrupt(run):
        if run.frames == 896:
            os.kill(os.getpid(), signal.SIGINT)
        return True

    whole, parts = tmp_path / "whole", tmp_path / "parts"
    train(tiny(whole))
    assert train(tiny(parts), watch=interrupt).was_interrupted
    train(tiny(parts), resume=True)
    rows = [
        [
            {name: value for name, value in row.items() if not name.startswith(TIMES)}
            for row in read_log(folder / "log.csv")
        ]
        for folder in (whole, parts)
    ]
    assert [row["frames"] for row in rows[0]] == [512, 1_024, 1_280]
    assert rows[0] == rows[1]


def test_the_seed_of_a_run_decides_what_code_from_outside_draws(tmp_path, monkeypatch):
    drawn = []
    make = TrainingRun.make_generator

    def make_and_draw(run, source=None):
        make(run, source)
        drawn.append(torch.rand(()).item())  # as weights of a generator from outside

    monkeypatch.setattr(TrainingRun, "make_generator", make_and_draw)
    for number, seed in enumerate((0, 0, 1)):
        torch.manual_seed(number)
        run = TrainingRun(tiny(tmp_path / str(number), seed=seed))
        drawn.append(torch.rand(()).item())
        run.close()
    assert drawn[:2] == drawn[2:4]
    assert not set(drawn[:2]) & set(drawn[4:])


def test_a_run_that_has_learned_nothing_says_so(tmp_path, capsys):
    replay = ReplaySettings(3_000, 300, min_transitions=3_000)
    train(tiny(tmp_path / "a", 256, replay=replay), show_progress=True)
    assert "learning starts at 3,000 (replay.min_transitions)" in "".join(capsys.readouterr())
    train(tiny(tmp_path / "b"), show_progress=True)
    assert "nothing was learned" not in "".join(capsys.readouterr())


def test_training_leaves_the_generator_of_torch_as_it_was(tmp_path):
    torch.manual_seed(7)
    before = torch.get_rng_state()
    train(tiny(tmp_path / "run", 256))
    assert torch.equal(torch.get_rng_state(), before)
