"""Metrics of the generator on held-out real transitions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.ensemble import Ensemble, Predictions
from marl_cair.generative.rare import RareCounts
from marl_cair.generative.settings import GeneratorSpec

NUM_CALIBRATION_BINS = 10


class Certainty(NamedTuple):
    """Bounds of all members' P(end) for a row that is not doubtful."""

    end: float  # least P(end) of an end
    going_on: float  # largest P(end) of a row that continues
    is_tuned: bool = False  # whether `going_on` was tuned on held-out ends


class HeldOut(NamedTuple):
    """Held-out real rows and their predictions."""

    rows: TensorDict
    predictions: Predictions
    likeliest: Tensor  # uint8 [N, C, H, W], decoded next states
    sampled: Tensor  # uint8 [N, C, H, W]
    rare_rows: TensorDict  # [R], held-out rows with a rare reward or an end: too few in `rows`
    rare_predictions: Predictions

    def select(self, which: slice) -> HeldOut:
        """Return some of the rows, and all rare ones."""
        return self._replace(
            rows=self.rows[which],
            predictions=Predictions(*(part[:, which] for part in self.predictions)),
            likeliest=self.likeliest[which],
            sampled=self.sampled[which],
        )


def predict_heldout(
    ensemble: Ensemble, rows: TensorDict, rare_rows: TensorDict, generator: torch.Generator
) -> HeldOut:
    """Predict real rows, and decode and sample their next states."""
    observation, action = rows["observation"], rows["action"]
    return HeldOut(
        rows,
        ensemble.predict(rows),
        ensemble.propose(observation, action, None),
        ensemble.propose(observation, action, generator),
        rare_rows,
        ensemble.predict(rare_rows),
    )


def compute_metrics(
    held: HeldOut, spec: GeneratorSpec, counts: RareCounts, certainty: Certainty
) -> dict[str, float]:
    """All metrics by name, without those that these rows cannot determine.

    counts: of rare rewards. certainty: of ends; rows with a doubtful end are never generated.
    """
    in_doubt = find_doubtful_ends(held.rare_predictions.terminal, certainty)
    # Every second end tuned the certainty, and does not test it.
    checked = torch.ones(held.rare_rows.shape[0], dtype=torch.bool)
    if certainty.is_tuned:
        ends = held.rare_rows["next", "terminated"].squeeze(-1).nonzero().squeeze(-1)
        checked[ends[::2]] = False
    return {
        **_measure_cells(held, spec),
        **_measure_uniform(held, spec),
        **_measure_likelihood(held, spec),
        **_measure_reward(held, counts, in_doubt, checked),
        **_measure_terminal(held, in_doubt, checked, certainty),
        **_measure_mask(held, spec),
    }


def _measure_cells(held: HeldOut, spec: GeneratorSpec) -> dict[str, float]:
    """Cells of the moving planes: changed-cell F1, error in 0..255, accuracy of each plane."""
    moving = list(spec.moving_planes)
    now, real = held.rows["observation"][:, moving], held.rows["next", "observation"][:, moving]
    guess, sample = held.likeliest[:, moving], held.sampled[:, moving]
    changed, predicted = _differ(real, now, spec), _differ(guess, now, spec)
    hits = float((changed & predicted & ~_differ(guess, real, spec)).sum())
    flat = (held.likeliest == held.rows["next", "observation"]).flatten(1)
    metrics = {
        "cells/copy_error": _find_error(now, real),
        "cells/error": _find_error(guess, real),
        "cells/sampled_error": _find_error(sample, real),
        "cells/exact_match": float(flat.all(-1).float().mean()),
        "cells/changed_share": float(changed.float().mean()),
        "cells/sampled_changed_share": float(_differ(sample, now, spec).float().mean()),
    }
    if changed.any():
        metrics["cells/changed_f1"] = 2.0 * hits / float(changed.sum() + predicted.sum())
        metrics["cells/changed_recall"] = hits / float(changed.sum())
    return metrics | _measure_planes(moving, guess, now, real)


def _differ(values: Tensor, others: Tensor, spec: GeneratorSpec) -> Tensor:
    return (values.int() - others.int()).abs() > spec.tolerance


def _measure_uniform(held: HeldOut, spec: GeneratorSpec) -> dict[str, float]:
    if not spec.num_uniform:
        return {}
    first = spec.num_spatial
    now = held.rows["observation"][:, first:, 0, 0]
    real = held.rows["next", "observation"][:, first:, 0, 0]
    guess, sample = held.likeliest[:, first:, 0, 0], held.sampled[:, first:, 0, 0]
    metrics = {
        "uniform/copy_mae": _find_error(now, real),
        "uniform/mae": _find_error(guess, real),
        "uniform/sampled_mae": _find_error(sample, real),
        "uniform/far": _share(((guess.int() - real.int()).abs() > 1).any(-1)),
        "uniform/nll": _mix(held.predictions.uniform_log_prob),
        "uniform/copy_nll": sum(
            _find_marginal_nll(now[:, place], real[:, place]) for place in range(spec.num_uniform)
        ),
    }
    return metrics | _measure_planes(range(first, spec.num_planes), guess, now, real)


def _measure_planes(
    planes: Sequence[int], guess: Tensor, now: Tensor, real: Tensor
) -> dict[str, float]:
    metrics = {}
    for place, plane in enumerate(planes):
        metrics[f"plane_{plane}/accuracy"] = _share(guess[:, place] == real[:, place])
        metrics[f"plane_{plane}/copy_accuracy"] = _share(now[:, place] == real[:, place])
    return metrics


def _measure_likelihood(held: HeldOut, spec: GeneratorSpec) -> dict[str, float]:
    """Negative log likelihood of real next states, and that of copy + marginal change."""
    now, real = held.rows["observation"], held.rows["next", "observation"]
    moving = list(spec.moving_planes)
    parts = [(now[:, plane].flatten(1), real[:, plane].flatten(1)) for plane in moving]
    scalars = range(spec.num_spatial, spec.num_planes)
    parts += [(now[:, plane, 0, :1], real[:, plane, 0, :1]) for plane in scalars]
    baseline = sum(_find_marginal_nll(before, after) for before, after in parts)
    return {
        "likelihood/nll": _mix(held.predictions.log_prob),
        "likelihood/copy_nll": float(baseline),
    }


def _find_marginal_nll(now: Tensor, real: Tensor) -> float:
    """Nats per row of a baseline: change with the plane's probability, then a value (or a
    difference, if that is likelier) with its frequency among changes.

    It is fitted on the rows that it is measured on: one nat is added for each fitted number (Akaike
    1974).
    """
    changed = now != real
    num_changed, num_cells = int(changed.sum()), changed.numel()
    if num_changed == 0:
        return 0.0
    odds = torch.tensor([num_changed, num_cells - num_changed], dtype=torch.float64)
    total = -(torch.special.xlogy(odds, odds / num_cells)).sum()
    later = real[changed].long()
    options = []
    for classes in (later, (later - now[changed].long()) % 256):
        counts = torch.bincount(classes, minlength=256).double()
        num_fitted = int((counts > 0).sum()) - 1
        options.append(num_fitted - torch.special.xlogy(counts, counts / num_changed).sum())
    return float(1.0 + total + torch.stack(options).min()) / now.shape[0]


def _sample_rewards(held: HeldOut, counts: RareCounts) -> tuple[Tensor, Tensor, Tensor]:
    """Real and predicted rewards [N] of rows that do not end, and weights float64 of sum 1.

    Stratified: rare rewards are those of `rare_rows`, weighted by their share of all rows. A few
    determine the variance, and `rows` would hold one or none of the largest. Ends are left out: one
    in five hundred rows would decide. Their rewards count as rare ones.
    """
    parts = []
    for rows, predicted, is_rare, share in (
        (held.rows, held.predictions, False, 1.0 - counts.rare_reward_odds),
        (held.rare_rows, held.rare_predictions, True, counts.rare_reward_odds),
    ):
        rewards = rows["next", "reward"].squeeze(-1)
        chosen = ~rows["next", "terminated"].squeeze(-1)
        chosen &= counts.is_rare_reward(rewards) == is_rare
        num = int(chosen.sum())
        weights = torch.full((num,), share / max(num, 1), dtype=torch.float64)
        parts.append((rewards[chosen], predicted.reward.mean(0)[chosen], weights))
    real, guess, weights = (torch.cat(part) for part in zip(*parts, strict=True))
    return real, guess, weights / weights.sum().clamp_min(1e-12)


def _measure_reward(
    held: HeldOut, counts: RareCounts, in_doubt: Tensor, checked: Tensor
) -> dict[str, float]:
    rewards = held.rows["next", "reward"].squeeze(-1)
    real, guess, weights = _sample_rewards(held, counts)

    def average(values: Tensor) -> float:
        return float((values.double() * weights).sum())

    metrics = {"reward/num_rare": float(checked.sum())}
    if real.numel():
        variance = average((real - average(real)).square())
        metrics["reward/mae"] = average((guess - real).abs())
        metrics["reward/std"] = variance**0.5
        metrics["reward/constant_mae"] = average((real - rewards.median()).abs())
        if variance > 0.0:
            metrics["reward/explained"] = 1.0 - average((guess - real).square()) / variance
    auc = find_auc(1.0 - held.predictions.reward_is_zero.mean(0), rewards != 0.0)
    if auc is not None:
        metrics["reward/nonzero_auc"] = auc
    if checked.any():
        # Found: the error is less than half of the real reward's distance from the median, or, for
        # an end with a usual reward, a quarter of the rewards' standard deviation.
        least = max(0.25 * metrics.get("reward/std", 0.0), 1e-6)
        rare = held.rare_rows["next", "reward"].squeeze(-1)
        allowed = (0.5 * (rare - rewards.median()).abs()).clamp_min(least)
        found = (held.rare_predictions.reward.mean(0) - rare).abs() <= allowed
        # A share of all rare rows, as of ends below: doubtful rows are not generated at all.
        metrics["reward/rare_missed"] = _share((~found & ~in_doubt)[checked])
    return metrics


def _measure_terminal(
    held: HeldOut, in_doubt: Tensor, checked: Tensor, certainty: Certainty
) -> dict[str, float]:
    real = held.rows["next", "terminated"].squeeze(-1)
    guess = held.predictions.terminal.mean(0)
    ended = held.rare_rows["next", "terminated"].squeeze(-1)
    rare_guess = held.rare_predictions.terminal.mean(0)
    found = rare_guess[ended]
    metrics = {
        "terminal/num": float(found.numel()),
        "terminal/share": _share(real),
        "terminal/ece": find_calibration_error(guess, real),
        "terminal/false_alarms": _share((guess > 0.5) & ~real),
        "terminal/doubtful": _share(find_doubtful_ends(held.predictions.terminal, certainty)),
    }
    if found.numel():
        metrics["terminal/recall"] = _share(found > 0.5)
        # An end is overlooked if it would be generated as a row that continues. If a clock shows 0
        # for two steps the last one cannot be determined; such rows are doubtful.
        overlooked = ((rare_guess <= 0.5) & ~in_doubt)[ended & checked]
        if overlooked.numel():
            metrics["terminal/overlooked"] = _share(overlooked)
    scores = torch.cat([guess[~real], found])
    auc = find_auc(scores, torch.arange(scores.numel()) >= int((~real).sum()))
    if auc is not None:
        metrics["terminal/auc"] = auc
    return metrics


def _measure_mask(held: HeldOut, spec: GeneratorSpec) -> dict[str, float]:
    """Next action masks of rows that do not end the episode."""
    goes_on = ~held.rows["next", "terminated"].squeeze(-1)
    if not goes_on.any():
        return {}
    real = held.rows["next", "action_mask"][goes_on]
    guess = decide_mask(held.predictions.mask, spec.noop_action)[goes_on]
    return {
        "mask/accuracy": _share(guess == real),
        "mask/copy_accuracy": _share(held.rows["action_mask"][goes_on] == real),
        "mask/exact": _share((guess == real).all(-1)),
        "mask/false_legal": _share(guess & ~real),
    }


def decide_mask(logits: Tensor, noop_action: int) -> Tensor:
    """Members' logits [M, N, A] -> bool [N, A]; the no-op is legal in every state."""
    mask = logits.mean(0) > 0.0
    mask[:, noop_action] = True
    return mask


def find_doubtful_ends(terminal: Tensor, certainty: Certainty) -> Tensor:
    """Rows that are, by members' P(end) [M, N], neither surely an end nor surely none: bool [N]."""
    ends = terminal.amin(0) >= certainty.end
    goes_on = terminal.amax(0) <= certainty.going_on
    return ~(ends | goes_on)


def tune_certainty(
    rows: Tensor, ends: Tensor, certain: float, most_overlooked: float, most_doubtful: float
) -> Certainty:
    """Choose the largest P(end) of rows that are generated as continuing.

    Usually 1 - certain. If ends are hard to predict (a bird touches a pipe by less than a pixel),
    less: at most half of `most_overlooked` of real ends may pass, but at most `most_doubtful` of
    all rows are rejected.

    rows, ends: members' P(end) [M, N] of held-out rows, and [M, K] of ends.
    """
    usual = 1.0 - certain
    if not ends.numel() or not rows.numel():
        return Certainty(certain, usual)
    wanted = float(ends.amax(0).quantile(0.5 * most_overlooked, interpolation="lower"))
    least = float(rows.amax(0).quantile(1.0 - most_doubtful))
    tuned = max(wanted, least)
    return Certainty(certain, tuned, True) if tuned < usual else Certainty(certain, usual)


def find_auc(scores: Tensor, labels: Tensor) -> float | None:
    """Area under the ROC curve, ties count half; None if one of the two labels is missing."""
    positive, negative = scores[labels], scores[~labels]
    if not positive.numel() or not negative.numel():
        return None
    order = negative.sort().values
    below = torch.searchsorted(order, positive.contiguous())
    up_to = torch.searchsorted(order, positive.contiguous(), right=True)
    return float((below + up_to).double().mean() / (2.0 * negative.numel()))


def find_calibration_error(probabilities: Tensor, labels: Tensor) -> float:
    """Expected calibration error: mean gap between probability and frequency over ten bins."""
    bins = (probabilities * NUM_CALIBRATION_BINS).long().clamp_max(NUM_CALIBRATION_BINS - 1)
    gap = (probabilities - labels.float()).double()
    sums = torch.zeros(NUM_CALIBRATION_BINS, dtype=torch.float64).index_add_(0, bins, gap)
    return float(sums.abs().sum() / max(1, labels.numel()))


def _find_error(guess: Tensor, real: Tensor) -> float:
    return float((guess.float() - real.float()).abs().mean())


def _share(holds: Tensor) -> float:
    return float(holds.float().mean())


def _mix(log_prob: Tensor) -> float:
    """Mean negative log likelihood of the members' even mixture, from log_prob [M, N]."""
    return float((math.log(log_prob.shape[0]) - torch.logsumexp(log_prob, 0)).mean())
