"""The replay buffer: which steps are trained on (paper §5, appendix F), and what each rule left out.

    replay = Replay(ReplayConfig(), objective, seed=7)
    replay.add(0, RunReader(folder))   # after each iteration, with its trajectories
    drawn = replay.draw()              # the steps that the newest iteration trains on

Rules, in this order:

1. a trajectory without a reward (blocked, an error, cancelled) is never trained on;
2. a trajectory to which the objective gives no advantage is left out (with the paper's: all but successes;
   with a baseline: those of groups that are not mixed, or of which an attempt was cut off or goes on);
3. a reply without a valid action is not reinforced: its step is left out, unless its advantage is negative;
4. nor is a step after which the screenshot was unchanged (repetition penalty), but for the answer, after
   which there is no observation;
5. a step that was used ``max_uses`` times is left out;
6. if the objective bounds staleness, a step is left out if the weights named in its reply are too old, or
   were never published;
7. iterations older than the last k are dropped;
8. from the rest, ``steps`` steps or ``trajectories`` whole trajectories are drawn without replacement, in
   proportion to the weight

       w(a) = ((k - a) / k) ** p        a: age in iterations, newest 0;  k = 4;  p = 2

   that is 1, 0.56, 0.25, 0.06. For iterations of equal size this is the authors' weight, a power of a step's
   rank in the order of collection.

The same seed, settings and trajectories give the same draw, regardless of the order in which they ended.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from statistics import fmean
from typing import Final, NamedTuple, Protocol

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

    ``trajectories + rescued == unrewarded + left_out + kept`` and
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
        rescued: earlier successes that were added to groups that failed altogether.
        group_count: number of groups, which are tasks with several attempts.
        groups: shares of them by what the attempts with a reward were: ``all_right``, ``all_wrong`` or
            ``mixed``; ``cut_off`` if an attempt did not end.
    """

    trajectories: int = 0
    unrewarded: int = 0
    left_out: int = 0
    kept: int = 0
    steps: int = 0
    unchanged: int = 0
    kept_steps: int = 0
    unreadable: int = 0
    rescued: int = 0
    group_count: int = 0
    groups: dict[str, float] = {}


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
        mean_staleness: mean age of their weights in updates; ``None`` if unknown.
        trajectories: number of trajectories that the drawn steps are of.
        earlier_uses: how often a drawn step was trained on before, mean.
        advantages: of the drawn steps: ``lowest``, ``highest``, and the mean of their size.
    """

    steps: tuple[StepRef, ...]
    counts: Counts
    pool: int
    used_up: int
    by_age: dict[int, int]
    stale: int = 0
    by_staleness: dict[int, int] = {}
    mean_staleness: float | None = None
    trajectories: int = 0
    earlier_uses: float = 0.0
    advantages: dict[str, float] = {}


class _Candidate(NamedTuple):
    """A trajectory with a reward: where it is, as the objective sees it, and of each step why it is not
    reinforced (empty if it is) and the version of the weights."""

    iteration: int
    attempt_id: str
    attempt: Attempt
    faults: list[str]
    versions: list[str]


_KINDS: Final = ("all_right", "all_wrong", "mixed", "cut_off")


def _kind(group: Sequence[_Candidate], is_whole: bool) -> str:
    """One of :data:`_KINDS`."""
    if not is_whole:
        return "cut_off"
    rewards = {each.attempt.reward for each in group}
    return "mixed" if len(rewards) > 1 else "all_right" if rewards == {1.0} else "all_wrong"


def _planned(run: Judged) -> Counter[str]:
    """The number of planned attempts at each task."""
    samples, planned = run.samples, Counter[str]()
    for task in run.drawn:
        planned[task.id] += samples
    return planned


def _whole(
    planned: Mapping[str, int], last: Mapping[tuple[str, int], tuple[int, Outcome]], *, is_over: bool
) -> Collection[str]:
    """The tasks whose attempts all ended. One that was lost to an error or that a website refused ended, too:
    the policy was not the reason."""
    ended: Counter[str] = Counter()
    for (task_id, _), (_, outcome) in last.items():
        may_change = outcome.is_retried or outcome is Outcome.JUDGE_ERROR
        ended[task_id] += outcome is not Outcome.CANCELLED and (is_over or not may_change)
    return {task_id for task_id, count in planned.items() if ended[task_id] >= count}


def _key(ref: StepRef) -> tuple[int, str, int]:
    return ref.iteration, ref.attempt_id, ref.index


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
        self._successes: dict[str, _Candidate] = {}
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
            is_over: whether no attempt of it is made any more: what is missing then is lost, not late.

        Raises:
            ConfigError: a trajectory is of a test task, or of one that leaks a test task of the run.
        """
        if self._pool and iteration < max(self._pool) and iteration not in self._pool:
            raise ValueError(f"iteration {iteration} comes after {max(self._pool)}")
        leaks = leaking(list(run.tasks.values()))
        found: list[_Candidate] = []
        last: dict[tuple[str, int], tuple[int, Outcome]] = {}  # of each sample: its newest attempt's outcome
        trajectories = 0
        for trajectory in run.trajectories():
            trajectories += 1
            episode, outcome = trajectory.episode, trajectory.outcome
            self._guard(task := run.tasks[episode.task_id])
            if task.id in leaks:
                raise ConfigError(f"{leaks[task.id]} of its run", hint="collect with split: train")
            sample = (task.id, episode.sample)
            last[sample] = max(last.get(sample, (-1, outcome)), (episode.retry, outcome))
            if outcome.reward is not None:
                found.append(self._candidate(iteration, trajectory, outcome.reward))
        planned = _planned(run)
        whole = _whole(planned, last, is_over=is_over)
        groups: defaultdict[str, list[_Candidate]] = defaultdict(list)
        for each in found:
            groups[each.attempt.task_id].append(each)
        kinds = Counter(
            _kind(group, id_ in whole) for id_, group in groups.items() if planned[id_] > 1 or len(group) > 1
        )
        if self._config.rescue:
            found += self._rescued(iteration, groups)
        advantages = self._objective.advantages(
            msgspec.structs.replace(each.attempt, is_whole=each.attempt.task_id in whole) for each in found
        )
        kept = [(each, advantages[each.attempt.id]) for each in found if each.attempt.id in advantages]
        refs = [
            StepRef(each.iteration, each.attempt_id, index, advantage, version)
            for each, advantage in kept
            for index, (fault, version) in enumerate(zip(each.faults, each.versions, strict=True))
            if advantage < 0 or not fault
        ]
        faults = Counter(fault for each, advantage in kept if advantage >= 0 for fault in each.faults)
        rewarded = sum(each.iteration == iteration for each in found)
        self._pool[iteration] = sorted(refs)
        self._counts[iteration] = Counts(
            trajectories=trajectories,
            unrewarded=trajectories - rewarded,
            left_out=len(found) - len(kept),
            kept=len(kept),
            steps=sum(len(each.faults) for each, _ in kept),
            unchanged=faults["unchanged"],
            kept_steps=len(refs),
            unreadable=faults["unreadable"],
            rescued=len(found) - rewarded,
            group_count=kinds.total(),
            groups={kind: kinds[kind] / kinds.total() for kind in _KINDS} if kinds else {},
        )
        for old in [number for number in self._pool if number <= max(self._pool) - self.span]:
            del self._pool[old]
        return self._counts[iteration]

    def mixed_trajectories(self) -> int:
        """The number of trajectories that :meth:`draw` could take now: with an advantage, so of a mixed group
        if the objective compares attempts, and with a step that is neither used up nor stale."""
        return len({(ref.iteration, ref.attempt_id) for _, ref in self._candidates()[0]})

    def draw(self) -> ReplaySample:
        """Draw the steps that the newest iteration trains on, and count them as used.

        The draw may be empty: there may be nothing to learn from yet.

        Raises:
            ValueError: no iteration was added.
        """
        newest = max(self._pool)
        candidates, used_up, stale = self._candidates()
        whole = self._config.trajectories is not None
        units: dict[tuple[int, int, str, int], list[StepRef]] = {}
        ages: list[int] = []
        for number, ref in candidates:
            unit = units.setdefault((number, ref.iteration, ref.attempt_id, -1 if whole else ref.index), [])
            ages += [] if unit else [newest - number]
            unit.append(ref)
        weights = ((self.span - np.array(ages)) / self.span) ** self._config.recency
        # Exponential keys over weights: the smallest keys are a weighted draw without replacement.
        rng = np.random.Generator(np.random.PCG64([self._seed, newest]))
        keys = rng.exponential(size=len(units)) / weights
        most = self._config.trajectories or self._config.steps
        every = list(units.values())
        chosen = sorted(ref for index in np.argsort(keys)[:most] for ref in every[index])
        advantages = [ref.advantage for ref in chosen]
        stalenesses = [self._staleness(ref) for ref in chosen if ref.version in self._versions]
        uses = sum(self._uses[_key(ref)] for ref in chosen)
        self.use(chosen)
        return ReplaySample(
            steps=tuple(chosen),
            counts=self._counts[newest],
            pool=len(candidates),
            used_up=used_up,
            stale=stale,
            by_staleness=dict(sorted(Counter(stalenesses).items())),
            mean_staleness=fmean(stalenesses) if stalenesses else None,
            by_age=dict(sorted(Counter(newest - ref.iteration for ref in chosen).items())),
            trajectories=len({(ref.iteration, ref.attempt_id) for ref in chosen}),
            earlier_uses=uses / len(chosen) if chosen else 0.0,
            advantages={
                "lowest": min(advantages),
                "highest": max(advantages),
                "mean_size": fmean(map(abs, advantages)),
            }
            if chosen
            else {},
        )

    def publish(self, version: str) -> None:
        """Count an update: this version now samples replies, and all others become one update older."""
        self._versions.setdefault(version, len(self._versions))

    def use(self, steps: Iterable[StepRef]) -> None:
        """Count steps as drawn. :meth:`draw` does this; a resumed training does it for earlier draws."""
        for ref in steps:
            self._uses[_key(ref)] += self._config.passes

    def _candidates(self) -> tuple[list[tuple[int, StepRef]], int, int]:
        """The steps that may be drawn, each with the iteration that it was added with, and the numbers of
        those that are used up and that are stale."""
        pool = [(number, ref) for number in sorted(self._pool) for ref in self._pool[number]]
        unused = [each for each in pool if self._may_be_used(each[1])]
        newest = max(self._pool, default=0)
        fresh = [each for each in unused if each[1].iteration < each[0] or self._is_fresh(each[1], newest)]
        return fresh, len(pool) - len(unused), len(unused) - len(fresh)

    def _candidate(self, iteration: int, trajectory: Trajectory, reward: float) -> _Candidate:
        episode, verdict = trajectory.episode, trajectory.verdict
        score = verdict.score if verdict is not None else None
        attempt = Attempt(episode.attempt_id, episode.task_id, reward, score)
        faults = [self._fault(step) for step in episode.steps]
        versions = [step.reply.weight_version for step in episode.steps]
        return _Candidate(iteration, episode.attempt_id, attempt, faults, versions)

    def _rescued(self, iteration: int, groups: Mapping[str, list[_Candidate]]) -> list[_Candidate]:
        """The newest earlier success at each task whose attempts all failed; remembers the new successes."""
        found = []
        for task_id, group in groups.items():
            earlier = self._successes.get(task_id)
            won = [each for each in group if each.attempt.reward == 1]
            if won and (earlier is None or earlier.iteration <= iteration):
                attempt = msgspec.structs.replace(won[0].attempt, id=f"{iteration}/{won[0].attempt.id}")
                self._successes[task_id] = won[0]._replace(attempt=attempt)
            elif not won and earlier is not None and earlier.iteration < iteration:
                found.append(earlier)
        return found

    def _may_be_used(self, ref: StepRef) -> bool:
        most = self._config.max_uses
        return most is None or self._uses[_key(ref)] + self._config.passes <= most

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
