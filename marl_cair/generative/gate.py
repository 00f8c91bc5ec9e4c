"""The quality gate: whether generated transitions may be used at all, and which of them.

Generated transitions are used only while the generator is good on held-out real transitions.
`check_quality` checks the generator as a whole (thresholds in GateConfig); `Acceptance` checks a
single row, with bounds that are tuned on held-out rows (split conformal tests).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.quality import Imagined, find_auc
from marl_cair.generative.settings import CERTAIN_TERMINAL, GateConfig, GeneratorSpec
from marl_cair.ranges import FLAG, Range, read_number

_CONSTANT = 1e-3  # standard deviation of rewards: where it is smaller they hardly vary
_ANY = Range(-math.inf, math.inf, float)


@dataclass(frozen=True)
class Acceptance:
    """Bounds for one generated row."""

    min_surety: float = math.inf  # log probability of the next observation
    certain: float = 1.0  # P(end) of an end, at least
    unlikely: float = 0.0  # P(end) of a row that continues is below
    may_end: bool = False  # whether rows that end the episode are accepted
    may_be_rare: bool = False  # whether rows with a rare reward are accepted

    def accept(self, made: Imagined, rare: Tensor) -> Tensor:
        """Which rows are accepted, bool [N]. rare: bool [N], rewards that are rare."""
        ends, goes_on = made.end >= self.certain, made.end < self.unlikely
        accepted = (made.surety >= self.min_surety) & (ends & self.may_end | goes_on)
        return accepted & (~rare | self.may_be_rare | ends)


@dataclass(frozen=True)
class GateReport:
    """Result of an evaluation; `reasons` says in words why the gate is shut, empty if it passed."""

    passed: bool
    reasons: tuple[str, ...]
    metrics: Mapping[str, float] = field(default_factory=dict)
    acceptance: Acceptance = field(default_factory=Acceptance)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `from_dict`."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> GateReport:
        """Read what `to_dict` wrote. Raises ValueError for bounds that are no numbers."""
        acceptance = dict(values["acceptance"])
        for name in ("min_surety", "certain", "unlikely"):
            read_number(acceptance, name, _ANY)
        for name in ("may_end", "may_be_rare"):
            read_number(acceptance, name, FLAG)
        return cls(
            read_number(values, "passed", FLAG),
            tuple(map(str, values["reasons"])),
            dict(values["metrics"]),
            Acceptance(**acceptance),
        )


class _Condition(NamedTuple):
    """A bound of one number."""

    text: str
    number: str
    bound: str  # of GateConfig
    is_least: bool


_CONDITIONS = (
    _Condition("changed-cell F1", "cells/changed_f1", "min_changed_f1", True),
    _Condition("explained share of change", "cells/change_explained", "min_change_explained", True),
    _Condition(
        "explained share of reward variance", "reward/explained", "min_reward_explained", True
    ),
    _Condition("accuracy gain of the worst scalar", "scalars/least_gain", "min_scalar_gain", True),
    _Condition(
        "relative error of a constant reward",
        "reward/constant_error",
        "max_constant_reward_error",
        False,
    ),
    _Condition("share of rare rewards made wrong", "rare/reward_missed", "max_rare_missed", False),
    _Condition(
        "end calibration error", "end/calibration_error", "max_terminal_ece", is_least=False
    ),
    _Condition("end AUC", "rare/end_auc", "min_terminal_auc", True),
    # A mask is to fit the state that is generated with it: here the real one.
    _Condition("action mask accuracy", "mask/given_next", "min_mask_accuracy", True),
    _Condition("accuracy gain of action masks", "mask/gain", "min_scalar_gain", True),
)


def check_quality(numbers: Mapping[str, float], config: GateConfig) -> tuple[str, ...]:
    """Reasons to keep the gate shut, in words; none if all conditions hold.

    Numbers that rows could not determine are not checked.
    """
    broken = [name for name, value in numbers.items() if not math.isfinite(value)]
    if broken:
        return (f"{', '.join(broken)} not finite: the network or the data hold NaN",)
    is_constant = numbers.get("reward/std", 0.0) < _CONSTANT
    skipped = {"reward/explained" if is_constant else "reward/constant_error"}
    if "cells/change_explained" in numbers:  # a picture or a vector: never exact
        skipped |= {"cells/changed_f1"}
    if numbers["rare/num_rewards"] < config.min_rare_rows:
        skipped |= {"rare/reward_missed"}
    if numbers["rare/num_ends"] < config.min_terminals:  # then no ends are generated
        skipped |= {"rare/end_auc"}
    reasons = []
    for text, name, bound, is_least in _CONDITIONS:
        value, limit = numbers.get(name), getattr(config, bound)
        if value is None or name in skipped:
            continue
        if value < limit if is_least else value > limit:
            side = "below" if is_least else "above"
            reasons.append(f"{text} {value:.3f} is {side} {limit:.3f}")
    return tuple(reasons)


def measure_rare(
    rows: TensorDict, made: Imagined, rare_reward: Tensor, going_on: Tensor
) -> dict[str, float]:
    """Numbers of held-out rare rows [R]. rare_reward: bool [R]; going_on: P(end) [G] of other rows,
    which do not end.

    A rare reward is missed if its error is more than half of it. Those of unrecognised ends do not
    count: what is expected there is the reward of a row that goes on.
    """
    ends, rewards = rows["next", "terminated"][:, 0], rows["next", "reward"][:, 0]
    rare_reward = rare_reward & (~ends | (made.end > 0.5))
    numbers = {
        "rare/num_rewards": float(rare_reward.sum()),
        "rare/num_ends": float(ends.sum()),
    }
    if rare_reward.any():
        missed = (made.reward - rewards).abs() > 0.5 * rewards.abs()
        numbers["rare/reward_missed"] = float(missed[rare_reward].float().mean())
    if ends.any():
        certainty = torch.cat([made.end[ends], going_on])
        is_end = torch.arange(len(certainty)) < int(ends.sum())
        auc = find_auc(certainty, is_end)
        if auc is not None:
            numbers["rare/end_auc"] = auc
        numbers["rare/end_recall"] = float((made.end > 0.5)[ends].float().mean())
    return numbers


def tune_acceptance(
    made: Imagined, ends: Tensor, numbers: Mapping[str, float], config: GateConfig
) -> Acceptance:
    """Bounds from predictions for held-out real rows, of which a share `tail` is rejected, and from
    P(end) `ends` [E] of held-out ends, of which `max_terminal_overlooked` may pass as going on.

    Rows that end (have a rare reward) are accepted only if there are at least `min_terminals`
    (`min_rare_rows`) held-out ones, as `measure_rare` counts them: fewer cannot show that they are
    predicted.
    """
    unlikely = 1.0 - CERTAIN_TERMINAL
    if len(ends):
        # The least likely of few ends is the bound, though not all of the share is used then.
        share = max(config.max_terminal_overlooked, 1.0 / (len(ends) + 1))
        unlikely = min(unlikely, _find_bound(ends, share))
    return Acceptance(
        min_surety=_find_bound(made.surety, config.tail),
        certain=CERTAIN_TERMINAL,
        unlikely=unlikely,
        may_end=len(ends) >= config.min_terminals,
        may_be_rare=numbers["rare/num_rewards"] >= config.min_rare_rows,
    )


def _find_bound(values: Tensor, share: float) -> float:
    """The value below which a new one lies with a chance of at most `share`, as ranks show."""
    rank = math.floor(share * (values.numel() + 1) + 1e-9)
    if not 1 <= rank <= values.numel():
        return -math.inf if rank < 1 else math.inf
    return float(values.sort().values[rank - 1])


def find_broken_structure(rows: TensorDict, spec: GeneratorSpec) -> Tensor:
    """Rows, bool [N], with more than one value of a group of exclusive planes at a cell, unless
    there were as many before the step.
    """
    now, later = rows["observation"], rows["next", "observation"]
    broken = torch.zeros(now.shape[0], dtype=torch.bool)
    for group in spec.exclusive_plane_groups:
        crowded, before = ((board[:, list(group)] > 0).sum(1) > 1 for board in (later, now))
        broken |= (crowded & ~before).flatten(1).any(-1)
    return broken
