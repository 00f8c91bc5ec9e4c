"""The benchmarks behind the README's self-play results, on training of seconds."""

import csv

import pytest
import yaml

from benchmarks._ladders import _space_out
from marl_cair.cli import main
from marl_cair.training.population.league_examples import EXAMPLES, PSRO_EXAMPLES
from tests.benchmark_runs import read_table

SHORT = (
    *("collector.num_worlds=16", "collector.steps_per_batch=8", "policy.hidden_width=16"),
    *("replay.min_transitions=200", "learner.batch_size=16", "torch_threads=1"),
)


def read_rows(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_table_tells_the_main_agent_the_mixture_and_who_beats_them(tmp_path):
    league = {**EXAMPLES["tiny"], "league_exploiter": {"learners": 0}, "total_frames": 512}
    (tmp_path / "league.yaml").write_text(yaml.safe_dump(league), "utf-8")
    options = ["--league", str(tmp_path / "league.yaml"), "--alone-frames", "512", "--games", "2"]
    options += ["--past-games", "2", "--budget", "512", "--workers", "1", "--out", str(tmp_path)]
    table = read_table("league_learning", "| what", [*options, *SHORT])
    assert "| best response of 512 scores | `mixture` |" in table
    assert (tmp_path / "self_play.png").read_bytes().startswith(b"\x89PNG")
    rows = read_rows(tmp_path / "results.csv")
    told = {(row["what"], row["against"]) for row in rows}
    for agent in ("main agent", "mixture"):
        assert {(f"{agent} scores", name) for name in ("random", "counter", "alone")} <= told
    for name in ("main_0", "mixture"):
        assert ("best response of 512 scores", name) in told
    for row in rows[:-1]:
        assert 0 <= float(row["low"]) <= float(row["value"]) <= float(row["high"]) <= 1
    assert rows[-1]["what"] == "rank correlation of rating with decisions"
    assert int(rows[-1]["games"]) >= 2


def test_the_table_of_rounds_tells_the_mixture_each_response_and_who_beats_them(tmp_path):
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(PSRO_EXAMPLES["tiny"]), "utf-8")
    options = ["--psro", str(tmp_path / "tiny.yaml"), "--games", "2", "--budget", "512"]
    options += ["--workers", "1", "--out", str(tmp_path)]
    table = read_table("psro_learning", "| what", [*options, *SHORT])
    assert "| best response of 512 scores | `mixture` |" in table
    assert (tmp_path / "psro.png").read_bytes().startswith(b"\x89PNG")
    rows = read_rows(tmp_path / "results.csv")
    told = [row["what"] for row in rows]
    assert {("mixture scores", row) for row in ("random", "player_000", "player_001")} <= {
        (row["what"], row["against"]) for row in rows
    }
    assert told[-4:] == [
        "player_000 scores least",
        "player_001 scores least",
        "best response of 512 scores",
        "rank correlation of rating with decisions",
    ]
    for row in rows[:-1]:
        assert 0 <= float(row["low"]) <= float(row["value"]) <= float(row["high"]) <= 1


def test_the_table_of_runs_tells_the_last_agent_its_past_and_who_beats_it(tmp_path):
    words = ["scenario=11x11", "max_ticks=600", "opponent.snapshot_every_frames=256", *SHORT]
    first, second = tmp_path / "first", tmp_path / "second"
    assert main(["train", *words, "total_frames=768", f"out={first}"]) == 0
    words += [f"initial_agent={first / 'latest'}", "total_frames=512", f"out={second}"]
    assert main(["train", *words]) == 0
    alone = first / "snapshots" / "frames_0000000512"
    options = [first, second, "--alone", alone, "--games", "2", "--past-games", "2"]
    options += ["--past-every", "300", "--budget", "512", "--workers", "1", "--out", tmp_path]
    table = read_table("self_play_learning", "1,280 decisions", [*options, *SHORT])
    assert "| best response of 512 scores | `last agent` |" in table
    assert (tmp_path / "self_play.png").read_bytes().startswith(b"\x89PNG")
    rows = read_rows(tmp_path / "results.csv")
    told = {(row["what"], row["against"]) for row in rows}
    assert {("last agent scores", name) for name in ("random", "counter", "alone")} <= told
    assert rows[-1]["what"] == "rank correlation of rating with decisions"
    # 256, 512, 768 and 1,024 decisions: thinned from the last one's 1,280 to one in 300.
    kept = {path.name for path in (tmp_path / "agents").iterdir()}
    assert kept == {"main_0", "main_0-0-768", "main_0-0-256", "alone"}
    assert rows[-1]["games"] == "3"


def test_labels_of_equal_ratings_stand_one_above_the_other():
    spaced = _space_out([1550.0, 0.0, 1545.0, 1700.0, 1555.0], 50.0)
    assert spaced == pytest.approx([1550.0, 0.0, 1500.0, 1700.0, 1600.0])
    assert _space_out([], 1.0) == []
