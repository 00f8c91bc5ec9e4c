"""Benchmarks beside other programs: what they are asked, and errors that name what went wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks._legal_actions import make_draw_legal
from benchmarks.deep_rts import WORKLOADS, Answer, Original, OriginalError
from benchmarks.peers import DRIVERS, PEERS, Peer, PeerError, start

PYTHON = Path(sys.executable)
CRESAL = "--map 15x15-2p-ffa-Cresal.json --players 2 --seconds 0.5"
THELOR = "--map 31x31-6p-ffa-Thelor.json --players 6 --seconds 0.5"


# --- the original --------------------------------------------------------------------------------

needs_shell = pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")


def make_original(folder: Path, script: str, processor_time: bool = False) -> Original:
    path = folder / "original"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return Original(path, processor_time)


@needs_shell
@pytest.mark.parametrize(
    ("index", "processor_time", "expected"),
    [
        (0, False, f"{CRESAL} --max-ticks 10000"),
        (6, False, f"{THELOR} --max-ticks 3000 --rich"),
        (8, False, f"{THELOR} --max-ticks 3000 --rich --halls"),
        (9, True, f"{THELOR} --max-ticks 10000 --copy-state --processor-time"),
    ],
)
def test_same_game_is_asked_for(tmp_path, index, processor_time, expected):
    script = f"""echo "$@" >{tmp_path}/asked
echo a line of its own
echo '{{"ticks_per_second": 1000, "mean_units": 6.5, "most_units": 8}}'"""
    original = make_original(tmp_path, script, processor_time)
    assert original.play(WORKLOADS[index], 0.5) == Answer(1000.0, 6.5, 8)
    assert (tmp_path / "asked").read_text() == f"{expected}\n"


@needs_shell
@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo no such map >&2; exit 1", "failed on 15x15, 2 players: no such map"),
        ("exit 3", "failed on 15x15, 2 players: exit status 3"),
        ("true", "did not answer with a rate"),
        ("echo '{}'", "did not answer with a rate"),
    ],
)
def test_failure_of_the_original_raises(tmp_path, script, message):
    with pytest.raises(OriginalError, match=message):
        make_original(tmp_path, script).check()


# --- peers ---------------------------------------------------------------------------------------


def make_peer(folder: Path, script: str) -> Peer:
    path = folder / "driver.py"
    path.write_text(f"import sys; sys.path.insert(0, {str(DRIVERS)!r})\n{script}\n")
    return Peer("a peer", "peer", (str(path),), "not at all")


def test_peer_is_asked_repeatedly_and_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    script = """open('litter', 'w').close()
from serve import serve
print('hello')
serve(lambda: 7, 'a small board')"""
    with start(make_peer(tmp_path, script), PYTHON, processor_time=False) as driver:
        assert driver.measure(0.0) == 0.0  # a check that it starts plays nothing
        assert driver.measure(0.01) > 7
        assert driver.description == "a small board"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["driver.py"]


def test_wrong_paths_are_named(tmp_path):
    missing = tmp_path / "missing"
    with pytest.raises(OriginalError, match="missing cannot be run: No such file"):
        Original(missing, processor_time=False).check()
    with pytest.raises(PeerError, match=r"MicroRTS .*missing cannot be run"):
        start(PEERS[0], missing, processor_time=False).__enter__()


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("import a_library_that_is_not_there", "a peer failed: ModuleNotFoundError: .*not_there"),
        ("print('{}')", "a peer failed: no rate in its answer"),
        ("", "a peer failed: no rate in its answer"),
    ],
)
def test_failure_of_a_peer_raises(tmp_path, script, message):
    with (
        start(make_peer(tmp_path, script), PYTHON, processor_time=True) as driver,
        pytest.raises(PeerError, match=message),
    ):
        driver.measure(0.0)


def test_every_driver_is_there():
    assert all((DRIVERS / peer.driver[0]).is_file() for peer in PEERS)


def test_each_legal_action_is_drawn_equally_often():
    mask = np.array([[[True, False, True, True], [False, False, False, True]]])
    counts = np.zeros((2, 4), int)
    chosen, draw = np.zeros((1, 2), np.int32), make_draw_legal()
    for drawn in np.arange(300, dtype=np.float32) / 300:
        draw(mask, np.full((1, 2), drawn, np.float32), chosen)
        counts[range(2), chosen[0]] += 1
    assert counts.tolist() == [[100, 0, 100, 100], [0, 0, 0, 300]]
