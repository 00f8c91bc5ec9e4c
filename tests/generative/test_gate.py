"""The gate's conditions one by one, and the tests of a single row."""

import json
import math
from dataclasses import replace

import pytest
import torch

from marl_cair.generative.gate import (
    Acceptance,
    GateReport,
    check_quality,
    find_broken_structure,
    measure_rare,
    tune_acceptance,
)
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.quality import Imagined
from marl_cair.generative.settings import GateConfig
from tests.generative.plane_game import SPEC, TERRAIN, TOWER

GOOD = {
    "cells/changed_f1": 0.9, "reward/std": 0.1, "reward/constant_error": 0.01,
    "reward/explained": 0.95,
    "rare/num_rewards": 40.0, "rare/reward_missed": 0.1, "rare/num_ends": 20.0,
    "rare/end_auc": 0.99, "end/calibration_error": 0.001,
    "mask/given_next": 0.999,
}  # fmt: skip


def make_imagined(surety=(0.0,), end=(0.0,), reward=(0.0,)):
    num = max(len(surety), len(end), len(reward))
    surety, end, reward = (
        torch.tensor(values).expand(num) if len(values) == 1 else torch.tensor(values)
        for values in (surety, end, reward)
    )
    return Imagined(torch.zeros(num, 1), torch.zeros(num, 1), reward, end, surety)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"cells/changed_f1": 0.41}, "changed-cell F1 0.410 is below 0.600"),
        ({"reward/explained": 0.2}, "explained share of reward variance 0.200 is below 0.600"),
        (
            {"reward/std": 0.0, "reward/constant_error": 0.3},
            "relative error of a constant reward 0.300 is above 0.200",
        ),
        ({"rare/reward_missed": 0.5}, "share of rare rewards made wrong 0.500 is above 0.400"),
        ({"end/calibration_error": 0.1}, "end calibration error 0.100 is above 0.020"),
        ({"rare/end_auc": 0.7}, "end AUC 0.700 is below 0.850"),
        ({"cells/change_explained": 0.5}, "explained share of change 0.500 is below 0.600"),
        ({"mask/given_next": 0.9}, "action mask accuracy 0.900 is below 0.980"),
        ({"scalars/least_gain": -0.3}, "gain of the worst scalar -0.300 is below -0.030"),
        ({"mask/gain": -0.05}, "accuracy gain of action masks -0.050 is below -0.030"),
        ({"cells/moved": math.nan}, "cells/moved not finite: the network or the data hold NaN"),
    ],
)
def test_each_condition_shuts_the_gate_alone(changes, reason):
    assert check_quality(GOOD, GateConfig()) == ()
    (found,) = check_quality(GOOD | changes, GateConfig())
    assert found.endswith(reason)


@pytest.mark.parametrize(
    "changes",
    [
        {
            "reward/std": 0.0,
            "reward/constant_error": 0.0,
            "reward/explained": -3.0,
        },  # a constant reward
        {"rare/num_rewards": 3.0, "rare/reward_missed": 1.0},  # too few to judge
        {"rare/num_ends": 3.0, "rare/end_auc": 0.1},
        {"cells/change_explained": 0.9, "cells/changed_f1": 0.1},  # shades are never exact
    ],
)
def test_what_rows_cannot_show_is_not_checked(changes):
    assert check_quality(GOOD | changes, GateConfig()) == ()


def test_an_open_gate_has_slack():
    almost = GOOD | {
        "cells/changed_f1": 0.55, "rare/reward_missed": 0.5, "rare/end_auc": 0.75
    }  # fmt: skip
    assert len(check_quality(almost, GateConfig())) == 3
    assert check_quality(almost, GateConfig().loosen()) == ()
    assert GateConfig(min_terminal_auc=0.0).loosen().min_terminal_auc == 0.0


def test_missed_rewards_and_recalled_ends_are_shares_of_rare_rows():
    rows = make_empty_transitions(SPEC, 4)
    rows["next", "reward"] = torch.tensor([[1.0], [1.0], [-1.0], [-1.0]])
    rows["next", "terminated"][2:] = True
    made = make_imagined(reward=(0.8, 0.2, -0.9, 0.0), end=(0.0, 0.0, 0.9, 0.1))
    rare = torch.tensor([True, True, True, True])  # the last is an end that is not recognised
    numbers = measure_rare(rows, made, rare, going_on=torch.tensor([0.2, 0.0]))
    assert numbers == {
        "rare/num_rewards": 3.0,
        "rare/num_ends": 2.0,
        "rare/reward_missed": pytest.approx(1 / 3),
        "rare/end_auc": 0.75,  # 0.9 above both, 0.1 above one
        "rare/end_recall": 0.5,
    }


def test_the_acceptance_rejects_a_tail_of_real_rows():
    made = make_imagined(surety=tuple(float(n) for n in range(100)))
    numbers, ends = {"rare/num_rewards": 3.0}, torch.full((30,), 0.9)
    acceptance = tune_acceptance(made, ends, numbers, GateConfig(tail=0.05))
    assert acceptance.min_surety == 4.0
    assert (acceptance.may_end, acceptance.may_be_rare) == (True, False)
    accepted = acceptance.accept(made, torch.zeros(100, dtype=torch.bool))
    assert int((~accepted).sum()) == 4


@pytest.mark.parametrize(
    ("ends", "unlikely"),
    [
        ([0.9] * 10, 0.2),  # recognised
        ([0.01, 0.03, 0.05] + [0.1] * 7, 0.05),  # the third of ten: three of eleven are below 30 %
        ([0.04] * 10, 0.04),  # alike, as the same state always is
        ([0.05, 0.1], 0.05),  # too few for 30 %: the least likely of them
        ([0.9], 0.2),
    ],
)
def test_rows_that_may_end_are_not_generated_as_going_on(ends, unlikely):
    made, numbers = make_imagined(surety=(1.0,) * 40), {"rare/num_rewards": 3.0}
    acceptance = tune_acceptance(made, torch.tensor(ends), numbers, GateConfig())
    assert acceptance.unlikely == pytest.approx(unlikely)
    assert acceptance.may_end == (len(ends) >= 10)
    shown = make_imagined(end=(unlikely - 1e-3, unlikely + 1e-3, *ends))
    rare = torch.zeros(2 + len(ends), dtype=torch.bool)
    acceptance = replace(acceptance, min_surety=-math.inf, may_end=False)
    accepted = acceptance.accept(shown, rare)
    assert accepted[:2].tolist() == [True, False]
    assert accepted[2:].float().mean() <= 0.3


def test_all_ends_may_be_overlooked_where_that_is_set():
    made, numbers = make_imagined(surety=(1.0,) * 40), {"rare/num_rewards": 3.0}
    ends = torch.full((10,), 0.01)
    open_gate = GateConfig(max_terminal_overlooked=1.0)
    assert tune_acceptance(made, ends, numbers, open_gate).unlikely == pytest.approx(0.2)


def test_unsure_untested_and_rare_rows_are_rejected():
    made = make_imagined(end=(0.0, 0.5, 0.9, 0.0), surety=(-1.0,))
    rare = torch.tensor([False, False, True, True])
    lenient = Acceptance(-math.inf, 0.8, 0.2, may_end=True, may_be_rare=True)
    assert lenient.accept(made, rare).tolist() == [True, False, True, True]
    strict = Acceptance(-math.inf, 0.8, 0.2, may_end=False, may_be_rare=False)
    assert strict.accept(made, rare).tolist() == [True, False, False, False]
    assert not Acceptance().accept(made, rare).any()


def test_two_exclusive_planes_at_a_cell_break_a_row():
    rows = make_empty_transitions(SPEC, 3)
    rows["next", "observation"][:2, TOWER, 1, 1] = 255
    rows["next", "observation"][:2, TERRAIN, 1, 1] = 200
    rows["observation"][1] = rows["next", "observation"][1]  # they were there before
    assert find_broken_structure(rows, SPEC).tolist() == [True, False, False]


def test_a_report_survives_json():
    report = GateReport(
        False, ("why",), {"cells/changed_f1": 0.5}, Acceptance(-3.0, 0.8, 0.1, True)
    )
    assert GateReport.from_dict(json.loads(json.dumps(report.to_dict()))) == report
    for name in ("certain", "unlikely"):
        broken = report.to_dict() | {"acceptance": report.to_dict()["acceptance"] | {name: "much"}}
        with pytest.raises(ValueError, match=name):
            GateReport.from_dict(broken)
