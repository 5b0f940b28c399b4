"""Computes the figures of a run from its trajectories, one in memory at a time."""

from __future__ import annotations

import math
from array import array
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Literal, NamedTuple, TypeAlias, TypedDict, cast

import msgspec
import numpy as np

from webgym.agent.policy import ORACLES
from webgym.core.outcome import Outcome, outcomes_line
from webgym.core.tables import DASH, Table, printed
from webgym.core.task import LEVELS, Task
from webgym.core.text import duration, plain, shortened
from webgym.core.trajectory import Step, Trajectory
from webgym.core.websites import host_or_text
from webgym.judge.blocking import blocking_host
from webgym.results.rates import Interval, Successes, over_tasks, pass_at
from webgym.tasks.selection import splits_in

UNKNOWN = "unknown"
"""Domain and website of a trajectory whose task the run lacks."""


REASONS = 5
"""Number of reasons and hosts that are printed; the report shows all."""

MANY_INVALID = 0.05
"""Share of replies without a valid action above which a run warns: the prompt may not fit the model."""


def oracle_notes(policies: Iterable[str]) -> list[str]:
    """The notes that accompany the figures of these policies wherever they are shown: one for each oracle."""
    plays = "is an oracle: it plays known solutions and uses no model"
    return [f"the {policy} policy {plays}" for policy in policies if policy in ORACLES]


FORM_FROM = 20
"""Rewarded attempts from which on a run warns that most answers have another form than asked for."""


def form_notes(rewarded: int, faults: Mapping[str, int]) -> list[str]:
    """The note that more than half of the attempts failed by the form of their answers, if they did."""
    failed = faults.get("form", 0)
    if rewarded < FORM_FROM or 2 * failed <= rewarded:
        return []
    return [
        f"{failed} of {rewarded} attempts gave answers in another form than their tasks ask for: does the "
        "agent follow the instruction? how well it finds the answers is not measured"
    ]


class Quantiles(TypedDict):
    """Summary of a distribution.

    Attributes:
        count: number of values.
        p50, p95: median and 95th percentile; ``None`` if there are no values.
    """

    count: int
    p50: float | None
    p95: float | None


class Group(TypedDict):
    """The figures of a group of attempts.

    Attributes:
        attempts: number of attempts; the sum of ``outcomes``.
        outcomes: number of attempts for each of the eight outcomes.
        planned: planned samples of the tasks of this group.
        success_rate: success / (success + failure + truncated); ``None`` if there are none of these.
        success_interval: its 95 % interval; ``None`` with the rate.
        success_rate_of_planned: success / planned; ``None`` if nothing was planned.
        success_interval_of_planned: its 95 % interval; ``None`` with the rate.
        steps: all steps taken.
        steps_per_attempt: over the attempts with a reward.
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
    """Attempts without a reward that ended for the same reason.

    Attributes:
        count: number of attempts.
        outcomes: their number by outcome.
        attempt_id, message: of the first.
    """

    count: int
    outcomes: dict[str, int]
    attempt_id: str
    message: str


class PassAt(TypedDict):
    """pass@k: the probability that at least one of k attempts at a task succeeds.

    Attributes:
        value: mean over tasks; ``None`` if there are none.
        tasks: number of tasks with at least k attempts with a reward.
    """

    value: float | None
    tasks: int


class Summary(TypedDict):
    """The content of ``summary.json``.

    Attributes:
        attempts: number of trajectories on disk, including repeated attempts.
        outcomes: number of attempts for each of the eight outcomes.
        success_rate: success / (success + failure + truncated), for ``overall``, ``easy``, ``medium`` and
            ``hard``; ``None`` if no attempt has a reward.
        success_interval: the 95 % intervals of these rates.
        success_rate_of_planned: success / planned, likewise: samples without a reward or never attempted
            count as unsuccessful. A sample that was attempted again after an error counts once.
        success_interval_of_planned: the 95 % intervals of these rates.
        planned: number of planned samples, likewise, without those of other collectors.
        elsewhere: number of samples that other collectors of a shared list have taken, by task.
        pass_at: pass@k for k = 1, 2, 4, ... and the number of samples per task, averaged over the tasks with
            at least k attempts with a reward. pass@1 is the mean over tasks of their success rates.
        steps: all steps taken.
        steps_per_attempt: over the attempts with a reward.
        wall_seconds: time during which at least one attempt was in progress, or as the collector measured.
        steps_per_second: ``steps`` / ``wall_seconds``.
        policy, judge: names, joined by commas; empty if there are none.
        seed: of the run.
        tasks: number of different tasks that were attempted.
        split: of these tasks, as they record it: ``train``, ``test``, ``unsplit`` or several.
        started_at: Unix time of the first attempt, seconds; ``None`` if there are none.
        step_milliseconds: time between an agent's reply and the next observation.
        operation_milliseconds: durations by operation of the browser server, and of ``policy`` (one
            reply) and ``judge`` (one trajectory).
        by_level, by_domain, by_website: figures of the attempts by level, domain and website.
        faults: number of failures by what was wrong first: ``form`` (the answer is not in the form that the
            task asks for), ``wrong value``, ``no evidence``, ``state``; empty if the judge does not say.
        lost_samples: samples whose last attempt ended in an error of the environment or the policy.
        invalid_replies: number of steps whose replies hold no valid action.
        invalid_reply_rate: their share of all steps; ``None`` if there are no steps.
        notes: caveats about all figures, a sentence each: an oracle as the policy, several judges, many
            invalid replies.
        blocked_hosts: number of blocked attempts by host, most first.
        losses: attempts without a reward by error code, or by outcome if there was no error (a website that
            blocks); most frequent first.
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
    steps_per_attempt: Quantiles
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
    faults: dict[str, int]
    lost_samples: int
    invalid_replies: int
    invalid_reply_rate: float | None
    notes: list[str]


def quantiles(values: Sequence[float]) -> Quantiles:
    """Median and 95th percentile, by linear interpolation between the ranks."""
    p50, p95 = map(float, np.quantile(values, (0.5, 0.95))) if len(values) else (None, None)
    return {"count": len(values), "p50": p50, "p95": p95}


def environment_milliseconds(steps: Sequence[Step]) -> list[float]:
    """Time between each reply and the next observation, milliseconds."""
    return [
        max(0.0, (after.at - before.at - before.reply.seconds) * 1000) for before, after in pairwise(steps)
    ]


class Digest(msgspec.Struct, frozen=True, array_like=True):
    """A summary of a trajectory from which a run's figures are computed.

    Attributes:
        judge: its name; ``None`` if there is no verdict.
        steps: number of steps.
        waits: see :func:`environment_milliseconds`.
        operations: milliseconds by operation, including ``policy`` and ``judge``.
        loss: why there is no reward: error code (or outcome if there was no error) and message.
        invalid: number of steps whose replies hold no valid action.
        first_invalid: what was wrong with the first of them.
        blocked_by: host that blocked the agent; empty if none did.
        fault: what was wrong with an answered attempt; empty if nothing was, or the judge does not say.
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
    fault: str = ""

    @property
    def error(self) -> str:
        """Code of the error that ended the attempt or prevented its verdict; empty if there was none."""
        code = self.loss[0] if self.loss else ""
        return code if self.outcome.is_error or code != self.outcome else ""


def digest_of(trajectory: Trajectory) -> Digest:
    """The digest of a trajectory."""
    episode = trajectory.episode
    operations: defaultdict[str, list[float]] = defaultdict(list)
    for observation in episode.observations:
        for operation, milliseconds in observation.milliseconds.items():
            operations[operation].append(milliseconds)
    operations["policy"] = [step.reply.seconds * 1000 for step in episode.steps]
    if trajectory.judge_seconds:
        operations["judge"] = [trajectory.judge_seconds * 1000]
    invalid_steps = [
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
        invalid=len(invalid_steps),
        first_invalid=invalid_steps[0] if invalid_steps else "",
        blocked_by=_blocked_by(trajectory),
        fault=(trajectory.verdict.fault or "") if trajectory.verdict else "",
    )


def _blocked_by(trajectory: Trajectory) -> str:
    verdict, seen = trajectory.verdict, trajectory.episode.observations
    if trajectory.outcome is not Outcome.BLOCKED:
        return ""
    if verdict is None:  # its start page was refused
        return host_or_text(seen[0].url) if seen else UNKNOWN
    return blocking_host(seen[0].url if seen else UNKNOWN, trajectory.episode, verdict.blocked)


def _loss(trajectory: Trajectory) -> tuple[str, str] | None:
    if trajectory.outcome.is_rewarded:
        return None
    if failure := trajectory.episode.failure or trajectory.judge_failure:
        return failure.code, failure.message
    return trajectory.outcome.value, trajectory.verdict.blocked.reason if trajectory.verdict else ""


class _TaskCount(NamedTuple):
    """Samples of one task: successes, those with a reward, and all planned ones."""

    won: int
    judged: int
    planned: int


class _Count:
    """Counts the attempts of a :class:`Group`."""

    def __init__(self) -> None:
        self.outcomes: Counter[Outcome] = Counter()
        self.steps = 0
        self.lengths = array("d")

    def add(self, digest: Digest) -> None:
        self.outcomes[digest.outcome] += 1
        self.steps += digest.steps
        if digest.outcome.is_rewarded:
            self.lengths.append(digest.steps)

    def group(self, planned: int, tasks: Iterable[Collection[_TaskCount]] = ()) -> Group:
        """The figures.

        Args:
            planned: number of planned samples.
            tasks: the counts of every task, by level, if tasks have several samples.
        """
        rewarded = sum(count for outcome, count in self.outcomes.items() if outcome.is_rewarded)
        successes = Successes(self.outcomes[Outcome.SUCCESS], rewarded, planned)
        judged, of_planned = successes.of_judged.interval, successes.of_planned.interval
        if tasks:
            _, judged = over_tasks([(task.won, task.judged) for task in level] for level in tasks)
            _, of_planned = over_tasks([(task.won, task.planned) for task in level] for level in tasks)
        return {
            "attempts": self.outcomes.total(),
            "outcomes": {outcome.value: self.outcomes[outcome] for outcome in Outcome},
            "planned": planned,
            "success_rate": successes.of_judged.value,
            "success_interval": judged,
            "success_rate_of_planned": successes.of_planned.value,
            "success_interval_of_planned": of_planned,
            "steps": self.steps,
            "steps_per_attempt": quantiles(self.lengths),
        }


def _covered(spans: Iterable[tuple[float, float]]) -> float:
    """The length of the union of time spans, so that pauses of a run do not count."""
    total, until = 0.0, -math.inf
    for start, end in sorted(spans):
        total += max(0.0, end - max(start, until))
        until = max(until, end)
    return total


_GroupKey: TypeAlias = tuple[Literal["all", "level", "domain", "website"], str]
"""Kind and name of a group of attempts."""


def _group_keys(task: Task | None) -> list[_GroupKey]:
    """The groups to which attempts at a task belong."""
    if task is None:
        return [("all", ""), ("domain", UNKNOWN), ("website", UNKNOWN)]
    return [("all", ""), ("level", task.level), ("domain", task.domain), ("website", task.website)]


class Tally:
    """Computes figures incrementally; memory grows by a few numbers per step.

    Args:
        tasks: of the run as drawn; one that was drawn twice is listed twice.
        samples: number of samples per listed task.
    """

    def __init__(self, tasks: Sequence[Task], samples: int = 1) -> None:
        self._per_task = samples
        self._tasks = {task.id: task for task in tasks}
        self._samples = Counter(task.id for task in tasks for _ in range(samples))
        self._counts: defaultdict[_GroupKey, _Count] = defaultdict(_Count)
        self._planned = Counter(key for task in tasks for key in _group_keys(task))
        for key in self._planned:
            self._planned[key] *= samples
        self._attempted: defaultdict[str, dict[int, tuple[int, Outcome]]] = defaultdict(dict)
        self._policies: dict[str, None] = {}
        self._judges: dict[str, None] = {}
        self._spans: list[tuple[float, float]] = []
        self._waits = array("d")
        self._operations: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))
        self._losses: dict[str, Loss] = {}
        self._blocked_by: Counter[str] = Counter()
        self._faults: Counter[str] = Counter()
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
        if digest.fault:
            self._faults[digest.fault] += 1
        if digest.blocked_by:
            self._blocked_by[digest.blocked_by] += 1
        for key in _group_keys(task):
            self._counts[key].add(digest)
            # More samples than planned, for example of a task that the run lacks.
            self._planned[key] += is_new and len(samples) > self._samples[digest.task_id]
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
        yield from oracle_notes(policies)
        if len(self._judges) > 1:
            yield f"attempts were judged by different judges: {', '.join(self._judges)}"
        overall = self._counts["all", ""]
        yield from form_notes(len(overall.lengths), self._faults)
        steps = overall.steps
        if steps and self._invalid / steps > MANY_INVALID:
            share = f"{self._invalid / steps:.1%} of {steps:,} replies hold no valid action"
            yield plain(f"{share}; the first: {self._first_invalid}")

    def _pass_at(self) -> dict[str, PassAt]:
        ends = [[outcome for _, outcome in samples.values()] for samples in self._attempted.values()]
        won = [
            (outcomes.count(Outcome.SUCCESS), sum(outcome.is_rewarded for outcome in outcomes))
            for outcomes in ends
        ]
        estimates: dict[str, PassAt] = {}
        for k in sorted({*(2**n for n in range(self._per_task.bit_length())), self._per_task}):
            values = [value for c, n in won if (value := pass_at(k, c, n)) is not None]
            mean = sum(values) / len(values) if values else None
            estimates[str(k)] = {"value": mean, "tasks": len(values)}
        return estimates

    def _groups(self, elsewhere: Mapping[str, int]) -> dict[_GroupKey, Group]:
        """The figures of all groups with attempts, and of every level."""
        planned = self._planned.copy()
        for task_id, count in elsewhere.items():
            for key in _group_keys(self._tasks.get(task_id)):
                planned[key] -= count
        tasks = self._by_task(elsewhere) if max(self._samples.values(), default=1) > 1 else {}
        keys: list[_GroupKey] = [("all", ""), *(("level", level) for level in LEVELS), *sorted(self._counts)]
        return {
            key: self._counts.get(key, _Count()).group(planned[key], tasks.get(key, {}).values())
            for key in keys
        }

    def _by_task(self, elsewhere: Mapping[str, int]) -> Mapping[_GroupKey, Mapping[str, list[_TaskCount]]]:
        """The counts of every task, by group and level."""
        found: defaultdict[_GroupKey, defaultdict[str, list[_TaskCount]]] = defaultdict(
            lambda: defaultdict(list)
        )
        for task_id in self._samples.keys() | self._attempted.keys():
            outcomes = [outcome for _, outcome in self._attempted.get(task_id, {}).values()]
            won, judged = outcomes.count(Outcome.SUCCESS), sum(outcome.is_rewarded for outcome in outcomes)
            planned = max(self._samples[task_id] - elsewhere.get(task_id, 0), len(outcomes))
            task = self._tasks.get(task_id)
            for key in _group_keys(task):
                found[key][task.level if task else UNKNOWN].append(_TaskCount(won, judged, planned))
        return found

    def summary(
        self,
        *,
        seed: int | None = None,
        policy: str | None = None,
        judge: str | None = None,
        wall_seconds: float | None = None,
        elsewhere: Mapping[str, int] | None = None,
    ) -> Summary:
        """The figures so far; see :func:`summarise`."""
        groups = self._groups(elsewhere or {})
        overall = groups["all", ""]
        levels: dict[str, Group] = {level: groups["level", level] for level in LEVELS}
        rated = {"overall": overall, **levels}
        wall = _covered(self._spans) if wall_seconds is None else wall_seconds
        figures: Summary = {
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
            "steps_per_attempt": overall["steps_per_attempt"],
            "wall_seconds": wall,
            "steps_per_second": overall["steps"] / wall if wall > 0 else 0.0,
            "policy": ", ".join(self._policies) if policy is None else policy,
            "judge": ", ".join(self._judges) or judge or "",
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
            "faults": dict(self._faults.most_common()),
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
        return cast(Summary, _Printable(figures))


class _Printable(dict[str, Any]):
    """A summary whose text is what the command line prints."""

    def __str__(self) -> str:
        return printed(summary_parts(cast(Summary, self)))


def summary_parts(summary: Summary) -> Iterator[Table | str]:
    """A run's outcomes and success rates: the lines and the table that are printed."""
    columns = ("", "success", "95 %", "judged", "success", "95 %", "planned", "median steps")
    rows = []
    for level in ("overall", *LEVELS):
        group = summary if level == "overall" else summary["by_level"][level]
        judged = sum(count for name, count in group["outcomes"].items() if Outcome(name).is_rewarded)
        steps = group["steps_per_attempt"]["p50"]
        cells = (
            *_rate(summary["success_rate"][level], summary["success_interval"][level]),
            str(judged),
            *_rate(summary["success_rate_of_planned"][level], summary["success_interval_of_planned"][level]),
            str(summary["planned"][level]),
            DASH if steps is None else f"{steps:.0f}",
        )
        rows.append((level, *cells))
    yield Table("", columns, rows)
    yield outcomes_line(summary["outcomes"])
    if faults := summary.get("faults"):
        yield f"  failed by {', '.join(f'{count} {fault}' for fault, count in faults.items())}"
    yield from loss_lines(summary)
    if hosts := summary["blocked_hosts"]:
        named = ", ".join(f"{plain(host)} ({count})" for host, count in list(hosts.items())[:REASONS])
        others = f", and {len(hosts) - REASONS} others" if len(hosts) > REASONS else ""
        yield f"  blocked by {named}{others}"
    for note in summary["notes"]:
        yield f"note {shortened(note)}"
    step, invalid = summary["step_milliseconds"], summary["invalid_reply_rate"]
    more = ""
    if step["p50"] is not None and step["p95"] is not None:
        more = f", step latency {step['p50']:.0f} ms (p50) {step['p95']:.0f} ms (p95)"
    if invalid is not None:
        more += f", {invalid:.1%} of replies invalid"
    yield (
        f"{summary['attempts']} trajectories, {summary['steps']} steps in "
        f"{duration(summary['wall_seconds'])}: {summary['steps_per_second']:.1f} steps/s{more}"
    )


def _rate(rate: float | None, interval: Interval | None) -> tuple[str, str]:
    return (
        DASH if rate is None else f"{rate:.1%}",
        DASH if interval is None else f"{interval[0]:.1%}–{interval[1]:.1%}",
    )


def loss_lines(summary: Summary) -> Iterator[str]:
    """Why attempts have no reward, the most frequent reasons first."""
    for code, loss in list(summary["losses"].items())[:REASONS]:
        reason = f": {shortened(loss['message'])}" if loss["message"] else ""
        yield "  " + plain(f"{loss['count']} {code}{reason} ({loss['attempt_id']})")


def summarise(
    attempts: Iterable[Trajectory | Digest],
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
        attempts: all trajectories or their digests; iterated once, one in memory at a time.
        tasks: as drawn; one that was drawn twice is listed twice.
        samples: number of samples per listed task.
        seed: of the run.
        policy: its name; by default those in the trajectories.
        judge: name of the configured one, for a run without a verdict.
        wall_seconds: by default computed from the attempts, without pauses between them.
        elsewhere: number of samples that other collectors of a shared list have taken, by task.
    """
    tally = Tally(tasks, samples)
    for attempt in attempts:
        tally.add(attempt if isinstance(attempt, Digest) else digest_of(attempt))
    return tally.summary(
        seed=seed, policy=policy, judge=judge, wall_seconds=wall_seconds, elsewhere=elsewhere
    )
