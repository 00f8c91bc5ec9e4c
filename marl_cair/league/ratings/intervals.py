"""Confidence intervals: ends of resamples, shares (Wilson), means (Student), medians (ranks)."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95
LEVEL = 1.0 - CONFIDENCE
TAIL = LEVEL / 2.0
Z = NormalDist().inv_cdf(1.0 - TAIL)


def find_ends(samples: NDArray[np.float64], values: Any) -> tuple[Any, Any]:
    """95 % intervals of resamples [S, ...], widened to hold the values [...]."""
    low, high = np.quantile(samples, (TAIL, 1.0 - TAIL), axis=0)
    return np.minimum(low, values), np.maximum(high, values)


def share_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % interval of a plain share of independent trials, Wilson's (1927)."""
    share, z = successes / trials, Z**2 / trials
    half = math.sqrt(z * (share * (1.0 - share) + z / 4.0))
    return (share + z / 2.0 - half) / (1.0 + z), (share + z / 2.0 + half) / (1.0 + z)


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of the mean of independent values [K] without bounds, by Student's t.

    One value does not show the spread: then it is from -inf to inf. Raises ValueError: no values.
    """
    if not len(values):
        raise ValueError("there are no values: an interval needs one or more")
    if len(values) == 1:
        return -math.inf, math.inf
    from scipy.special import stdtrit

    mean = float(values.mean())
    half = float(stdtrit(len(values) - 1, 1.0 - TAIL) * values.std(ddof=1)) / math.sqrt(len(values))
    return mean - half, mean + half


def median_interval(values: NDArray[np.float64]) -> tuple[float, float]:
    """95 % interval of the median of independent values [K] of any distribution: two of them, by
    the binomial distribution of how many are below the median.

    Fewer than 6 values show nothing: then it is from -inf to inf. Raises ValueError: no values.
    """
    if not len(values):
        raise ValueError("there are no values: an interval needs one or more")
    from scipy.stats import binom

    rank = int(binom.ppf(TAIL, len(values), 0.5))
    if rank < 1:
        return -math.inf, math.inf
    ordered = np.sort(values)
    return float(ordered[rank - 1]), float(ordered[-rank])
