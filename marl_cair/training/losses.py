"""Losses of Q-learning: from networks and a batch to a loss, TD errors and action values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import ClassVar, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn import functional

from marl_cair.policies.actor import find_values
from marl_cair.policies.q_network import QNetwork
from marl_cair.training.settings.learner import LearnerSettings


class LossResult(NamedTuple):
    """What a loss returns. Rows [...] are [N], or [N, T] of sequences."""

    loss: Tensor  # scalar float32, with gradient
    td_error: Tensor  # float32 [...], target - Q(s, a), without gradient
    values: Tensor  # float32 [..., A], Q(s, .), with gradient


class Loss(ABC):
    """Base class of losses, the entries of `LOSSES`; made with the settings of the learner."""

    LEARNS_FROM_REPLAY: ClassVar[bool]  # from sampled transitions, else from the newest steps
    HAS_TARGET_NETWORK: ClassVar[bool]
    READS_SEQUENCES: ClassVar[bool] = False  # whether it can train networks with memory
    TAKES_ACTION_SHAPES: ClassVar[bool] = False  # whether it can train actions at each cell

    def __init__(self, settings: LearnerSettings) -> None:
        self.settings = settings

    @abstractmethod
    def __call__(self, network: QNetwork, target: QNetwork, batch: TensorDict) -> LossResult:
        """batch: TensorDict [N], of transitions with the keys of replay/transition.py, or of steps
        as `newest_steps.make_rows` makes them; for networks with memory [N, T], of sequences
        (replay/sequences.py). target: `network` itself if there is none.
        """


class DqnLoss(Loss):
    """Deep Q-learning on transitions from a replay buffer (Mnih et al. 2015).

    Target of a row: R + gamma^k * (not terminated) * Q_target(s', a'), R the discounted sum of k
    rewards; a' is the best legal action by the online network (double Q-learning, van Hasselt et
    al. 2016), or with `learner.double=false` by the target network. TorchRL's `DQNLoss` computes
    the same numbers, but gives neither Q(s, .) nor signed TD errors.

    Networks with memory learn from sequences: both networks begin with the stored state and read
    the burn-in steps first (R2D2, Kapturowski et al. 2019).
    """

    LEARNS_FROM_REPLAY: ClassVar[bool] = True
    HAS_TARGET_NETWORK: ClassVar[bool] = True
    READS_SEQUENCES: ClassVar[bool] = True

    def __call__(self, network: QNetwork, target: QNetwork, batch: TensorDict) -> LossResult:
        """batch: TensorDict [N] with the keys of replay/transition.py; "priority_weight" float32
        [N], if there, weighs the rows. For networks with memory [N, T], as `read_sequences`.
        """
        if network.state_size:
            return self._learn_sequences(network, target, batch)
        following = batch["next"]
        with torch.no_grad():
            seen, mask = following["observation"], following["action_mask"]
            rated = target(seen)
            chooser = network(seen) if self.settings.double else rated
            action = mask_values(chooser, mask).argmax(-1, keepdim=True)
            ahead = rated.gather(-1, action).squeeze(-1)
            wanted = find_targets(batch, ahead, self.settings.gamma)
        return compare(network(batch["observation"]), batch, wanted, self.settings.loss)

    def _learn_sequences(
        self, network: QNetwork, target: QNetwork, batch: TensorDict
    ) -> LossResult:
        settings, burn_in = self.settings, count_burn_in(batch)
        part, values = batch[:, burn_in:], unroll_after(burn_in, network, batch)
        with torch.no_grad():
            rated = unroll_after(burn_in, target, batch)
            chooser = values if settings.double else rated
            action = mask_values(chooser, part["action_mask"]).argmax(-1, keepdim=True)
            value = rated.gather(-1, action).squeeze(-1)
            wanted = find_step_returns(part, value, settings.gamma, settings.n_steps)
        loss, td_error, _ = compare(values, part, wanted, settings.loss)
        pad = functional.pad
        return LossResult(loss, pad(td_error, (burn_in, 0)), pad(values, (0, 0, burn_in, 0)))


class QuantileLoss(DqnLoss):
    """Quantile regression of the distribution of returns (Dabney et al. 2018), with the head
    `quantile`; otherwise as `DqnLoss`.

    The targets of a row are those of `DqnLoss` with each of the K quantiles of Q_target(s', a') in
    place of the value, a' the best legal action by means. Their loss is `measure_quantiles`, and
    the TD error is that of the means.
    """

    READS_SEQUENCES: ClassVar[bool] = False

    def __call__(self, network: QNetwork, target: QNetwork, batch: TensorDict) -> LossResult:
        """batch: as `DqnLoss`. Raises ValueError for networks with another head."""
        following = batch["next"]
        with torch.no_grad():
            seen, mask = following["observation"], following["action_mask"]
            rated = target(seen, quantiles=True)
            chooser = network(seen) if self.settings.double else rated.mean(-1)
            ahead = select_quantiles(rated, mask_values(chooser, mask).argmax(-1))
            wanted = find_targets(batch, ahead, self.settings.gamma)
        found = network(batch["observation"], quantiles=True)
        chosen = select_quantiles(found, batch["action"])
        loss = average_rows(batch, chosen, wanted, measure_quantiles)
        return LossResult(loss, (wanted - chosen).mean(-1).detach(), found.mean(-1))


class PqnLoss(Loss):
    """Parallelised Q-learning on the newest steps of many worlds (Gallici et al. 2025): no replay
    buffer, no target network; the networks need normalisation (`policy.norm=layer`).

    A row's target is its Q(lambda) return (`find_lambda_returns`) in "target" float32 [N];
    generated rows sum rewards of `learner.n_steps` before the online network's value.
    """

    LEARNS_FROM_REPLAY: ClassVar[bool] = False
    HAS_TARGET_NETWORK: ClassVar[bool] = False
    READS_SEQUENCES: ClassVar[bool] = True
    TAKES_ACTION_SHAPES: ClassVar[bool] = True

    def __call__(self, network: QNetwork, target: QNetwork, batch: TensorDict) -> LossResult:
        """batch: TensorDict [N] with "observation", "action" and "target"; for networks with memory
        [N, T], with "state", of which the first step's is used, "starts" and "learned" too.
        `target` is not used.
        """
        if network.state_size:
            values = unroll_after(0, network, batch)
        else:
            values = network(batch["observation"])
        return compare(values, batch, batch["target"], self.settings.loss)


def find_targets(batch: TensorDict, ahead: Tensor, gamma: float) -> Tensor:
    """R + gamma^k * (not terminated) * `ahead` of a batch of transitions, float32 [N].

    ahead: float32 [N], or [N, K] for K targets of each row.
    """
    following = batch["next"]
    if ahead.ndim == batch.ndim:
        return find_targets(batch, ahead.unsqueeze(-1), gamma).squeeze(-1)
    discount = gamma ** batch["steps_to_next_obs"]
    rest: Tensor = (discount * ahead).masked_fill(following["terminated"], 0.0)
    targets: Tensor = following["reward"] + rest
    return targets


def compare(values: Tensor, batch: TensorDict, wanted: Tensor, measure: str) -> LossResult:
    """Loss of `values` float32 [..., A] at the actions taken, against `wanted` float32 [...].

    measure: "smooth_l1" (Huber) or "l2". Rows weigh as "priority_weight" float32 [...], if there;
    those that are not "learned" bool [...], if there, do not count. Actions [..., H, W] need
    "action_mask" bool [..., H, W, A], see `find_values`.
    """
    action = batch["action"]
    chosen = find_values(values, action, batch["action_mask"] if action.ndim > batch.ndim else None)
    loss = average_rows(batch, chosen, wanted, partial(measure_errors, measure=measure))
    return LossResult(loss, (wanted - chosen).detach(), values)


def average_rows(
    batch: TensorDict,
    chosen: Tensor,
    wanted: Tensor,
    measure: Callable[[Tensor, Tensor], Tensor],
) -> Tensor:
    """Mean over the rows of `measure(chosen, wanted)`, weighted as `compare` describes.

    chosen, wanted: float32 [...] or [..., K], of batch shape [...].
    """
    weights = batch.get("priority_weight", torch.ones(batch.shape, device=chosen.device))
    learned = find_learned(batch, chosen.device)
    # Selected first: NaN of steps that are not learned would reach the gradient even at weight 0.
    losses = measure(chosen[learned], wanted[learned]) * weights[learned]
    average: Tensor = losses.sum() / weights[learned].sum()
    return average


def find_learned(batch: TensorDict, device: torch.device) -> Tensor:
    """Steps of `batch` [...] that are learned, bool [...]: all but for "learned" of sequences."""
    learned: Tensor = batch.get("learned", torch.ones(batch.shape, dtype=torch.bool, device=device))
    return learned


def measure_errors(chosen: Tensor, wanted: Tensor, measure: str) -> Tensor:
    """Loss of each row [N], of kind `measure`."""
    if measure == "l2":
        return functional.mse_loss(chosen, wanted, reduction="none")
    return functional.smooth_l1_loss(chosen, wanted, reduction="none")


def measure_quantiles(chosen: Tensor, wanted: Tensor) -> Tensor:
    """Quantile Huber loss of each row, float32 [M] (Dabney et al. 2018, equations 9 and 10, with
    kappa 1): the mean over all pairs i, j of |tau_i - [u < 0]| * huber(u), u = wanted_j - chosen_i,
    tau_i = (2 i - 1) / (2 K). The paper's is K times as large, as it sums over i.

    chosen, wanted: float32 [M, K].
    """
    num_quantiles = chosen.shape[-1]
    tau = (torch.arange(num_quantiles, device=chosen.device) + 0.5) / num_quantiles
    error = wanted.unsqueeze(-2) - chosen.unsqueeze(-1)
    huber = functional.smooth_l1_loss(error, torch.zeros_like(error), reduction="none")
    share = (tau.unsqueeze(-1) - (error < 0).float()).abs()
    return (share * huber).mean((-2, -1))


def select_quantiles(quantiles: Tensor, action: Tensor) -> Tensor:
    """Of quantiles [..., A, K] those of the actions int64 [...]: [..., K]."""
    index = action[..., None, None].expand(*action.shape, 1, quantiles.shape[-1])
    return quantiles.gather(-2, index).squeeze(-2)


def mask_values(values: Tensor, action_mask: Tensor) -> Tensor:
    """The values [..., A] with the lowest number in place of those of illegal actions."""
    return values.masked_fill(~action_mask, torch.finfo(values.dtype).min)


def find_lambda_returns(
    reward: Tensor,
    best_ahead: Tensor,
    terminated: Tensor,
    is_end: Tensor,
    gamma: float,
    q_lambda: float,
) -> Tensor:
    """Q(lambda) returns float32 [T, S] of T steps of S streams (Peng and Williams 1996; Daley and
    Amato 2019, equation 6).

    G_t = r_t + gamma * (lambda * G_t+1 + (1 - lambda) * max Q(s_t+1, .)), where the part with
    lambda is cut at the end of an episode and after step T.

    reward: float32 [T, S]. best_ahead: float32 [T, S], largest legal Q of the next state; not used
    where `terminated`. terminated, is_end: bool [T, S]; is_end also where an episode is truncated.
    """
    best_ahead = best_ahead.masked_fill(terminated, 0.0)
    returns = torch.empty_like(reward)
    following = best_ahead[-1]
    for step in range(len(reward) - 1, -1, -1):
        mixed = q_lambda * following + (1.0 - q_lambda) * best_ahead[step]
        ahead = torch.where(is_end[step], best_ahead[step], mixed)
        returns[step] = following = reward[step] + gamma * ahead
    return returns


def count_burn_in(batch: TensorDict) -> int:
    """Number of first steps of the sequences [N, T] that are learned in none of them."""
    return int(batch["learned"].any(0).long().argmax())


def unroll_after(burn_in: int, network: QNetwork, batch: TensorDict) -> Tensor:
    """Values float32 [N, T - burn_in, A] of sequences [N, T] after the burn-in steps, which only
    move the stored state on, without gradient.

    batch: with "observation", "starts" and "state", of which the first step's is used.
    """
    seen, starts = batch["observation"].transpose(0, 1), batch["starts"].T
    state = batch["state"][:, 0]
    if burn_in:
        with torch.no_grad():
            _, states = network.unroll(seen[:burn_in], state, starts[:burn_in])
        state = states[-1]
    values, _ = network.unroll(seen[burn_in:], state, starts[burn_in:])
    return values.transpose(0, 1)


def find_step_returns(batch: TensorDict, value: Tensor, gamma: float, n_steps: int) -> Tensor:
    """n-step returns float32 [N, T] of sequences.

    The rewards of n_steps steps and the value of the entry after them; of fewer steps if the
    episode or the sequence ends before, and no value after a terminated step.

    batch: with "reward", "terminated" and "learned". value: float32 [N, T], of each entry.
    """
    reward, terminated, learned = batch["reward"], batch["terminated"], batch["learned"]
    ahead = _shift(value).masked_fill(terminated, 0.0)
    goes_on = _shift(learned)
    goes_on[:, -1] = False
    found: Tensor = reward + gamma * ahead
    for _ in range(min(n_steps, found.shape[1]) - 1):
        found = reward + gamma * torch.where(goes_on, _shift(found), ahead)
    return found


def _shift(rows: Tensor) -> Tensor:
    """Rows [N, T] of the next entry; those of the last are its own."""
    return torch.cat([rows[:, 1:], rows[:, -1:]], 1)
