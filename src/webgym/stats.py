"""Bootstrap intervals of rates: whole clusters are resampled, all resamples at once."""

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

    Clusters with equal counts are one kind of cluster, and how often each kind is drawn is multinomial: that
    is the same bootstrap, and takes no longer for many clusters than for few.

    Args:
        clusters: counts of each; ``width`` of them.
        width: how many counts a cluster has.
        resamples: how many draws.
        generator: makes them.

    Returns:
        The sums of every resample, of shape (resamples, width).
    """
    if not clusters:
        return np.zeros((resamples, width), np.int64)
    kinds, often = np.unique(np.array(clusters, np.int64), axis=0, return_counts=True)
    drawn: Counts = generator.multinomial(len(clusters), often / often.sum(), size=resamples) @ kinds
    return drawn


def percentiles(drawn: Values, confidence: float) -> tuple[float, float] | None:
    """The percentile interval of a figure from its resamples, NaN where it is undefined in one.

    Returns:
        ``None`` where the resamples say nothing: the figure is undefined in more of them than the interval
        leaves out, or the same in all.
    """
    defined = drawn[~np.isnan(drawn)]
    if not len(defined) or len(defined) < confidence * len(drawn):
        return None
    low, high = np.quantile(defined, [(1 - confidence) / 2, (1 + confidence) / 2])
    return None if low == high else (float(low), float(high))
