"""The resource demand of trajectories, which is the same under every schedule."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from webgym.simulate.config import Costs, Workload

LENGTHS: Final = ((3.7, 7.8), (4.9, 9.9), (5.5, 11.9))
"""Mode and mean of the steps of easy, medium and hard trajectories (paper §3)."""

_SCALE_SAMPLE: Final = 100_000
"""Sample size for fitting the scale of lengths; the mean is then accurate to half a percent."""


Steps: TypeAlias = NDArray[np.int64]

REPLY_SIGMA = 0.5
"""Spread of the reply's length (log-normal)."""


class Demand(NamedTuple):
    """The demand of a trajectory with n steps: n actions (including the first navigation) and n observations.

    Attributes:
        steps: n.
        act_cpu, look_cpu: CPU seconds of each action and observation, n each.
        page: seconds of waiting for the network after each action, n.
        tokens: number of tokens of each reply, n.
    """

    steps: int
    act_cpu: list[float]
    look_cpu: list[float]
    page: list[float]
    tokens: list[float]


def draw_steps(workload: Workload, count: int) -> Steps:
    """Number of steps of ``count`` trajectories. The first ones do not depend on ``count``."""
    return _steps(
        workload, draw_levels(workload, count), _scale(workload.model_copy(update={"trajectories": 1}))
    )


def draw_levels(workload: Workload, count: int) -> Steps:
    """Difficulty of ``count`` trajectories: 0 for easy, 1 for medium, 2 for hard."""
    shares = np.cumsum(workload.mix) / sum(workload.mix)
    uniform = np.random.default_rng([workload.seed, 1]).random(count)
    return np.searchsorted(shares, uniform, side="right").clip(0, 2)


def _steps(workload: Workload, level: Steps, scale: float) -> Steps:
    normal = np.random.default_rng([workload.seed, 2]).normal(size=len(level))
    modes, means = np.array(LENGTHS).T
    variance = np.log(means / modes) / 1.5  # of a log-normal: ln(mean / mode) = 1.5 sigma^2
    location = np.log(modes) + variance
    lengths = scale * np.exp(location[level] + np.sqrt(variance[level]) * normal)
    budgets = np.array(workload.budgets)[level]
    steps: Steps = np.clip(np.rint(lengths), 1, budgets).astype(np.int64)
    return steps


@lru_cache(maxsize=64)
def _scale(workload: Workload) -> float:
    """The factor that gives the configured mean length; the largest one tried if none does."""
    low, high, levels = 0.05, 50.0, draw_levels(workload, _SCALE_SAMPLE)
    for _ in range(40):
        middle = (low * high) ** 0.5
        if _steps(workload, levels, middle).mean() < workload.mean_steps:
            low = middle
        else:
            high = middle
    return high


def _lognormal(generator: np.random.Generator, mean: float, sigma: float, count: int) -> list[float]:
    drawn: list[float] = (mean * np.exp(sigma * generator.normal(size=count) - sigma**2 / 2)).tolist()
    return drawn


def demand(workload: Workload, costs: Costs, number: int, steps: int) -> Demand:
    """Draw the demand of a trajectory.

    Args:
        number: of the trajectory; it and the workload's seed determine the draw.
        steps: of the trajectory.
    """
    generator = np.random.default_rng([workload.seed, 3, number])
    if costs.page_waits:
        page = generator.choice(costs.page_waits, steps)
    else:
        page = costs.page_seconds * np.exp(costs.page_sigma * generator.normal(size=steps))
        page = np.minimum(page, costs.page_longest)
    return Demand(
        steps,
        _lognormal(generator, costs.act_cpu, costs.cpu_sigma, steps),
        _lognormal(generator, costs.look_cpu, costs.cpu_sigma, steps),
        page.tolist(),
        _lognormal(generator, costs.reply_tokens, REPLY_SIGMA, steps),
    )
