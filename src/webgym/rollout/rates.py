"""Success rates: over judged attempts, and over all planned samples.

The rate over judged attempts is the paper's: it excludes attempts that were blocked or failed for a reason
other than the policy. Since excluding attempts can raise it, it is always reported together with the rate
over planned samples, in which an attempt that has no reward or was never made counts as unsuccessful.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

_Z: Final = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

Interval: TypeAlias = tuple[float, float]


def wilson(successes: int, of: int) -> Interval | None:
    """The 95 % Wilson score interval of a proportion; ``None`` if ``of`` is 0."""
    if of == 0:
        return None
    share, z2 = successes / of, _Z * _Z
    middle = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = _Z * math.sqrt(share * (1 - share) / of + z2 / (4 * of * of)) / (1 + z2 / of)
    return max(0.0, middle - half), min(1.0, middle + half)


def pass_at(k: int, successes: int, of: int) -> float | None:
    """Estimate pass@k: the probability that at least one of ``k`` attempts succeeds.

    Unbiased, from ``successes`` out of ``of`` attempts; ``None`` if ``of`` is less than ``k``.
    """
    if of < k:
        return None
    return 1.0 - math.comb(of - successes, k) / math.comb(of, k)


class Rate(NamedTuple):
    """A success rate.

    Attributes:
        value: from 0 to 1; ``None`` if there are no attempts.
        interval: 95 % Wilson interval; ``None`` if the value is.
    """

    value: float | None
    interval: Interval | None


@dataclass(frozen=True)
class Successes:
    """Counts of a group of attempts, and the two success rates that follow.

    Attributes:
        won: successful attempts.
        judged: attempts with a reward: success, failure, truncated.
        planned: planned samples, whatever their outcome.
    """

    won: int
    judged: int
    planned: int

    @property
    def of_judged(self) -> Rate:
        """Success rate over the attempts with a reward."""
        return _rate(self.won, self.judged)

    @property
    def of_planned(self) -> Rate:
        """Success rate over all planned samples."""
        return _rate(self.won, self.planned)


def _rate(won: int, of: int) -> Rate:
    return Rate(won / of if of else None, wilson(won, of))
