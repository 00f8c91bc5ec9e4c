"""The benchmark that compares mixtures of opponents, on runs of seconds."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SHORT = (
    *("scenario=11x11", "max_ticks=100", "policy.hidden_width=8", "collector.num_worlds=16"),
    *("replay.min_transitions=300", "learner.batch_size=16", "torch_threads=1"),
    *("evaluation.bots=[]", "opponent.snapshot_every_frames=512"),
)


def run_benchmark(folder: Path) -> str:
    options = ["--mixtures", "default", "latest", "--seeds", "0", "--games", "2"]
    options += ["--frames", "1024", "--out", str(folder)]
    command = [sys.executable, "-m", "benchmarks.opponents", *options, *SHORT]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout[done.stdout.index("| mixture") :]


def test_the_table_is_made_once_and_shown_again(tmp_path):
    table = run_benchmark(tmp_path)
    matches = (tmp_path / "matches.csv").read_text("utf-8")
    assert "default-0,latest-0,2," in matches
    assert run_benchmark(tmp_path) == table
    assert (tmp_path / "matches.csv").read_text("utf-8") == matches
    lines = table.strip().splitlines()
    assert {line.split("|")[1].strip() for line in lines[2:]} == {"default", "latest"}
