"""Figures are drawn for all kinds of plans, and for logs of any length."""

from marl_cair.experiments.figures import draw_panels, draw_results
from marl_cair.experiments.summary import Run, summarise
from marl_cair.training.run_log import format_rows
from tests.experiments.plans import change_task, make_plan

ROW = {"look": 0, "seconds": 0.0, "frames": 0, "score": 0.5, "mean": 0.5}
LATER = {**ROW, "look": 1, "seconds": 9.0, "frames": 900}


def is_picture(path):
    return path.read_bytes().startswith(b"\x89PNG")


def test_curves_and_ends_are_drawn(tmp_path):
    runs = [Run("maze", ("dqn",), seed, [ROW, LATER]) for seed in range(2)]
    runs.append(Run("maze", ("oracle",), 0, [ROW]))
    task = change_task(levels=[0.9], published={"dqn": 0.7}, scale=[])
    for number, looks in enumerate(({"frames": 128}, {})):
        plan, path = make_plan(looks=looks, tasks=task), tmp_path / f"{number}.png"
        draw_results(plan, runs, summarise(plan, runs), path)
        assert is_picture(path)


def test_panels_show_all_networks_with_a_log(tmp_path):
    rows = [
        {"frames": 100.0 * n, "loss/all": 0.1 / n, "episodes/return": n, "actions/up": 0.5}
        for n in (1, 2)
    ]
    logs = {"long": rows, "short": rows[:1]}
    files = {name: [tmp_path / f"{name}.csv"] for name in (*logs, "none")}
    for name, of_run in logs.items():
        files[name][0].write_text(format_rows(of_run), "utf-8")
    draw_panels("maze", files, tmp_path / "panels.png")
    assert is_picture(tmp_path / "panels.png")
    draw_panels("maze", {"none": files["none"]}, tmp_path / "nothing.png")
    assert not (tmp_path / "nothing.png").exists()
