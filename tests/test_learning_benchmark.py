"""The benchmark behind the README's results table, on a run of seconds."""

import csv
from pathlib import Path

from tests.benchmark_runs import read_table

SHORT = (
    *("scenario=11x11", "max_ticks=300", "policy.hidden_width=16", "collector.num_worlds=16"),
    *("generator=none", "replay.min_transitions=300", "learner.batch_size=16", "torch_threads=1"),
    *("evaluation.every_frames=512", "evaluation.games=2", "total_frames=2048"),
)


def run_benchmark(folder: Path) -> str:
    options = ["--networks", "conv", "--seeds", "3", "--games", "8", "--out", str(folder)]
    return read_table("learning", "| network", [*options, *SHORT])


def test_the_table_is_made_once_and_shown_again(tmp_path):
    table = run_benchmark(tmp_path)
    log = (tmp_path / "conv-3" / "log.csv").read_bytes()
    assert run_benchmark(tmp_path) == table
    assert (tmp_path / "conv-3" / "log.csv").read_bytes() == log
    with (tmp_path / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["network"], row["seed"], row["opponent"]) for row in rows] == [
        ("conv", "3", "random"),
        ("conv", "3", "counter"),
    ]
    for row in rows:
        assert row["games"] == "8"
        assert 0 <= float(row["low"]) <= float(row["won"]) <= float(row["high"]) <= 100
        assert (
            f"| `{row['opponent']}` | 8 | {row['won']} % [{row['low']}, {row['high']}] |" in table
        )


def test_recipes_of_one_player_are_trained_rated_and_drawn(tmp_path):
    options = ["--game", "deep_maze", "--recipes", "deep_maze_9x9", "--networks", "conv"]
    options += ["--seeds", "3", "--games", "8", "--out", str(tmp_path)]
    words = [word for word in SHORT if not word.startswith(("scenario", "max_ticks"))]
    words = [*options, *words, "max_ticks=40"]
    tables = [read_table("solo_learning", "| recipe", words) for _ in range(2)]
    assert tables[0] == tables[1]
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "results.csv").open(newline="") as file:
        ended, extra = csv.DictReader(file)
    assert (ended["number"], extra["number"]) == ("ended", "extra_steps")
    for row in (ended, extra):
        assert (row["recipe"], row["seed"], row["games"]) == ("deep_maze_9x9", "3", "8")
        assert float(row["low"]) <= float(row["value"]) <= float(row["high"])
