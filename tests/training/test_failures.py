"""Errors in the middle of a run: what is saved, and what the user reads."""

import dataclasses
import functools

import pytest
import torch

from marl_cair.cli import main
from marl_cair.training.collecting.exploration import Exploration
from marl_cair.training.learner import DivergedError
from marl_cair.training.losses import DqnLoss
from marl_cair.training.settings.config import CheckpointSettings, ExplorationSettings
from tests.training import runs
from tests.training.runs import NEVER, small

train = functools.partial(runs.train, resume_with="THE COMMAND")
HERE = "tests.training.test_failures"
CALLS = []  # one entry for each call of the classes below
FAULTS = {}  # what they do after some calls


class Faulty(DqnLoss):
    """Raises, or returns NaN."""

    def __call__(self, network, target, batch):
        CALLS.append(1)
        result = super().__call__(network, target, batch)
        if len(CALLS) >= 10 and "loss" in FAULTS:
            raise FAULTS["loss"]
        factor = torch.nan if len(CALLS) >= 10 and "nan" in FAULTS else 1.0
        return result._replace(loss=result.loss * factor)


class Lost(Exploration):
    """Raises."""

    def __call__(self, values, action_mask, generator, frames):
        CALLS.append(1)
        if len(CALLS) >= 25 and "exploration" in FAULTS:
            raise FAULTS["exploration"]
        return action_mask.float().argmax(-1)


@pytest.fixture(autouse=True)
def no_calls():
    CALLS.clear()
    FAULTS.clear()


def with_loss(folder, **changes):
    run = small(folder, "duel", **changes)
    learner = dataclasses.replace(run.learner, algorithm=f"{HERE}:Faulty", frames_per_update=16)
    return dataclasses.replace(run, learner=learner)


@pytest.mark.usefixtures("test_game")
def test_a_run_whose_loss_raises_is_saved_and_goes_on_once_it_is_mended(tmp_path):
    FAULTS["loss"] = IndexError("seven")
    with pytest.raises(IndexError, match="seven") as caught:
        train(with_loss(tmp_path / "run"))
    (note,) = caught.value.__notes__
    frames = torch.load(tmp_path / "run/resume/state.pt", weights_only=True)["frames"]
    assert 0 < frames < 512
    assert f"frame {frames:,} ({__file__}, line" in note
    assert f"state of frame {frames:,} is saved" in note
    assert note.endswith("; THE COMMAND goes on from it")
    assert (tmp_path / "run" / "latest" / "weights.pt").is_file()
    FAULTS.clear()
    assert train(with_loss(tmp_path / "run"), resume=True).frames == 512


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("every", [NEVER, 128])
def test_an_error_while_collecting_leaves_the_last_saved_state(tmp_path, every, capsys):
    FAULTS["exploration"] = ValueError("left or right?")
    kind = ExplorationSettings(kind=f"{HERE}:Lost", anneal_frames=NEVER)
    run = small(
        tmp_path / "run",
        "duel",
        exploration=kind,
        checkpoint=CheckpointSettings(every_frames=every),
    )
    with pytest.raises(ValueError, match="left or right") as caught:
        train(run)
    wanted = "no state is saved; THE" if every == NEVER else "state of frame 128 is saved; THE"
    assert wanted in caught.value.__notes__[0]
    assert (tmp_path / "run" / "resume").is_dir() == (every != NEVER)
    FAULTS.clear()
    assert train(run, resume=True, show_progress=True).frames == 512
    assert ("begins at frame 0" in capsys.readouterr().out) == (every == NEVER)


@pytest.mark.usefixtures("test_game")
def test_a_diverged_run_keeps_the_last_saved_agent_and_names_the_loss(tmp_path):
    FAULTS["nan"] = True
    run = with_loss(tmp_path / "run", checkpoint=CheckpointSettings(every_frames=128))
    with pytest.raises(DivergedError, match=f"or with another {HERE}:Faulty") as caught:
        train(run)
    saved = torch.load(tmp_path / "run/resume/state.pt", weights_only=True)["frames"]
    assert saved % 128 == 0
    assert f"state of frame {saved} is saved" in caught.value.__notes__[0]


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("command", ["", "THE COMMAND"])
def test_runs_without_own_code_and_runs_of_others_are_not_saved_then(tmp_path, command):
    """They resume from the last state, to the same bits as a run that was never stopped."""

    def fail(run):
        if run.frames > 300:
            raise OSError("no space left")
        return True

    run = with_loss(tmp_path / "run") if not command else small(tmp_path / "run", "duel")
    with pytest.raises(OSError, match="no space left") as caught:
        train(run, watch=fail, resume_with=command)
    notes = getattr(caught.value, "__notes__", [])
    assert len(notes) == bool(command)
    assert all("no state is saved; THE COMMAND begins again" in note for note in notes)
    assert not (tmp_path / "run" / "resume").exists()


@pytest.mark.usefixtures("test_game")
def test_weights_that_are_not_finite_are_not_saved(tmp_path):
    def damage(run):
        if run.frames > 300:
            next(run.learner.network.parameters()).data[:] = torch.nan
            raise AssertionError("not a number")
        return True

    run = with_loss(tmp_path / "run", checkpoint=CheckpointSettings(every_frames=128))
    with pytest.raises(AssertionError) as caught:
        train(run, watch=damage)
    note = caught.value.__notes__[0]
    assert "the state of frame 256 is saved (saving more now failed: " in note
    assert "not finite" in note


@pytest.mark.usefixtures("test_game")
def test_the_command_prints_what_is_saved(tmp_path, capsys):
    FAULTS["loss"] = ValueError("seven")
    words = ["game=last_standing", "scenario=duel", f"learner.algorithm={HERE}:Faulty"]
    words += ["collector.num_worlds=8", "collector.steps_per_batch=16", "replay.min_transitions=64"]
    words += [
        "learner.frames_per_update=16",
        "generator=none",
        "evaluation.bots=[]",
        "opponent=random",
        "policy.hidden_width=8",
    ]
    assert main(["train", *words, f"out={tmp_path / 'run'}", "total_frames=512"]) == 2
    error = capsys.readouterr().err
    assert "marl-cair: seven\nmarl-cair: frame " in error
    assert f"is saved; marl-cair train resume={tmp_path / 'run'} allow_code=true goes" in error
