"""The success rate of a policy on a test set, by difficulty, as papers report it.

Every planned sample of every task counts once, by the last attempt at it. Success, failure and truncated
have a reward and make up the rate; the other outcomes are reported separately and do not count. The rate
over all
planned samples is reported as well: there, everything but success counts against the policy.

Intervals are those of :mod:`webgym.results.rates`.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
from pydantic import Field

from webgym.core.outcome import Outcome
from webgym.core.settings import Settings
from webgym.core.task import LEVELS, Level, StepBudget
from webgym.core.trajectory import Failure, Trajectory
from webgym.results.manifest import Manifest, Records, manifest_of
from webgym.results.rates import RESAMPLES, Interval, Method, Successes, over_tasks
from webgym.results.summary import oracle_notes
from webgym.store.runs import RECORDED, RunReader, verdicts_of

TEST_BUDGET: Final = StepBudget(30, 50, 70)
"""Steps per attempt in testing, by level (paper §5)."""

Group: TypeAlias = Literal["easy", "medium", "hard", "overall"]
GROUPS: Final[tuple[Group, ...]] = (*LEVELS, "overall")


class EvaluationConfig(Settings):
    """Settings of the bootstrap, for several samples per task."""

    resamples: Annotated[int, Field(ge=100)] = RESAMPLES
    """Number of bootstrap resamples."""

    seed: int = 0
    """Seed of the bootstrap."""


class Sample(msgspec.Struct, frozen=True):
    """The last attempt at a planned sample of a task.

    Attributes:
        task_id: id of the task.
        level: its difficulty.
        outcome: how the attempt ended.
        steps: number of steps.
    """

    task_id: str
    level: Level
    outcome: Outcome
    steps: int


class Row(msgspec.Struct, frozen=True):
    """The result at one level of difficulty, or over all.

    Attributes:
        tasks: number of tasks in the test set; a task that was drawn twice counts twice.
        attempts: number of samples with a reward, over which the rate is taken.
        successes: how many of them succeeded.
        rate: success rate; ``None`` if there are no attempts.
        interval: its 95 % confidence interval; ``None`` with the rate.
        method: how the interval was computed.
        planned: number of planned samples of all tasks, without those of other collectors of a shared list.
        rate_of_planned: successes / planned; ``None`` if nothing was planned.
        interval_of_planned: its 95 % confidence interval; ``None`` with this rate. By bootstrap for several
            samples per task.
        solved: number of tasks with at least one success, and of tasks with a reward.
        steps: mean number of steps of the attempts with a reward; ``None`` if there are none.
        no_reward: number of the other samples, by outcome.
        missing: number of planned samples that have not ended yet, or are not judged.
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
    """The result of a run.

    Attributes:
        run: name of its folder.
        policy, judge: names.
        seed: seed of the run; ``None`` if it is not recorded.
        samples: planned samples per task.
        budget: steps by level; ``None`` if they are not recorded.
        rows: results by level, and overall.
        notes: caveats of the figures, as in the run's summary.
        manifest: the conditions of the evaluation.
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
    """The result of a run, which may still be in progress.

    Args:
        run: the run folder.
        judge: judge whose verdicts count: that of the collection, or one that judged the run again, by its
            name or a prefix of it.
        config: settings of the intervals.

    Raises:
        RunFolderError: the folder is not a run, or there is no such judge.
    """
    reader = RunReader(run, skip_corrupt=True)
    per_task = reader.samples
    name, ended_by = _judged_by(run, judge)
    records = Records()
    samples = list(_samples(reader, ended_by, records))
    drawn = [(task.id, task.level) for task in reader.drawn]
    summary: Mapping[str, Any] = reader.summary or {"notes": oracle_notes(records.policies)}
    rows = rows_of(samples, drawn, per_task, config, elsewhere=summary.get("elsewhere"))
    overall = rows["overall"]
    counted = {"planned": overall.planned, "judged": overall.attempts, "successes": overall.successes}
    manifest = manifest_of(
        reader, records, None if name == RECORDED else name, counted | {"missing": overall.missing}
    )
    return Evaluation(
        run=manifest.run,
        policy=summary.get("policy") or ", ".join(records.policies),
        judge=(summary.get("judge") or RECORDED) if name == RECORDED else name,
        seed=manifest.seed,
        samples=per_task,
        budget=manifest.budget,
        rows=rows,
        manifest=manifest,
        notes=(*summary.get("notes", ()), *records.left_out),
    )


def rewards_by_task(
    run: Path, judge: str = RECORDED, records: Records | None = None
) -> dict[str, tuple[Level, float]]:
    """Level and mean success of every task with a reward, by task id; see :func:`evaluate`.

    Args:
        run, judge: as there.
        records: collects what the attempts record.
    """
    reader = RunReader(run, skip_corrupt=True)
    _, ended_by = _judged_by(run, judge)
    means = _by_task(_samples(reader, ended_by, records or Records()))
    return {task_id: (reader.tasks[task_id].level, won / of) for task_id, (won, of) in means.items()}


def rows_of(
    samples: Sequence[Sample],
    drawn: Sequence[tuple[str, Level]],
    per_task: int = 1,
    config: EvaluationConfig | None = None,
    *,
    elsewhere: Mapping[str, int] | None = None,
) -> dict[Group, Row]:
    """The results of a set of samples.

    Args:
        samples: of these tasks.
        drawn: id and level of every task in the test set; one that was drawn twice is listed twice.
        per_task: planned samples per listed task.
        config: settings of the intervals.
        elsewhere: number of samples that other collectors of a shared list have taken, by task.
    """
    config, taken = config or EvaluationConfig(), elsewhere or {}
    levels, times = dict(drawn), Counter(id for id, _ in drawn)
    recorded = Counter(sample.task_id for sample in samples)
    # At least those recorded here: another collector may have taken over a sample after an error.
    counts = {id: max(n * per_task - taken.get(id, 0), recorded[id]) for id, n in times.items()}
    rewarded, planned = {}, {}
    for level in LEVELS:
        won = _by_task(sample for sample in samples if sample.level == level)
        rewarded[level] = list(won.values())
        planned[level] = [(won.get(id, (0, 0))[0], n) for id, n in counts.items() if levels[id] == level]
    rows: dict[Group, Row] = {}
    for group in GROUPS:
        of_group = [sample for sample in samples if group in ("overall", sample.level)]
        tasks = sum(group in ("overall", level) for _, level in drawn)
        included = [level for level in LEVELS if group in ("overall", level)]
        judged, all_planned = ([of[level] for level in included] for of in (rewarded, planned))
        rows[group] = _row(of_group, tasks, judged, all_planned, config)
    return rows


def _row(
    samples: Sequence[Sample],
    tasks: int,
    judged: Sequence[Sequence[tuple[int, int]]],
    planned: Sequence[Sequence[tuple[int, int]]],
    config: EvaluationConfig,
) -> Row:
    """The row of a group: its samples, its number of tasks, and of each different task by level its
    successes with the number of judged and of planned samples."""
    rewarded = [sample for sample in samples if sample.outcome.is_rewarded]
    by_task = [task for level in judged for task in level]
    rates = Successes(
        sum(won for won, _ in by_task), len(rewarded), sum(n for level in planned for _, n in level)
    )
    method, interval = over_tasks(judged, config.resamples, config.seed)
    lost = Counter(sample.outcome.value for sample in samples if not sample.outcome.is_rewarded)
    return Row(
        tasks=tasks,
        attempts=len(rewarded),
        successes=rates.won,
        rate=rates.of_judged.value,
        interval=interval,
        method=method,
        planned=rates.planned,
        rate_of_planned=rates.of_planned.value,
        interval_of_planned=over_tasks(planned, config.resamples, config.seed)[1],
        solved=(sum(bool(won) for won, _ in by_task), len(by_task)),
        steps=sum(sample.steps for sample in rewarded) / len(rewarded) if rewarded else None,
        no_reward={outcome.value: lost[outcome.value] for outcome in Outcome if lost[outcome.value]},
        missing=rates.planned - len(samples),
    )


def _by_task(samples: Iterable[Sample]) -> dict[str, tuple[int, int]]:
    """Number of successes and of attempts with a reward, for every task with a reward."""
    counts: dict[str, tuple[int, int]] = defaultdict(lambda: (0, 0))
    for sample in samples:
        if sample.outcome.is_rewarded:
            won, of = counts[sample.task_id]
            counts[sample.task_id] = (won + (sample.outcome is Outcome.SUCCESS), of + 1)
    return counts


_Ended: TypeAlias = tuple[Outcome, Failure | None]
"""An attempt's outcome by a judge, and the error because of which it has no reward."""


def _judged_by(run: Path, judge: str) -> tuple[str, Callable[[Trajectory], _Ended | None]]:
    """A judge's full name, and a function that returns an attempt's outcome by it, or ``None`` if it was not
    judged."""

    def as_recorded(trajectory: Trajectory) -> _Ended:
        return trajectory.outcome, trajectory.episode.failure or trajectory.judge_failure

    if judge == RECORDED:
        return RECORDED, as_recorded
    name, judged_by_attempt = verdicts_of(run, judge)

    def as_judged(trajectory: Trajectory) -> _Ended | None:
        if trajectory.outcome.is_retried:  # it did not end regularly, so that no judge changes its outcome
            return as_recorded(trajectory)
        judged = judged_by_attempt.get(trajectory.episode.attempt_id)
        return (judged.outcome, judged.failure) if judged else None

    return name, as_judged


def _samples(
    reader: RunReader, ended_by: Callable[[Trajectory], _Ended | None], records: Records
) -> Iterator[Sample]:
    """The last attempt at every sample, without cancelled ones, which have not ended yet."""
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
    orphans = sum(entry.task_id not in reader.tasks for entry in reader.attempts.values())
    left_out = {
        "damaged records": len(reader.skipped),
        "attempts at tasks that the run does not hold": orphans,
    }
    records.left_out = [
        f"{what}: {count} left out; webgym verify names them" for what, count in left_out.items() if count
    ]
