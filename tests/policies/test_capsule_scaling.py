"""Costs of updates by input and actions: estimated, measured, stored and drawn."""

import sys

import pytest

from benchmarks.capsule_scaling import (
    BODIES,
    Case,
    Cost,
    draw,
    format_table,
    list_cases,
    read_costs,
    run,
    write_costs,
)


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_a_case_is_measured_in_a_process_of_its_own():
    cost = run(Case("capsule", 16, 4, 2), 1.0)
    assert cost.measured_mb > 4 * cost.parameters * 4 / 1e6
    assert 0.0 < cost.seconds < 60.0


def test_a_case_that_is_too_large_is_not_run(tmp_path):
    case = Case("thesis_capsule", 84, 300, 16)
    cost = run(case, 8.0)
    assert cost.estimated_mb > 8_000
    assert cost.measured_mb is None
    assert "| not run | not run |" in format_table({case: cost})
    path = tmp_path / "costs.csv"
    write_costs({case: cost}, path)
    ((again, kept),) = read_costs(path).items()
    assert again == case
    assert kept[2:] == (None, None)
    assert kept.estimated_mb == pytest.approx(cost.estimated_mb, rel=1e-3)


def test_costs_are_drawn(tmp_path):
    costs = {case: Cost(1_000, 5.0, 6.0, 0.1) for case in list_cases(BODIES, 16)}
    draw(costs, tmp_path / "costs.png")
    assert (tmp_path / "costs.png").read_bytes().startswith(b"\x89PNG")
