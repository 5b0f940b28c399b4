"""Settings of a simulation: the workload, service times, and capacities."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

from pydantic import Field

from webgym.core.settings import Settings

Schedule: TypeAlias = Literal["async", "step_barrier", "episode_barrier"]
Queues: TypeAlias = Literal["per_operation", "global"]

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
