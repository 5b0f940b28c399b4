"""Bootstrap intervals of rates by resampling whole clusters."""

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
    """Draw clusters with replacement, as many as there are, and add up their counts.

    The number of times that each distinct cluster is drawn is multinomial, so drawing those numbers
    is the same bootstrap, and its cost does not grow with the number of clusters.

    Args:
        clusters: the ``width`` counts of each cluster.
        width: number of counts per cluster.
        resamples: number of resamples.
        generator: source of randomness.

    Returns:
        The sums of every resample, of shape (resamples, width).
    """
    if not clusters:
        return np.zeros((resamples, width), np.int64)
    kinds, counts = np.unique(np.array(clusters, np.int64), axis=0, return_counts=True)
    drawn: Counts = generator.multinomial(len(clusters), counts / counts.sum(), size=resamples) @ kinds
    return drawn


def percentiles(drawn: Values, confidence: float) -> tuple[float, float] | None:
    """The percentile interval of a statistic from its resamples, which are NaN where it is undefined.

    Returns:
        ``None`` if there is no meaningful interval: the statistic is undefined in more than ``1 -
        confidence`` of the resamples, or the same in all.
    """
    defined = drawn[~np.isnan(drawn)]
    if not len(defined) or len(defined) < confidence * len(drawn):
        return None
    low, high = np.quantile(defined, [(1 - confidence) / 2, (1 + confidence) / 2])
    return None if low == high else (float(low), float(high))
