"""The benchmark asks the original's executable for the same games, and says what went wrong."""

import sys
from pathlib import Path

import pytest

from benchmarks.deep_rts import WORKLOADS, Answer, Original, OriginalError

PLAIN, RICH, EQUAL, COPIED = (WORKLOADS[index] for index in (0, 6, 8, 9))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a shell script")


def make_original(folder: Path, script: str, processor_time: bool = False) -> Original:
    path = folder / "original"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return Original(path, processor_time)


CRESAL = "--map 15x15-2p-ffa-Cresal.json --players 2 --seconds 0.5"
THELOR = "--map 31x31-6p-ffa-Thelor.json --players 6 --seconds 0.5"


@pytest.mark.parametrize(
    ("workload", "processor_time", "expected"),
    [
        (PLAIN, False, f"{CRESAL} --max-ticks 10000"),
        (RICH, False, f"{THELOR} --max-ticks 3000 --rich"),
        (EQUAL, False, f"{THELOR} --max-ticks 3000 --rich --halls"),
        (COPIED, True, f"{THELOR} --max-ticks 10000 --copy-state --processor-time"),
    ],
)
def test_same_game_is_asked_for(tmp_path, workload, processor_time, expected):
    script = f"""echo "$@" >{tmp_path}/asked
echo a line of its own
echo '{{"ticks_per_second": 1000, "mean_units": 6.5, "most_units": 8}}'"""
    original = make_original(tmp_path, script, processor_time)
    assert original.play(workload, 0.5) == Answer(1000.0, 6.5, 8)
    assert (tmp_path / "asked").read_text() == f"{expected}\n"


def test_wrong_path_is_named(tmp_path):
    with pytest.raises(OriginalError, match="missing cannot be run: No such file"):
        Original(tmp_path / "missing", processor_time=False).check()


@pytest.mark.parametrize(
    ("script", "message"),
    [
        ("echo no such map >&2; exit 1", "failed on 15x15, 2 players: no such map"),
        ("exit 3", "failed on 15x15, 2 players: exit status 3"),
        ("true", "did not answer with a rate"),
        ("echo '{}'", "did not answer with a rate"),
    ],
)
def test_failure_is_told(tmp_path, script, message):
    with pytest.raises(OriginalError, match=message):
        make_original(tmp_path, script).check()
