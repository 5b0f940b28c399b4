"""Success rates: over judged attempts, and over all planned samples.

The rate over judged attempts is the paper's: it excludes attempts that were blocked or failed for a reason
other than the policy. Since excluding attempts can raise it, it is always reported together with the rate
over planned samples, in which an attempt that has no reward or was never made counts as unsuccessful.

**Intervals.** With one sample per task, attempts are independent and the interval is Wilson's: it needs no
random numbers and is accurate near 0 and 1, which is typical of hard tasks. With several samples per task
they are not independent (a task is easy or hard for all of them), so tasks are resampled with all their
samples (bootstrap, percentiles), within each level of difficulty, because the test set fixes the number of
tasks per level. If all samples have the same outcome, resampling shows no spread; the interval is then
Wilson's, counting tasks rather than attempts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from webgym.core.stats import percentiles, resampled

_Z: Final = 1.959963984540054
"""Two-sided 95 % quantile of the normal distribution."""

Interval: TypeAlias = tuple[float, float]
Method: TypeAlias = Literal["wilson", "bootstrap"]

RESAMPLES: Final = 10_000

_Clusters: TypeAlias = tuple[tuple[int, int], ...]


def wilson(successes: float, of: int) -> Interval | None:
    """The 95 % Wilson score interval of a proportion; ``None`` if ``of`` is 0.

    Args:
        successes: not a whole number if tasks are counted of which some samples succeeded.
        of: number of attempts or tasks.
    """
    if of == 0:
        return None
    share, z2 = successes / of, _Z * _Z
    middle = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = _Z * math.sqrt(share * (1 - share) / of + z2 / (4 * of * of)) / (1 + z2 / of)
    return max(0.0, middle - half), min(1.0, middle + half)


def over_tasks(
    levels: Iterable[Iterable[tuple[int, int]]], resamples: int = RESAMPLES, seed: int = 0
) -> tuple[Method, Interval | None]:
    """The 95 % interval of a success rate over tasks, and how it was computed.

    Args:
        levels: (successes, samples) of every task, by level of difficulty.
        resamples: number of bootstrap resamples.
        seed: of the bootstrap.
    """
    counted = (tuple(sorted(task for task in level if task[1])) for level in levels)
    return _over_tasks(tuple(sorted(level for level in counted if level)), resamples, seed)


@lru_cache(4096)  # many websites have the same counts
def _over_tasks(levels: tuple[_Clusters, ...], resamples: int, seed: int) -> tuple[Method, Interval | None]:
    tasks = [task for level in levels for task in level]
    won, of = (sum(task[place] for task in tasks) for place in (0, 1))
    if of == len(tasks):
        return "wilson", wilson(won, of)
    generator = np.random.default_rng(seed)
    drawn = np.sum([resampled(level, 2, resamples, generator) for level in levels], axis=0)
    if spread := percentiles(drawn[:, 0] / drawn[:, 1], 0.95):
        return "bootstrap", spread
    # If all resamples are alike, count tasks, because only these are independent.
    return "wilson", wilson(won / of * len(tasks), len(tasks))


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
