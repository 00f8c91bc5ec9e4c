"""`marl-cair experiment` and `reproduce`: plans by name, and what is refused."""

import csv
from pathlib import Path

import pytest

from marl_cair.cli import main
from marl_cair.cli.experiment import CONF, compose, list_plans
from marl_cair.experiments.cells import make_cells
from marl_cair.experiments.plan import read_plan
from tests.processes import ROOT
from tests.refusals import assert_refused

PLAN = """
words: [game=deep_maze, generator=none]
tasks: {maze: {rating: {games: 4}}}
factors: {network: {conv: [policy=conv]}}
budget: {seconds: 60}
"""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(PLAN, "utf-8")
    return str(path)


def test_ready_made_plans_are_listed_and_read():
    assert {"thesis", "solo", "opponents", "memory", "deep_line_wars"} <= set(list_plans())
    for name in list_plans():
        assert read_plan(str(CONF / "plan" / f"{name}.yaml")).about


def test_later_layers_of_words_override():
    config = compose([["seed=3", "policy=conv"], ["policy=capsule"], ["learner.gamma=0.9"]])
    assert (config.seed, config.policy.body, config.learner.gamma) == (3, "capsule", 0.9)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["thesi"], "unknown plan (a YAML file, or a ready-made one) 'thesi': nearest are"),
        (["thesis", "--budget", "20"], "--budget is '20', it must be a number above 0 with s, m"),
        (["thesis", "--workers", "0"], "--workers is 0, it must be 1 or more"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", ["experiment", "reproduce"])
def test_wrong_words_are_refused(capsys, command, words, message):
    assert_refused(capsys, message, command, *words)


def test_a_folder_of_other_files_is_refused_before_work(capsys, plan, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("mine", "utf-8")
    assert_refused(
        capsys, "holds files of no run (mine.txt)", "experiment", plan, "--out", str(out)
    )
    assert [path.name for path in out.iterdir()] == ["mine.txt"]


def test_help_lists_the_plans(capsys):
    with pytest.raises(SystemExit):
        main(["reproduce", "--help"])
    assert "deep_line_wars, memory, offline, opponents, solo, synthetic, thesis" in " ".join(
        capsys.readouterr().out.split()
    )


def test_the_plan_of_the_guide_can_be_run(tmp_path):
    text = (CONF.parent.parent / "docs" / "experiment.md").read_text("utf-8")
    file = tmp_path / "plan.yaml"
    file.write_text(text.partition("```yaml\n")[2].partition("```")[0], "utf-8")
    cells = make_cells(read_plan(file), compose, 1.0, tmp_path)
    assert len(cells) == 3 * (4 + 2 + 2)  # of the maze only those with generated transitions


PLANS = [Path(str(CONF / "plan" / f"{name}.yaml")) for name in list_plans()]
OTHERS = sorted((ROOT / "benchmarks" / "plans").glob("*.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("path", [*PLANS, *OTHERS], ids=lambda path: path.stem)
def test_each_cell_of_a_plan_can_be_composed(path, tmp_path):
    plan = read_plan(path)
    cells = make_cells(plan, compose, 1.0, tmp_path)
    assert len({cell.name for cell in cells}) == len(cells) >= len(plan.seeds)
    trained = [cell.config for cell in cells if not (cell.agent or cell.trainer)]
    for config in trained:  # pqn learns nothing without normalised layers, distances nothing with
        if config.learner.algorithm == "pqn":
            assert config.policy.norm == ("none" if config.policy.distances else "layer")


@pytest.mark.slow
def test_two_tasks_of_the_thesis_are_reproduced_within_a_budget(tmp_path, capsys):
    out, tasks = tmp_path / "out", ("deep_line_wars", "flappy_bird")
    words = ["reproduce", "thesis", "--only", *tasks, "conv", "none", "--out", str(out)]
    assert main([*words, "--budget", "30s", "--workers", "2"]) == 0
    assert "Scaled down by --budget 30s: each run has" in capsys.readouterr().out
    with (out / "table.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = [(row["task"], row["network"], row["runs"]) for row in rows]
    assert found == [(task, "conv", "3") for task in tasks]
    for task in tasks:
        assert (out / f"panels_{task}.png").read_bytes().startswith(b"\x89PNG")
