"""Quality of predicted transitions against real ones: cells, moves, rewards, ends, open loop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import takewhile
from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn import functional

from marl_cair.generative.networks.boards import is_picture
from marl_cair.generative.settings import GeneratorSpec

NUM_CALIBRATION_BINS = 10
VECTOR_STEPS = 16  # of each level of a vector's entry, see `codecs.VectorCodec`
LEAST_CONSTANT = 5e-3  # of rewards: errors are divided by the constant, or by this if it is less
HORIZONS = (1, 2, 4, 8, 16)  # steps of open-loop prediction


class Imagined(NamedTuple):
    """Predictions of N transitions."""

    observation: Tensor  # [N, ...], the likeliest next one
    action_mask: Tensor  # bool [N, A], the next one
    reward: Tensor  # [N]
    end: Tensor  # [N], probability that the episode ends
    surety: Tensor  # [N], log probability of the predicted next observation

    def select(self, which: slice) -> Imagined:
        """Some of the predictions."""
        return Imagined(*(part[which] for part in self))


Imagine = Callable[[TensorDict], Imagined]  # rows with observation, action_mask, action


def measure_rows(rows: TensorDict, made: Imagined, spec: GeneratorSpec) -> dict[str, float]:
    """Numbers of one-step predictions for real `rows` [N] by name; those that cannot be determined
    are left out.

    cells/...: of boards and frames, with the copy baseline beside them. moved: share of the cells
    to which a unit has moved where a value is predicted (a recall); moved_exactly: the right value;
    moved_precision: share of the predicted moves whose cell does hold a value. exact: whole
    observations. change_explained: of pictures and vectors, share of the squared change that is
    predicted. In none of these do rows that end count: what is seen after an end is never used.
    """
    ends = rows["next", "terminated"].squeeze(-1)
    numbers: dict[str, float] = {}
    if (goes_on := ~ends).any():
        numbers |= _measure_cells(rows[goes_on], made.observation[goes_on], spec)
    common = ~ends & (made.end < 0.5)  # what is wrong about ends is measured apart
    if common.any():
        numbers |= _measure_reward(rows["next", "reward"][common, 0], made.reward[common])
    numbers |= measure_ends(ends, made.end)
    if goes_on.any():
        real, guess = rows["next", "action_mask"][goes_on], made.action_mask[goes_on]
        numbers["mask/accuracy"] = _share(real == guess)
        copied = numbers["mask/copy_accuracy"] = _share(real == rows["action_mask"][goes_on])
        numbers["mask/gain"] = numbers["mask/accuracy"] - copied
    return numbers


def _measure_cells(rows: TensorDict, guess: Tensor, spec: GeneratorSpec) -> dict[str, float]:
    now, real = rows["observation"], rows["next", "observation"]
    same = differ(guess, real, spec).logical_not()
    numbers = {"cells/exact": _share(same.flatten(1).all(1))}
    if now.ndim == 2:
        error = (guess - real).abs().mean()
        copied = (now - real).abs().mean()
        return numbers | {"vector/error_of_copy": float(error / copied.clamp_min(1e-9))}
    moving = list(spec.moving_planes)
    before, after, made, right = (one[:, moving] for one in (now, real, guess, same))
    changed, predicted = differ(before, after, spec), differ(made, before, spec)
    hits = (changed & predicted & right).sum()
    if changed.any():
        total = (changed.sum() + predicted.sum()).clamp_min(1)
        numbers["cells/changed_f1"] = float(2.0 * hits / total)
        if is_picture(spec):
            numbers["cells/change_explained"] = _find_explained(before, made, after)
    moved = find_moves(before, after)
    if moved.any():
        numbers["cells/moved"] = _share((made > 0)[moved])
        numbers["cells/moved_exactly"] = _share(right[moved])
    claimed = find_moves(before, made)
    if claimed.any():
        numbers["cells/moved_precision"] = _share((after > 0)[claimed])
    accuracy, copies = (_find_plane_accuracy(one, real, spec) for one in (guess, now))
    if now.shape[2:] == (1, 1) and (now != real).any():  # a vector, see `codecs.VectorCodec`
        digits = (join_digits(one.flatten(1)) for one in (now, guess, real))
        numbers["cells/change_explained"] = _find_explained(*digits)
    scalars = range(spec.num_spatial, spec.num_planes)
    if scalars:
        gains = (accuracy[plane] - copies[plane] for plane in scalars)
        numbers["scalars/least_gain"] = min(gains)
    for plane in (*moving, *scalars):
        numbers[f"plane_{plane}/accuracy"] = accuracy[plane]
        numbers[f"plane_{plane}/copy_accuracy"] = copies[plane]
    return numbers


def join_digits(planes: Tensor) -> Tensor:
    """Whole numbers int64 [N, V] of the planes [N, 1 + 2 V] of a vector: levels and their steps."""
    digits = planes[:, 1:].long()  # a sample may step beyond the last step of a level
    return digits[:, ::2] * VECTOR_STEPS + digits[:, 1::2].clamp(max=VECTOR_STEPS - 1)


def _find_explained(before: Tensor, made: Tensor, after: Tensor) -> float:
    """Share of the squared change that is predicted: 1 for all of it, 0 for a copy."""
    left, change = ((one.float() - after.float()).square().sum() for one in (made, before))
    return 1.0 - float(left / change)


def differ(values: Tensor, others: Tensor, spec: GeneratorSpec) -> Tensor:
    """Where observations differ visibly, bool like them."""
    if values.is_floating_point():
        return (values - others).abs() > 1e-3
    if not spec.tolerance:
        return values != others
    return (values.int() - others.int()).abs() > spec.tolerance


def find_moves(now: Tensor, later: Tensor) -> Tensor:
    """Cells of uint8 [N, P, H, W] that were empty and hold a value now, beside one that held a
    value of the same plane before: bool.
    """
    held = (now > 0).float()
    near = functional.max_pool2d(held, 3, stride=1, padding=1) > 0
    return (now == 0) & (later > 0) & near


def _find_plane_accuracy(guess: Tensor, real: Tensor, spec: GeneratorSpec) -> list[float]:
    same = differ(guess, real, spec).logical_not()
    shares: list[float] = same.transpose(0, 1).flatten(1).float().mean(1).tolist()
    return shares


def _measure_reward(real: Tensor, guess: Tensor) -> dict[str, float]:
    variance, error = float(real.var(correction=0)), float((guess - real).abs().mean())
    numbers = {
        "reward/mae": error,
        "reward/constant_error": error / max(abs(float(real.median())), LEAST_CONSTANT),
        "reward/std": float(real.std(correction=0)),
    }
    if variance > 1e-9:
        numbers["reward/explained"] = 1.0 - float((guess - real).square().mean()) / variance
    auc = find_auc((guess - real.median()).abs(), (rare := find_rare(real)))
    if auc is not None:
        far = 0.5 * (real - real.median()).abs()[rare]
        numbers["reward/rare_auc"] = auc
        numbers["reward/rare_recall"] = _share((guess - real).abs()[rare] <= far)
    return numbers


def find_rare(rewards: Tensor) -> Tensor:
    """Rewards [N] more than two standard deviations from their median: bool [N]."""
    return (rewards - rewards.median()).abs() > 2.0 * rewards.std(correction=0).clamp_min(1e-6)


def measure_ends(real: Tensor, guess: Tensor) -> dict[str, float]:
    """AUC, recall and calibration of P(end) `guess` [N] against `real`, bool [N]."""
    numbers = {
        "end/calibration_error": find_calibration_error(guess, real),
        "end/false_alarms": _share((guess > 0.5) & ~real),
    }
    auc = find_auc(guess, real)
    if auc is not None:
        numbers |= {"end/auc": auc, "end/recall": _share(guess[real] > 0.5)}
    return numbers


def measure_acceptance(
    rows: TensorDict, made: Imagined, spec: GeneratorSpec, accepted: Tensor
) -> dict[str, float]:
    """Share of predictions that are `accepted`, bool [N], and how many of these are exact."""
    exact = ~differ(made.observation, rows["next", "observation"], spec).flatten(1).any(1)
    numbers = {"accepted/share": _share(accepted)}
    if accepted.any():
        numbers["accepted/exact"] = _share(exact[accepted])
    return numbers


def find_chains(rows: TensorDict, length: int, most: int) -> Tensor:
    """Places int64 [K, length] of up to `most` chains of consecutive rows, spread over `rows`.

    rows: with "episode", "seat" and "step", as data sets have.
    """
    keys = zip(*(rows[name].tolist() for name in ("episode", "seat", "step")), strict=True)
    place_of = {key: place for place, key in enumerate(keys)}
    chains = []
    for (episode, seat, step), _ in sorted(place_of.items()):
        chain = [place_of.get((episode, seat, step + n)) for n in range(length)]
        if None not in chain:
            chains.append(chain)
    stride = max(1, len(chains) // most)
    return torch.tensor(chains[::stride][:most], dtype=torch.int64).view(-1, length)


def measure_open_loop(
    rows: TensorDict, chains: Tensor, imagine: Imagine, spec: GeneratorSpec
) -> dict[str, float]:
    """Exact match, changed-cell F1 (against the start) and moved values after k steps of prediction
    from its own predictions, with the real actions of all players. Moves are of values that were
    there at the start (`trace_values`).

    chains: int64 [K, T] places of consecutive real rows.
    """
    numbers: dict[str, float] = {}
    start = rows[chains[:, 0]]
    seen, known = start["observation"], start["observation"]
    for step in range(chains.shape[1]):
        real = rows[chains[:, step]]
        current = real.clone()
        current["observation"] = seen
        seen = imagine(current).observation
        if seen.ndim == 4:
            known = trace_values(known, real["next", "observation"])
        if step + 1 in HORIZONS:
            found = _compare_open(start, real, seen, known, spec)
            numbers |= {f"open_loop/{step + 1}_{name}": value for name, value in found.items()}
    return numbers


def find_safe_steps(numbers: Mapping[str, float], least_f1: float) -> int:
    """The longest roll-out, of HORIZONS, up to which each changed-cell F1 of `measure_open_loop` is
    `least_f1` or more; 0 if the first step's is not.
    """
    named = ((steps, numbers.get(f"open_loop/{steps}_changed_f1", 0.0)) for steps in HORIZONS)
    good = list(takewhile(lambda one: one[1] >= least_f1, named))
    return good[-1][0] if good else 0


def trace_values(known: Tensor, later: Tensor) -> Tensor:
    """The values of uint8 [N, C, H, W] that may have come from `known` ones, at most a cell away;
    0 elsewhere. New units, which appear at random cells, are left out.
    """
    near = functional.max_pool2d((known > 0).float(), 3, stride=1, padding=1) > 0
    return later * near


def _compare_open(
    start: TensorDict, real: TensorDict, guess: Tensor, known: Tensor, spec: GeneratorSpec
) -> dict[str, float]:
    true, first = real["next", "observation"], start["observation"]
    same = differ(guess, true, spec).logical_not()
    numbers = {"exact": _share(same.flatten(1).all(1))}
    if true.ndim == 2:
        return numbers
    moving = list(spec.moving_planes)
    same = same[:, moving]
    changed, predicted = (differ(one, first, spec)[:, moving] for one in (true, guess))
    total = (changed.sum() + predicted.sum()).clamp_min(1)
    numbers["changed_f1"] = float(2.0 * (changed & predicted & same).sum() / total)
    moved = find_moves(real["observation"][:, moving], known[:, moving])
    if moved.any():
        numbers["moved"] = _share((guess[:, moving] > 0)[moved])
    return numbers


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
    bins = (probabilities * NUM_CALIBRATION_BINS).long().clamp(0, NUM_CALIBRATION_BINS - 1)
    gap = (probabilities - labels.float()).double()
    sums = torch.zeros(NUM_CALIBRATION_BINS, dtype=torch.float64).index_add_(0, bins, gap)
    return float(sums.abs().sum() / max(1, labels.numel()))


def _share(holds: Tensor) -> float:
    return float(holds.float().mean())
