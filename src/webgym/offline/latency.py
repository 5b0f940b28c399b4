"""Simulated latency of the offline web: a seeded, heavy-tailed distribution."""

from __future__ import annotations

import math

from webgym.offline.seeds import stream

MEDIAN_SECONDS = 0.04
SIGMA = 0.9
"""Sigma of the log-normal distribution: about one request in a hundred takes at least eight medians."""
LONGEST_SECONDS = 2.5


def seconds(
    seed: int,
    host: str,
    path: str,
    nth: int,
    scale: float,
    *,
    sigma: float = SIGMA,
    longest: float = LONGEST_SECONDS,
) -> float:
    """The latency of the ``nth`` request for ``path`` on ``host``, seconds.

    Args:
        seed: of the offline web.
        host: of the website.
        path: of the request.
        nth: number of the request for this path, from 1.
        scale: factor of the latency; 0 for none.
        sigma: standard deviation of its logarithm.
        longest: the longest one, before the factor, seconds.
    """
    if scale <= 0:
        return 0.0
    drawn = stream(seed, "latency", host, path, nth).lognormvariate(math.log(MEDIAN_SECONDS), sigma)
    return min(drawn, longest) * scale
