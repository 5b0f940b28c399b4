"""The figures of a run, from its trajectories alone, one in memory at a time."""

from __future__ import annotations

import math
from array import array
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Literal, TypeAlias, TypedDict

import msgspec
import numpy as np

from webgym.agent.policy import ORACLES
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS, Task
from webgym.core.trajectory import Step, Trajectory
from webgym.judge.blocking import blocking_host
from webgym.rollout.rates import Interval, Successes, pass_at
from webgym.tasks.selection import splits_in

UNKNOWN = "unknown"
"""Domain and website of a trajectory whose task the run does not hold."""


MANY_INVALID = 0.05
"""Share of replies without an action above which a run warns: the model was perhaps asked wrongly."""


def oracle_note(policy: str) -> str:
    """What must be said wherever an oracle's figures are shown."""
    return f"the {policy} policy is an oracle: it plays known solutions and asks no model"


class Quantiles(TypedDict):
    """A distribution, in short.

    Attributes:
        count: how many values it was made from.
        p50, p95: median and 95th percentile; ``None`` if there was no value.
    """

    count: int
    p50: float | None
    p95: float | None


class Group(TypedDict):
    """The attempts that have something in common.

    Attributes:
        attempts: all of them; the outcomes add up to it.
        outcomes: how many ended so, for all eight outcomes.
        planned: samples that were wanted of the tasks of this group, whatever became of them.
        success_rate: success / (success + failure + truncated); ``None`` if there is none of these.
        success_interval: its Wilson 95 % interval; ``None`` with the rate.
        success_rate_of_planned: success / planned; ``None`` if nothing was planned.
        success_interval_of_planned: its Wilson 95 % interval; ``None`` with the rate.
        steps: all steps taken.
        steps_per_attempt: median and 95th percentile over the attempts that carry a reward.
    """

    attempts: int
    outcomes: dict[str, int]
    planned: int
    success_rate: float | None
    success_interval: Interval | None
    success_rate_of_planned: float | None
    success_interval_of_planned: Interval | None
    steps: int
    steps_per_attempt: Quantiles


class Loss(TypedDict):
    """Attempts without a reward that ended for one reason.

    Attributes:
        count: how many.
        outcomes: what became of them.
        attempt_id, message: of the first.
    """

    count: int
    outcomes: dict[str, int]
    attempt_id: str
    message: str


class PassAt(TypedDict):
    """The chance that one of k attempts at a task succeeds.

    Attributes:
        value: mean over the tasks; ``None`` if there is none.
        tasks: how many have k attempts that carry a reward.
    """

    value: float | None
    tasks: int


class Summary(TypedDict):
    """What ``summary.json`` holds.

    Attributes:
        attempts: trajectories on disk, those that were made again included.
        outcomes: how many ended so, for all eight outcomes; adds up to ``attempts``.
        success_rate: success / (success + failure + truncated), for ``overall``, ``easy``, ``medium`` and
            ``hard``; ``None`` where nothing was rewarded.
        success_interval: the Wilson 95 % intervals of these rates.
        success_rate_of_planned: success / planned, likewise: what carries no reward, or was never attempted,
            is no success. A sample that was attempted again after an error is one.
        success_interval_of_planned: the Wilson 95 % intervals of these rates.
        planned: samples that were wanted, likewise, without those of other collectors.
        elsewhere: by task, how many of its samples other collectors of a shared list have.
        pass_at: for k = 1, 2, 4, ... and the number of samples per task: the chance that at least one of k
            attempts at a task succeeds, averaged over the tasks with k attempts that carry a reward. At 1 it
            is the mean over tasks of their success rates.
        steps: all steps taken.
        wall_seconds: while at least one attempt was in progress, or as the collector measured.
        steps_per_second: ``steps`` / ``wall_seconds``.
        policy, judge: names; several are joined by commas. Empty if there was none.
        seed: of the run.
        tasks: how many different tasks were attempted.
        split: of these tasks: ``train``, ``test``, ``unsplit`` or several, as the tasks themselves say.
        started_at: Unix time of the first attempt, seconds; ``None`` if there is none.
        step_milliseconds: what an agent waits for between its reply and the next look at the page.
        operation_milliseconds: per operation of the browser server, as it measured, and ``policy`` (one
            reply) and ``judge`` (one trajectory).
        by_level, by_domain, by_website: the same figures for a part of the attempts.
        lost_samples: samples whose last attempt ended in an error of the environment or the policy.
        invalid_replies: steps whose replies hold no action.
        invalid_reply_rate: their share of all steps; ``None`` if there is none.
        notes: what every figure here must be read with, a sentence each: that an oracle played, that many
            replies held no action.
        blocked_hosts: attempts that each host kept out, most first.
        losses: what ended attempts that carry no reward, by error code, or by outcome where there was no
            error (a website that blocks); most frequent first.
    """

    attempts: int
    outcomes: dict[str, int]
    success_rate: dict[str, float | None]
    success_interval: dict[str, Interval | None]
    success_rate_of_planned: dict[str, float | None]
    success_interval_of_planned: dict[str, Interval | None]
    planned: dict[str, int]
    elsewhere: dict[str, int]
    pass_at: dict[str, PassAt]
    steps: int
    wall_seconds: float
    steps_per_second: float
    policy: str
    judge: str
    seed: int | None
    tasks: int
    split: str
    started_at: float | None
    step_milliseconds: Quantiles
    operation_milliseconds: dict[str, Quantiles]
    by_level: dict[str, Group]
    by_domain: dict[str, Group]
    by_website: dict[str, Group]
    blocked_hosts: dict[str, int]
    losses: dict[str, Loss]
    lost_samples: int
    invalid_replies: int
    invalid_reply_rate: float | None
    notes: list[str]


def quantiles(values: Sequence[float]) -> Quantiles:
    """Median and 95th percentile, by linear interpolation between the ranks."""
    p50, p95 = map(float, np.quantile(values, (0.5, 0.95))) if len(values) else (None, None)
    return {"count": len(values), "p50": p50, "p95": p95}


def environment_milliseconds(steps: Sequence[Step]) -> list[float]:
    """How long the agent waited after each reply for the next look at the page."""
    return [
        max(0.0, (after.at - before.at - before.reply.seconds) * 1000) for before, after in pairwise(steps)
    ]


class Digest(msgspec.Struct, frozen=True, array_like=True):
    """What the figures of a run are made from: of a trajectory some hundred numbers, instead of its record.

    Attributes:
        judge: who judged it; ``None`` if nobody could.
        steps: how many were taken.
        waits: as :func:`environment_milliseconds` says.
        operations: milliseconds by operation, ``policy`` and ``judge`` among them.
        loss: why it carries no reward: error code, or outcome where there was no error, and message.
        invalid: steps whose replies hold no action.
        first_invalid: what was wrong with the first of these.
        blocked_by: host that kept the agent out; empty if none did.
    """

    attempt_id: str
    task_id: str
    sample: int
    retry: int
    outcome: Outcome
    policy: str
    judge: str | None
    started_at: float
    seconds: float
    steps: int
    waits: list[float]
    operations: dict[str, list[float]]
    loss: tuple[str, str] | None
    invalid: int
    first_invalid: str
    blocked_by: str = ""


def digest_of(trajectory: Trajectory) -> Digest:
    """What the figures of a run need of a trajectory."""
    episode = trajectory.episode
    operations: defaultdict[str, list[float]] = defaultdict(list)
    for observation in episode.observations:
        for operation, milliseconds in observation.milliseconds.items():
            operations[operation].append(milliseconds)
    operations["policy"] = [step.reply.seconds * 1000 for step in episode.steps]
    if trajectory.judge_seconds:
        operations["judge"] = [trajectory.judge_seconds * 1000]
    unread = [
        f"{step.parse_error} ({episode.attempt_id}, step {step.index})"
        for step in episode.steps
        if step.action is None
    ]
    return Digest(
        attempt_id=episode.attempt_id,
        task_id=episode.task_id,
        sample=episode.sample,
        retry=episode.retry,
        outcome=trajectory.outcome,
        policy=episode.policy,
        judge=trajectory.verdict.judge if trajectory.verdict else None,
        started_at=episode.started_at,
        seconds=episode.seconds,
        steps=len(episode.steps),
        waits=environment_milliseconds(episode.steps),
        operations=dict(operations),
        loss=_loss(trajectory),
        invalid=len(unread),
        first_invalid=unread[0] if unread else "",
        blocked_by=_blocked_by(trajectory),
    )


def _blocked_by(trajectory: Trajectory) -> str:
    verdict, seen = trajectory.verdict, trajectory.episode.observations
    if trajectory.outcome is not Outcome.BLOCKED or verdict is None:
        return ""
    return blocking_host(seen[0].url if seen else UNKNOWN, trajectory.episode, verdict.blocked)


def _loss(trajectory: Trajectory) -> tuple[str, str] | None:
    if trajectory.outcome.is_rewarded:
        return None
    if failure := trajectory.episode.failure or trajectory.judge_failure:
        return failure.code, failure.message
    return trajectory.outcome.value, trajectory.verdict.blocked.reason if trajectory.verdict else ""


class _Count:
    """One :class:`Group` while it is counted."""

    def __init__(self) -> None:
        self.outcomes: Counter[Outcome] = Counter()
        self.steps = 0
        self.lengths = array("d")

    def add(self, digest: Digest) -> None:
        self.outcomes[digest.outcome] += 1
        self.steps += digest.steps
        if digest.outcome.is_rewarded:
            self.lengths.append(digest.steps)

    def group(self, planned: int) -> Group:
        rewarded = sum(count for outcome, count in self.outcomes.items() if outcome.is_rewarded)
        successes = Successes(self.outcomes[Outcome.SUCCESS], rewarded, planned)
        return {
            "attempts": self.outcomes.total(),
            "outcomes": {outcome.value: self.outcomes[outcome] for outcome in Outcome},
            "planned": planned,
            "success_rate": successes.of_judged.value,
            "success_interval": successes.of_judged.interval,
            "success_rate_of_planned": successes.of_planned.value,
            "success_interval_of_planned": successes.of_planned.interval,
            "steps": self.steps,
            "steps_per_attempt": quantiles(self.lengths),
        }


def _covered(spans: Iterable[tuple[float, float]]) -> float:
    """The length of the union of intervals: a pause between two parts of a run does not count."""
    total, until = 0.0, -math.inf
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, until))
        until = max(until, end)
    return total


_Place: TypeAlias = tuple[Literal["all", "level", "domain", "website"], str]
"""A group of attempts: what they have in common, and which."""


def _places(task: Task | None) -> list[_Place]:
    """The groups that attempts at a task are in."""
    if task is None:
        return [("all", ""), ("domain", UNKNOWN), ("website", UNKNOWN)]
    return [("all", ""), ("level", task.level), ("domain", task.domain), ("website", task.website)]


class Tally:
    """Counts trajectories as they come; memory grows by a few numbers per step.

    Args:
        tasks: of the run as they were drawn: one that was drawn twice comes twice.
        samples: planned of every task.
    """

    def __init__(self, tasks: Sequence[Task], samples: int = 1) -> None:
        self._per_task = samples
        self._tasks = {task.id: task for task in tasks}
        self._samples = Counter(task.id for task in tasks for _ in range(samples))
        self._counts: defaultdict[_Place, _Count] = defaultdict(_Count)
        self._planned = Counter(place for task in tasks for place in _places(task))
        for place in self._planned:
            self._planned[place] *= samples
        self._attempted: defaultdict[str, dict[int, tuple[int, Outcome]]] = defaultdict(dict)
        self._policies: dict[str, None] = {}
        self._judges: dict[str, None] = {}
        self._spans: list[tuple[float, float]] = []
        self._waits = array("d")
        self._operations: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
        self._losses: dict[str, Loss] = {}
        self._blocked_by: Counter[str] = Counter()
        self._invalid = 0
        self._first_invalid = ""

    def add(self, digest: Digest) -> None:
        """Count one trajectory."""
        task = self._tasks.get(digest.task_id)
        samples = self._attempted[digest.task_id]
        is_new = digest.sample not in samples
        newest = samples.get(digest.sample)
        if newest is None or newest[0] <= digest.retry:
            samples[digest.sample] = (digest.retry, digest.outcome)
        if digest.blocked_by:
            self._blocked_by[digest.blocked_by] += 1
        for place in _places(task):
            self._counts[place].add(digest)
            # More than the run says it planned, as of a task that it does not hold.
            self._planned[place] += is_new and len(samples) > self._samples[digest.task_id]
        self._policies.setdefault(digest.policy)
        if digest.judge is not None:
            self._judges.setdefault(digest.judge)
        self._spans.append((digest.started_at, digest.started_at + digest.seconds))
        self._waits.extend(digest.waits)
        for operation, milliseconds in digest.operations.items():
            self._operations[operation].extend(milliseconds)
        self._invalid += digest.invalid
        self._first_invalid = self._first_invalid or digest.first_invalid
        if digest.loss is not None:
            code, message = digest.loss
            first: Loss = {"count": 0, "outcomes": {}, "attempt_id": digest.attempt_id, "message": message}
            loss, outcome = self._losses.setdefault(code, first), digest.outcome.value
            loss["count"] += 1
            loss["outcomes"][outcome] = loss["outcomes"].get(outcome, 0) + 1

    def _notes(self, policies: Iterable[str]) -> Iterator[str]:
        for name in policies:
            if name in ORACLES:
                yield oracle_note(name)
        steps = self._counts["all", ""].steps
        if steps and self._invalid / steps > MANY_INVALID:
            share = f"{self._invalid / steps:.1%} of {steps:,} replies hold no action"
            yield f"{share}; the first: {self._first_invalid}"

    def _pass_at(self) -> dict[str, PassAt]:
        ends = [[outcome for _, outcome in samples.values()] for samples in self._attempted.values()]
        won = [
            (outcomes.count(Outcome.SUCCESS), sum(outcome.is_rewarded for outcome in outcomes))
            for outcomes in ends
        ]
        found: dict[str, PassAt] = {}
        for k in sorted({*(2**n for n in range(self._per_task.bit_length())), self._per_task}):
            values = [value for c, n in won if (value := pass_at(k, c, n)) is not None]
            mean = sum(values) / len(values) if values else None
            found[str(k)] = {"value": mean, "tasks": len(values)}
        return found

    def _groups(self, elsewhere: Mapping[str, int]) -> dict[_Place, Group]:
        """All in which anything was attempted, and every level."""
        planned = self._planned.copy()
        for task_id, count in elsewhere.items():
            for place in _places(self._tasks.get(task_id)):
                planned[place] -= count
        places: list[_Place] = [("all", ""), *(("level", level) for level in LEVELS), *sorted(self._counts)]
        return {place: self._counts.get(place, _Count()).group(planned[place]) for place in places}

    def summary(
        self,
        *,
        seed: int | None = None,
        policy: str | None = None,
        judge: str | None = None,
        wall_seconds: float | None = None,
        elsewhere: Mapping[str, int] | None = None,
    ) -> Summary:
        """The figures so far, as :func:`summarise` tells them."""
        groups = self._groups(elsewhere or {})
        overall = groups["all", ""]
        levels: dict[str, Group] = {level: groups["level", level] for level in LEVELS}
        rated = {"overall": overall, **levels}
        wall = _covered(self._spans) if wall_seconds is None else wall_seconds
        return {
            "attempts": overall["attempts"],
            "outcomes": overall["outcomes"],
            "success_rate": {name: group["success_rate"] for name, group in rated.items()},
            "success_interval": {name: group["success_interval"] for name, group in rated.items()},
            "success_rate_of_planned": {
                name: group["success_rate_of_planned"] for name, group in rated.items()
            },
            "success_interval_of_planned": {
                name: group["success_interval_of_planned"] for name, group in rated.items()
            },
            "planned": {name: group["planned"] for name, group in rated.items()},
            "elsewhere": dict(elsewhere) if elsewhere else {},
            "pass_at": self._pass_at(),
            "steps": overall["steps"],
            "wall_seconds": wall,
            "steps_per_second": overall["steps"] / wall if wall > 0 else 0.0,
            "policy": ", ".join(self._policies) if policy is None else policy,
            "judge": ", ".join(self._judges) if judge is None else judge,
            "seed": seed,
            "tasks": len(self._attempted),
            "split": splits_in(self._tasks[id] for id in self._attempted if id in self._tasks),
            "started_at": min((start for start, _ in self._spans), default=None),
            "step_milliseconds": quantiles(self._waits),
            "operation_milliseconds": {
                name: quantiles(values) for name, values in sorted(self._operations.items()) if values
            },
            "by_level": levels,
            "by_domain": {name: group for (kind, name), group in groups.items() if kind == "domain"},
            "by_website": {name: group for (kind, name), group in groups.items() if kind == "website"},
            "lost_samples": sum(
                last in (Outcome.ENVIRONMENT_ERROR, Outcome.POLICY_ERROR)
                for samples in self._attempted.values()
                for _, last in samples.values()
            ),
            "invalid_replies": self._invalid,
            "invalid_reply_rate": self._invalid / overall["steps"] if overall["steps"] else None,
            "notes": list(self._notes(self._policies)),
            "blocked_hosts": dict(self._blocked_by.most_common()),
            "losses": dict(sorted(self._losses.items(), key=lambda item: -item[1]["count"])),
        }


def summarise(
    trajectories: Iterable[Trajectory],
    tasks: Sequence[Task],
    samples: int = 1,
    *,
    seed: int | None = None,
    policy: str | None = None,
    judge: str | None = None,
    wall_seconds: float | None = None,
    elsewhere: Mapping[str, int] | None = None,
) -> Summary:
    """The figures of a run.

    Args:
        trajectories: all of them; read once, never held.
        tasks: as they were drawn: one that was drawn twice comes twice.
        samples: planned of every task.
        seed: of the run.
        policy, judge: names; taken from the trajectories where not given.
        wall_seconds: taken from the attempts where not given; pauses between them are left out.
        elsewhere: how many samples of a task other collectors of a shared list have, where they have any.
    """
    tally = Tally(tasks, samples)
    for trajectory in trajectories:
        tally.add(digest_of(trajectory))
    return tally.summary(
        seed=seed, policy=policy, judge=judge, wall_seconds=wall_seconds, elsewhere=elsewhere
    )
