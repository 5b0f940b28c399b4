"""Success rates: over judged attempts, and over all planned samples.

The rate over judged attempts is the paper's: what was blocked, or failed for a reason that is not the
policy's, is no failure of it. But what leaves that rate can raise it, so the other one is told beside it
wherever it is told: there an attempt without a reward, or that was never made, is one without success.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeAlias

_Z: Final = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

Interval: TypeAlias = tuple[float, float]


def wilson(successes: int, of: int) -> Interval | None:
    """The Wilson score interval at 95 % of a proportion; ``None`` of nothing."""
    if of == 0:
        return None
    share, z2 = successes / of, _Z * _Z
    middle = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = _Z * math.sqrt(share * (1 - share) / of + z2 / (4 * of * of)) / (1 + z2 / of)
    return max(0.0, middle - half), min(1.0, middle + half)


def pass_at(k: int, successes: int, of: int) -> float | None:
    """The chance that at least one of ``k`` attempts succeeds, where ``successes`` of ``of`` did.

    The unbiased estimate, from all choices of ``k`` among them; ``None`` if there were fewer.
    """
    if of < k:
        return None
    return 1.0 - math.comb(of - successes, k) / math.comb(of, k)


class Rate(NamedTuple):
    """A success rate.

    Attributes:
        value: from 0 to 1; ``None`` of nothing.
        interval: Wilson's, at 95 %; ``None`` with the value.
    """

    value: float | None
    interval: Interval | None


@dataclass(frozen=True)
class Successes:
    """What the two success rates of a group of attempts are made from.

    Attributes:
        won: attempts that succeeded.
        judged: attempts that carry a reward: success, failure, truncated.
        planned: samples that were wanted, whatever became of them.
    """

    won: int
    judged: int
    planned: int

    @property
    def of_judged(self) -> Rate:
        """Over the attempts that carry a reward."""
        return _rate(self.won, self.judged)

    @property
    def of_planned(self) -> Rate:
        """Over all samples that were planned."""
        return _rate(self.won, self.planned)


def _rate(won: int, of: int) -> Rate:
    return Rate(won / of if of else None, wilson(won, of))
