"""The gate's conditions one by one, and the tests of a single row."""

import json
import math
from typing import Any

import pytest
import torch

from marl_cair.generative import GateConfig
from marl_cair.generative.ensemble import Predictions
from marl_cair.generative.gate import (
    Acceptance,
    GateReport,
    check_metrics,
    find_broken_structure,
    find_rejections,
)
from marl_cair.generative.heldout import make_empty_transitions
from marl_cair.generative.metrics import (
    Certainty,
    _find_marginal_nll,
    compute_metrics,
    decide_mask,
    find_auc,
    find_calibration_error,
    find_doubtful_ends,
    predict_heldout,
    tune_certainty,
)
from marl_cair.generative.networks.outcome import RewardBins
from marl_cair.generative.rare import RareCounts
from tests.generative.conftest import train
from tests.generative.plane_game import SPEC, TERRAIN, TOWER

GOOD = {
    "cells/changed_f1": 0.9, "cells/error": 0.1, "cells/copy_error": 1.0,
    "cells/changed_share": 0.01, "cells/sampled_changed_share": 0.011,
    "likelihood/nll": 5.0, "likelihood/copy_nll": 30.0,
    "uniform/mae": 1.0, "uniform/copy_mae": 9.0, "uniform/nll": 1.0, "uniform/copy_nll": 2.0,
    "uniform/far": 0.5,
    "reward/std": 0.1, "reward/mae": 0.01, "reward/explained": 0.95,
    "reward/num_rare": 40.0, "reward/rare_missed": 0.1,
    "terminal/ece": 0.001, "terminal/num": 20.0, "terminal/auc": 0.99,
    "terminal/overlooked": 0.1,
    "mask/accuracy": 0.999,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"cells/changed_f1": 0.41}, "changed-cell F1 0.410 is below 0.600"),
        ({"cells/error": 0.8}, "cell error 0.800 is above 0.70 of the copy baseline's 1.000"),
        (
            {"cells/sampled_changed_share": 0.03},
            "0.0300 is not within a factor of 1.50 of the real",
        ),
        (
            {"likelihood/nll": 25.0},
            "next-state negative log likelihood 25.000 is above 0.80 of the",
        ),
        (
            {"uniform/mae": 6.0, "uniform/nll": 1.9},
            "error 6.000 is above 0.60 of the copy baseline's 9.000, and uniform-plane negative",
        ),
        ({"reward/explained": 0.3}, "explained share of reward variance 0.300 is below 0.700"),
        ({"reward/rare_missed": 0.9}, "made wrong 0.900 is above 0.400"),
        ({"terminal/ece": 0.1}, "terminal calibration error 0.100 is above 0.020"),
        ({"terminal/auc": 0.7}, "terminal AUC 0.700 is below 0.850"),
        ({"terminal/overlooked": 0.4}, "share of overlooked ends 0.400 is above 0.300"),
        ({"mask/accuracy": 0.9}, "action mask accuracy 0.900 is below 0.980"),
        ({"reward/std": 0.0, "reward/mae": 0.2}, "reward error 0.200 is above 0.001"),
        ({"likelihood/nll": math.nan}, "likelihood/nll not finite: the networks or the data"),
        # Terminal rewards count if no other reward does.
        ({"reward/std": 0.0, "reward/mae": 0.0, "reward/rare_missed": 0.9}, "made wrong 0.900"),
    ],
)
def test_each_condition_alone_shuts_the_gate(changes, reason):
    (found,) = check_metrics({**GOOD, **changes}, GateConfig())
    assert reason in found


@pytest.mark.parametrize(
    "changes",
    [
        {},
        # The best single prediction of a clock is no change.
        {
            "uniform/mae": 0.07,
            "uniform/copy_mae": 0.07,
            "uniform/copy_nll": 0.6,
            "uniform/far": 0.01,
        },
        {"uniform/mae": 9.0},  # unpredictable, but with the right odds
        # Few ends and rare rewards.
        {"terminal/num": 3.0, "terminal/overlooked": 1.0},
        {"reward/num_rare": 3.0, "reward/rare_missed": 1.0},
    ],
)
def test_good_metrics_open_the_gate(changes):
    assert check_metrics({**GOOD, **changes}, GateConfig()) == ()


@pytest.mark.parametrize(
    ("between", "beyond"),
    [
        ({"reward/explained": 0.6}, {"reward/explained": 0.4}),
        ({"reward/rare_missed": 0.5}, {"reward/rare_missed": 0.6}),
        ({"terminal/overlooked": 0.4}, {"terminal/overlooked": 0.6}),
        ({"cells/changed_f1": 0.55}, {"cells/changed_f1": 0.53}),  # little slack, as little noise
        ({"cells/error": 0.72}, {"cells/error": 0.74}),
        ({"likelihood/nll": 24.4}, {"likelihood/nll": 24.8}),
        (
            {"uniform/mae": 5.7, "uniform/nll": 1.63},
            {"uniform/mae": 5.8, "uniform/nll": 1.65},
        ),
    ],
)
def test_an_open_gate_stays_open_within_its_slack(between, beyond):
    config = GateConfig()
    assert check_metrics({**GOOD, **between}, config) != ()
    assert check_metrics({**GOOD, **between}, config.loosen()) == ()
    assert check_metrics({**GOOD, **beyond}, config.loosen()) != ()
    assert check_metrics({**GOOD, **between, "terminal/auc": 0.8}, config.loosen()) != ()


def test_marginal_baseline_of_a_clock_is_its_odds_of_stepping():
    now = torch.arange(100, 200, dtype=torch.uint8)[:, None]
    steps = (torch.arange(100) % 4 == 0)[:, None]
    odds = torch.tensor(0.25)
    entropy = -(odds * odds.log() + (1 - odds) * (1 - odds).log())
    nll = _find_marginal_nll(now, now - steps.to(torch.uint8))
    assert nll == pytest.approx(float(entropy) + 1 / 100, abs=1e-5)  # the odds are fitted


def test_marginal_baseline_is_as_good_as_it_would_be_on_other_rows():
    """Drawn evenly from 64 values: log(64), and half a nat for each number fitted to 400 rows."""
    draws = torch.Generator().manual_seed(0)
    found = []
    for _ in range(20):
        real = torch.randint(1, 65, (400, 1), generator=draws).to(torch.uint8)
        found.append(_find_marginal_nll(torch.zeros_like(real), real))
    expected = math.log(64) + 64 / (2 * 400)
    assert sum(found) / len(found) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize(
    ("terminal", "in_doubt"),
    [([0.05, 0.1], False), ([0.5, 0.45], True), ([0.9, 0.95], False), ([0.1, 0.9], True)],
)
def test_an_end_is_in_doubt_unless_all_members_are_sure(terminal, in_doubt):
    certainty = Certainty(end=0.8, going_on=0.2)
    assert bool(find_doubtful_ends(torch.tensor(terminal)[:, None], certainty)[0]) is in_doubt


def test_ends_that_are_predicted_well_need_only_the_usual_certainty():
    rows, ends = torch.full((2, 100), 0.01), torch.full((2, 20), 0.9)
    assert tune_certainty(rows, ends, 0.8, 0.3, 0.25) == Certainty(0.8, pytest.approx(0.2))
    assert not tune_certainty(rows, ends[:, :0], 0.8, 0.3, 0.25).is_tuned


def test_ends_that_are_hard_to_predict_are_doubtful_earlier():
    rows = torch.linspace(0.0, 0.1, 101).repeat(2, 1)
    ends = torch.linspace(0.05, 0.15, 21).repeat(2, 1)
    certainty = tune_certainty(rows, ends, 0.8, 0.4, 0.25)
    # A fifth of the ends, half of the allowed share, is below 0.07, but at most a quarter of all
    # rows may be rejected.
    assert certainty == Certainty(0.8, pytest.approx(0.075, abs=1e-3), is_tuned=True)
    certainty = tune_certainty(rows, ends, 0.8, 0.4, 0.5)
    assert certainty.going_on == pytest.approx(0.07, abs=1e-3)
    overlooked = ~find_doubtful_ends(ends, certainty)
    assert float(overlooked.float().mean()) == pytest.approx(0.2, abs=0.05)


@pytest.mark.slow
def test_the_bound_of_ends_that_is_checked_is_the_one_that_is_applied(real_rows, monkeypatch):
    """An ensemble that hardly predicts ends: one half of the rows tunes, the other one tests."""
    checked = []

    def note(*given: Any):
        checked.append(given[-1])
        return compute_metrics(*given)

    monkeypatch.setattr("marl_cair.generative.generator.compute_metrics", note)
    certainty = train(real_rows, real_rows, 60).evaluate().acceptance.certainty
    assert certainty.is_tuned
    assert checked == [certainty]


@pytest.mark.parametrize(
    ("terminal", "certainty", "missed"),
    [
        (0.01, Certainty(0.8, 0.2), 1.0),  # surely continuing, which is wrong for all
        (0.5, Certainty(0.8, 0.2), 0.0),  # all doubtful: none is generated
        (0.15, Certainty(0.8, 0.1, is_tuned=True), 0.0),
    ],
)
def test_doubtful_rows_do_not_count_as_missed(
    trained,
    real_rows,
    terminal,
    certainty,
    missed,
):
    """Rewards and ends; every second end tests a tuned certainty."""
    ends = real_rows[real_rows["next", "terminated"].squeeze(-1)][:21].clone()
    ends["next", "reward"] += 100.0
    held = predict_heldout(trained.ensemble, real_rows[:64], ends, torch.Generator().manual_seed(0))
    predicted = held.rare_predictions
    predicted = predicted._replace(terminal=torch.full_like(predicted.terminal, terminal))
    bins = RewardBins(SPEC.reward_range, trained.config.size.reward_bins)
    counts = RareCounts(bins, trained.config.rare_reward_share)
    metrics = compute_metrics(held._replace(rare_predictions=predicted), SPEC, counts, certainty)
    assert metrics["reward/rare_missed"] == metrics["terminal/overlooked"] == missed
    assert metrics["reward/num_rare"] == (10 if certainty.is_tuned else 21)
    assert metrics["terminal/num"] == 21


def test_a_report_survives_plain_data():
    acceptance = Acceptance(-3.0, -1.0, 0.1, Certainty(0.8, 0.05, True), may_end=True)
    report = GateReport(False, ("too early",), {"mask/accuracy": 0.9}, acceptance)
    assert GateReport.from_dict(json.loads(json.dumps(report.to_dict()))) == report


def make_predictions(**changes):
    """Two members that agree on one ordinary row."""
    fields: dict[str, torch.Tensor] = {
        "log_prob": torch.full((2, 1), -5.0),
        "worst_log_prob": torch.full((2, 1), -2.0),
        "uniform_log_prob": torch.full((2, 1), -1.0),
        "reward": torch.zeros(2, 1),
        "reward_is_zero": torch.ones(2, 1),
        "terminal": torch.full((2, 1), 0.01),
        "mask": torch.zeros(2, 1, 3),
    }
    return Predictions(**{**fields, **{name: torch.tensor(v) for name, v in changes.items()}})


BOUNDS = Acceptance(-10.0, -4.0, 0.05, Certainty(0.8, 0.2), may_end=True, may_be_rare=True)


def refuse(predicted, bounds: Acceptance = BOUNDS):
    rejections = find_rejections(
        make_empty_transitions(SPEC, 1), predicted, bounds, SPEC, lambda reward: reward.abs() > 0.5
    )
    return {name for name, which in rejections.items() if bool(which[0])}


def test_agreed_likely_row_is_accepted():
    assert refuse(make_predictions()) == set()


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"log_prob": [[-5.0], [-11.0]]}, "unlikely_state"),
        ({"log_prob": [[-5.0], [math.nan]]}, "unlikely_state"),
        ({"worst_log_prob": [[-2.0], [-6.5]]}, "unlikely_cell"),
        ({"reward": [[0.0], [0.06]]}, "reward_disagreement"),
        ({"terminal": [[0.1], [0.9]]}, "terminal_disagreement"),
        ({"terminal": [[0.01], [0.3]]}, "terminal_disagreement"),
    ],
)
def test_one_doubtful_member_turns_the_row_away(changes, name):
    assert refuse(make_predictions(**changes)) == {name}


def test_ends_and_rare_rewards_are_made_only_if_tested():
    ends = make_predictions(terminal=[[0.99], [0.99]])
    rare = make_predictions(reward=[[0.9], [0.9]])
    untested = Acceptance(-10.0, -4.0, 0.05, Certainty(0.8, 0.2), may_end=False, may_be_rare=False)
    assert refuse(ends) == set()
    assert refuse(rare) == set()
    assert refuse(ends, untested) == {"untested_end"}
    assert refuse(rare, untested) == {"untested_reward"}


def test_broken_structure_is_found():
    rows = make_empty_transitions(SPEC, 5)
    later = rows["next", "observation"]
    later[1, TERRAIN, 0, 0] = 200  # a static plane changed
    later[2, SPEC.num_spatial, 1, 1] = 5  # a uniform plane is not uniform
    rows["observation"][:, TERRAIN, 2, 2] = 200
    later[:, TERRAIN, 2, 2] = 200
    later[3, TOWER, 2, 2] = 255  # a tower on a rock: exclusive planes
    rows["observation"][4, TOWER, 2, 2] = 255  # it was so before the step
    later[4, TOWER, 2, 2] = 255
    assert find_broken_structure(rows, SPEC).tolist() == [False, True, True, True, False]


def test_auc_counts_ties_half():
    scores = torch.tensor([0.1, 0.5, 0.5, 0.9])
    assert find_auc(scores, torch.tensor([False, False, True, True])) == 0.875
    assert find_auc(scores, torch.tensor([True, True, True, True])) is None


def test_calibration_error_is_the_gap():
    probabilities = torch.tensor([0.25] * 4 + [0.95] * 4)
    labels = torch.tensor([True, False, False, False] + [True] * 2 + [False] * 2)
    assert find_calibration_error(probabilities, labels) == pytest.approx(0.225)


def test_no_op_is_always_legal():
    assert decide_mask(torch.full((2, 1, 3), -9.0), noop_action=1).tolist() == [
        [False, True, False]
    ]
