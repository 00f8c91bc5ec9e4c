"""The quality gate: whether generated transitions may be used at all, and which of them.

Generated transitions are used only while the generator is good on held-out real transitions.
`check_metrics` checks the generator as a whole (thresholds in GateConfig). A single row must also
look like a real one to all members (`Acceptance`, tuned on held-out rows: a split conformal test).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.ensemble import Predictions
from marl_cair.generative.metrics import Certainty, HeldOut, find_doubtful_ends, tune_certainty
from marl_cair.generative.settings import GateConfig, GeneratorSpec
from marl_cair.ranges import FLAG, Range, read_number, read_numbers

_ANY = Range(-math.inf, math.inf, float)
_NEVER_CERTAIN = Certainty(end=1.0, going_on=0.0)


@dataclass(frozen=True)
class Acceptance:
    """Bounds for one generated row; those of likelihood are quantiles of real rows."""

    min_log_prob: float = math.inf  # of the whole next state, lowest of the members
    min_worst_log_prob: float = math.inf  # of its least likely cell, mean of the members
    max_reward_spread: float = 0.0  # between members, in reward units
    certainty: Certainty = _NEVER_CERTAIN  # of ends
    may_end: bool = False  # whether rows that end the episode are accepted
    may_be_rare: bool = False  # whether rows with a rare reward are accepted


@dataclass(frozen=True)
class GateReport:
    """Result of an evaluation; `reasons` says in words why the gate is shut, empty if it passed."""

    passed: bool
    reasons: tuple[str, ...]
    metrics: Mapping[str, float] = field(default_factory=dict)
    acceptance: Acceptance = field(default_factory=Acceptance)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `from_dict`."""
        values = asdict(self)
        values["acceptance"]["certainty"] = list(self.acceptance.certainty)
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> GateReport:
        """Read what `to_dict` wrote. Raises ValueError for bounds that are no numbers."""
        acceptance = dict(values["acceptance"])
        for name in ("min_log_prob", "min_worst_log_prob", "max_reward_spread"):
            read_number(acceptance, name, _ANY)
        for name in ("may_end", "may_be_rare"):
            read_number(acceptance, name, FLAG)
        end, going_on, *tuned = acceptance["certainty"]
        end, going_on = read_numbers([end, going_on], "certainty", _ANY)
        (is_tuned,) = read_numbers(tuned or [False], "certainty.is_tuned", FLAG)
        acceptance["certainty"] = Certainty(end, going_on, is_tuned)
        return cls(
            read_number(values, "passed", FLAG),
            tuple(map(str, values["reasons"])),
            dict(values["metrics"]),
            Acceptance(**acceptance),
        )


class _Condition(NamedTuple):
    """A bound of one metric. kind: LEAST, MOST, RATIO or FACTOR (of another metric)."""

    kind: int
    text: str
    metric: str
    bound: str  # of GateConfig
    reference: str = ""


LEAST, MOST, RATIO, FACTOR = range(4)
_NLL = "negative log likelihood"
_CONDITIONS = (
    _Condition(LEAST, "changed-cell F1", "cells/changed_f1", "min_changed_f1"),
    _Condition(RATIO, "cell error", "cells/error", "max_cell_error_ratio", "cells/copy_error"),
    _Condition(
        *(FACTOR, "share of cells that change in samples", "cells/sampled_changed_share"),
        *("max_change_ratio", "cells/changed_share"),
    ),
    _Condition(
        *(RATIO, f"next-state {_NLL}", "likelihood/nll", "max_nll_ratio", "likelihood/copy_nll"),
    ),
    _Condition(
        *(RATIO, "uniform-plane error", "uniform/mae", "max_uniform_mae_ratio"),
        "uniform/copy_mae",
    ),
    _Condition(
        *(RATIO, f"uniform-plane {_NLL}", "uniform/nll", "max_nll_ratio", "uniform/copy_nll"),
    ),
    _Condition(
        *(LEAST, "explained share of reward variance", "reward/explained", "min_reward_explained"),
    ),
    _Condition(MOST, "reward error", "reward/mae", "max_reward_mae_if_constant"),
    _Condition(
        *(MOST, "share of rare rewards that would be made wrong", "reward/rare_missed"),
        "max_rare_missed",
    ),
    _Condition(MOST, "terminal calibration error", "terminal/ece", "max_terminal_ece"),
    _Condition(LEAST, "terminal AUC", "terminal/auc", "min_terminal_auc"),
    _Condition(
        *(MOST, "share of overlooked ends", "terminal/overlooked", "max_terminal_overlooked"),
    ),
    _Condition(LEAST, "action mask accuracy", "mask/accuracy", "min_mask_accuracy"),
)


def check_metrics(metrics: Mapping[str, float], config: GateConfig) -> tuple[str, ...]:
    """Reasons to keep the gate shut, in words; none if all conditions hold."""
    broken = [name for name, value in metrics.items() if not math.isfinite(value)]
    if broken:
        return (f"{', '.join(broken)} not finite: the networks or the data hold NaN",)
    is_constant = metrics.get("reward/std", 0.0) < config.max_reward_mae_if_constant
    skipped = {"reward/explained" if is_constant else "reward/mae"}
    if "cells/changed_f1" not in metrics:
        skipped |= {"cells/error", "cells/sampled_changed_share"}
    if metrics["reward/num_rare"] < config.min_rare_rows:
        skipped |= {"reward/rare_missed"}
    if metrics["terminal/num"] < config.min_terminals:  # then no ends are generated
        skipped |= {"terminal/auc", "terminal/overlooked"}
    failures = {
        condition.metric: _describe_failure(condition, metrics, getattr(config, condition.bound))
        for condition in _CONDITIONS
        if condition.metric in metrics and condition.metric not in skipped
    }
    if "uniform/mae" in metrics:
        # The likeliest value of a plane that changes in fewer than half of the rows is no change,
        # however well its odds are known: such planes are checked by likelihood.
        inexact, unlikely = failures["uniform/mae"], failures.pop("uniform/nll")
        fails = inexact and unlikely and metrics["uniform/far"] > config.max_uniform_far
        failures["uniform/mae"] = f"{inexact}, and {unlikely}" if fails else ""
    return tuple(filter(None, failures.values()))


def _describe_failure(condition: _Condition, metrics: Mapping[str, float], bound: float) -> str:
    """The reason in words; empty if the condition holds."""
    text, value = condition.text, metrics[condition.metric]
    if condition.kind == LEAST:
        return "" if value >= bound else f"{text} {value:.3f} is below {bound:.3f}"
    if condition.kind == MOST:
        return "" if value <= bound else f"{text} {value:.3f} is above {bound:.3f}"
    other = metrics[condition.reference]
    if condition.kind == RATIO:
        reason = f"{text} {value:.3f} is above {bound:.2f} of the copy baseline's {other:.3f}"
        return "" if value <= bound * other else reason
    reason = f"{text} {value:.4f} is not within a factor of {bound:.2f} of the real {other:.4f}"
    return "" if other / bound <= value <= other * bound else reason


def tune_acceptance(held: HeldOut, config: GateConfig) -> Acceptance:
    """Bounds from held-out real rows: each likelihood test rejects a share `tail` of them.

    Rows that end (have a rare reward) are accepted only if there are at least `min_terminals`
    (`min_rare_rows`) real ones that are not doubtful: fewer cannot show that they are predicted.
    """
    predicted = held.predictions
    ends = held.rare_rows["next", "terminated"].squeeze(-1)
    certainty = tune_certainty(
        predicted.terminal,
        held.rare_predictions.terminal[:, ends][:, ::2],
        config.certain_terminal,
        config.max_terminal_overlooked,
        config.max_doubtful_rows,
    )
    known = ~find_doubtful_ends(held.rare_predictions.terminal, certainty)
    spread = config.max_reward_spread * float(held.rows["next", "reward"].std(correction=0))
    return Acceptance(
        min_log_prob=_find_lower_quantile(predicted.log_prob.amin(0), config.tail),
        min_worst_log_prob=_find_lower_quantile(predicted.worst_log_prob.mean(0), config.tail),
        max_reward_spread=max(spread, config.max_reward_mae_if_constant),
        certainty=certainty,
        may_end=int((ends & known).sum()) >= config.min_terminals,
        may_be_rare=int(known.sum()) >= config.min_rare_rows,
    )


def _find_lower_quantile(values: Tensor, share: float) -> float:
    """The conformal bound: a new value of the same kind is below it with probability <= share."""
    rank = math.floor(share * (values.numel() + 1))
    return float(values.sort().values[rank - 1]) if rank >= 1 else -math.inf


def find_rejections(
    rows: TensorDict,
    predicted: Predictions,
    acceptance: Acceptance,
    spec: GeneratorSpec,
    is_rare: Callable[[Tensor], Tensor],
) -> dict[str, Tensor]:
    """For each test the `rows` [N] that it rejects, bool [N]. is_rare: rewards [N] -> bool [N]."""
    ends = predicted.terminal > 0.5
    spread = predicted.reward.amax(0) - predicted.reward.amin(0)
    rare = is_rare(predicted.reward.mean(0))
    return {
        "unlikely_state": ~(predicted.log_prob.amin(0) >= acceptance.min_log_prob),
        "unlikely_cell": ~(predicted.worst_log_prob.mean(0) >= acceptance.min_worst_log_prob),
        "reward_disagreement": ~(spread <= acceptance.max_reward_spread),
        "terminal_disagreement": find_doubtful_ends(predicted.terminal, acceptance.certainty),
        "untested_end": ends.any(0) & ~torch.tensor(acceptance.may_end),
        "untested_reward": rare & ~torch.tensor(acceptance.may_be_rare),
        "broken_structure": find_broken_structure(rows, spec),
    }


def find_broken_structure(rows: TensorDict, spec: GeneratorSpec) -> Tensor:
    """Find the rows, bool [N], that are impossible in games of this spec.

    Static planes must be copied, uniform planes must be constant over the board, and of a group of
    exclusive planes at most one may be above 0 at a cell (unless more were before the step).
    """
    now, later = rows["observation"], rows["next", "observation"]
    broken = torch.zeros(now.shape[0], dtype=torch.bool)
    for plane in spec.static_planes:
        broken |= (now[:, plane] != later[:, plane]).flatten(1).any(-1)
    uniform = later[:, spec.num_spatial :].flatten(2)
    if spec.num_uniform:
        broken |= (uniform != uniform[..., :1]).flatten(1).any(-1)
    for group in spec.exclusive_plane_groups:
        crowded = (later[:, list(group)] > 0).sum(1) > 1
        before = (now[:, list(group)] > 0).sum(1) > 1
        broken |= (crowded & ~before).flatten(1).any(-1)
    return broken
