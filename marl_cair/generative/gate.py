"""The quality gate: whether generated transitions may be used at all, and which of them.

Nothing generated is used unless the generator is good on real transitions that it never saw. The
whole is judged by `judge` (thresholds in GateConfig); a single row must also look to all members
like a real one (`Acceptance`, tuned on held-out rows: a split conformal test).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.ensemble import Opinions
from marl_cair.generative.metrics import Certainty, HeldOut, find_doubtful_ends, tune_certainty
from marl_cair.generative.settings import GateConfig, GeneratorSpec
from marl_cair.ranges import FLAG, Range, read_number, read_numbers

_ANY = Range(-math.inf, math.inf, float)
NEVER_CERTAIN = Certainty(end=1.0, going_on=0.0)


@dataclass(frozen=True)
class Acceptance:
    """Bounds that one generated row must keep; those of likelihood are quantiles of real rows."""

    min_log_prob: float = math.inf  # of the whole next state, by the most doubtful member
    min_worst_log_prob: float = math.inf  # of its least likely cell, mean over the members
    max_reward_spread: float = 0.0  # between members, in reward units
    certainty: Certainty = NEVER_CERTAIN  # of ends
    may_end: bool = False  # whether rows that end the episode may be made
    may_be_rare: bool = False  # whether rows with a rare reward may be made


@dataclass(frozen=True)
class GateReport:
    """What the gate found. `reasons` says in plain words why it is shut; empty where it passed."""

    passed: bool
    reasons: tuple[str, ...]
    metrics: Mapping[str, float] = field(default_factory=dict)
    acceptance: Acceptance = field(default_factory=Acceptance)

    def to_dict(self) -> dict[str, Any]:
        """Plain data; `from_dict` makes an equal report of it."""
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


def judge(metrics: Mapping[str, float], config: GateConfig) -> tuple[str, ...]:
    """Reasons to keep the gate shut, in plain words; none where all conditions hold."""
    broken = [name for name, value in metrics.items() if not math.isfinite(value)]
    if broken:
        return (f"{', '.join(broken)} not finite: the networks or the data hold NaN",)
    reasons = [
        *_judge_next_state(metrics, config),
        *_judge_reward(metrics, config),
        *_judge_terminal(metrics, config),
    ]
    if "mask/accuracy" in metrics:
        reasons += _require_least(
            "action mask accuracy", metrics["mask/accuracy"], config.min_mask_accuracy
        )
    return tuple(reasons)


def _judge_next_state(metrics: Mapping[str, float], config: GateConfig) -> list[str]:
    reasons = []
    if "cells/changed_f1" in metrics:
        reasons += _require_least(
            "changed-cell F1", metrics["cells/changed_f1"], config.min_changed_f1
        )
        reasons += _require_ratio(
            "cell error",
            metrics["cells/error"],
            metrics["cells/copy_error"],
            config.max_cell_error_ratio,
        )
        reasons += _require_like(
            "share of cells that change in samples",
            metrics["cells/sampled_changed_share"],
            metrics["cells/changed_share"],
            config.max_change_ratio,
        )
    reasons += _require_ratio(
        "next-state negative log likelihood",
        metrics["likelihood/nll"],
        metrics["likelihood/copy_nll"],
        config.max_nll_ratio,
    )
    if "uniform/mae" in metrics:
        missed = _require_ratio(
            "uniform-plane error",
            metrics["uniform/mae"],
            metrics["uniform/copy_mae"],
            config.max_uniform_mae_ratio,
        )
        unlikely = _require_ratio(
            "uniform-plane negative log likelihood",
            metrics["uniform/nll"],
            metrics["uniform/copy_nll"],
            config.max_nll_ratio,
        )
        # The likeliest value of what changes less often than not is no change, however well its
        # odds are known; those are judged by likelihood then.
        if missed and unlikely and metrics["uniform/far"] > config.max_uniform_far:
            reasons += [f"{missed[0]}, and {unlikely[0]}"]
    return reasons


def _judge_reward(metrics: Mapping[str, float], config: GateConfig) -> list[str]:
    reasons = []
    if metrics.get("reward/std", 0.0) >= config.max_reward_mae_if_constant:
        reasons += _require_least(
            "explained share of reward variance",
            metrics["reward/explained"],
            config.min_reward_explained,
        )
    elif "reward/mae" in metrics:
        reasons += _require_most(
            "reward error", metrics["reward/mae"], config.max_reward_mae_if_constant
        )
    if metrics["reward/num_rare"] >= config.min_rare_rows:
        reasons += _require_most(
            "share of rare rewards that would be made wrong",
            metrics["reward/rare_missed"],
            config.max_rare_missed,
        )
    return reasons


def _judge_terminal(metrics: Mapping[str, float], config: GateConfig) -> list[str]:
    reasons = _require_most(
        "terminal calibration error", metrics["terminal/ece"], config.max_terminal_ece
    )
    if metrics["terminal/num"] < config.min_terminals:
        return reasons  # ends are then not made, see tune_acceptance
    if "terminal/auc" in metrics:
        reasons += _require_least("terminal AUC", metrics["terminal/auc"], config.min_terminal_auc)
    reasons += _require_most(
        "share of overlooked ends", metrics["terminal/overlooked"], config.max_terminal_overlooked
    )
    return reasons


def _require_least(what: str, value: float, least: float) -> list[str]:
    return [] if value >= least else [f"{what} {value:.3f} is below {least:.3f}"]


def _require_most(what: str, value: float, most: float) -> list[str]:
    return [] if value <= most else [f"{what} {value:.3f} is above {most:.3f}"]


def _require_ratio(what: str, value: float, baseline: float, most: float) -> list[str]:
    if value <= most * baseline:
        return []
    return [f"{what} {value:.3f} is above {most:.2f} of the copy baseline's {baseline:.3f}"]


def _require_like(what: str, value: float, real: float, factor: float) -> list[str]:
    if real / factor <= value <= real * factor:
        return []
    return [f"{what} {value:.4f} is not within a factor of {factor:.2f} of the real {real:.4f}"]


def tune_acceptance(held: HeldOut, config: GateConfig) -> Acceptance:
    """Bounds from held-out real rows: each likelihood test turns away a share `tail` of them.

    With fewer than `min_terminals` real ends (`min_rare_rows` rare rewards) that are not in doubt
    it cannot be told whether the generator knows them; rows that have them are then not made.
    """
    opinions = held.opinions
    certainty = _find_certainty(held, config)
    known = ~find_doubtful_ends(held.rare_opinions.terminal, certainty)
    ends = held.rare_rows["next", "terminated"].squeeze(-1)
    spread = config.max_reward_spread * float(held.rows["next", "reward"].std(correction=0))
    return Acceptance(
        min_log_prob=_find_lower_quantile(opinions.log_prob.amin(0), config.tail),
        min_worst_log_prob=_find_lower_quantile(opinions.worst_log_prob.mean(0), config.tail),
        max_reward_spread=max(spread, config.max_reward_mae_if_constant),
        certainty=certainty,
        may_end=int((ends & known).sum()) >= config.min_terminals,
        may_be_rare=int(known.sum()) >= config.min_rare_rows,
    )


def _find_certainty(held: HeldOut, config: GateConfig) -> Certainty:
    """What is asked of members' P(end), chosen on the rows and on every second held-out end."""
    ends = held.rare_rows["next", "terminated"].squeeze(-1)
    return tune_certainty(
        held.opinions.terminal,
        held.rare_opinions.terminal[:, ends][:, ::2],
        config.certain_terminal,
        config.max_terminal_overlooked,
        config.max_doubtful_rows,
    )


def _find_lower_quantile(values: Tensor, share: float) -> float:
    """The conformal bound: a new value of the same kind lies below it with odds <= share."""
    rank = math.floor(share * (values.numel() + 1))
    if rank < 1:
        return -math.inf
    return float(values.sort().values[rank - 1])


def find_refusals(
    opinions: Opinions, acceptance: Acceptance, is_rare: Callable[[Tensor], Tensor]
) -> dict[str, Tensor]:
    """For each test, bool [N]: which rows it turns away. `is_rare` tells rare rewards [N]."""
    ends = opinions.terminal > 0.5
    spread = opinions.reward.amax(0) - opinions.reward.amin(0)
    reward = opinions.reward.mean(0)
    rare = is_rare(reward) & ~torch.tensor(acceptance.may_be_rare)
    return {
        "unlikely_state": ~(opinions.log_prob.amin(0) >= acceptance.min_log_prob),
        "unlikely_cell": ~(opinions.worst_log_prob.mean(0) >= acceptance.min_worst_log_prob),
        "reward_disagreement": ~(spread <= acceptance.max_reward_spread),
        "terminal_disagreement": find_doubtful_ends(opinions.terminal, acceptance.certainty),
        "untested_end": ends.any(0) & ~torch.tensor(acceptance.may_end),
        "untested_reward": rare,
    }


def find_broken_structure(rows: TensorDict, spec: GeneratorSpec) -> Tensor:
    """Find the rows, bool [N], that no game of this spec can hold.

    Static planes must be copied, uniform planes must be constant over the board, and of a group of
    exclusive planes one at most is above 0 at a cell (where that already held before).
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
