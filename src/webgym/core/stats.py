"""Bootstrap intervals from resampled clusters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Counts: TypeAlias = NDArray[np.int64]
Values: TypeAlias = NDArray[np.float64]


def resampled(
    clusters: Sequence[Sequence[int]], width: int, resamples: int, generator: np.random.Generator
) -> Counts:
    """Resample clusters with replacement, and add up their counts.

    Clusters with equal counts are grouped, and the number of draws from each group is multinomial. This is
    the same bootstrap, and its time depends on the number of groups only.

    Args:
        clusters: the counts of each cluster, ``width`` of them.
        width: the number of counts of a cluster.
        resamples: the number of resamples; each has as many clusters as ``clusters``.
        generator: the source of randomness.

    Returns:
        The sums of counts, of shape (resamples, width).
    """
    if not clusters:
        return np.zeros((resamples, width), np.int64)
    groups, sizes = np.unique(np.array(clusters, np.int64), axis=0, return_counts=True)
    drawn: Counts = generator.multinomial(len(clusters), sizes / sizes.sum(), size=resamples) @ groups
    return drawn


def percentiles(drawn: Values, confidence: float) -> tuple[float, float] | None:
    """The percentile interval of a statistic.

    Args:
        drawn: the statistic of every resample; NaN where it is undefined.
        confidence: the confidence level, between 0 and 1.

    Returns:
        The ends of the interval; ``None`` if the statistic is the same in all resamples, or undefined in
        more than a share of 1 - ``confidence`` of them.
    """
    defined = drawn[~np.isnan(drawn)]
    if not len(defined) or len(defined) < confidence * len(drawn):
        return None
    low, high = np.quantile(defined, [(1 - confidence) / 2, (1 + confidence) / 2])
    return None if low == high else (float(low), float(high))
