"""Confidence intervals: shares of points (Wilson), means (Student) and medians."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
Z = NormalDist().inv_cdf(0.5 + CONFIDENCE / 2.0)


def win_rate_interval(wins: float, draws: float, games: float) -> tuple[float, float]:
    """95 % interval of the share of points (a draw is half a point) of independent games.

    Wilson's score interval with the trinomial variance; without draws it is plain Wilson.
    Counts may be broken, where older games weigh less.

    Raises:
        ValueError: no games, or more wins and draws than games.
    """
    if games < 1 or wins < 0 or draws < 0 or wins + draws > games:
        raise ValueError(f"{wins} wins and {draws} draws of {games} games cannot be")
    mean = (wins + draws / 2.0) / games
    spread = wins + draws / 4.0 - games * mean**2
    return _wilson(mean, games, spread, certain_share=1.0)


def block_interval(
    scores: NDArray[np.float64], games_per_block: float = 2.0
) -> tuple[float, float]:
    """95 % interval of the mean of block scores [K], each the mean of the games of a map seed.

    The variance is that between blocks: draws and opposite results within a block narrow the
    interval, equal results widen it. Where all points went to one side it is Wilson's of
    games_per_block * K independent games.

    Raises:
        ValueError: no blocks, or a score outside 0..1.
    """
    if not len(scores) or scores.min() < 0.0 or scores.max() > 1.0:
        raise ValueError(f"block scores {scores.tolist()} must be one or more numbers in 0..1")
    mean = float(scores.mean())
    spread = float(np.square(scores - mean).sum())
    return _wilson(mean, len(scores), spread, certain_share=1.0 / games_per_block)


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of the mean of independent values [K] without bounds, by Student's t.

    From one value nothing is known of the spread: then it reaches from -inf to inf.

    Raises:
        ValueError: no values.
    """
    if not len(values):
        raise ValueError("there are no values: an interval needs one or more")
    if len(values) == 1:
        return -math.inf, math.inf
    from scipy.special import stdtrit

    mean = float(values.mean())
    spread = float(values.std(ddof=1)) / math.sqrt(len(values))
    half = float(stdtrit(len(values) - 1, 0.5 + CONFIDENCE / 2.0)) * spread
    return mean - half, mean + half


def median_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of the median of independent values [K], whatever their distribution: two of
    them, between which the median lies unless too many tosses of a coin fall alike.

    From fewer than 6 values nothing is known: then it reaches from -inf to inf.

    Raises:
        ValueError: no values.
    """
    if not len(values):
        raise ValueError("there are no values: an interval needs one or more")
    from scipy.stats import binom

    rank = int(binom.ppf((1.0 - CONFIDENCE) / 2.0, len(values), 0.5))
    if rank < 1:
        return -math.inf, math.inf
    ordered = np.sort(values)
    return float(ordered[rank - 1]), float(ordered[-rank])


def _wilson(mean: float, num: float, spread: float, certain_share: float) -> tuple[float, float]:
    """Wilson's interval (1927) of `num` values in 0..1 at their effective number.

    The effective number is that of coin tosses whose mean varies as much (Dean and Pagano 2015,
    "Evaluating confidence interval methods for binomial proportions in clustered surveys").

    Args:
        mean: of the values.
        num: of values.
        spread: sum of their squared deviations.
        certain_share: what that variance is of a coin toss's, where all values are 0 or all are 1.
    """
    largest = mean * (1.0 - mean)  # variance of coin tosses: no values in 0..1 have a larger one
    share = certain_share
    if largest > 0.0:
        # One coin toss more than was seen: draws throughout do not show that nothing else occurs.
        share = (spread / largest + 1.0) / (num + 1.0)
    z_squared = Z**2 * share / num
    centre = (mean + z_squared / 2.0) / (1.0 + z_squared)
    half = math.sqrt(z_squared * (largest + z_squared / 4.0)) / (1.0 + z_squared)
    # The mean lies inside but for rounding.
    return min(max(0.0, centre - half), mean), max(min(1.0, centre + half), mean)
