"""The success rate of a policy on a test set, by difficulty, as papers report it; and two runs compared.

Every planned sample of every task counts once, by the last attempt at it. Success, failure and truncated
have a reward and make up the rate; the other outcomes are reported separately and do not count. The rate
over all planned samples is reported as well: there, everything but success counts against the policy.

Intervals are those of :mod:`webgym.results.rates`.

**Comparisons are paired.** A task counts with the mean over its attempts with a reward, in each run; only
tasks that have one in both runs are compared, and the number of others is reported. Tasks are resampled with
both of their means (bootstrap, percentiles), so that the difficulty of tasks does not widen the interval.
With few tasks this interval is too narrow, and if all tasks of each level differ alike, there is none: a
difference is significant only if an exact permutation test over the tasks agrees.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
import numpy as np
from pydantic import Field

from webgym.agent.policy import ORACLES
from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.core.settings import Settings
from webgym.core.stats import percentiles
from webgym.core.tables import DASH, Table, printed
from webgym.core.task import LEVELS, Level, StepBudget
from webgym.core.text import counted, plain
from webgym.core.trajectory import Failure, Trajectory
from webgym.core.verdict import Verdict
from webgym.core.websites import host_or_text
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
        websites: results by website, of a benchmark with few, as its papers list them; else empty.
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
    websites: dict[str, Row] = {}

    def __str__(self) -> str:
        return printed([*tables([self]), *map(plain, notes(self))])


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
        websites=_by_website(reader, samples, summary.get("elsewhere"), config) if manifest.benchmark else {},
    )


FEW_WEBSITES: Final = 20
"""Most websites of a benchmark whose results are listed one by one; WebVoyager has 15."""


def _by_website(
    reader: RunReader,
    samples: Sequence[Sample],
    elsewhere: Mapping[str, int] | None,
    config: EvaluationConfig | None,
) -> dict[str, Row]:
    hosts = {task.id: host_or_text(task.website) for task in reader.drawn}
    if not 1 < len(names := dict.fromkeys(hosts.values())) <= FEW_WEBSITES:
        return {}
    rows = {}
    for name in names:
        of_website = [sample for sample in samples if hosts.get(sample.task_id) == name]
        drawn = [(task.id, task.level) for task in reader.drawn if hosts[task.id] == name]
        rows[name] = rows_of(of_website, drawn, reader.samples, config, elsewhere=elsewhere)["overall"]
    return rows


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


_Ended: TypeAlias = tuple[Outcome, Failure | None, Verdict | None]
"""An attempt's outcome by a judge, the error because of which it has no reward, and the verdict."""


def _judged_by(run: Path, judge: str) -> tuple[str, Callable[[Trajectory], _Ended | None]]:
    """A judge's full name, and a function that returns an attempt's outcome by it, or ``None`` if it was not
    judged."""

    def as_recorded(trajectory: Trajectory) -> _Ended:
        failure = trajectory.episode.failure or trajectory.judge_failure
        return trajectory.outcome, failure, trajectory.verdict

    if judge == RECORDED:
        return RECORDED, as_recorded
    name, judged_by_attempt = verdicts_of(run, judge)

    def as_judged(trajectory: Trajectory) -> _Ended | None:
        if trajectory.outcome.is_retried:  # it did not end regularly, so that no judge changes its outcome
            return as_recorded(trajectory)
        judged = judged_by_attempt.get(trajectory.episode.attempt_id)
        return (judged.outcome, judged.failure, judged.verdict) if judged else None

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
        outcome, failure, verdict = ended
        records.add(trajectory, outcome, failure, verdict, task.website)
        yield Sample(episode.task_id, task.level, outcome, len(episode.steps))
    orphans = sum(entry.task_id not in reader.tasks for entry in reader.attempts.values())
    left_out = {
        "damaged records": len(reader.skipped),
        "attempts at tasks that the run does not hold": orphans,
    }
    records.left_out = [
        f"{what}: {count} left out; webgym verify names them" for what, count in left_out.items() if count
    ]


def tables(results: Sequence[Evaluation]) -> Iterator[Table]:
    """Tables for a paper: success of one run by difficulty, or of several runs; samples without a reward."""
    if len(results) == 1:
        (result,) = results
        is_repeated = result.samples > 1
        columns, rows = _rows({group: result.rows[group] for group in GROUPS}, is_repeated=is_repeated)
        yield Table(f"Success of {_policy(result)} by difficulty, judged by {result.judge}", columns, rows)
        if result.websites:
            columns, rows = _rows(result.websites, is_repeated=is_repeated)
            yield Table("Success by website", columns, rows)
    else:
        yield from _side_by_side(results)
    if lost := list(dict.fromkeys(name for each in results for name in each.rows["overall"].no_reward)):
        rows = [
            (result.run, *(str(result.rows["overall"].no_reward.get(name, 0)) for name in lost))
            for result in results
        ]
        yield Table("Samples without a reward, not in the rates", ("run", *lost), rows)


def _policy(result: Evaluation) -> str:
    is_oracle = not ORACLES.isdisjoint(result.policy.split(", "))
    return f"{result.policy} (oracle)" if is_oracle else result.policy


def conditions(results: Sequence[Evaluation]) -> Table:
    """A table for a paper: the conditions under which runs were made, with a column per run."""
    columns = [dict(_conditions(result.manifest)) for result in results]
    rows = [(name, *(column[name] for column in columns)) for name in columns[0]]
    return Table("Conditions", ("", *(result.run for result in results)), rows, names=1 + len(results))


def _conditions(manifest: Manifest) -> Iterator[tuple[str, str]]:
    """The fields of a manifest by their names, which it documents."""
    for field in manifest.__struct_fields__:
        value = getattr(manifest, field)
        if field == "invalid":
            value = {
                f"{outcome} {code}".strip(): n
                for outcome, codes in value.items()
                for code, n in codes.items()
            }
        if field != "run":
            yield field.replace("_", " "), _recorded(value)


def _recorded(value: Any) -> str:
    if value is None:
        return "not recorded"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        items = (f"{name}: {_recorded(item)}" for name, item in value.items() if item is not None)
        return "; ".join(items) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value)) or "none"
    return str(value)


def notes(result: Evaluation, *, alone: bool = True) -> Iterator[str]:
    """Notes below the table: policy, judge, budget, method of the intervals, samples without a reward.

    Args:
        result: the evaluation.
        alone: whether the table is of this run alone; that of several has no column ``ever``.
    """
    overall = result.rows["overall"]
    yield from result.notes
    yield f"policy {result.policy}, judged by {result.judge}, seed {result.seed}"
    budget = "" if result.budget is None else f"at most {' / '.join(map(str, result.budget))} steps"
    per_task = "1 sample" if result.samples == 1 else f"{result.samples} samples"
    yield f"{per_task} per task{', ' if budget else ''}{budget}"
    if result.samples > 1 and alone:
        yield "ever: share of the tasks with at least one successful sample"
    if result.samples > 1 or any(row.method == "bootstrap" for row in result.rows.values()):
        kinds = "bootstrap, stratified by difficulty; where all tasks had the same result, Wilson's"
        yield f"95 % intervals over tasks: {kinds}"
    else:
        yield "95 % intervals: Wilson's"
    if overall.no_reward:
        lost = ", ".join(f"{count} {name}" for name, count in overall.no_reward.items())
        yield f"without a reward, left out of the rate of judged and unsuccessful in that of all: {lost}"
    if overall.missing:
        missing = "1 sample is" if overall.missing == 1 else f"{overall.missing} samples are"
        yield f"{missing} missing: the run is not finished (webgym eval --resume), or not judged"


def _rows(results: Mapping[Any, Row], *, is_repeated: bool) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Columns, and a row per group; the column ``ever`` only if tasks have several samples."""
    solved = ("ever, %",) if is_repeated else ()
    rates = ("success, %", "95 % interval", "of planned, %", "95 % interval")
    columns = ("", "tasks", "judged", *rates, *solved, "mean steps", "no reward")
    rows = []
    for group, row in results.items():
        won, tasks = row.solved
        ever = (f"{100 * won / tasks:.1f}" if tasks else DASH,) if is_repeated else ()
        steps = DASH if row.steps is None else f"{row.steps:.1f}"
        lost = str(sum(row.no_reward.values()))
        rows.append((group, str(row.tasks), str(row.attempts), *_rates(row), *ever, steps, lost))
    return columns, rows


def _side_by_side(results: Sequence[Evaluation]) -> Iterator[Table]:
    def row(result: Evaluation, count: int, columns: slice) -> tuple[str, ...]:
        cells = (_rates(result.rows[group])[columns] for group in GROUPS)
        return result.run, _policy(result), str(count), *(_with_interval(*cell) for cell in cells)

    head = ("run", "policy")
    judged = [row(result, result.rows["overall"].attempts, slice(0, 2)) for result in results]
    yield Table("Success over judged attempts, %, with 95 % intervals", (*head, "judged", *GROUPS), judged)
    planned = [row(result, result.rows["overall"].planned, slice(2, 4)) for result in results]
    yield Table(
        "Success over all planned samples, %, with 95 % intervals", (*head, "planned", *GROUPS), planned
    )


def _with_interval(rate: str, interval: str) -> str:
    return rate if interval == DASH else f"{rate} [{interval}]"


def _rates(row: Row) -> tuple[str, str, str, str]:
    """Both rates with their intervals: over judged attempts, over all planned samples."""
    judged = _percent(row.rate, row.interval)
    return *judged, *_percent(row.rate_of_planned, row.interval_of_planned)


def _percent(rate: float | None, interval: Interval | None) -> tuple[str, str]:
    return (
        DASH if rate is None else f"{100 * rate:.1f}",
        DASH if interval is None else f"{100 * interval[0]:.1f}, {100 * interval[1]:.1f}",
    )


CONFIDENCE: Final = 0.95
_GRID: Final = 840
"""Parts of 1 that the permutation test counts in: exact for tasks with up to eight attempts."""
_COUNTED: Final = 10_000_000
"""Additions up to which the permutation test counts all sums one by one (a tenth of a second)."""

Sizes: TypeAlias = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class Difference(msgspec.Struct, frozen=True):
    """The difference at one level of difficulty, or over all.

    Attributes:
        tasks: number of tasks with a reward in both runs.
        first, second: mean success over these tasks; ``None`` if there are none.
        difference: second - first; ``None`` if there are no tasks.
        interval: 95 % confidence interval of the difference; ``None`` if resampling shows no spread.
        better, worse: number of tasks with a higher and with a lower mean in the second run.
        p_value: two-sided probability of the exact permutation test, that a difference is at least as large
            if chance alone decides which run is better at each task; ``None`` if no task differs. Where all
            tasks differ by the same amount this is the sign test.
    """

    tasks: int
    first: float | None
    second: float | None
    difference: float | None
    interval: Interval | None
    better: int
    worse: int
    p_value: float | None = None

    @property
    def is_decided(self) -> bool:
        """Whether the permutation test is significant at 5 %, and an interval, if any, excludes 0."""
        if self.p_value is None or self.p_value >= 1 - CONFIDENCE:
            return False
        return self.interval is None or not self.interval[0] <= 0 <= self.interval[1]


class Comparison(msgspec.Struct, frozen=True):
    """The comparison of two runs.

    Attributes:
        first, second: names of their folders.
        rows: differences by level, and overall.
        only_first, only_second: number of tasks with a reward in only one of the runs, which are left out.
        notes: caveats of the figures: an oracle as a run's policy, records that are left out.
    """

    first: str
    second: str
    rows: dict[Group, Difference]
    only_first: int
    only_second: int
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        return printed([*self.tables(), *self.conclusions()])

    def tables(self) -> list[Table]:
        """Success in both runs and its difference, by level, as a table."""
        header = ("", "tasks", self.first, self.second, "difference", "95 %", "better", "worse")
        return [Table("Success, %", header, [(group, *_cells(row)) for group, row in self.rows.items()])]

    def conclusions(self) -> Iterator[str]:
        """Lines below the table: which run is better, what is left out, and the notes."""
        overall = self.rows["overall"]
        better = self.second if (overall.difference or 0) > 0 else self.first
        conclusion = f"{better} is better" if overall.is_decided else "the difference may be chance"
        exact = "" if overall.p_value is None else f" (exact permutation test: p = {overall.p_value:.2g})"
        yield f"overall: {conclusion}{exact}"
        alone = ((self.only_first, self.first), (self.only_second, self.second))
        left_out = [
            f"{counted(count, 'task')} with a reward in {name} only" for count, name in alone if count
        ]
        if left_out:
            yield f"left out: {', '.join(left_out)}"
        yield from map(plain, self.notes)


def _cells(row: Difference) -> tuple[str, ...]:
    if row.first is None or row.second is None or row.difference is None:
        return (str(row.tasks), "-", "-", "-", "-", "-", "-")
    spread = "-" if row.interval is None else f"{100 * row.interval[0]:+.1f} to {100 * row.interval[1]:+.1f}"
    rates = (f"{100 * row.first:.1f}", f"{100 * row.second:.1f}", f"{100 * row.difference:+.1f}")
    return (str(row.tasks), *rates, spread, str(row.better), str(row.worse))


def compare(
    first: Path, second: Path, judge: str = RECORDED, config: EvaluationConfig | None = None
) -> Comparison:
    """Compare two runs.

    Args:
        first, second: run folders.
        judge: judge whose verdicts count, in both: see :func:`webgym.results.evaluation.evaluate`.
        config: settings of the bootstrap.

    Raises:
        RunFolderError: a folder is not a run, or there is no such judge.
        UsageError: no task has a reward in both.
    """
    records = (Records(), Records())
    first_rewards = rewards_by_task(first, judge, records[0])
    second_rewards = rewards_by_task(second, judge, records[1])
    shared = first_rewards.keys() & second_rewards.keys()
    if not shared:
        raise UsageError("no task has a reward in both runs", hint="compare runs over the same tasks")
    config = config or EvaluationConfig()
    pairs: dict[Level, list[tuple[float, float]]] = {level: [] for level in LEVELS}
    for task_id in sorted(shared):
        level, mean = first_rewards[task_id]
        pairs[level].append((mean, second_rewards[task_id][1]))
    generator = np.random.default_rng(config.seed)
    drawn = {level: _resampled(of_level, config.resamples, generator) for level, of_level in pairs.items()}
    names = (first.resolve().name, second.resolve().name)
    return Comparison(
        first=names[0],
        second=names[1],
        rows={group: _difference(group, pairs, drawn) for group in GROUPS},
        only_first=len(first_rewards.keys() - shared),
        only_second=len(second_rewards.keys() - shared),
        notes=tuple(
            f"{name}: {note}"
            for name, recorded in zip(names, records, strict=True)
            for note in (*oracle_notes(recorded.policies), *recorded.left_out)
        ),
    )


def _resampled(
    pairs: list[tuple[float, float]], resamples: int, generator: np.random.Generator
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The sum of differences in every resample of a level's tasks."""
    if not pairs:
        return np.zeros(resamples)
    gains = np.round([after - before for before, after in pairs], 12)  # 2/3 - 1/3 is 1/3
    gains, counts = np.unique(gains, return_counts=True)
    return np.asarray(generator.multinomial(len(pairs), counts / counts.sum(), size=resamples) @ gains)


def _difference(
    group: Group,
    pairs: Mapping[Level, list[tuple[float, float]]],
    drawn: Mapping[Level, np.ndarray[tuple[int, ...], np.dtype[np.float64]]],
) -> Difference:
    levels = LEVELS if group == "overall" else (group,)
    of_group = [pair for level in levels for pair in pairs[level]]
    if not of_group:
        return Difference(0, None, None, None, None, 0, 0)
    before, after = (float(np.mean(column)) for column in zip(*of_group, strict=True))
    spread = sum(drawn[level] for level in levels) / len(of_group)
    interval = percentiles(np.asarray(spread), CONFIDENCE)
    better, worse = sum(b > a for a, b in of_group), sum(b < a for a, b in of_group)
    return Difference(
        tasks=len(of_group),
        first=before,
        second=after,
        difference=after - before,
        interval=interval,
        better=better,
        worse=worse,
        p_value=_permutation_test([b - a for a, b in of_group]) if better + worse else None,
    )


def _permutation_test(gains: list[float]) -> float:
    """The two-sided probability that the sum of gains is at least as far from 0 if each has a random sign."""
    steps = np.rint(np.array(gains) * _GRID).astype(np.int64)
    steps = steps[steps != 0]
    steps //= max(1, int(np.gcd.reduce(steps)))
    sizes, observed = np.abs(steps), abs(int(steps.sum()))
    tail = _tail if len(sizes) * int(sizes.sum()) <= _COUNTED else _tail_by_transform
    return min(1.0, max(0.0, 2 * tail(sizes, observed)))


def _tail(sizes: Sizes, observed: int) -> float:
    """The probability that the sum of sizes with random signs is at least the observed one."""
    chances = np.ones(1)  # of each sum of sizes[:n], from -sum to sum
    for size in sizes:
        chances = (np.pad(chances, (2 * size, 0)) + np.pad(chances, (0, 2 * size))) / 2
    return float(chances[int(sizes.sum()) + observed :].sum())


def _tail_by_transform(sizes: Sizes, observed: int) -> float:
    """The same, as the inverse of the sum's characteristic function, the product of cos(size * angle).

    It is off by 1e-12 at most. Sums are counted modulo a number so large that by Hoeffding's inequality
    the chance of a sum beyond it is less than 1e-13; the rest is rounding.
    """
    values, counts = np.unique(sizes, return_counts=True)
    total, deviation = int(sizes.sum()), float(np.sqrt((sizes.astype(float) ** 2).sum())) / 2
    # The sum is 2 * w - total, where w is the sum of the sizes with a positive sign. What is counted is
    # w - total // 2.
    modulus = 1 << math.ceil(math.log2(min(total + 1, 16 * deviation)))
    cosines = np.cos(np.arange(2 * modulus) * (np.pi / modulus))
    with np.errstate(divide="ignore"):
        logarithms, is_negative = np.log(np.abs(cosines)), cosines < 0
    angles = np.arange(modulus // 2 + 1)
    logarithm, is_flipped = np.zeros(len(angles)), np.zeros(len(angles), bool)
    for value, count in zip(values.tolist(), counts.tolist(), strict=True):
        places = (angles * value) & (2 * modulus - 1)
        logarithm += count * logarithms[places]
        if count % 2:
            is_flipped ^= is_negative[places]
    transform = np.exp(logarithm) * np.where(is_flipped, -1.0, 1.0)
    if total % 2:
        transform = transform * np.exp(-1j * np.pi * angles / modulus)
    chances = np.fft.irfft(transform, modulus)
    return float(chances[(total + observed) // 2 - total // 2 : modulus // 2 + total % 2].sum())
