"""Experiments end to end: killed and resumed, failing cells, folders of other plans."""

import csv
import dataclasses
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
import yaml

from marl_cair.checkpoint import LATEST_FOLDER
from marl_cair.experiments import looks, worker
from marl_cair.experiments.cells import DONE_FILE, load_cell
from marl_cair.experiments.experiment import ExperimentConfig, run_experiment
from marl_cair.experiments.looks import LOOKS_FILE
from marl_cair.experiments.plan import Length
from marl_cair.files import OutputFolderError, write_json
from marl_cair.training.trainer import train
from tests.experiments.plans import TINY, change_task, compose_layers, list_cells, make_plan
from tests.processes import ROOT

NAME = "maze-dqn-0"


def read_looks(path):
    """Rows without the processor time, which no two runs share."""
    with path.open(newline="", encoding="utf-8") as file:
        return [{k: v for k, v in row.items() if k != "seconds"} for row in csv.DictReader(file)]


def prepare(folder, number=0, **changes):
    """The folder of a cell, ready to run."""
    cell = list_cells(make_plan(**changes), folder)[number]
    place = folder / "cells" / cell.name
    place.mkdir(parents=True)
    cell.save(place)
    return place


def run_here(folder):
    return worker.run_cell(folder, lambda share, rows: None)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a cell that ran without interruption."""
    folder = prepare(tmp_path_factory.mktemp("whole"))
    assert run_here(folder)
    return folder


def test_a_cell_is_an_ordinary_run_with_looks(whole):
    rows = read_looks(whole / LOOKS_FILE)
    assert [row["frames"] for row in rows] == ["0", "128", "256", "384", "512"]
    assert {"score", "mean", "ended", "extra_steps", "return"} <= rows[0].keys()
    assert (whole / "run" / LATEST_FOLDER).is_dir()
    assert (whole / "run" / "log.csv").is_file()
    assert not (whole / "run" / "resume").exists()


def test_a_finished_cell_is_not_repeated(whole):
    before = (whole / LOOKS_FILE).stat().st_mtime_ns
    assert run_here(whole)
    assert (whole / LOOKS_FILE).stat().st_mtime_ns == before


def test_an_interrupted_cell_is_resumed_with_the_same_looks(whole, tmp_path, monkeypatch):
    """The first call dies in its fourth look, after the state of frame 256."""
    folder, calls = prepare(tmp_path), []

    def die(*arguments):
        calls.append(arguments)
        if len(calls) == 4:
            raise RuntimeError("killed")
        return measure(*arguments)

    measure = worker.Looks.add.__globals__["measure"]
    monkeypatch.setitem(worker.Looks.add.__globals__, "measure", die)
    with pytest.raises(RuntimeError, match="killed"):
        run_here(folder)
    assert not (folder / DONE_FILE).exists()
    assert len(read_looks(folder / LOOKS_FILE)) == 3
    assert run_here(folder)
    assert read_looks(folder / LOOKS_FILE) == read_looks(whole / LOOKS_FILE)
    assert_equal_agents(folder, whole)


def assert_equal_agents(*folders):
    one, other = (torch.load(f / "run" / LATEST_FOLDER / "weights.pt") for f in folders)
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)


def test_an_agent_is_rated_once(tmp_path):
    folder = prepare(tmp_path, number=2)
    assert run_here(folder)
    (row,) = read_looks(folder / LOOKS_FILE)
    assert (row["frames"], row["ended"]) == ("0", "1.0")


def test_a_cell_without_looks_is_rated_at_its_end_by_its_best_agent(tmp_path):
    words = [*TINY["words"], "evaluation.every_frames=128", "evaluation.games=2"]
    rating = {"games": 4, "agent": "best"}
    folder = prepare(tmp_path, words=words, tasks=change_task(rating=rating), looks={})
    assert run_here(folder)
    first, last = read_looks(folder / LOOKS_FILE)
    assert (first["frames"], last["frames"]) == ("0", "512")


def test_a_cell_that_ended_before_its_first_evaluation_has_no_best_agent(tmp_path):
    rated = {"tasks": change_task(rating={"games": 4, "agent": "best"}), "looks": {}}
    words = [*TINY["words"], "evaluation.every_frames=100_000_000"]
    folder = prepare(tmp_path, words=words, budget={"seconds": 0.1}, **rated)
    with pytest.raises(ValueError, match=r"rating.agent is 'best', .* \(100,000,000\) to evaluate"):
        run_here(folder)


def test_a_budget_in_seconds_ends_a_cell(tmp_path):
    folder = prepare(tmp_path, budget={"seconds": 0.5}, looks={"seconds": 0.2})
    assert run_here(folder)
    seconds = [row["seconds"] for row in looks.read_looks(folder / LOOKS_FILE)]
    assert seconds == sorted(seconds)
    assert seconds[0] == 0
    assert seconds[-2] < 0.5 <= seconds[-1]


def train_elsewhere(cell, look):
    """A trainer of another library, of 10 ms and 100 steps an iteration."""
    from marl_cair.games import GAMES

    sys.stdout.write("{'loss': 1.0}\n")  # trainers print; progress is read elsewhere
    agent, frames = GAMES["deep_maze"].bot("oracle", cell.config.game.rated_scenario), 0
    while look(agent, frames / 10_000, frames):
        frames += 100


def test_a_trainer_of_another_library_is_a_cell(tmp_path):
    place = "tests.experiments.test_experiment:train_elsewhere"
    folder = prepare(tmp_path, number=2, others={"mine": place})
    assert run_here(folder)
    rows = read_looks(folder / LOOKS_FILE)
    assert [row["frames"] for row in rows] == ["0", "200", "300", "400", "600"]
    assert {row["ended"] for row in rows} == {"1.0"}


# --- whole plans -------------------------------------------------------------------------------


def run(plan, out, **options):
    return run_experiment(plan, ExperimentConfig(out=out, workers=2, **options), compose_layers)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a plan of agents alone, and its result."""
    out = tmp_path_factory.mktemp("finished") / "out"
    plan = make_plan(tasks=change_task(when={"dqn": None, "pqn": None}), seeds=[0])
    return out, plan, run(plan, out)


def test_a_plan_is_run_in_a_process_and_shown_again(finished):
    out, plan, result = finished
    assert (result.failed, result.skipped) == ({}, {})
    assert "| maze | oracle | 1 |" in result.text
    assert [row["seed"] for row in read_looks(out / "looks.csv")] == ["0"]
    assert {path.name for path in out.iterdir()} >= {
        *("looks.csv", "table.md", "table.csv", "table.tex", "figure.png", "figure.pdf"),
    }
    assert (out / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert run(plan, out).text == result.text


def test_a_plan_may_grow_in_its_folder(finished, tmp_path):
    out, plan, _ = finished
    out = Path(shutil.copytree(out, tmp_path / "out"))
    looks_of_first = out / "cells" / "maze-oracle-0" / LOOKS_FILE
    before = looks_of_first.stat().st_mtime_ns
    without = {"dqn": None, "pqn": None, "new": None}
    task = TINY["tasks"]["maze"] | {"agents": ["oracle", "random"], "when": without}
    changes = {"factors": {"learner": {**TINY["factors"]["learner"], "new": []}}, "seeds": [0]}
    grown = make_plan(tasks={"maze": task, "again": task | {"agents": ["oracle"]}}, **changes)
    result = run(grown, out)
    assert (result.failed, looks_of_first.stat().st_mtime_ns) == ({}, before)
    names = {path.name for path in (out / "cells").iterdir()}
    assert names == {"maze-oracle-0", "maze-random-0", "again-oracle-0"}
    with pytest.raises(OutputFolderError, match="plan.tasks.again is .* there, None here"):
        run(plan, out)
    other = make_plan(tasks={"maze": task | {"words": ["max_ticks=9"]}, "again": task}, **changes)
    with pytest.raises(OutputFolderError, match=r"plan.tasks.maze.words is \[\] there"):
        run(other, out)


def test_tables_say_where_cells_are_of_other_code(finished, tmp_path):
    out, plan, result = finished
    assert "versions of the code" not in result.text
    out = Path(shutil.copytree(out, tmp_path / "out"))
    plan = dataclasses.replace(plan, seeds=(0, 1))
    (out / "cells" / "maze-oracle-0" / DONE_FILE).write_text("marl_cair 0123abcd\n", "utf-8")
    assert "Cells were run by 2 versions of the code" in run(plan, out).text


def test_the_folder_of_another_plan_version_or_budget_is_refused(finished, tmp_path, monkeypatch):
    out, plan, _ = finished
    with pytest.raises(OutputFolderError, match="plan.budget.frames is .* there, 700 here"):
        run(dataclasses.replace(plan, budget=Length(frames=700)), out)
    assert "Another question" in run(dataclasses.replace(plan, about="Another question"), out).text
    with pytest.raises(OutputFolderError, match="budget is '' there, '20m' here"):
        run(plan, out, budget="20m", budget_seconds=1200.0)
    # Cells of another version may have settings that are unknown here.
    out = Path(shutil.copytree(out, tmp_path / "out"))
    for cell in (out / "cells").glob("*/cell.json"):
        write_json(cell, {"no_such_option": 1})
    monkeypatch.setattr("marl_cair.experiments.experiment.__version__", "9.9")
    with pytest.raises(ValueError, match="cell.json, perhaps of another version .*no_such_option"):
        load_cell(cell.parent)
    with pytest.raises(OutputFolderError, match="version is '.*' there, '9.9' here"):
        run(plan, out)


def test_a_budget_must_be_able_to_start_all_cells(tmp_path):
    options = {"budget": "1s", "budget_seconds": 1.0}
    with pytest.raises(ValueError, match="--budget needs budget.seconds in the plan"):
        run(make_plan(), tmp_path / "a", **options)
    with pytest.raises(ValueError, match="--budget 1s is too short to start 4 cells: give more"):
        run(make_plan(budget={"seconds": 60}), tmp_path / "a", **options)
    assert not (tmp_path / "a").exists()


def test_cells_of_two_threads_follow_one_another_on_two_cores(tmp_path):
    plan = make_plan(
        words=[*TINY["words"], "torch_threads=2"],
        factors={"learner": {"dqn": []}},
        tasks=change_task(agents=[], scale=[]),
        budget={"frames": 128},
        looks={},
    )
    assert not run(plan, tmp_path / "out").failed
    cells = [tmp_path / "out" / "cells" / f"maze-dqn-{seed}" for seed in (0, 1)]
    spans = sorted(
        ((cell / "run" / "config.yaml").stat().st_mtime_ns, (cell / DONE_FILE).stat().st_mtime_ns)
        for cell in cells
    )
    assert spans[0][1] <= spans[1][0]


def test_unknown_choices_and_trainers_are_refused_before_work(tmp_path):
    with pytest.raises(ValueError, match="unknown task or choice 'dqm': nearest are 'dqn'"):
        run(make_plan(), tmp_path / "a", only=("dqm",))
    task = TINY["tasks"]["maze"]
    plan = make_plan(tasks={"maze": task, "other": {**task, "when": {"pqn": None}}})
    with pytest.raises(ValueError, match=r"--only is \['other', 'pqn'\], it must be a task and"):
        run(plan, tmp_path / "a", only=("other", "pqn"))
    with pytest.raises(ValueError, match="no_such_module:train cannot be imported"):
        run(make_plan(others={"mine": "no_such_module:train"}), tmp_path / "a", allow_code=True)
    assert not (tmp_path / "a").exists()


@pytest.mark.slow
def test_a_failed_cell_is_named_and_a_large_one_skipped(tmp_path):
    words = [*TINY["words"], f"replay.capacity_transitions={10**12}"]
    plan = make_plan(
        words=words,
        others={"mine": f"{__name__}:fail"},
        tasks=change_task(rating={"games": 4}, when={"pqn": None}),
        seeds=[0],
    )
    result = run(plan, tmp_path / "out", allow_code=True)
    assert "ValueError: no luck (exit code 1" in result.failed["maze-mine-0"]
    assert "capacity_transitions" in result.skipped[NAME]
    assert f"Not run on this machine: {NAME}" in result.text
    assert "2 of 3 cells are not finished" in result.text


def fail(cell, look):
    raise ValueError("no luck")


@pytest.mark.skipif(sys.platform != "linux", reason="finds the cells' processes in /proc")
def test_a_killed_plan_is_resumed_and_equals_an_uninterrupted_one(tmp_path):
    """The command and its cell are killed: no process has time to save."""
    changes = {"seeds": [0], "budget": {"frames": 1024}}
    changes["tasks"] = change_task(agents=[], scale=[], when={"pqn": None})
    plan, out = make_plan(**changes), tmp_path / "killed"
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump({**TINY, **changes}), "utf-8")
    command = [sys.executable, "-m", "marl_cair", "experiment", tmp_path / "plan.yaml"]
    process = subprocess.Popen(
        [*command, "--out", out, "--workers", "2"], env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    file = out / "cells" / NAME / LOOKS_FILE
    while not (file.exists() and len(read_looks(file)) >= 3):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGSTOP)  # it would name the cells as failed
    for threads in Path(f"/proc/{process.pid}/task").glob("*/children"):
        for child in threads.read_text().split():
            os.kill(int(child), signal.SIGKILL)
    process.kill()
    process.wait()
    assert not (out / "cells" / NAME / DONE_FILE).exists()
    assert run(plan, out).failed == {}
    whole = prepare(tmp_path, **changes)
    assert run_here(whole)
    rows = read_looks(whole / LOOKS_FILE)
    assert read_looks(out / "cells" / NAME / LOOKS_FILE) == rows
    assert [{key: row[key] for key in rows[0]} for row in read_looks(out / "looks.csv")] == rows
    assert_equal_agents(out / "cells" / NAME, whole)


def test_training_ends_where_a_watcher_says_so(tmp_path):
    cell, *_ = list_cells(make_plan(), tmp_path)
    seen = []

    def watch(run):
        seen.append((run.frames, run.processor_seconds))
        return run.frames < 192

    result = train(cell.config, show_progress=False, watch=watch)
    assert [frames for frames, _ in seen] == [0, 64, 128, 192]
    assert result.frames == 192
    assert 0 < result.processor_seconds == seen[-1][1]
    again = train(cell.config, resume=True, show_progress=False, watch=watch)
    assert again.frames == 192
    assert again.processor_seconds == result.processor_seconds
