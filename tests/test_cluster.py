"""Leagues and experiments on a Ray cluster of two machines, of which one is killed."""

import os
import re
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml

from marl_cair import cluster
from marl_cair.cluster import ClusterError, Node, RayPool, check_cluster
from marl_cair.experiments import worker
from marl_cair.experiments.cells import DONE_FILE
from marl_cair.experiments.experiment import ExperimentConfig, run_experiment
from marl_cair.experiments.looks import LOOKS_FILE
from marl_cair.experiments.remote import RayTasks
from marl_cair.league.league import LeagueConfig, run_league
from tests.experiments.plans import TINY, change_task, compose_layers, list_cells, make_plan
from tests.experiments.test_experiment import read_looks
from tests.processes import ROOT, run_python

WAIT_SECONDS = 120.0
# The command line, on a machine that other work may keep busy.
PATIENT = """import sys
from marl_cair import cluster
from marl_cair.cli import main
cluster._CONNECT_SECONDS = cluster._ANSWER_SECONDS = 600.0
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def machines():
    """A head and a second machine with a core each: processes of this machine."""
    pytest.importorskip("ray", reason='Ray is not installed: pip install "marl_cair[ray]"')
    with ExitStack() as stack:
        patch = stack.enter_context(pytest.MonkeyPatch.context())
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        patch.setenv("RAY_AUTH_MODE", "disabled")
        patch.setattr(cluster, "_CONNECT_SECONDS", WAIT_SECONDS)
        from ray.cluster_utils import Cluster

        limits = {"num_cpus": 1, "object_store_memory": 80 << 20, "include_dashboard": False}
        nodes = Cluster(initialize_head=True, head_node_args=limits)
        stack.callback(nodes.shutdown)
        nodes.add_node(**limits)
        yield nodes


@pytest.fixture(scope="module")
def where(machines):
    return f"ray:{machines.address}"


@pytest.fixture(scope="module")
def pool(where):
    """The one connection of this process, which leagues and experiments use too."""
    with RayPool(where, 1) as opened:
        yield opened


def wait_for(condition, seconds=WAIT_SECONDS):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "this has taken too long"
        time.sleep(0.05)


def test_a_league_on_a_cluster_has_the_table_of_one_without(pool, where, tmp_path):
    def play(out, **options):
        return run_league(
            LeagueConfig(
                ("random", "rusher", "turtle"),
                scenario="11x11",
                scenario_options={"max_ticks": 300},
                games_per_pair=16,
                out=str(tmp_path / out),
                replays=False,
                **options,
            ),
            show_progress=False,
        )

    assert play("a", cluster=where).text == play("b").text.replace("/b/", "/a/")
    for table in ("ladder.csv", "winrates.csv", "seats.csv", "maps.csv"):
        assert (tmp_path / "a" / table).read_bytes() == (tmp_path / "b" / table).read_bytes()


def test_machines_with_other_versions_or_folders_are_named(pool, tmp_path, monkeypatch):
    def require(message, **changes):
        monkeypatch.setattr(pool, "_context", pool._context._replace(**changes))
        with pytest.raises(ClusterError, match=message):
            pool.require_shared(tmp_path)
        monkeypatch.undo()

    versions = {**pool._context.versions, "marl_cair": "9.9", "torch": "1.0"}
    name = r"the machine \S+ of the cluster"
    require(rf"{name} has marl_cair \S+ and not 9.9, torch \S+ and not 1.0: ", versions=versions)
    other_code = {**pool._context.versions, "code of marl_cair": "0"}
    require(rf"{name} has code of marl_cair \w+ and not 0: ", versions=other_code)
    require(rf"{name} does not see /no/folder: start the command in", folder="/no/folder")
    pool.require_shared(tmp_path)
    assert list(tmp_path.iterdir()) == []
    with monkeypatch.context() as patch:
        patch.setattr(RayPool, "nodes", [Node("key", "10.0.0.1", 0)])
        with pytest.raises(ClusterError, match="no machine of the cluster has cores for tasks"):
            pool.require_shared(tmp_path)
    monkeypatch.setattr(Path, "touch", lambda self: None)
    with pytest.raises(ClusterError, match=rf"{name} does not see {tmp_path}: give a folder that"):
        pool.require_shared(tmp_path)


def test_a_machine_with_other_versions_is_named_by_its_own_answer(machines, pool, tmp_path):
    """Its processes find packages of other versions first."""
    for name in ("marl_cair", "ray"):
        about = tmp_path / f"{name}-9.9.dist-info" / "METADATA"
        about.parent.mkdir()
        about.write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 9.9\n", "utf-8")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    other = machines.add_node(num_cpus=0, env_vars={"PYTHONPATH": path})
    with pytest.raises(ClusterError, match=r"has marl_cair 9.9 and not \S+, ray 9.9 and not \S+: "):
        pool.require_shared(tmp_path)
    machines.remove_node(other)
    wait_for(lambda: all(node.num_cpus for node in pool.nodes))
    pool.require_shared(tmp_path)


def test_a_cluster_of_another_ray_is_not_joined(machines):
    """Ray itself says so, when a process joins."""
    lines = (
        "import ray, marl_cair.cluster as cluster",
        "ray.__version__ = '9.9'",
        f"cluster._CONNECT_SECONDS = {WAIT_SECONDS}",
        f"cluster.RayPool('ray:{machines.address}', 1)",
    )
    done = run_python(ROOT, "-c", "\n".join(lines))
    assert re.search(r"ClusterError: the Ray at \S+ cannot be joined \(Version mism", done.stderr)


def test_errors_of_tasks_are_those_of_the_function(pool, monkeypatch):
    monkeypatch.setattr(cluster, "_RETRIES", 0)
    with pytest.raises(ZeroDivisionError, match="^integer division or modulo by zero$"):
        pool.submit(divmod, 1, 0).result()
    with pytest.raises(ClusterError, match="a task has not ended in 1 tries .*: see whether"):
        pool.submit(os._exit, 1).result()


def test_a_cell_that_no_machine_can_hold_is_named(pool, tmp_path):
    cells = list_cells(make_plan(words=[*TINY["words"], "torch_threads=2"]), tmp_path)
    found = RayTasks(pool).find_shortages(cells[:1])
    (why,) = found.values()
    assert re.fullmatch(
        r"on \S+: it needs 2 cores \(torch_threads\), Ray has \d there", why
    )  # fmt: skip


def test_a_killed_machine_costs_its_unfinished_work_only(machines, pool, where, tmp_path):
    """The looks of both cells are those of cells that ran here."""
    plan = make_plan(tasks=change_task(agents=[], scale=[], when={"pqn": None}))
    out, names = tmp_path / "out", ("maze-dqn-0", "maze-dqn-1")
    files = [out / "cells" / name / LOOKS_FILE for name in names]
    killed = []

    def kill(*_):
        if not killed and all(file.exists() for file in files):
            killed.extend(machines.worker_nodes)
            machines.remove_node(killed[0], allow_graceful=False)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("marl_cair.experiments.scheduler.Progress.note", kill)
        patch.setattr(worker, "_REPORT_SECONDS", 0.0)
        result = run_experiment(plan, ExperimentConfig(out=out, cluster=where), compose_layers)
    assert killed
    assert (result.failed, result.skipped) == ({}, {})
    for cell, file in zip(list_cells(plan, tmp_path / "here"), files, strict=True):
        folder = tmp_path / "here" / "cells" / cell.name
        folder.mkdir(parents=True)
        cell.save(folder)
        assert worker.run_cell(folder, lambda share, rows: None)
        assert read_looks(file) == read_looks(folder / LOOKS_FILE)


@pytest.mark.slow
def test_a_plan_whose_head_is_killed_is_resumed_without_it(machines, tmp_path):
    from ray.cluster_utils import Cluster

    changes = {"seeds": [0], "budget": {"frames": 1024}}
    changes["tasks"] = change_task(agents=[], scale=[], when={"pqn": None})
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump({**TINY, **changes}), "utf-8")
    plan, out = make_plan(**changes), tmp_path / "out"
    (cell,) = list_cells(plan, tmp_path / "whole")
    file = out / "cells" / cell.name / LOOKS_FILE
    limits = {"num_cpus": 1, "object_store_memory": 80 << 20, "include_dashboard": False}
    with ExitStack() as stack:
        head = Cluster(initialize_head=True, head_node_args=limits)
        stack.callback(head.shutdown)
        words = ["experiment", tmp_path / "plan.yaml", "--out", out]
        process = subprocess.Popen(
            [sys.executable, "-c", PATIENT, *words, "--cluster", f"ray:{head.address}"],
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        stack.callback(process.kill)
        wait_for(lambda: file.exists() and len(read_looks(file)) >= 3, seconds=600.0)
        head.remove_node(head.head_node, allow_graceful=False)
        assert process.wait(600) != 0
    assert not (file.parent / DONE_FILE).exists()
    result = run_experiment(plan, ExperimentConfig(out=out, workers=1), compose_layers)
    assert (result.failed, result.skipped) == ({}, {})
    folder = tmp_path / "whole" / "cells" / cell.name
    folder.mkdir(parents=True)
    cell.save(folder)
    assert worker.run_cell(folder, lambda share, rows: None)
    assert read_looks(file) == read_looks(folder / LOOKS_FILE)


@pytest.mark.slow
def test_a_stopped_cell_saves_its_run(pool, tmp_path):
    cell, *_ = list_cells(make_plan(budget={"frames": 10**6}), tmp_path)
    folder = tmp_path / "cells" / cell.name
    folder.mkdir(parents=True)
    cell.save(folder)
    tasks = RayTasks(pool)
    tasks.find_shortages([cell])
    tasks.submit(cell, folder, lambda *found: None)
    wait_for((folder / LOOKS_FILE).exists)
    tasks.stop()
    assert (folder / "run" / "resume").is_dir()
    assert not (folder / DONE_FILE).exists()


# --- without a cluster -------------------------------------------------------------------------


@pytest.mark.parametrize("text", ["rey", "ray:", "ray://host:10001", "ray:host", "Local"])
def test_where_it_runs_is_one_of_four(text):
    with pytest.raises(ValueError, match=f"--cluster is '{text}', it must be local, ray "):
        check_cluster(text)


def test_a_missing_ray_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ClusterError, match=r'--cluster ray needs Ray: pip install "marl_cair.ray.'):
        RayPool("ray", 1)


def test_an_address_that_does_not_answer_is_refused(monkeypatch):
    pytest.importorskip("ray", reason='Ray is not installed: pip install "marl_cair[ray]"')
    monkeypatch.setattr(cluster, "_CONNECT_SECONDS", 2.0)
    monkeypatch.setattr("ray.is_initialized", lambda: False)
    with pytest.raises(ClusterError, match="no Ray answers at 127.0.0.1:9 within 2 s: start Ray"):
        RayPool("ray:127.0.0.1:9", 1)
