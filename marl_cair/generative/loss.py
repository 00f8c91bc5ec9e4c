"""The training loss of one network: negative log likelihood of real transitions."""

from __future__ import annotations

from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor
from torch.nn import functional

from marl_cair.generative.networks.ccdn import CCDN, Encoding, NextState
from marl_cair.generative.networks.cells import find_log_prob
from marl_cair.generative.networks.economy import find_changes
from marl_cair.generative.networks.outcome import Outcome, RewardBins, read_reward


class RareCorrection(NamedTuple):
    """Undoes the oversampling of rare rows, so that predictions stay calibrated."""

    row_weights: Tensor  # [N], true density over batch density, for the next-state heads
    reward_log_odds: Tensor  # [bins], log(share in batch / true share), added to logits in training
    reward_variance: float  # of real rewards where the episode goes on
    terminal_log_odds: float  # the same for ends: log odds in batch - true log odds


def find_losses(
    network: CCDN, rows: TensorDict, correction: RareCorrection, stride: int, offset: int
) -> dict[str, Tensor]:
    """Mean losses of `rows` by head, in nats per row; their sum is what is minimised.

    stride, offset: of the places where no plane changed, every `stride`-th from `offset` on is
    used, with weight `stride`: an unbiased estimate at a fraction of the cost.
    """
    observation, following = rows["observation"], rows["next", "observation"]
    encoding = network.encode(observation, rows["action"])
    _, later = network.split(following)
    changes = find_changes(encoding.scalars, later)
    economy_nll = -network.economy.find_log_prob(encoding.outlook, encoding.scalars, changes).sum(
        -1
    )
    board = network.reveal_economy(encoding, changes)
    state = NextState(following, changes, board)
    cell_nll = _find_cell_nll(network, encoding, state, stride, offset)
    outcome = network.judge(encoding, state, rows["action_mask"])
    return {
        "economy": (economy_nll * correction.row_weights).mean(),
        "cells": (cell_nll * correction.row_weights).mean(),
        **find_outcome_losses(outcome, network.bins, rows, correction),
    }


def find_outcome_losses(
    outcome: Outcome, bins: RewardBins, rows: TensorDict, correction: RareCorrection
) -> dict[str, Tensor]:
    """Those of rewards, ends and masks."""
    rewards = rows["next", "reward"].squeeze(-1)
    reward_error = read_reward(outcome, bins) - rewards
    reward_target = bins.spread(rewards)
    reward_logits = outcome.reward + correction.reward_log_odds
    terminal_logits = outcome.terminal + correction.terminal_log_odds
    terminated = rows["next", "terminated"].squeeze(-1).float()
    # What an end pays is a hundred times what a step pays; the bins alone learn it.
    reward_square = (reward_error.square() * correction.row_weights * (1.0 - terminated)).mean()
    # Before rewards vary their variance is tiny: nothing else would be learned from such batches.
    reward_scale = (reward_square.detach() / MAX_REWARD_LOSS).clamp_min(correction.reward_variance)
    # A finished world's mask means nothing, so its rows do not teach the mask head.
    mask_nll = functional.binary_cross_entropy_with_logits(
        outcome.mask, rows["next", "action_mask"].float(), reduction="none"
    ).mean(-1)
    return {
        "reward": functional.cross_entropy(reward_logits, reward_target),
        # Shaped rewards are far smaller than a win: cross entropy hardly feels their mean.
        "reward_mean": reward_square / reward_scale,
        "terminal": functional.binary_cross_entropy_with_logits(terminal_logits, terminated),
        "mask": (mask_nll * (1.0 - terminated)).mean() * MASK_WEIGHT,
    }


MAX_REWARD_LOSS = 4.0  # of the reward's mean, in variances of real rewards
MASK_WEIGHT = 20.0  # the mean over actions, scaled to count like a head of its own


def _find_cell_nll(
    network: CCDN, encoding: Encoding, state: NextState, stride: int, offset: int
) -> Tensor:
    """Estimated negative log likelihood [N] of the moving planes of `state`."""
    later = state.observation[:, network.moving]
    changed = (later != encoding.planes).any(1).flatten()
    quiet = torch.arange(min(offset, changed.numel()), changed.numel(), stride)
    quiet = quiet[~changed[quiet]]
    busy = changed.nonzero().squeeze(-1)
    places = torch.cat([busy, quiet])
    num, planes = later.shape[:2]
    area = changed.numel() // num
    image, place = places // area, places % area
    values = later.flatten(2)[image, :, place].flatten().float()
    cells = network.find_cells(encoding, state.changes, state.board, places)
    log_prob = find_log_prob(cells, values)
    weights = torch.ones(places.numel())
    weights[busy.numel() :] = float(stride)
    nll = -log_prob.view(-1, planes).sum(-1) * weights
    return torch.zeros(num).index_add(0, image, nll)
