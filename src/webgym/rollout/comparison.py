"""Two runs over the same tasks: which succeeds more often, and whether that is more than chance.

**Paired.** A task counts with the mean over its attempts that carry a reward, in each run; only tasks that
have one in both runs are compared, and the others are counted. Tasks are resampled with both of their means
(bootstrap, percentiles), so that what makes a task easy or hard for everybody is in neither's interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from webgym.core.errors import UsageError
from webgym.core.task import LEVELS, Level
from webgym.rollout.evaluation import GROUPS, EvaluationConfig, Group, rewards_by_task
from webgym.rollout.rates import Interval
from webgym.rollout.rejudge import RECORDED
from webgym.stats import percentiles

CONFIDENCE: Final = 0.95


class Difference(msgspec.Struct, frozen=True):
    """One level of difficulty, or all.

    Attributes:
        tasks: that have a reward in both runs.
        first, second: mean success over these tasks; ``None`` of none.
        difference: second - first; ``None`` of none.
        interval: of the difference, at 95 %; ``None`` where resampling shows no spread.
        better, worse: tasks of a higher and of a lower mean in the second run.
    """

    tasks: int
    first: float | None
    second: float | None
    difference: float | None
    interval: Interval | None
    better: int
    worse: int

    @property
    def is_decided(self) -> bool:
        """Whether the interval leaves out 0."""
        return self.interval is not None and not self.interval[0] <= 0 <= self.interval[1]


class Comparison(msgspec.Struct, frozen=True):
    """Two runs.

    Attributes:
        first, second: names of their folders.
        rows: by level, and overall.
        only_first, only_second: tasks that have a reward in one run alone, and so are left out.
    """

    first: str
    second: str
    rows: dict[Group, Difference]
    only_first: int
    only_second: int


def compare(
    first: Path, second: Path, judge: str = RECORDED, config: EvaluationConfig | None = None
) -> Comparison:
    """Compare two runs.

    Args:
        first, second: run folders.
        judge: whose verdicts count, in both: see :func:`webgym.rollout.evaluation.evaluate`.
        config: of the bootstrap.

    Raises:
        RunFolderError: a folder is no run, or there is no such judge.
        UsageError: no task has a reward in both.
    """
    one, other = (rewards_by_task(run, judge) for run in (first, second))
    shared = one.keys() & other.keys()
    if not shared:
        raise UsageError("no task has a reward in both runs", hint="compare runs over the same tasks")
    config = config or EvaluationConfig()
    pairs: dict[Level, list[tuple[float, float]]] = {level: [] for level in LEVELS}
    for task_id in sorted(shared):
        level, mean = one[task_id]
        pairs[level].append((mean, other[task_id][1]))
    generator = np.random.default_rng(config.seed)
    drawn = {level: _resampled(held, config.resamples, generator) for level, held in pairs.items()}
    return Comparison(
        first=first.resolve().name,
        second=second.resolve().name,
        rows={group: _difference(group, pairs, drawn) for group in GROUPS},
        only_first=len(one.keys() - shared),
        only_second=len(other.keys() - shared),
    )


def _resampled(
    pairs: list[tuple[float, float]], resamples: int, generator: np.random.Generator
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The sum of differences in every resample of a level's tasks."""
    if not pairs:
        return np.zeros(resamples)
    gains, often = np.unique([after - before for before, after in pairs], return_counts=True)
    return np.asarray(generator.multinomial(len(pairs), often / often.sum(), size=resamples) @ gains)


def _difference(
    group: Group,
    pairs: Mapping[Level, list[tuple[float, float]]],
    drawn: Mapping[Level, np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> Difference:
    levels = LEVELS if group == "overall" else (group,)
    held = [pair for level in levels for pair in pairs[level]]
    if not held:
        return Difference(0, None, None, None, None, 0, 0)
    before, after = (float(np.mean(column)) for column in zip(*held, strict=True))
    spread = sum(drawn[level] for level in levels) / len(held)
    return Difference(
        tasks=len(held),
        first=before,
        second=after,
        difference=after - before,
        interval=percentiles(np.asarray(spread), CONFIDENCE),
        better=sum(b > a for a, b in held),
        worse=sum(b < a for a, b in held),
    )
