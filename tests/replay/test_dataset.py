"""Data sets on disk: what is written is read, and damage is refused."""

import dataclasses
import json
import shutil

import pytest
import torch
from tensordict import TensorDict

from marl_cair.files import OutputFolderError
from marl_cair.replay import load_dataset
from marl_cair.replay.dataset import DATASET_FILE, DatasetDescription, new_dataset
from marl_cair.stored import DamagedFileError

ABOUT = DatasetDescription(
    game="toy",
    game_version="1",
    scenario="small",
    scenario_options={"rows": 2},
    representation="planes",
    observation_shape=(3, 2, 2),
    observation_dtype="uint8",
    num_actions=4,
    num_players=2,
    players=("random", "random"),
    seed=0,
    num_train=6,
    num_heldout=4,
    train_episodes=0,
    heldout_episodes=0,
)


def fill(made, num_episodes=2):
    for side in (made.train, made.heldout):
        side["episode"][:] = torch.arange(len(side)) % num_episodes
        side["observation"][:] = torch.arange(len(side), dtype=torch.uint8)[:, None, None, None]
        side["other_actions"][:] = 3


@pytest.fixture
def folder(tmp_path):
    with new_dataset(tmp_path / "data", ABOUT) as made:
        fill(made)
    return tmp_path / "data"


def test_what_was_written_is_mapped_again_anywhere(folder, tmp_path):
    moved = tmp_path / "elsewhere"
    shutil.move(folder, moved)
    data = load_dataset(moved)
    assert data.about == dataclasses.replace(ABOUT, train_episodes=2, heldout_episodes=2)
    assert (len(data.train), len(data.heldout)) == (6, 4)
    assert data.train["observation"][5].unique().tolist() == [5]
    assert data.heldout["other_actions"].tolist() == [[3]] * 4
    # TensorDict's own loader reads it too.
    assert torch.equal(TensorDict.load_memmap(moved / "train")["episode"], data.train["episode"])


def test_games_of_one_player_have_no_other_actions(tmp_path):
    with new_dataset(tmp_path / "data", dataclasses.replace(ABOUT, num_players=1)) as made:
        made.train["episode"][3:] = made.heldout["episode"][2:] = 1
    assert "other_actions" not in load_dataset(tmp_path / "data").train


def test_too_few_episodes_are_refused_and_nothing_is_left(tmp_path):
    with (
        pytest.raises(ValueError, match=r"of 1 and 1 episodes, .* needs 2 or more .* max_ticks"),
        new_dataset(tmp_path / "data", ABOUT) as made,
    ):
        fill(made, num_episodes=1)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_something_else_is_kept(folder, tmp_path):
    (tmp_path / "notes.txt").write_text("mine", "utf-8")
    message = r"holds files of no data set \(.*\) and no dataset.json"
    with pytest.raises(OutputFolderError, match=message), new_dataset(tmp_path, ABOUT):
        pass
    assert (tmp_path / "notes.txt").read_text("utf-8") == "mine"
    with new_dataset(folder, ABOUT) as made:  # a data set is replaced
        fill(made)


def test_a_folder_without_a_data_set_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no data set .*`marl-cair dataset collect"):
        load_dataset(tmp_path)


def test_a_missing_file_is_named(folder):
    (folder / "train" / "next" / "reward.memmap").unlink()
    with pytest.raises(DamagedFileError, match=r"train/next/reward.memmap is missing: copy"):
        load_dataset(folder)


def test_a_torn_file_is_named(folder):
    path = folder / "heldout" / "observation.memmap"
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(DamagedFileError, match=r"has 47 bytes, but 4 rows .* are 48: copy it"):
        load_dataset(folder)


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"observation_shape": [3, 2, 9]}, DamagedFileError, "has 72 bytes, but 6 rows of"),
        ({"num_train": 60}, DamagedFileError, "but 60 rows of"),
        ({"num_actions": 0}, DamagedFileError, "does not describe a data set"),
        ({"observation_dtype": "complexity"}, DamagedFileError, "does not describe a data set"),
        ({"format_version": 99}, ValueError, "of format 99, this version reads up to 1: update"),
    ],
)
def test_a_description_that_does_not_fit_is_refused(folder, changes, error, message):
    path = folder / DATASET_FILE
    facts = json.loads(path.read_text("utf-8"))
    facts.pop("checksum", None)
    path.write_text(json.dumps({**facts, **changes}), "utf-8")
    (folder / "manifest.json").unlink()
    with pytest.raises(error, match=message):
        load_dataset(folder)
