"""The device of a run: which there are, and training on a GPU that is emulated."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch

from marl_cair.cli import main
from marl_cair.cli.train import read_resume
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.checks import DeviceError, find_device
from marl_cair.training.settings.config import TrainConfig
from tests.training.runs import tiny

ON_GPU = Path(__file__).with_name("on_gpu.py")


@pytest.fixture
def two_gpus(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)


@pytest.mark.usefixtures("two_gpus")
def test_each_gpu_of_the_machine_is_a_device():
    names = ("cpu", "cuda", "cuda:0", "cuda:1")
    assert [find_device(name) for name in names] == [torch.device(name) for name in names]
    with pytest.raises(
        DeviceError, match=r"'cuda:2', .* finds 2 GPUs here .*: take cpu or cuda:0..1"
    ):
        find_device("cuda:2")


@pytest.mark.parametrize("name", ["gpu", "cuda:", "cuda:-1", "cuda:x", "CPU", "mps", ""])
def test_other_names_are_refused(name):
    with pytest.raises(ValueError, match=f"device is {name!r}, it must be cpu, cuda or cuda:N"):
        TrainConfig(device=name)
    with pytest.raises(ValueError, match="it must be cpu"):
        find_device(name)


def test_a_missing_gpu_is_refused_before_any_work(tmp_path, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    found = (
        r"'cuda', .* finds 0 GPUs here .*is_available\(\) is False.*: take cpu, or install a driver"
    )
    with pytest.raises(DeviceError, match=found):
        TrainingRun(tiny(tmp_path / "run", device="cuda"))
    assert not (tmp_path / "run").exists()


def test_a_resumed_run_may_have_another_device(finished_copy, capsys):
    assert read_resume([f"resume={finished_copy}", "device=cuda:1"]).device == "cuda:1"
    if not torch.cuda.is_available():
        assert main(["train", f"resume={finished_copy}", "device=cuda", "total_frames=700"]) == 2
        assert "device is 'cuda', but PyTorch" in capsys.readouterr().err


@pytest.mark.parametrize("marked", ["not slow", pytest.param("slow", marks=pytest.mark.slow)])
def test_training_on_an_emulated_gpu(marked):
    command = ["-m", "pytest", "-p", "tests.emulated_gpu", str(ON_GPU), "-q", "-m", marked]
    done = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-8_000:]
