"""Tables as CSV, Markdown and LaTeX hold the same lines."""

import csv

import pytest

from docs.experiment_results import read_runs
from marl_cair.experiments.summary import Entry, Estimate, Reached, Run
from marl_cair.experiments.tables import format_estimate, write_looks, write_tables
from tests.experiments.plans import change_task, make_plan

ROW = {"look": 1.0, "seconds": 2.5, "frames": 128, "score": 0.5, "mean": 0.5}


@pytest.fixture
def plan():
    rating = {"games": 4, "unit": "% won"}
    return make_plan(source="paper", tasks=change_task(rating=rating, published={"dqn": 78}))


def read(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_an_estimate_shows_its_interval_if_it_has_one():
    assert format_estimate(Estimate(0.5, 0.25, 0.75)) == "0.500 [0.250, 0.750]"
    assert format_estimate(Estimate(78.25)) == "78.2"
    assert format_estimate(Estimate(12345.6)) == "12,346"


def test_a_table_is_written_in_three_forms(plan, tmp_path):
    entries = [
        Entry("maze", ("dqn",), 2, {"steps": Estimate(512.0), "score": Estimate(60, 50, 70)}),
        Entry("maze", ("oracle",), 1, {"steps": Estimate(0.0), "score": Estimate(99.0)}),
    ]
    text = write_tables(plan, entries, [], "Two seeds.", tmp_path)
    assert text == (tmp_path / "table.md").read_text("utf-8")
    assert text.splitlines()[0] == "Which learner? Two seeds."
    assert "| task | learner | unit | paper | runs | steps | score |" in text
    assert "| maze | dqn | % won | 78 | 2 | 512 | 60.0 [50.0, 70.0] |" in text
    assert "| maze | oracle | % won |  | 1 | - | 99.0 |" in text
    first, second = read(tmp_path / "table.csv")
    assert (first["paper"], second["paper"]) == ("78.0", "")
    assert [float(first[f"score{end}"]) for end in ("", "_low", "_high")] == [60, 50, 70]
    assert (second["score"], second["score_low"]) == ("99.0", "")
    latex = (tmp_path / "table.tex").read_text("utf-8")
    assert r"maze & dqn & 78 & 2 & 512 & 60.0 [50.0, 70.0] \\" in latex
    assert r"Two seeds. maze: \% won.}" in latex
    assert not (tmp_path / "levels.md").exists()


def test_marks_of_markdown_and_latex_are_escaped_and_zero_has_no_sign(plan, tmp_path):
    entry = Entry("maze", ("dqn",), 1, {"a|b^2": Estimate(-0.0001)})
    assert "a\\|b^2" in (text := write_tables(plan, [entry], [], "", tmp_path))
    assert "| 0.000 |" in text
    assert r"a|b\textasciicircum{}2" in (tmp_path / "table.tex").read_text("utf-8")


def test_levels_are_a_table_of_their_own(plan, tmp_path):
    run = Run("maze", ("dqn",), 3, [ROW])
    reached = [Reached(run, 0.5, ROW, 0.5), Reached(run, 0.9, None, 0.5)]
    text = write_tables(plan, [Entry("maze", ("dqn",), 1, {})], reached, "One seed.", tmp_path)
    held = "| maze | dqn | 3 | 0.5 | 0.5 | 2 s | 128 | held 0.5 |"
    assert held in text
    assert "| maze | dqn | 3 | 0.5 | 0.9 | never | - | best 0.5 |" in text
    assert held in (tmp_path / "levels.md").read_text("utf-8")
    first, second = read(tmp_path / "levels.csv")
    assert [float(first[name]) for name in ("level", "seconds", "steps", "score")] == [
        *(0.5, 2.5, 128, 0.5)
    ]
    assert (second["seconds"], second["score"]) == ("", "0.5")


def test_looks_are_one_row_for_each_cell_and_look(plan, tmp_path):
    runs = [Run("maze", ("dqn",), 3, [ROW, {**ROW, "return": 0.25}])]
    write_looks(plan, runs, tmp_path / "looks.csv")
    first, second = read(tmp_path / "looks.csv")
    assert (first["task"], first["learner"], first["seed"], first["frames"]) == (
        *("maze", "dqn", "3"),
        "128",
    )
    assert (first["return"], second["return"]) == ("", "0.25")


def test_runs_are_read_again_from_the_raw_looks_of_an_experiment(plan, tmp_path):
    """`python docs/experiment_results.py` makes tables and the figure from them."""
    later = {"look": 2, "seconds": 5.0, "frames": 256, "score": 1.0, "mean": 0.75, "pipes": 3}
    runs = [Run("maze", ("dqn",), 1, [ROW, later]), Run("maze", ("oracle",), 0, [ROW])]
    write_looks(plan, runs, tmp_path / "looks.csv")
    assert read_runs(plan, tmp_path / "looks.csv") == runs
