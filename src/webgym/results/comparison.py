"""Compares two runs over the same tasks: their success rates, and whether the difference is significant.

**Paired.** A task counts with the mean over its attempts with a reward, in each run; only tasks that have one
in both runs are compared, and the number of others is reported. Tasks are resampled with both of their means
(bootstrap, percentiles), so that the difficulty of tasks does not widen the interval. With few tasks this
interval is too narrow, and if all tasks of each level differ alike, there is none: a difference is
significant only if an exact permutation test over the tasks agrees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Final, TypeAlias

import msgspec
import numpy as np

from webgym.core.errors import UsageError
from webgym.core.stats import percentiles
from webgym.core.task import LEVELS, Level
from webgym.results.evaluation import GROUPS, EvaluationConfig, Group, rewards_by_task
from webgym.results.manifest import Records
from webgym.results.rates import Interval
from webgym.results.summary import oracle_notes
from webgym.store.runs import RECORDED

CONFIDENCE: Final = 0.95
_GRID: Final = 840
"""Parts of 1 that the permutation test counts in: exact for tasks with up to eight attempts."""
_COUNTED: Final = 10_000_000
"""Additions up to which the permutation test counts all sums one by one (a tenth of a second)."""

Sizes: TypeAlias = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class Difference(msgspec.Struct, frozen=True):
    """The difference at one level of difficulty, or over all.

    Attributes:
        tasks: number of tasks with a reward in both runs.
        first, second: mean success over these tasks; ``None`` if there are none.
        difference: second - first; ``None`` if there are no tasks.
        interval: 95 % confidence interval of the difference; ``None`` if resampling shows no spread.
        better, worse: number of tasks with a higher and with a lower mean in the second run.
        p_value: two-sided probability of the exact permutation test, that a difference is at least as large
            if chance alone decides which run is better at each task; ``None`` if no task differs. Where all
            tasks differ by the same amount this is the sign test.
    """

    tasks: int
    first: float | None
    second: float | None
    difference: float | None
    interval: Interval | None
    better: int
    worse: int
    p_value: float | None = None

    @property
    def is_decided(self) -> bool:
        """Whether the permutation test is significant at 5 %, and an interval, if any, excludes 0."""
        if self.p_value is None or self.p_value >= 1 - CONFIDENCE:
            return False
        return self.interval is None or not self.interval[0] <= 0 <= self.interval[1]


class Comparison(msgspec.Struct, frozen=True):
    """The comparison of two runs.

    Attributes:
        first, second: names of their folders.
        rows: differences by level, and overall.
        only_first, only_second: number of tasks with a reward in only one of the runs, which are left out.
        notes: caveats of the figures: an oracle as a run's policy, records that are left out.
    """

    first: str
    second: str
    rows: dict[Group, Difference]
    only_first: int
    only_second: int
    notes: tuple[str, ...] = ()


def compare(
    first: Path, second: Path, judge: str = RECORDED, config: EvaluationConfig | None = None
) -> Comparison:
    """Compare two runs.

    Args:
        first, second: run folders.
        judge: judge whose verdicts count, in both: see :func:`webgym.results.evaluation.evaluate`.
        config: settings of the bootstrap.

    Raises:
        RunFolderError: a folder is not a run, or there is no such judge.
        UsageError: no task has a reward in both.
    """
    records = (Records(), Records())
    first_rewards = rewards_by_task(first, judge, records[0])
    second_rewards = rewards_by_task(second, judge, records[1])
    shared = first_rewards.keys() & second_rewards.keys()
    if not shared:
        raise UsageError("no task has a reward in both runs", hint="compare runs over the same tasks")
    config = config or EvaluationConfig()
    pairs: dict[Level, list[tuple[float, float]]] = {level: [] for level in LEVELS}
    for task_id in sorted(shared):
        level, mean = first_rewards[task_id]
        pairs[level].append((mean, second_rewards[task_id][1]))
    generator = np.random.default_rng(config.seed)
    drawn = {level: _resampled(of_level, config.resamples, generator) for level, of_level in pairs.items()}
    names = (first.resolve().name, second.resolve().name)
    return Comparison(
        first=names[0],
        second=names[1],
        rows={group: _difference(group, pairs, drawn) for group in GROUPS},
        only_first=len(first_rewards.keys() - shared),
        only_second=len(second_rewards.keys() - shared),
        notes=tuple(
            f"{name}: {note}"
            for name, recorded in zip(names, records, strict=True)
            for note in (*oracle_notes(recorded.policies), *recorded.left_out)
        ),
    )


def _resampled(
    pairs: list[tuple[float, float]], resamples: int, generator: np.random.Generator
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The sum of differences in every resample of a level's tasks."""
    if not pairs:
        return np.zeros(resamples)
    gains = np.round([after - before for before, after in pairs], 12)  # 2/3 - 1/3 is 1/3
    gains, counts = np.unique(gains, return_counts=True)
    return np.asarray(generator.multinomial(len(pairs), counts / counts.sum(), size=resamples) @ gains)


def _difference(
    group: Group,
    pairs: Mapping[Level, list[tuple[float, float]]],
    drawn: Mapping[Level, np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> Difference:
    levels = LEVELS if group == "overall" else (group,)
    of_group = [pair for level in levels for pair in pairs[level]]
    if not of_group:
        return Difference(0, None, None, None, None, 0, 0)
    before, after = (float(np.mean(column)) for column in zip(*of_group, strict=True))
    spread = sum(drawn[level] for level in levels) / len(of_group)
    interval = percentiles(np.asarray(spread), CONFIDENCE)
    better, worse = sum(b > a for a, b in of_group), sum(b < a for a, b in of_group)
    return Difference(
        tasks=len(of_group),
        first=before,
        second=after,
        difference=after - before,
        interval=interval,
        better=better,
        worse=worse,
        p_value=_permutation_test([b - a for a, b in of_group]) if better + worse else None,
    )


def _permutation_test(gains: list[float]) -> float:
    """The two-sided probability that the sum of gains is at least as far from 0 if each has a random sign."""
    steps = np.rint(np.array(gains) * _GRID).astype(np.int64)
    steps = steps[steps != 0]
    steps //= max(1, int(np.gcd.reduce(steps)))
    sizes, observed = np.abs(steps), abs(int(steps.sum()))
    tail = _tail if len(sizes) * int(sizes.sum()) <= _COUNTED else _tail_by_transform
    return min(1.0, max(0.0, 2 * tail(sizes, observed)))


def _tail(sizes: Sizes, observed: int) -> float:
    """The probability that the sum of sizes with random signs is at least the observed one."""
    chances = np.ones(1)  # of each sum of sizes[:n], from -sum to sum
    for size in sizes:
        chances = (np.pad(chances, (2 * size, 0)) + np.pad(chances, (0, 2 * size))) / 2
    return float(chances[int(sizes.sum()) + observed :].sum())


def _tail_by_transform(sizes: Sizes, observed: int) -> float:
    """The same, as the inverse of the sum's characteristic function, the product of cos(size * angle).

    It is off by 1e-12 at most. Sums are counted modulo a number so large that by Hoeffding's inequality
    the chance of a sum beyond it is less than 1e-13; the rest is rounding.
    """
    values, counts = np.unique(sizes, return_counts=True)
    total, deviation = int(sizes.sum()), float(np.sqrt((sizes.astype(float) ** 2).sum())) / 2
    # The sum is 2 * w - total, where w is the sum of the sizes with a positive sign. What is counted is
    # w - total // 2.
    modulus = 1 << math.ceil(math.log2(min(total + 1, 16 * deviation)))
    cosines = np.cos(np.arange(2 * modulus) * (np.pi / modulus))
    with np.errstate(divide="ignore"):
        logarithms, is_negative = np.log(np.abs(cosines)), cosines < 0
    angles = np.arange(modulus // 2 + 1)
    logarithm, is_flipped = np.zeros(len(angles)), np.zeros(len(angles), bool)
    for value, count in zip(values.tolist(), counts.tolist(), strict=True):
        places = (angles * value) & (2 * modulus - 1)
        logarithm += count * logarithms[places]
        if count % 2:
            is_flipped ^= is_negative[places]
    transform = np.exp(logarithm) * np.where(is_flipped, -1.0, 1.0)
    if total % 2:
        transform = transform * np.exp(-1j * np.pi * angles / modulus)
    chances = np.fft.irfft(transform, modulus)
    return float(chances[(total + observed) // 2 - total // 2 : modulus // 2 + total % 2].sum())
