"""Settings of a simulation: workload, service times, capacities; and the demand of each trajectory."""

from __future__ import annotations

from functools import lru_cache
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from webgym.core.settings import Settings

Schedule: TypeAlias = Literal["async", "step_barrier", "episode_barrier"]
Queues: TypeAlias = Literal["per_operation", "global"]

REPLY_SIGMA: Final = 0.5
"""Spread of the reply's length (log-normal)."""

SCHEDULES: Final[tuple[Schedule, ...]] = ("async", "step_barrier", "episode_barrier")


class Workload(Settings):
    """How many trajectories, and how long each is.

    A trajectory's steps are log-normal within its difficulty, cut off at the budget. Modes and means per
    difficulty are the paper's (§3, trajectory length by difficulty); all are then scaled by one factor, so
    that the mean over the mix, after the cut, is ``mean_steps``.
    """

    trajectories: int = Field(default=1800, ge=1)
    """As many as the paper's measurement has (§4)."""

    mean_steps: float = Field(default=13.2, gt=1)
    """Of a trajectory, after the cut at its budget (paper §4)."""

    mix: tuple[float, float, float] = (25.0, 5.0, 1.0)
    """Weights of easy, medium and hard tasks: the task set's own (paper §5)."""

    budgets: tuple[int, int, int] = (15, 30, 45)
    """Most steps of an easy, medium and hard task (paper §5)."""

    seed: int = 0
    """Of everything random."""


class Costs(Settings):
    """How long things take. Seconds are wall time where nothing else is said.

    The defaults stand for real websites and a model of eight billion parameters on H100s. CPU seconds per
    step and the two figures of the network are fitted to the paper (:mod:`webgym.simulate.paper`); the others
    are assumed.
    """

    open_cpu: float = Field(default=1.0, ge=0)
    """CPU seconds to make a browser session ready, and to clean up after it."""

    act_cpu: float = Field(default=6.0, gt=0)
    """CPU seconds of an action and of the page that follows it, on average."""

    look_cpu: float = Field(default=1.5, gt=0)
    """CPU seconds of the screenshot and what is read with it, on average."""

    cpu_sigma: float = Field(default=0.8, ge=0)
    """Spread of both (log-normal): some pages are far heavier than others."""

    page_seconds: float = Field(default=1.0, ge=0)
    """Median time that an action waits for the network, using no processor."""

    page_sigma: float = Field(default=1.5, ge=0)
    """Spread of it (log-normal): the tail that a barrier waits for."""

    page_longest: float = Field(default=60.0, gt=0)
    """When a page that does not come is given up."""

    page_waits: tuple[float, ...] = ()
    """Measured waits for the network, seconds. If there are any, waits are drawn from these, and are not
    log-normal."""

    prompt_tokens: int = Field(default=6000, ge=1)
    """Of a request that are not in the prefix cache: pictures of the window, and the text."""

    reply_tokens: float = Field(default=350.0, gt=0)
    """Of a reply, on average."""

    prefill_tokens_per_second: float = Field(default=20_000.0, gt=0)
    """That one GPU reads, if it does nothing else."""

    prefill_chunk: int = Field(default=2048, ge=1)
    """Tokens that are read in one iteration, beside the tokens that are written in it."""

    decode_seconds: float = Field(default=0.012, gt=0)
    """Of one iteration of one GPU, which writes a token of every reply in its batch."""

    decode_seconds_per_reply: float = Field(default=0.0003, ge=0)
    """What each reply in the batch adds to it."""

    batch: int = Field(default=64, ge=1)
    """Most replies that one GPU writes at once; further requests wait."""

    judge_seconds: float = Field(default=20.0, ge=0)
    """Of one verdict."""

    train_seconds: float = Field(default=0.0, ge=0)
    """Of one update, on processors of its own."""


class System(Settings, allow_inf_nan=False):
    """How much there is of everything, and how it is scheduled."""

    cpus: int = Field(default=64, ge=1, le=1_000_000)
    """Processors of all browser machines together."""

    gpus: float = Field(default=24, gt=0, le=1_000_000)
    """That serve the policy. A part of one is a slower one."""

    environments: int = Field(default=256, ge=1)
    """Episodes at once, as far as there are browsers."""

    browsers_per_cpu: float = Field(default=8.0, gt=0)
    """Most browser sessions per processor, for their memory."""

    judges: int | None = Field(default=None, ge=1)
    """Verdicts at once; where all are taken, browsers wait. ``None`` for as many as environments."""

    schedule: Schedule = "async"
    """``async``: no barrier. ``step_barrier``: a group of as many tasks as environments advances in lock
    step, all browsers and then one batch of policy calls. ``episode_barrier``: such a group waits for its
    last episode."""

    refills: bool = False
    """Step barrier: an environment whose episode ended takes the next task in the next round, as the baseline
    of the collector does. Otherwise the whole group waits for its longest episode."""

    queues: Queues = "per_operation"
    """In front of the processors: a queue for each operation, which take turns by service time, or one for
    all, first come, first served."""

    straggler_share: float = Field(default=1.0, gt=0, le=1)
    """Once this share has ended, the rest are cut short after ``straggler_seconds``. Async alone."""

    straggler_seconds: float = Field(default=120.0, ge=0)
    """The grace period."""

    iterations: int = Field(default=1, ge=1)
    """Updates of the policy; the workload's trajectories are those of one."""

    staleness: int = Field(default=0, ge=0)
    """How many updates old the policy may be when an episode begins. 0: collection and training in turns."""

    @property
    def sessions(self) -> int:
        """Episodes at once."""
        return max(1, min(self.environments, int(self.browsers_per_cpu * self.cpus)))


# --- demand, which is the same under every schedule -----------------------------------------------------


LENGTHS: Final = ((3.7, 7.8), (4.9, 9.9), (5.5, 11.9))
"""Mode and mean of the steps of easy, medium and hard trajectories (paper §3)."""

_SCALE_SAMPLE: Final = 100_000
"""Sample size for fitting the scale of lengths; the mean is then accurate to half a percent."""


Steps: TypeAlias = NDArray[np.int64]


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
