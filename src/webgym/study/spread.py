"""What differences between rows of a study are more than chance: all rows share one spread, seeds are paired.

All trainings share their test tasks, and those of a seed their draws as far as the rows' settings allow. So
a training's result is fitted as an effect of its row plus one of its seed. What remains is the spread that
every difference of rows is held against, with far more degrees of freedom than two rows have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import NormalDist
from typing import Any, Final, NamedTuple

import numpy as np

LEAST_FREEDOM: Final = 2
"""Degrees of freedom from which on a spread says something."""

_CONFIDENT, _POWER = 0.975, 0.8


class Difference(NamedTuple):
    """How much better one row is than another, with half of the 95 % interval; ``inf`` if there is none."""

    mean: float
    half_width: float


class Fit:
    """A fit of results by row and seed.

    Args:
        results: by row and seed; any may be missing.

    Attributes:
        freedom: degrees of freedom of the spread.
        spread: standard deviation of results, apart from what row and seed explain.
    """

    def __init__(self, results: Mapping[tuple[str, int], float]) -> None:
        self._rows = sorted({row for row, _ in results})
        seeds = sorted({seed for _, seed in results})
        design = np.array(
            [
                [*(row == each for each in self._rows), *(seed == each for each in seeds[1:])]
                for row, seed in results
            ],
            dtype=float,
        )
        found = np.array(list(results.values()))
        self._effects, _, rank, _ = np.linalg.lstsq(design, found, rcond=None)
        self._inverse: Any = np.linalg.pinv(design.T @ design)
        rest = found - design @ self._effects
        self.freedom = len(found) - int(rank)
        self.spread = math.sqrt(rest @ rest / self.freedom) if self.freedom else math.nan

    def difference(self, better: str, worse: str) -> Difference | None:
        """Between two rows, of which both must have results; else ``None``."""
        if better not in self._rows or worse not in self._rows:
            return None
        contrast = np.zeros(len(self._effects))
        contrast[self._rows.index(better)], contrast[self._rows.index(worse)] = 1.0, -1.0
        half = math.inf
        if self.freedom >= LEAST_FREEDOM:
            error = self.spread * math.sqrt(contrast @ self._inverse @ contrast)
            half = student(_CONFIDENT, self.freedom) * error
        return Difference(float(contrast @ self._effects), half)


def detectable(spread: float, rows: int, seeds: int) -> float:
    """The smallest difference between two rows that a study finds in four of five cases; ``inf`` if none.

    Args:
        spread: standard deviation of a training's result, apart from row and seed.
        rows, seeds: of the study.
    """
    freedom = (rows - 1) * (seeds - 1)
    if freedom < LEAST_FREEDOM:
        return math.inf
    return (student(_CONFIDENT, freedom) + student(_POWER, freedom)) * spread * math.sqrt(2 / seeds)


def student(share: float, freedom: int) -> float:
    """Quantile of Student's t from the normal distribution's (Abramowitz and Stegun 26.7.5); from two degrees
    of freedom on within 1 %."""
    z = NormalDist().inv_cdf(share)
    terms = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + sum(term / freedom**power for power, term in enumerate(terms, start=1))
