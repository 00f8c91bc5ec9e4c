"""The benchmark that compares mixtures of opponents, on runs of seconds."""

from pathlib import Path

from tests.benchmark_runs import read_table

SHORT = (
    *("scenario=11x11", "max_ticks=100", "policy.hidden_width=8", "collector.num_worlds=16"),
    *("replay.min_transitions=300", "learner.batch_size=16", "torch_threads=1"),
    *("evaluation.bots=[]", "opponent.snapshot_every_frames=512"),
)


def run_benchmark(folder: Path) -> str:
    options = ["--mixtures", "default", "latest", "--seeds", "0", "--games", "2"]
    options += ["--frames", "1024", "--out", str(folder)]
    return read_table("opponents", "| mixture", [*options, *SHORT])


def test_the_table_is_made_once_and_shown_again(tmp_path):
    table = run_benchmark(tmp_path)
    matches = (tmp_path / "matches.csv").read_text("utf-8")
    assert "default-0,latest-0,2," in matches
    assert run_benchmark(tmp_path) == table
    assert (tmp_path / "matches.csv").read_text("utf-8") == matches
    lines = table.strip().splitlines()
    assert {line.split("|")[1].strip() for line in lines[2:]} == {"default", "latest"}
