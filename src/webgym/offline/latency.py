"""How long the offline web's servers take: a heavy-tailed distribution, seeded."""

from __future__ import annotations

import math

from webgym.offline.seeds import stream

MEDIAN_SECONDS = 0.04
SIGMA = 0.9
"""Spread of the log-normal distribution: about one request in a hundred takes eight medians or more."""
LONGEST_SECONDS = 2.5


def seconds(seed: int, host: str, path: str, nth: int, scale: float, *, sigma: float = SIGMA) -> float:
    """The latency of the ``nth`` request for ``path`` on ``host``.

    Args:
        scale: factor on every latency; 0 for none.
        sigma: spread of the logarithm.
    """
    if scale <= 0:
        return 0.0
    drawn = stream(seed, "latency", host, path, nth).lognormvariate(math.log(MEDIAN_SECONDS), sigma)
    return min(drawn, LONGEST_SECONDS) * scale
