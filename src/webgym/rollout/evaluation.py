"""The success rate of a policy on a test set, by difficulty, as a paper reports it.

Every planned sample of every task counts once, by the last attempt at it. Success, failure and truncated
carry a reward and make up the rate; the other outcomes are told beside it and never enter it. The rate over
all planned samples stands next to it: there whatever is no success counts against the policy.

**Intervals.** With one sample per task, attempts are independent and the interval is Wilson's: it needs no
random numbers and holds what it promises near 0 and 1, where test sets of hard tasks live. With several
samples per task they are not (a task is easy or hard for all of them), so tasks are resampled with all their
samples (bootstrap, percentiles), within each level of difficulty, because the test set fixes how many tasks
of each there are. Where every task ends alike, resampling shows no spread; the interval is then Wilson's,
counting tasks rather than attempts.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
import numpy as np
from pydantic import Field

from webgym.agent.policy import ORACLES
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS, Level, StepBudget
from webgym.core.trajectory import Failure, Trajectory
from webgym.rollout.manifest import Manifest, Records, manifest_of
from webgym.rollout.rates import Interval, Rate, Successes, wilson
from webgym.rollout.rejudge import RECORDED, verdicts_of
from webgym.rollout.store import RunReader
from webgym.rollout.summary import oracle_note
from webgym.settings import Settings
from webgym.stats import Counts, percentiles, resampled

TEST_BUDGET: Final = StepBudget(30, 50, 70)
"""Steps per attempt in testing, by level (paper §5)."""

Group: TypeAlias = Literal["easy", "medium", "hard", "overall"]
Method: TypeAlias = Literal["wilson", "bootstrap"]
GROUPS: Final[tuple[Group, ...]] = (*LEVELS, "overall")


class EvaluationConfig(Settings):
    """How the intervals of several samples per task are made."""

    resamples: Annotated[int, Field(ge=100)] = 10_000
    """Of the bootstrap."""

    seed: int = 0
    """Of the bootstrap."""


class Sample(msgspec.Struct, frozen=True):
    """The last attempt at a planned sample of a task.

    Attributes:
        task_id: of the task.
        level: its difficulty.
        outcome: how the attempt ended.
        steps: how many it took.
    """

    task_id: str
    level: Level
    outcome: Outcome
    steps: int


class Row(msgspec.Struct, frozen=True):
    """One level of difficulty, or all.

    Attributes:
        tasks: of the test set; one that was drawn twice counts twice.
        attempts: samples that ended with a reward; the rate is of these.
        successes: how many of them succeeded.
        rate: success rate; ``None`` of nothing.
        interval: at 95 %; ``None`` with the rate.
        method: where the interval comes from.
        planned: samples of all tasks, whatever became of them.
        rate_of_planned: successes over planned; ``None`` of nothing.
        interval_of_planned: at 95 %; ``None`` with this rate. Bootstrap of several samples per task.
        solved: tasks that succeeded at least once, and tasks with a reward at all.
        steps: mean over the attempts that carry a reward; ``None`` of nothing.
        no_reward: the other samples, by outcome.
        missing: samples that were planned and have not ended yet, or not been judged.
    """

    tasks: int
    attempts: int
    successes: int
    rate: float | None
    interval: Interval | None
    method: Method
    planned: int
    rate_of_planned: float | None
    interval_of_planned: Interval | None
    solved: tuple[int, int]
    steps: float | None
    no_reward: dict[str, int]
    missing: int


class Evaluation(msgspec.Struct, frozen=True):
    """A run as a result.

    Attributes:
        run: name of its folder.
        policy, judge: names.
        seed: of the run; ``None`` if it is not told.
        samples: planned per task.
        budget: steps by level; ``None`` if the run does not tell.
        rows: by level, and overall.
        notes: what the figures must be read with, as in the run's summary.
        manifest: under which conditions it was made.
    """

    run: str
    policy: str
    judge: str
    seed: int | None
    samples: int
    budget: tuple[int, int, int] | None
    rows: dict[Group, Row]
    manifest: Manifest
    notes: tuple[str, ...] = ()


def evaluate(run: Path, judge: str = RECORDED, config: EvaluationConfig | None = None) -> Evaluation:
    """The result of a run, which may still be going on.

    Args:
        run: the run folder.
        judge: whose verdicts count: the collection's own, or those of a judge that judged it again, by its
            name or how that begins.
        config: of the intervals.

    Raises:
        RunFolderError: the folder is no run, or there is no such judge.
    """
    reader = RunReader(run, skip_corrupt=True)
    per_task = int(reader.config.get("samples") or 1)
    name, ended_by = _judged_by(run, judge)
    records = Records()
    samples = list(_samples(reader, ended_by, records))
    levels = Counter(task.level for task in reader.drawn)
    told: Mapping[str, Any] = reader.summary or {
        "notes": [oracle_note(each) for each in ORACLES & records.policies.keys()]
    }
    rows = rows_of(samples, levels, per_task, config)
    whole = rows["overall"]
    counted = {"planned": whole.planned, "judged": whole.attempts, "successes": whole.successes}
    manifest = manifest_of(
        reader, records, None if name == RECORDED else name, counted | {"missing": whole.missing}
    )
    return Evaluation(
        run=manifest.run,
        policy=told.get("policy") or ", ".join(records.policies),
        judge=(told.get("judge") or RECORDED) if name == RECORDED else name,
        seed=manifest.seed,
        samples=per_task,
        budget=manifest.budget,
        rows=rows,
        manifest=manifest,
        notes=tuple(told.get("notes", ())),
    )


def rewards_by_task(run: Path, judge: str = RECORDED) -> dict[str, tuple[Level, float]]:
    """Level and mean success of every task of a run that has a reward; see :func:`evaluate`."""
    reader = RunReader(run, skip_corrupt=True)
    _, ended_by = _judged_by(run, judge)
    means = _by_task(_samples(reader, ended_by, Records()))
    return {task_id: (reader.tasks[task_id].level, won / of) for task_id, (won, of) in means.items()}


def rows_of(
    samples: Sequence[Sample],
    tasks: Mapping[Level, int],
    per_task: int = 1,
    config: EvaluationConfig | None = None,
) -> dict[Group, Row]:
    """The table of a set of samples.

    Args:
        samples: at most ``per_task`` of a task.
        tasks: how many tasks of every level the test set has.
        per_task: samples planned for every task.
        config: of the intervals.
    """
    config = config or EvaluationConfig()
    generator = np.random.default_rng(config.seed)
    judged, planned = {}, {}
    for level in LEVELS:
        of_level = _by_task(sample for sample in samples if sample.level == level)
        judged[level] = resampled(list(of_level.values()), 2, config.resamples, generator)
        won = [(wins, per_task) for wins, _ in of_level.values()]
        won += [(0, per_task)] * (tasks.get(level, 0) - len(won))  # tasks without a reward count, too
        planned[level] = resampled(won, 2, config.resamples, generator)
    rows: dict[Group, Row] = {}
    for group in GROUPS:
        of_group = [sample for sample in samples if group in ("overall", sample.level)]
        count = sum(count for level, count in tasks.items() if group in ("overall", level))
        rows[group] = _row(of_group, count, per_task, _spread(judged, group), _spread(planned, group))
    return rows


def _spread(drawn: Mapping[Level, Counts], group: Group) -> Interval | None:
    """The percentile interval of a rate from its resamples of (successes, of)."""
    sums = drawn[group] if group != "overall" else np.sum(list(drawn.values()), axis=0)
    with np.errstate(invalid="ignore"):
        return percentiles(sums[:, 0] / sums[:, 1], 0.95)


def _row(
    samples: Sequence[Sample], tasks: int, per_task: int, judged: Interval | None, planned: Interval | None
) -> Row:
    rewarded = [sample for sample in samples if sample.outcome.is_rewarded]
    won = sum(sample.outcome is Outcome.SUCCESS for sample in rewarded)
    rates = Successes(won, len(rewarded), tasks * per_task)
    by_task = _by_task(rewarded)
    method, interval = _interval(rates.of_judged, judged, len(rewarded), len(by_task))
    lost = Counter(sample.outcome.value for sample in samples if not sample.outcome.is_rewarded)
    return Row(
        tasks=tasks,
        attempts=len(rewarded),
        successes=won,
        rate=rates.of_judged.value,
        interval=interval,
        method=method,
        planned=rates.planned,
        rate_of_planned=rates.of_planned.value,
        interval_of_planned=_interval(rates.of_planned, planned, rates.planned, tasks)[1],
        solved=(sum(bool(won) for won, _ in by_task.values()), len(by_task)),
        steps=sum(sample.steps for sample in rewarded) / len(rewarded) if rewarded else None,
        no_reward={outcome.value: lost[outcome.value] for outcome in Outcome if lost[outcome.value]},
        missing=tasks * per_task - len(samples),
    )


def _interval(
    rate: Rate, spread: Interval | None, attempts: int, tasks: int
) -> tuple[Method, Interval | None]:
    """Where the interval of a rate comes from, and the interval."""
    if rate.value is None or tasks == attempts:
        return "wilson", rate.interval
    if spread:
        return "bootstrap", spread
    # Of clustered attempts that all end alike, only the tasks are independent.
    return "wilson", wilson(round(rate.value * tasks), tasks)


def _by_task(samples: Iterable[Sample]) -> dict[str, tuple[int, int]]:
    """Successes and rewarded attempts of every task that has one."""
    found: dict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for sample in samples:
        if sample.outcome.is_rewarded:
            won, of = found[sample.task_id]
            found[sample.task_id] = (won + (sample.outcome is Outcome.SUCCESS), of + 1)
    return found


_Ended: TypeAlias = tuple[Outcome, Failure | None]
"""How an attempt ended by a judge, and the error that kept the reward from being."""


def _judged_by(run: Path, judge: str) -> tuple[str, Callable[[Trajectory], _Ended | None]]:
    """A judge's whole name, and how an attempt ended by it; ``None`` for one that it has not judged."""

    def as_recorded(trajectory: Trajectory) -> _Ended:
        return trajectory.outcome, trajectory.episode.failure or trajectory.judge_failure

    if judge == RECORDED:
        return RECORDED, as_recorded
    name, held = verdicts_of(run, judge)

    def as_judged(trajectory: Trajectory) -> _Ended | None:
        if trajectory.outcome.is_retried:  # it did not end of its own, whoever judges
            return as_recorded(trajectory)
        judged = held.get(trajectory.episode.attempt_id)
        return (judged.outcome, judged.failure) if judged else None

    return name, as_judged


def _samples(
    reader: RunReader, ended_by: Callable[[Trajectory], _Ended | None], records: Records
) -> Iterator[Sample]:
    """The last attempt at every sample. One that the run was stopped in has not ended yet."""
    last = {}
    for entry in sorted(reader.attempts.values(), key=lambda entry: entry.retry):
        last[entry.task_id, entry.sample] = entry
    for trajectory in reader.trajectories([entry.attempt_id for entry in last.values()]):
        episode = trajectory.episode
        task = reader.tasks.get(episode.task_id)
        ended = ended_by(trajectory)
        if task is None or ended is None or ended[0] is Outcome.CANCELLED:
            continue
        outcome, failure = ended
        records.add(trajectory, outcome, failure, task.website)
        yield Sample(episode.task_id, task.level, outcome, len(episode.steps))
