"""The replay buffer: which steps are trained on (paper §5, appendix F), and what each rule left out.

    replay = Replay(ReplayConfig(), objective, seed=7)
    replay.add(0, RunReader(folder))   # after each iteration, with its trajectories
    drawn = replay.draw()              # the steps that the newest iteration trains on

Rules, in this order:

1. a trajectory without a reward (blocked, an error, cancelled) is never trained on;
2. a trajectory to which the objective gives no advantage is left out (with the paper's: all but successes);
3. a reply without a valid action is not reinforced: its step is left out, unless its advantage is negative;
4. nor is a step after which the screenshot was unchanged (repetition penalty), but for the answer, after
   which there is no observation;
5. a step that was used ``max_uses`` times is left out;
6. if the objective bounds staleness, a step is left out if the weights named in its reply are too old, or
   were never published;
7. iterations older than the last k are dropped;
8. from the rest, ``steps`` steps are drawn without replacement, in proportion to the weight

       w(a) = ((k - a) / k) ** p        a: age in iterations, newest 0;  k = 4;  p = 2

   that is 1, 0.56, 0.25, 0.06. For iterations of equal size this is the authors' weight, a power of a step's
   rank in the order of collection.

The same seed, settings and trajectories give the same draw, regardless of the order in which they ended.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Protocol

import msgspec
import numpy as np

from webgym.core.action import Answer
from webgym.core.errors import ConfigError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Step, Trajectory
from webgym.tasks.split import leaking
from webgym.train.config import ReplayConfig
from webgym.train.objectives import Attempt, Objective


class Judged(Protocol):
    """The trajectories of an iteration: a :class:`webgym.RunReader`, or an object like it."""

    @property
    def tasks(self) -> Mapping[str, Task]:
        """The tasks by id."""
        ...

    @property
    def drawn(self) -> Sequence[Task]:
        """The tasks in the order drawn, one that was drawn twice twice."""
        ...

    @property
    def samples(self) -> int:
        """Planned attempts at each drawn task."""
        ...

    def trajectories(self) -> Iterator[Trajectory]:
        """All trajectories."""
        ...


class StepRef(msgspec.Struct, frozen=True, order=True):
    """A reference to a step that is trained on.

    Attributes:
        iteration: in which it was collected.
        attempt_id: of its trajectory.
        index: in its trajectory, from 0.
        advantage: of its trajectory, from the objective.
        version: of the policy's weights, as its reply records it; empty if unknown.
    """

    iteration: int
    attempt_id: str
    index: int
    advantage: float = 1.0
    version: str = ""


class Counts(msgspec.Struct, frozen=True):
    """Counts of an iteration's trajectories, and of the steps of those that are trained on.

    ``trajectories == unrewarded + left_out + kept`` and
    ``steps == unreadable + unchanged + kept_steps``.

    Attributes:
        trajectories: all trajectories of the iteration.
        unrewarded: without a reward (rule 1).
        left_out: without an advantage (rule 2).
        kept: trained on.
        steps: all steps of the kept trajectories.
        unchanged: left out by the repetition penalty (rule 4).
        kept_steps: may be drawn.
        unreadable: left out because their replies have no valid action (rule 3).
    """

    trajectories: int = 0
    unrewarded: int = 0
    left_out: int = 0
    kept: int = 0
    steps: int = 0
    unchanged: int = 0
    kept_steps: int = 0
    unreadable: int = 0


class ReplaySample(msgspec.Struct, frozen=True):
    """The steps that an iteration trains on.

    Attributes:
        steps: listed once; they are trained on :attr:`ReplayConfig.passes` times.
        counts: of the newest iteration.
        pool: number of steps that could be drawn, over all iterations.
        used_up: number of steps that rule 5 left out, over all iterations.
        stale: number of steps that rule 6 left out, over all iterations.
        by_staleness: number of drawn steps by the age of their weights in updates, if known.
        by_age: number of drawn steps by age in iterations.
    """

    steps: tuple[StepRef, ...]
    counts: Counts
    pool: int
    used_up: int
    by_age: dict[int, int]
    stale: int = 0
    by_staleness: dict[int, int] = {}


def refuse_test_tasks(task: Task) -> None:
    """Refuse a task of the test split.

    Raises:
        ConfigError: the task is of the test split.
    """
    if task.split == "test":
        raise ConfigError(
            f"{task.id} is a test task: nothing is trained on it", hint="collect with split: train"
        )


class Replay:
    """A replay buffer of references to the steps of the last iterations.

    Args:
        config: parameters of the rules.
        objective: determines which trajectories are trained on.
        seed: of the draws.
        guard: called with the task of every trajectory; raises if it must not be trained on.
    """

    def __init__(
        self,
        config: ReplayConfig,
        objective: Objective,
        *,
        seed: int = 0,
        guard: Callable[[Task], None] = refuse_test_tasks,
    ) -> None:
        self._config = config
        self._objective = objective
        self._seed = seed
        self._guard = guard
        self._pool: dict[int, list[StepRef]] = {}
        self._counts: dict[int, Counts] = {}
        self._uses: Counter[tuple[int, str, int]] = Counter()
        self._versions = {"0": 0}  # number of earlier updates, by version of the weights

    @property
    def span(self) -> int:
        """Number of iterations that are kept: the configured one, or fewer if the objective bounds
        staleness."""
        oldest = self._objective.max_age
        return self._config.iterations if oldest is None else min(self._config.iterations, oldest + 1)

    def add(self, iteration: int, run: Judged, *, is_over: bool = True) -> Counts:
        """Add the steps of an iteration, and drop iterations that are too old.

        An iteration that is still kept may be added again, with the attempts that ended since.

        Args:
            iteration: its number.
            run: its trajectories.
            is_over: whether no attempt of it is made any more. Until then, groups of attempts at a task of
                which one has not ended are left out.

        Raises:
            ConfigError: a trajectory is of a test task, or of one that leaks a test task of the run.
        """
        if self._pool and iteration < max(self._pool) and iteration not in self._pool:
            raise ValueError(f"iteration {iteration} comes after {max(self._pool)}")
        leaks = leaking(list(run.tasks.values()))
        trajectories = 0
        ended = Counter[str]()
        rewarded: list[Attempt] = []
        steps: dict[str, list[str]] = {}  # why each step is not reinforced; empty if it is
        versions: dict[str, list[str]] = {}
        for trajectory in run.trajectories():
            trajectories += 1
            episode = trajectory.episode
            self._guard(task := run.tasks[episode.task_id])
            if task.id in leaks:
                raise ConfigError(f"{leaks[task.id]} of its run", hint="collect with split: train")
            if (reward := trajectory.outcome.reward) is not None:
                rewarded.append(Attempt(episode.attempt_id, episode.task_id, reward))
                steps[episode.attempt_id] = [self._fault(step) for step in episode.steps]
                versions[episode.attempt_id] = [step.reply.weight_version for step in episode.steps]
            outcome = trajectory.outcome
            ended[episode.task_id] += not outcome.is_retried and outcome is not Outcome.JUDGE_ERROR
        if not is_over:
            planned = Counter(task.id for task in run.drawn)
            whole = {id_ for id_ in planned if ended[id_] >= planned[id_] * run.samples}
            rewarded = [each for each in rewarded if each.task_id in whole]
        advantages = self._objective.advantages(rewarded)
        refs = [
            StepRef(iteration, attempt, index, advantage, versions[attempt][index])
            for attempt, advantage in advantages.items()
            for index, fault in enumerate(steps[attempt])
            if advantage < 0 or not fault
        ]
        faults = Counter(
            fault for attempt, advantage in advantages.items() if advantage >= 0 for fault in steps[attempt]
        )
        self._pool[iteration] = sorted(refs)
        self._counts[iteration] = Counts(
            trajectories=trajectories,
            unrewarded=trajectories - len(rewarded),
            left_out=len(rewarded) - len(advantages),
            kept=len(advantages),
            steps=sum(len(steps[attempt]) for attempt in advantages),
            unchanged=faults["unchanged"],
            kept_steps=len(refs),
            unreadable=faults["unreadable"],
        )
        for old in [number for number in self._pool if number <= max(self._pool) - self.span]:
            del self._pool[old]
        return self._counts[iteration]

    def mixed_trajectories(self) -> int:
        """The number of trajectories that :meth:`draw` could take now."""
        pool = [ref for refs in self._pool.values() for ref in refs if self._may_be_used(ref)]
        newest = max(self._pool, default=0)
        return len({(ref.iteration, ref.attempt_id) for ref in pool if self._is_fresh(ref, newest)})

    def draw(self) -> ReplaySample:
        """Draw the steps that the newest iteration trains on, and count them as used.

        The draw may be empty: there may be nothing to learn from yet.

        Raises:
            ValueError: no iteration was added.
        """
        newest = max(self._pool)
        pool = [ref for iteration in sorted(self._pool) for ref in self._pool[iteration]]
        unused = [ref for ref in pool if self._may_be_used(ref)]
        candidates = [ref for ref in unused if self._is_fresh(ref, newest)]
        ages = np.array([newest - ref.iteration for ref in candidates])
        weights = ((self.span - ages) / self.span) ** self._config.recency
        # Exponential keys over weights: the smallest keys are a weighted draw without replacement.
        rng = np.random.Generator(np.random.PCG64([self._seed, newest]))
        keys = rng.exponential(size=len(candidates)) / weights
        chosen = sorted(candidates[index] for index in np.argsort(keys)[: self._config.steps])
        self.use(chosen)
        return ReplaySample(
            steps=tuple(chosen),
            counts=self._counts[newest],
            pool=len(candidates),
            used_up=len(pool) - len(unused),
            stale=len(unused) - len(candidates),
            by_staleness=dict(
                sorted(
                    Counter(self._staleness(ref) for ref in chosen if ref.version in self._versions).items()
                )
            ),
            by_age=dict(sorted(Counter(newest - ref.iteration for ref in chosen).items())),
        )

    def publish(self, version: str) -> None:
        """Count an update: this version now samples replies, and all others become one update older."""
        self._versions.setdefault(version, len(self._versions))

    def use(self, steps: Iterable[StepRef]) -> None:
        """Count steps as drawn. :meth:`draw` does this; a resumed training does it for earlier draws."""
        for ref in steps:
            self._uses[ref.iteration, ref.attempt_id, ref.index] += self._config.passes

    def _may_be_used(self, ref: StepRef) -> bool:
        most = self._config.max_uses
        uses = self._uses[ref.iteration, ref.attempt_id, ref.index]
        return most is None or uses + self._config.passes <= most

    def _is_fresh(self, ref: StepRef, newest: int) -> bool:
        most = self._objective.max_age
        if most is None:
            return True
        if not ref.version:  # unknown: as old as its iteration
            return newest - ref.iteration <= most
        return ref.version in self._versions and self._staleness(ref) <= most

    def _staleness(self, ref: StepRef) -> int:
        return len(self._versions) - 1 - self._versions[ref.version]

    def _fault(self, step: Step) -> str:
        """Why a step is not reinforced; empty if it is."""
        if step.action is None:
            return "unreadable"
        is_idle = step.changed is False and not isinstance(step.action, Answer)
        return "unchanged" if is_idle and self._config.repetition_penalty else ""
