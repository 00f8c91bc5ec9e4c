"""The benchmark beside other games asks a peer's own interpreter, and says what went wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks._legal_actions import make_draw_legal
from benchmarks.peers import DRIVERS, PEERS, Peer, PeerError, start

PYTHON = Path(sys.executable)


def make_peer(folder: Path, script: str) -> Peer:
    path = folder / "driver.py"
    path.write_text(f"import sys; sys.path.insert(0, {str(DRIVERS)!r})\n{script}\n")
    return Peer("a peer", "peer", (str(path),), "not at all")


def test_peer_is_asked_again_and_again(tmp_path):
    peer = make_peer(
        tmp_path, "from serve import serve\nprint('hello')\nserve(lambda: 7, 'a small board')"
    )
    with start(peer, PYTHON, processor_time=False) as driver:
        assert driver.measure(0.0) == 0.0  # a check that it starts plays nothing
        assert driver.measure(0.01) > 7
        assert driver.description == "a small board"


def test_peer_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    peer = make_peer(
        tmp_path, "open('litter', 'w').close()\nfrom serve import serve\nserve(lambda: 7, '')"
    )
    with start(peer, PYTHON, processor_time=True) as driver:
        driver.measure(0.0)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["driver.py"]


def test_wrong_path_is_named(tmp_path):
    with (
        pytest.raises(PeerError, match=r"MicroRTS .*missing cannot be run"),
        start(PEERS[0], tmp_path / "missing", processor_time=False),
    ):
        pass


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("import a_library_that_is_not_there", "a peer failed: ModuleNotFoundError: .*not_there"),
        ("print('{}')", "a peer failed: no rate in its answer"),
        ("", "a peer failed: no rate in its answer"),
    ],
)
def test_failure_is_told(tmp_path, script, message):
    with (
        start(make_peer(tmp_path, script), PYTHON, processor_time=False) as driver,
        pytest.raises(PeerError, match=message),
    ):
        driver.measure(0.0)


@pytest.mark.parametrize("driver", sorted({peer.driver[0] for peer in PEERS}))
def test_every_driver_is_there(driver):
    assert (DRIVERS / driver).is_file()


def test_each_legal_action_is_drawn_equally_often():
    mask = np.array([[[True, False, True, True], [False, False, False, True]]])
    counts = np.zeros((2, 4), int)
    chosen, draw = np.zeros((1, 2), np.int32), make_draw_legal()
    for drawn in np.arange(300, dtype=np.float32) / 300:
        draw(mask, np.full((1, 2), drawn, np.float32), chosen)
        counts[range(2), chosen[0]] += 1
    assert counts.tolist() == [[100, 0, 100, 100], [0, 0, 0, 300]]
