"""The training loop (paper §5): sample tasks, collect, judge, replay, update, publish; sometimes evaluate.

    async with open_training(config, Path("training/first")) as training:
        await training.run()

Every stage of an iteration ends by writing a file (:mod:`webgym.train.folder`), from which the next stage
follows: an interrupted training continues at the same stage and neither repeats nor loses an attempt.

With ``loop.staleness`` 0, the default, iteration n is collected with the weights of iteration n - 1 and
nothing overlaps, as in the paper. With s, collecting, learning and evaluating go on side by side:

- An iteration begins when the one before has begun all of its attempts, while up to s earlier ones still wait
  for their update. All share the same browser sessions, so that none is idle, and stragglers run on.
- An update begins when most attempts of its iteration have ended. The rest are learned from with a later one,
  once, and a group of attempts at a task only as a whole.
- New weights reply from the next step of every attempt on. Evaluations keep those that they began with.
"""

from __future__ import annotations

import asyncio
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol, TypeAlias

import msgspec
from pydantic import Field, field_validator, model_validator

from webgym.agent.policy import Policy
from webgym.agent.profiles import choose_profile
from webgym.core.background import uninterrupted
from webgym.core.errors import ConfigError, SiteDead, TrainingError, error_from_code
from webgym.core.outcome import Outcome
from webgym.core.settings import Section
from webgym.core.task import Task
from webgym.inference.local import LocalConfig
from webgym.inference.vllm import EXPLICIT, VllmConfig
from webgym.judge.factory import name_of
from webgym.llm.config import Sampling
from webgym.results.summary import Summary
from webgym.rollout.progress import Progress
from webgym.rollout.sessions import Places
from webgym.rollout.trackers import TrackerName
from webgym.run.choice import health_of
from webgym.run.collect import collect, resume
from webgym.run.config import RunConfig, Secrets, ServerChoice, read_config
from webgym.store.files import CONFIG, EVALUATIONS, SITES
from webgym.store.runs import RunReader
from webgym.tasks.sampling import Sampler, SamplerConfig
from webgym.tasks.split import refuse_leaks
from webgym.train.config import LearnConfig
from webgym.train.figures import figures_of, iteration_line, rates_of, success_line, watch_for_collapse
from webgym.train.folder import Stage, TrainingFolder
from webgym.train.frontier import Frontier
from webgym.train.layout import Layout
from webgym.train.progress import TrainingProgress
from webgym.train.replay import Counts, Replay, ReplaySample
from webgym.train.serving import Serving
from webgym.train.stopping import Stop

Show: TypeAlias = Callable[[Progress], AbstractAsyncContextManager[None]]
Tell: TypeAlias = Callable[[str], None]
Track: TypeAlias = Callable[[Mapping[str, Any]], None]

_OF_THE_MACHINE: Final = {
    *("executable", "sandbox", "temporary_root", "freeze", "cgroup", "slot_bytes", "slot_tasks"),
    *("launch_seconds", "open_seconds", "recycle_episodes", "reserve_bytes"),
}
"""Settings of browsers that do not change what an agent sees and does."""
_OF_THE_PAGES: Final = {"latency", "latency_sigma", "latency_longest", "slow_seconds"}


class LoopConfig(Section):
    """Settings of the training loop."""

    iterations: int = Field(default=30, ge=1)
    """Total number of iterations."""

    tasks: int = Field(default=1024, ge=1)
    """Tasks drawn for an iteration (paper §5: 512 or, better, 1,024)."""

    staleness: int = Field(default=0, ge=0)
    """Most updates by which collection may run ahead; 0 for the paper's synchronous loop. With 2, neither
    collecting nor learning waits if they take equally long; with 1, stragglers are waited for."""

    evaluate_every: int = Field(default=5, ge=0)
    """Evaluate every this many iterations, and before the first and after the last; 0 for never."""

    keep_weights: int = Field(default=2, ge=1)
    """Number of newest iterations whose weights stay on disk, beside those with the best evaluation. What
    training goes on from (weights in float32 and the optimizer's moments) stays of the newest alone."""

    give_up_after: int = Field(default=5, ge=1)
    """Stop after this many iterations in a row with nothing to train on."""

    most_lost: float = Field(default=0.5, ge=0, le=1)
    """Stop if a larger share of an iteration's or evaluation's samples was lost to errors of the judge, the
    policy or the environment. Nothing is trained on or counted then; ``--resume`` makes up for them."""


class EvaluationConfig(Section):
    """Settings of evaluations. Their tasks are always the same, so that results can be compared."""

    count: int | None = Field(default=None, ge=1)
    """Number of test tasks, drawn at random; ``None`` for all."""

    samples: int = Field(default=1, ge=1)
    """Attempts per task."""

    sessions: int | None = Field(default=None, ge=1)
    """Browser sessions of its own for an evaluation beside collection (``loop.staleness`` above 0); ``None``
    to share those of collection."""

    budget: tuple[int, int, int] = (30, 50, 70)
    """Step budgets of easy, medium and hard tasks (paper §5)."""

    seed: int = 0
    """Seed of the draw and of the attempts."""

    sampling: Sampling | None = None
    """Sampling parameters of the replies, over those of training; the paper's are top-p 0.99 and top-k 2."""


class TrainConfig(Section):
    """The config of a training, stored in resolved form as ``config.yaml`` in its folder. No secrets."""

    seed: int = Field(default=0, ge=0)
    """Seed of the draws of tasks and steps, and of the attempts."""

    learn: LearnConfig
    """From judged trajectories to weights."""

    rollout: RunConfig = RunConfig()
    """How trajectories are collected and judged. The policy is the trained model."""

    sampler: SamplerConfig = SamplerConfig()
    """Which training tasks are drawn."""

    loop: LoopConfig = LoopConfig()
    """The training loop."""

    evaluation: EvaluationConfig = EvaluationConfig()
    """The evaluations."""

    trackers: tuple[TrackerName, ...] = ("tensorboard",)
    """Trackers that get the figures of each iteration: ``tensorboard``, ``wandb``."""

    project: str = "webgym"
    """Project name in Weights & Biases."""

    local: LocalConfig | None = None
    """The model in this process that collects; by default :attr:`LearnConfig.model`."""

    vllm: VllmConfig | None = None
    """A vLLM server that collects instead: started here, or running already."""

    layout: str | None = None
    """GPUs of this machine that learn, policy servers, and GPUs of the judge's server, such as ``4+3+1``, or
    ``4+2x2+0`` for two servers of two GPUs each. They are started there, the policy in place of ``local``."""

    @field_validator("layout")
    @classmethod
    def _is_layout(cls, value: str | None) -> str | None:
        return None if value is None else str(Layout.parse(value))

    @model_validator(mode="after")
    def _check_serving(self) -> TrainConfig:
        if self.local is not None and self.vllm is not None:
            raise ValueError("set either local or vllm, not both")
        if self.loop.staleness and self.rollout.collector.is_grouped:
            raise ValueError("a collector.schedule with groups leaves nothing to overlap: set staleness to 0")
        if self.loop.staleness and self.rollout.collector.metrics_port:
            raise ValueError("collections that overlap need a collector.metrics_port each: set it to 0")
        return self

    @property
    def sampling(self) -> Sampling:
        """Sampling parameters of the policy's replies: what is set, over the profile's."""
        served = self.vllm or self.local or LocalConfig(path=self.learn.model)
        name = Path(served.path if isinstance(served, LocalConfig) else self.learn.model).name
        return choose_profile(self.rollout.agent.profile, name).sampling_of(served.sampling)


class Learns(Protocol):
    """Trains weights on steps; implemented by :class:`webgym.train.update.Learner`."""

    def learn(self, number: int, draw: ReplaySample, folder: TrainingFolder) -> Mapping[str, Any]:
        """Train on a draw and save the weights; returns figures of the update. Blocks."""
        ...


class Attempts(Protocol):
    """Collects runs; implemented by :func:`make_run`."""

    async def __call__(
        self,
        out: Path,
        config: RunConfig,
        tasks: Sequence[Task],
        policy: Policy,
        secrets: Secrets,
        show: Show | None,
        places: Places | None,
    ) -> Summary:
        """Collect a run, or resume it if it exists."""
        ...


async def make_run(
    out: Path,
    config: RunConfig,
    tasks: Sequence[Task],
    policy: Policy,
    secrets: Secrets,
    show: Show | None,
    places: Places | None = None,
    finishing: asyncio.Event | None = None,
) -> Summary:
    """Collect a run, or resume it if it exists; once ``finishing`` is set, no new attempt starts."""
    used: dict[str, Any] = {"policy": policy, "secrets": secrets, "show": show, "tell": None}
    used |= {"places": places, "finishing": finishing}
    if (out / CONFIG).exists():
        # What failed before the training stopped, often for the same cause, gets all of its tries again.
        return await resume(out, server=config.server, judge=config.judge, retry_errors=True, **used)
    return await collect(config, out, tasks=tasks, **used)


class Training:
    """A training run. Make it with :func:`webgym.train.start.open_training`.

    Args:
        config: everything.
        folder: where.
        tasks: the whole task set; test tasks are used for evaluation only.
        serving: serves the policy.
        learner: trains the weights.
        replay: selects the steps to train on.
        where: browsers and websites.
        secrets: of those.
        show: shows the progress of each run.
        tell: called with each line that the user should read, such as a warning.
        stop: ends the training in time.
        attempts: collects the runs.

    Attributes:
        progress: of the training.

    Raises:
        ConfigError: the tasks have no training split, training tasks leak test tasks, or evaluations differ
            from those in the folder.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: TrainingFolder,
        tasks: Sequence[Task],
        *,
        serving: Serving,
        learner: Learns,
        replay: Replay,
        where: ServerChoice,
        secrets: Secrets,
        show: Show | None = None,
        tell: Tell | None = None,
        stop: Stop | None = None,
        attempts: Attempts | None = None,
    ) -> None:
        self._stop = stop or Stop()
        self._attempts = attempts or partial(make_run, finishing=self._stop.requested)
        self.config = config
        self.folder = folder
        self._serving = serving
        self._learner = learner
        self._replay = replay
        self._secrets = secrets
        self._show = show
        self._tell = tell or (lambda _line: None)
        self._track: Track = lambda _row: None
        unchecked = config.rollout.policy.model_copy(update={"check": False})  # before the training began
        self._rollout = config.rollout.model_copy(update={"server": where, "policy": unchecked})
        health = self._rollout.health
        if health.file is None and self._rollout.tasks.file is not None:  # what is found is for later draws
            health = health.model_copy(update={"file": folder.path / SITES})
            self._rollout = self._rollout.model_copy(update={"health": health})
        sampling = config.sampler.model_copy(update={"seed": config.seed})
        frontier = config.learn.frontier
        self._frontier = Frontier(frontier) if frontier is not None else None
        weigh = self._frontier.weigh if self._frontier is not None else None
        self._sampler = Sampler(
            tasks, sampling, blocked=health_of(self._rollout).blocked, weigh=weigh, anew=weigh is not None
        )
        self._test = [task for task in tasks if task.split == "test"]
        if self._sampler.selected.split != "train":
            raise ConfigError(
                f"the tasks to train on are of the split {self._sampler.selected.split!r}",
                hint="give a task set with a train split: webgym tasks split makes one",
            )
        refuse_leaks(self._sampler.selected.tasks, self._test)
        self._refuse_other_evaluations()
        self.progress = TrainingProgress(config.loop.iterations)
        self._is_copied = config.loop.staleness > 0 and serving.copy() is not None
        """Whether evaluations have a copy of the model."""
        self._advanced = asyncio.Condition()
        self._free = asyncio.Semaphore(config.rollout.collector.sessions)
        self._enough: dict[int, asyncio.Event] = {}
        """Of each iteration that was begun, set once enough of its attempts have ended for an update."""
        self._late: set[int] = set()
        """Iterations in the replay of which attempts may be missing that end later."""
        self._published = 0
        self._finished = -1
        """The last finished iteration; 0 before the first, once the first weights are evaluated."""
        self._empty_iterations = 0
        self._frontier_knows = 0
        """The last iteration whose results the frontier has."""
        self._seconds: defaultdict[int, dict[str, float]] = defaultdict(
            lambda: dict.fromkeys(("collect", "replay", "update", "publish", "evaluate"), 0.0)
        )

    def use(self, where: ServerChoice, secrets: Secrets, track: Track) -> None:
        """Set the services, which start after this object is created.

        Args:
            where: browsers and websites.
            secrets: of those.
            track: called with each finished iteration's row of ``metrics.jsonl``.
        """
        self._rollout = self._rollout.model_copy(update={"server": where})
        self._secrets, self._track = secrets, track

    async def run(self) -> list[dict[str, Any]]:
        """Run the remaining iterations, and return a row of figures for every iteration.

        If there is no more time (``stop``), the folder says so when this returns
        (:attr:`TrainingFolder.stopped`).

        Raises:
            ExceptionGroup: holds the error that stopped the training.
        """
        self._refuse_other_evaluations()  # of which one may have been copied here
        self._restore()
        self.folder.mark_stopped(False)
        async with asyncio.TaskGroup() as group:
            watch = group.create_task(self._serving.watch())
            work = group.create_task(self._work(group))
            stop = group.create_task(self._stop.in_time(work, self._notify_advanced))
            await asyncio.wait([work])
            watch.cancel()
            stop.cancel()
        self.folder.mark_stopped(self.folder.stage(self.config.loop.iterations) is not None)
        return self.folder.write_metrics()

    async def _work(self, group: asyncio.TaskGroup) -> None:
        await self._begin()
        all_stages = (self._collect_all(group), self._learn_all(), self._finish_all())
        work = {group.create_task(each) for each in all_stages}
        try:
            await asyncio.wait(work)
        finally:
            for each in work:
                each.cancel()

    def _is_stopping(self) -> bool:
        return self._stop.requested.is_set()

    async def _begin(self) -> None:
        if learned := self.folder.learned(self._published):
            await self._serving.publish(self.folder.weights(learned), str(learned))
        if self.config.loop.evaluate_every and not self._test:
            self._tell("there are no test tasks, so nothing is evaluated")
        self.progress.begin(max(0, self._finished))

    def _restore(self) -> None:
        """Restore the state of sampler, frontier, replay and progress from finished stages."""
        if evaluated := self.folder.evaluations():
            self.progress.evaluated = success_line(evaluated[max(evaluated)])
        if self.folder.latest_weights() is not None and not self.folder.evaluation(0).exists():
            self._finished = 0  # the first weights are not evaluated any more
        for number in range(1, self.config.loop.iterations + 1):
            if self.folder.is_past(number, Stage.SAMPLE):
                sampled = self.folder.figures(number, Stage.SAMPLE)
                self._sampler.restore(sampled["sampler"])
                self._frontier_knows = sampled.get("frontier_knows", number - 1)
                if self._frontier is not None:
                    self._frontier.restore(sampled["frontier"])
            if self.folder.is_past(number, Stage.REPLAY):
                self._add(number)
                self._replay.use(self.folder.batch(number))
            if self.folder.is_past(number, Stage.UPDATE):
                self._published = number
                if self.folder.figures(number, Stage.UPDATE):
                    self._replay.publish(str(number))
                    self._empty_iterations = 0
                else:
                    self._empty_iterations += 1
            if self.folder.stage(number) is None:
                self._finished = number
        due = next(filter(self._is_evaluated, range(self._finished + 1, self._published)), None)
        if due is not None and not self._is_copied:  # its weights must reply first
            self._published = due

    # --- collecting ---------------------------------------------------------------------------------------

    async def _collect_all(self, group: asyncio.TaskGroup) -> None:
        runs = set[asyncio.Task[None]]()
        try:
            for number in range(1, self.config.loop.iterations + 1):
                if self.folder.is_past(number, Stage.COLLECT):
                    continue
                await self._until(partial(self._may_collect, number))
                if self._is_stopping():
                    break
                if not self.folder.is_past(number, Stage.SAMPLE):
                    await asyncio.to_thread(self._sample, number)
                places = Places(self._free)
                runs.add(group.create_task(self._collect(number, places)))
                self._enough[number] = places.enough
                await self._notify_advanced()
                await places.spare.wait()
            if runs:
                await asyncio.wait(runs)
        finally:
            for run in runs:
                run.cancel()

    def _may_collect(self, number: int) -> bool:
        staleness = self.config.loop.staleness
        if staleness == 0:
            return self._finished >= number - 1
        return self._published >= number - 1 - staleness

    def _sample(self, number: int) -> None:
        """Draw the tasks of an iteration. The frontier knows the results of all that were learned from."""
        while self.folder.is_past(known := self._frontier_knows + 1, Stage.COLLECT):
            if known >= number - self.config.loop.staleness:
                break  # whether it has ended depends on the clock
            self._take_results(known)
        tasks = self._sampler.draw(self.config.loop.tasks)
        frontier = self._frontier.state() if self._frontier is not None else {}
        state = {"sampler": self._sampler.state(), "frontier": frontier}
        self.folder.write_sample(number, tasks, state | {"frontier_knows": self._frontier_knows})

    async def _collect(self, number: int, places: Places) -> None:
        started = time.monotonic()
        config = self._rollout.model_copy(update={"seed": self.config.seed * 10_007 + number})
        run, tasks = self.folder.run(number), self.folder.tasks(number)
        with self.progress.stage(number, "collect"):
            summary = await self._attempt(run, config, tasks, self._serving.policy, places)
            if not self._is_stopping():  # or attempts may be missing
                figures = await asyncio.to_thread(figures_of, RunReader(run), summary)
                seconds = time.monotonic() - started
                self.folder.finish(number, Stage.COLLECT, figures | {"seconds": seconds})
                self.progress.collected = success_line(figures)
        places.spare.set()
        places.enough.set()
        await self._notify_advanced()

    def _take_results(self, number: int) -> None:
        """Add the rewards of an iteration to the frontier."""
        self._frontier_knows = number
        if self._frontier is None:
            return
        run = RunReader(self.folder.run(number))
        self._frontier.take(
            (run.tasks[trajectory.episode.task_id], float(trajectory.outcome is Outcome.SUCCESS))
            for trajectory in run.trajectories()
            if trajectory.outcome.is_rewarded
        )

    async def _attempt(
        self, out: Path, config: RunConfig, tasks: Sequence[Task], policy: Policy, places: Places
    ) -> Summary:
        """Make the attempts of a stage; if the training stops meanwhile, not all of them.

        Raises:
            TrainingError: too many were lost. The stage is not finished.
        """
        shared = places if self.config.loop.staleness else None
        summary = await self._attempts(out, config, tasks, policy, self._secrets, self._show, shared)
        planned = summary["planned"]["overall"]
        lost = summary["lost_samples"] + summary["outcomes"][Outcome.JUDGE_ERROR]
        lost -= sum(  # whoever keeps websites cannot be waited for
            loss["count"]
            for code, loss in summary["losses"].items()
            if isinstance(error_from_code(code, ""), SiteDead)
        )
        if lost > self.config.loop.most_lost * planned and not self._is_stopping():
            losses = summary["losses"].values()
            of_faults = (each for each in losses if any(Outcome(name).is_error for name in each["outcomes"]))
            raise TrainingError(
                f"{lost} of {planned} samples of {out.relative_to(self.folder.path)} were lost to errors: "
                + next((each["message"] for each in of_faults), "see its report"),
                hint="fix the cause, then --resume judges or attempts them again; loop.most_lost in "
                "config.yaml allows for more",
            )
        return summary

    # --- learning -----------------------------------------------------------------------------------------

    async def _learn_all(self) -> None:
        for number in range(self._published + 1, self.config.loop.iterations + 1):
            await self._until(partial(self._has_begun, number))
            if number in self._enough:
                await self._enough[number].wait()
                if await asyncio.to_thread(self._is_lossy, number):  # the end of its run says what to do
                    await self._until(partial(self.folder.is_past, number, Stage.COLLECT))
            # What was drawn is trained on, since other processes may have begun with it.
            is_drawn = self.folder.is_past(number, Stage.REPLAY)
            if not is_drawn and not self._stop.allow(self._update_seconds()):
                return
            with self._timed(number, "replay"):
                draw = await asyncio.to_thread(self._draw, number)
            with self._timed(number, "update"):
                await self._update(number, draw)
            if not self._is_copied:  # evaluations would get the new weights, too
                await self._until(partial(self._is_evaluated_before, number))
            if self._is_stopping():
                return
            with self._timed(number, "publish"):
                await self._publish(number)

    def _is_lossy(self, number: int) -> bool:
        """Whether more attempts of an iteration have ended in errors than may be lost."""
        run = self.folder.run(number)
        ended = RunReader(run).attempts.values() if run.exists() else ()
        planned = len(self.folder.tasks(number)) * self._rollout.samples
        return sum(each.outcome.is_error for each in ended) > self.config.loop.most_lost * planned

    def _has_begun(self, number: int) -> bool:
        return number in self._enough or self.folder.is_past(number, Stage.COLLECT)

    def _update_seconds(self) -> float:
        """How long the update of the last finished iteration took; 0 if there is none."""
        if self._finished < 1:
            return 0.0
        row = self.folder.figures(self._finished, Stage.FINISH)
        return max(row["seconds"]["update"], row["update"].get("seconds", 0.0))  # the first only since a stop

    @contextmanager
    def _timed(self, number: int, stage: str) -> Iterator[None]:
        """Show a stage in the progress, and note its wall time."""
        started = time.monotonic()
        with self.progress.stage(number, stage):
            yield
        self._seconds[number][stage] = time.monotonic() - started

    def _draw(self, number: int) -> ReplaySample:
        if self.folder.is_past(number, Stage.REPLAY):
            return self.folder.draw(number)
        for late in sorted(self._late):
            self._late.discard(late)
            if late >= number - self._replay.span:
                self._add(late)
        counts, wanted = self._add(number), self.config.learn.replay.trajectories or 0
        found, gathered = self._replay.mixed_trajectories(), self._empty_iterations + 1
        if found < wanted and gathered < min(self._replay.span, self.config.loop.give_up_after):
            draw = ReplaySample((), counts, 0, 0, {})
        else:
            draw = self._replay.draw()
        if found < wanted:
            rest = "it is made of those" if draw.steps else "collecting goes on"
            self._tell(f"iteration {number}: {found} of {wanted} trajectories for an update; {rest}")
        self.folder.write_batch(number, draw)
        return draw

    def _add(self, number: int) -> Counts:
        """Add what there is of an iteration to the replay; what comes later is added before the next draw."""
        is_over = self.folder.is_past(number, Stage.COLLECT)
        if not is_over:
            self._late.add(number)
        return self._replay.add(number, RunReader(self.folder.run(number)), is_over=is_over)

    async def _update(self, number: int, draw: ReplaySample) -> None:
        if self.folder.is_past(number, Stage.UPDATE):
            return
        if draw.steps:
            # A thread cannot be cancelled: the folder stays locked until it has ended.
            await uninterrupted(asyncio.to_thread(self._learn, number, draw))
            self._empty_iterations = 0
        else:
            self.folder.finish(number, Stage.UPDATE, {})
            self._empty_iterations += 1
            self._tell(f"iteration {number}: there is nothing to train on yet; the weights do not change")
        if self._empty_iterations >= self.config.loop.give_up_after:
            raise TrainingError(
                f"{self._empty_iterations} iterations in a row had nothing to train on: "
                "no step had an advantage",
                hint="start with easier tasks or a better model; what was collected is kept",
            )

    def _learn(self, number: int, draw: ReplaySample) -> None:
        self.folder.finish(number, Stage.UPDATE, self._learner.learn(number, draw, self.folder))

    async def _publish(self, number: int) -> None:
        if self.folder.figures(number, Stage.UPDATE):
            await self._serving.publish(self.folder.weights(number), str(number))
            self._replay.publish(str(number))
        self._published = number
        await self._notify_advanced()

    # --- evaluating and finishing -------------------------------------------------------------------------

    async def _finish_all(self) -> None:
        for number in range(self._finished + 1, self.config.loop.iterations + 1):
            await self._until(partial(self._may_finish, number))
            if self._is_stopping():
                return
            if self._is_evaluated(number):
                with self._timed(number, "evaluate"):
                    await self._evaluate(number)
            if self._is_stopping():
                return
            if number:
                self._finish(number)
            self._finished = number
            await self._notify_advanced()

    def _may_finish(self, number: int) -> bool:
        return number == 0 or (self._published >= number and self.folder.is_past(number, Stage.COLLECT))

    def _is_evaluated(self, number: int) -> bool:
        every, last = self.config.loop.evaluate_every, self.config.loop.iterations
        return bool(every and self._test) and (number % every == 0 or number == last)

    def _is_evaluated_before(self, number: int) -> bool:
        """Whether all evaluations of earlier iterations have ended."""
        return not any(map(self._is_evaluated, range(self._finished + 1, number)))

    async def _evaluate(self, number: int) -> None:
        if self.folder.is_evaluated(number):
            return
        run, tasks = self._planned_evaluation()
        own = self.config.evaluation.sessions
        places = Places(asyncio.Semaphore(own) if own else self._free)
        async with self._pinned(number) as policy:
            summary = await self._attempt(self.folder.evaluation(number), run, tasks, policy, places)
        if self._is_stopping():
            return
        rates = rates_of(summary)
        self.folder.write_evaluation(number, rates)
        self.progress.evaluated = success_line(rates)
        self._tell(f"evaluation after iteration {number}: {success_line(rates)}")

    @asynccontextmanager
    async def _pinned(self, number: int) -> AsyncIterator[Policy]:
        """The policy with the weights of an iteration, whatever is published meanwhile."""
        copy = self._serving.copy() if self._is_copied else None
        if copy is None:
            yield self._serving.policy
            return
        async with copy:
            if learned := self.folder.learned(number):
                await copy.publish(self.folder.weights(learned), str(learned))
            yield copy.policy

    def _planned_evaluation(self) -> tuple[RunConfig, list[Task]]:
        """The run of every evaluation, and its tasks."""
        config = self.config.evaluation
        easy, medium, hard = config.budget
        limits = {"budget_easy": easy, "budget_medium": medium, "budget_hard": hard}
        choice = self._rollout.tasks.model_copy(update={"split": "test", "count": "all", "ratio": None})
        run = self._rollout.model_copy(
            update={
                "seed": config.seed,
                "samples": config.samples,
                "tasks": choice,
                "agent": self._rollout.agent.model_copy(update={"sampling": config.sampling}),
                "attempt": self._rollout.attempt.model_copy(update=limits),
                "collector": self._rollout.collector.model_copy(update={"straggler_share": 1.0}),
            }
        )
        tasks = Sampler(self._test, SamplerConfig(split="test", seed=config.seed)).draw(
            min(config.count or len(self._test), len(self._test))
        )
        return run, tasks

    def _refuse_other_evaluations(self) -> None:
        """Refuse to evaluate otherwise than before: one curve would show what cannot be compared.

        Raises:
            ConfigError: tasks, attempts, replies' sampling, browsers or judge differ from those of the newest
                evaluation on disk.
        """
        paths = sorted(self.folder.path.glob(f"{EVALUATIONS}/*/{CONFIG}"))
        if not paths or not self.config.loop.evaluate_every or not self._test:
            return
        newest = RunReader(paths[-1].parent, skip_corrupt=True)
        run, tasks = self._planned_evaluation()
        sampling = (run.agent.sampling or Sampling()).over(self.config.sampling)
        now = _conditions(run, tasks, sampling.body(), name_of(run.judge))
        replies = (step.reply for each in newest.trajectories() for step in each.episode.steps)
        known = now["sampling"]
        recorded = next((reply.sampling for reply in replies if known.keys() & reply.sampling), known)
        config = read_config(newest)[0]
        judges = (each.verdict.judge for each in newest.trajectories() if each.verdict is not None)
        judge = name_of(config.judge)
        if ":" not in config.judge.name:  # one of our own, which puts its name into its verdicts
            judge = next(judges, judge)
        before = _conditions(config, newest.drawn, recorded, judge)
        # A judge is told by name: it may be one with the same settings, of another version.
        judges_told = {"rollout.judge": f"rollout.judge ({judge}, now {now['rollout.judge']})"}
        differing = [judges_told.get(name, name) for name, value in now.items() if value != before[name]]
        if differing:
            raise ConfigError(
                f"{newest.path.relative_to(self.folder.path)} had other values: {', '.join(differing)} "
                "(evaluations could not be compared)",
                hint=f"undo the change in {CONFIG}, the tasks or the version of WebGym; "
                f"or move {EVALUATIONS}/ elsewhere, and a new curve begins",
            )

    def _finish(self, number: int) -> None:
        collected = self.folder.figures(number, Stage.COLLECT)
        row = {
            "iteration": number,
            "at": time.time(),
            "trajectories": collected["attempts"] + self._trajectories_before(number),
            "seconds": self._seconds[number] | {"collect": collected.pop("seconds")},
            "collect": collected,
            "replay": self.folder.figures(number, Stage.REPLAY),
            "update": self.folder.figures(number, Stage.UPDATE),
        }
        self.folder.finish(number, Stage.FINISH, row)
        rows = self.folder.write_metrics()
        # Only now: until then weights may be needed that replied before, or are evaluated.
        self.folder.prune_weights(self.config.loop.keep_weights, number)
        self.progress.finish()
        self._tell(iteration_line(rows[-1], self.progress))
        self._track(rows[-1])
        watch_for_collapse(rows, self.config.learn.on_collapse, self._tell)

    def _trajectories_before(self, number: int) -> int:
        if number == 1:
            return 0
        return int(self.folder.figures(number - 1, Stage.FINISH)["trajectories"])

    # --- waiting ------------------------------------------------------------------------------------------

    async def _until(self, holds: Callable[[], bool]) -> None:
        """Wait until this holds, or the training stops."""
        async with self._advanced:
            await self._advanced.wait_for(lambda: holds() or self._is_stopping())

    async def _notify_advanced(self) -> None:
        async with self._advanced:
            self._advanced.notify_all()


def _conditions(
    config: RunConfig, tasks: Sequence[Task], sampling: Mapping[str, Any], judge: str
) -> dict[str, Any]:
    """What must be the same for the results of evaluations to be compared, by name."""
    return {
        "test tasks": sorted(map(msgspec.json.encode, tasks)),
        "evaluation.seed": config.seed,
        "evaluation.samples": config.samples,
        "evaluation.budget": config.attempt.budget,
        "sampling": EXPLICIT.body() | dict(sampling),
        "rollout.agent": config.agent.model_copy(update={"sampling": None}),
        "rollout.attempt.viewport": config.attempt.viewport,
        "rollout.browser": config.browser.model_dump(exclude=_OF_THE_MACHINE),
        "rollout.sites": config.sites.model_dump(include=_OF_THE_PAGES),
        "rollout.judge": judge,
    }
