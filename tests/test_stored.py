"""Stored files are read by kind, size and checksum before their content."""

import json
import os
import shutil
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch

from marl_cair.checkpoint import CheckpointError, load_network, load_tensors
from marl_cair.cli import main
from marl_cair.files import copy_folder, replaced_folder, write_json
from marl_cair.games.deep_rts.maps.maps import MapError, read_map
from marl_cair.league.agents.mixtures import read_mixture
from marl_cair.league.store.store import LeagueStore, LeagueStoreError
from marl_cair.replay.array_folder import load_arrays
from marl_cair.stored import MAX_BYTES, RECORD, DamagedFileError, find_damage, read_bytes, read_json
from marl_cair.training.settings.config_file import load_config, read_yaml

AGENT = Path(__file__).parents[1] / "agents" / "deep_line_wars_10x15"


@pytest.fixture(autouse=True)
def in_a_second():
    """Each refusal comes before content: within a second of processor time, two if busy."""
    begun = time.process_time()
    yield
    assert time.process_time() - begun < 2.0


def test_a_folder_that_is_replaced_lists_its_files(tmp_path):
    with replaced_folder(tmp_path / "a") as fresh:
        (fresh / "x.txt").write_text("one")
        with replaced_folder(fresh / "inner") as inner:
            (inner / "y.txt").write_text("two")
    listed = json.loads((tmp_path / "a" / "manifest.json").read_text())["files"]
    assert sorted(listed) == ["inner/manifest.json", "x.txt"]
    assert list(find_damage(tmp_path / "a").values()) == ["", ""]
    assert read_bytes(tmp_path / "a" / "inner" / "y.txt", RECORD) == b"two"
    (tmp_path / "a" / "inner" / "y.txt").write_text("twe")
    with pytest.raises(DamagedFileError, match="y.txt is damaged: its digest"):
        read_bytes(tmp_path / "a" / "inner" / "y.txt", RECORD)
    with pytest.raises(DamagedFileError, match=r"a[\\/]?.*y.txt is damaged"):
        copy_folder(tmp_path / "a" / "inner", tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_json_carries_its_checksum(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"number": 1.5, 3: (1, 2)})
    assert read_json(path) == {"number": 1.5, "3": [1, 2]}
    path.write_text(path.read_text().replace("1.5", "2.5"))
    with pytest.raises(DamagedFileError, match="a.json is not as it was written"):
        read_json(path)
    path.write_text('{"number": 2.5}')  # of an older version
    assert read_json(path) == {"number": 2.5}


@pytest.mark.parametrize("text", ["[" * 200_000, '{"a":' * 100_000, "1" * 5_000, "", "\x00"])
def test_json_that_is_none(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(DamagedFileError, match="a.json is no JSON"):
        read_json(tmp_path / "a.json")


def make_pipe(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    os.mkfifo(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("agent.json", lambda path: load_network(path.parent)),
        ("weights.pt", load_tensors),
        ("mixture.json", lambda path: read_mixture(path.parent)),
        ("config.yaml", lambda path: load_config(path.parent)),
        ("league.yaml", read_yaml),
        ("run.json", read_json),
        ("map.txt", read_map),
        ("map.json", read_map),
        ("league.sqlite", lambda path: LeagueStore(path, {"team_of_seat": [0, 1]})),
    ],
)
def test_a_pipe_is_not_waited_for(tmp_path, name, read):
    make_pipe(tmp_path / name)
    with pytest.raises((ValueError, OSError)):
        read(tmp_path / name)


def test_gigantic_files_are_refused_by_size(tmp_path):
    for name, read, error in (
        ("map.txt", read_map, MapError),
        ("map.json", read_map, MapError),
        ("a.json", read_json, DamagedFileError),
        ("a.yaml", read_yaml, DamagedFileError),
    ):
        with (tmp_path / name).open("wb") as file:
            file.truncate(max(MAX_BYTES[RECORD], 25_000_000) + 1)  # a map of 5,000 x 5,000
        with pytest.raises(error, match="bytes, a .* file has at most"):
            read(tmp_path / name)


@pytest.mark.slow
def test_yaml_bombs(tmp_path):
    lines = ["a0: &a0 [x, x]"] + [f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 40)]
    (tmp_path / "a.yaml").write_text("\n".join(lines))
    with pytest.raises(DamagedFileError, match="it holds aliases"):
        read_yaml(tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text("a: " + "[" * 5_000)
    with pytest.raises(DamagedFileError, match="cannot be read"):
        read_yaml(tmp_path / "a.yaml")


def test_zip_bombs(tmp_path):
    path = tmp_path / "a.pt"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as parts:
        parts.writestr("archive/data.pkl", bytes(50_000_000))
    with pytest.raises(CheckpointError, match="parts of it are compressed"):
        load_tensors(path)
    torch.save({"a": torch.zeros(1).expand(10**12)}, path)
    with pytest.raises(CheckpointError, match="is more than it holds"):
        load_tensors(path)


def test_mixtures_of_too_many(tmp_path):
    members = [{"agent": "deep_line_wars/random", "weight": 5e-5}] * 20_000
    record = {"format": "marl_cair mixture", "format_version": 1, "members": members}
    (tmp_path / "mixture.json").write_text(json.dumps(record))
    with pytest.raises(CheckpointError, match="it has 20000 members, it must have 1 to 256"):
        read_mixture(tmp_path)


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"no array", "claim", "objects"])
def test_arrays_that_are_none(tmp_path, content):
    (tmp_path / "facts.json").write_text("{}")
    path = tmp_path / "rows.npy"
    if content == "claim":
        with path.open("wb") as file:
            header = {"descr": "<f8", "fortran_order": False, "shape": (10**15,)}
            np.lib.format.write_array_header_1_0(file, header)
    elif content == "objects":
        np.save(path, np.array([print], object), allow_pickle=True)
    else:
        path.write_bytes(content)
    with pytest.raises(DamagedFileError, match=r"rows.npy (is no array|says that it is)"):
        load_arrays(tmp_path)


def test_a_network_larger_than_its_weights_is_not_made(tmp_path):
    about = json.loads((AGENT / "agent.json").read_text("utf-8"))
    about["network"]["hidden_width"] = 10**8
    (tmp_path / "agent.json").write_text(json.dumps(about))
    shutil.copy(AGENT / "weights.pt", tmp_path)
    with pytest.raises(CheckpointError, match=r"is of a network of [\d,]{12,} bytes, the file has"):
        load_network(tmp_path)


def test_weights_that_are_not_finite_are_named(tmp_path):
    weights = dict(torch.load(AGENT / "weights.pt", weights_only=True))
    name = list(weights)[3]
    weights[name].view(-1)[0] = float("nan")
    torch.save(weights, tmp_path / "weights.pt")
    shutil.copy(AGENT / "agent.json", tmp_path)
    with pytest.raises(CheckpointError, match=rf"{name} holds numbers that are not finite"):
        load_network(tmp_path)


def test_a_league_file_that_is_a_folder(tmp_path):
    (tmp_path / "league.sqlite").mkdir()
    with pytest.raises(LeagueStoreError, match="is no regular file"):
        LeagueStore(tmp_path / "league.sqlite", {"team_of_seat": [0, 1]})


def test_verify_names_each_damaged_file(tmp_path, capsys):
    copy_folder(AGENT, tmp_path / "agent")
    assert main(["verify", str(tmp_path)]) == 0
    assert capsys.readouterr().out == "2 files are sound, 0 are damaged, 0 have no checksum\n"
    with (tmp_path / "agent" / "weights.pt").open("r+b") as file:
        file.seek(1000)
        file.write(b"?!")
    (tmp_path / "agent" / "agent.json").unlink()
    assert main(["verify", str(tmp_path)]) == 1
    first, second, last = capsys.readouterr().out.splitlines()
    assert first.endswith("agent.json: is missing")
    assert second.endswith("weights.pt: is damaged: its digest differs from its manifest")
    assert last == "0 files are sound, 2 are damaged, 0 have no checksum"
    (tmp_path / "agent" / "manifest.json").unlink()
    main(["verify", str(tmp_path / "agent")])
    assert "no manifest, an older version wrote it" in capsys.readouterr().out
    assert main(["verify", str(tmp_path / "nowhere")]) == 2


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
def test_a_folder_with_a_symbolic_link_is_not_copied(tmp_path):
    (tmp_path / "secret").write_text("x", "utf-8")
    (tmp_path / "a" / "inner").mkdir(parents=True)
    (tmp_path / "a" / "inner" / "link").symlink_to(tmp_path / "secret")
    with pytest.raises(ValueError, match="symbolic link"):
        copy_folder(tmp_path / "a", tmp_path / "b")
    assert not (tmp_path / "b").exists()
