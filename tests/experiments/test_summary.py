"""Interquartile means, equal time and steps, scales and levels, by numbers that can be seen."""

import numpy as np
import pytest

from marl_cair.experiments.summary import Run, find_iqm, find_levels, summarise
from tests.experiments.plans import change_task, make_plan


def make_run(kind, seed, speed, scores, every=10.0):
    rows = [
        {"look": n, "seconds": every * n, "frames": every * n * speed, "score": s, "mean": s}
        for n, s in enumerate(scores)
    ]
    return Run("maze", (kind,), seed, rows)


def test_the_interquartile_mean_leaves_out_the_quarter_at_each_end():
    found = find_iqm([np.array([0.0, 1.0, 2.0, 100.0])])
    assert found.value == 1.5
    assert 0.0 <= found.low < 1.5 < found.high <= 100.0
    assert np.isnan(find_iqm([np.array([3.0])]).low)
    assert find_iqm([np.array([2.0, 2.0])]) == (2.0, 2.0, 2.0)


def test_strata_are_drawn_from_apart():
    """Two tasks without spread within leave no spread, though they differ."""
    assert find_iqm([np.zeros(3), np.ones(3)]) == (0.5, 0.5, 0.5)


def test_runs_are_compared_at_equal_time_and_equal_steps():
    quick = [make_run("pqn", seed, 300, [0.0, 0.9, 0.9, 0.9]) for seed in range(4)]
    slow = [make_run("dqn", seed, 100, [0.0, 0.3, 0.6, 0.9]) for seed in range(4)]
    plan = make_plan(tasks=change_task(scale=[0.0, 0.9]))
    first, second = summarise(plan, quick + slow)
    assert (first.kind, first.num_runs, second.kind) == (("pqn",), 4, ("dqn",))
    assert first.values["score"].value == pytest.approx(0.9)
    # 30 s or 3,000 steps are the end of both: the slow run then rises from 0.6 to 0.9.
    assert first.values["at equal time"].value == pytest.approx(0.9)
    assert second.values["at equal time"].value == pytest.approx(0.75)
    assert second.values["at equal steps"].value == pytest.approx(0.75)
    assert first.values["at equal steps"].value == pytest.approx(0.75, abs=0.02)
    assert first.values["normalised"].value == pytest.approx(1.0)
    assert first.values["at the start"].value == 0.0


def test_an_agent_of_the_plan_is_the_end_of_a_scale():
    plan = make_plan(looks={}, tasks=change_task(scale=[0.5, "oracle"]))
    oracle = Run("maze", ("oracle",), 0, [dict.fromkeys(("seconds", "frames"), 0.0) | scores(0.9)])
    trained = Run("maze", ("dqn",), 0, [{"seconds": 3.0, "frames": 9.0} | scores(0.7)])
    found = summarise(plan, [trained, oracle])
    assert [entry.values["normalised"].value for entry in found] == pytest.approx([0.5, 1.0])
    assert "at the start" not in found[0].values
    assert "normalised" not in summarise(plan, [trained])[0].values  # not rated yet


def scores(score):
    return {"score": score, "mean": score}


def test_a_level_counts_when_two_looks_in_a_row_reach_it():
    plan = make_plan(tasks=change_task(levels=[0.95, 0.96]))
    run = make_run("pqn", 0, 100, [0.5, 0.96, 0.5, 0.97, 0.95, 0.2])
    reached, never = find_levels(plan, [run])
    assert (reached.first["seconds"], reached.lowest) == (30.0, 0.2)
    assert (never.first, never.lowest) == (None, 0.97)
    untrained = make_run("pqn", 0, 100, [1.0, 1.0, 0.5, 0.4])
    assert [one.first for one in find_levels(plan, [untrained])] == [None, None]


def test_only_kinds_that_are_in_all_tasks_are_compared_over_all():
    tasks = {name: {"scale": [0.0, 1.0]} for name in ("a", "b", "c")}
    plan = make_plan(looks={}, tasks=tasks)
    cells = {"everywhere": "abc", "first": "ab", "last": "bc"}
    runs = [
        Run(task, (kind,), 0, [{"frames": 8.0, "seconds": 1.0} | scores(0.5)])
        for kind, own in cells.items()
        for task in own
    ]
    found = [entry for entry in summarise(plan, runs) if entry.task == "all"]
    assert [(entry.kind, entry.num_runs) for entry in found] == [(("everywhere",), 3)]


def test_a_score_beyond_the_end_of_the_scale_counts_as_more_than_1():
    plan = make_plan(looks={}, tasks=change_task(scale=[0.0, 0.5]))
    run = Run("maze", ("dqn",), 0, [{"frames": 8.0, "seconds": 1.0} | scores(0.6)])
    assert summarise(plan, [run])[0].values["normalised"].value == pytest.approx(1.2)


def test_overestimation_is_left_out_where_a_run_has_none():
    runs = [make_run("dqn", seed, 100, [0.0, 0.0]) for seed in (0, 1)]
    runs[0].rows[-1]["overestimation"] = 3.0
    (entry,) = summarise(make_plan(tasks=change_task(scale=[])), runs)
    assert "overestimation" not in entry.values


def test_overestimation_is_that_of_the_last_third():
    run = make_run("dqn", 0, 100, [0.0, 0.0, 0.0, 0.0])
    for row, excess in zip(run.rows[1:], (9.0, 1.0, 3.0), strict=True):
        row["overestimation"] = excess
    (entry,) = summarise(make_plan(tasks=change_task(scale=[])), [run])
    assert entry.values["overestimation"].value == pytest.approx(2.0)


def test_levels_stand_kind_by_kind_with_their_seeds_in_order():
    plan = make_plan(tasks=change_task(levels=[0.5]))
    rows = [{"frames": frames, "seconds": 1.0, "score": 1.0} for frames in (0, 8, 16)]
    runs = [Run("maze", (kind,), seed, rows) for seed in (0, 1) for kind in ("dqn", "pqn")]
    found = [(one.run.kind[0], one.run.seed) for one in find_levels(plan, runs)]
    assert found == [("dqn", 0), ("dqn", 1), ("pqn", 0), ("pqn", 1)]
