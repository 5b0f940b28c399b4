"""Time and memory of the stages of work on a task set of the paper's size.

Every stage runs several times, in separate processes. Reading its input is not timed and, as far as possible,
not counted. No model is called: instead of rewriting derived tasks, their facts are concatenated.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import msgspec
from benchmarks.task_set.synthetic import Shape, make_lengths, make_tasks

from webgym.bench.stepping import MEGABYTE
from webgym.core.tables import Table
from webgym.core.task import Task
from webgym.tasks.formats import read_tasks, write_tasks

DRAWN: Final = 1_024
"""Number of tasks of an iteration (paper §5)."""
_JSON, _PARQUET = "tasks.jsonl", "tasks.parquet"
_TEST_SHARE: Final = 1_167 / 300_000


class TasksBench(msgspec.Struct, frozen=True, kw_only=True):
    """The size of the benchmark.

    Attributes:
        shape: of the task set.
        rounds: number of runs of each stage.
    """

    shape: Shape = Shape()
    rounds: int = 3

    @property
    def test_tasks(self) -> int:
        """The number of test tasks, with the paper's share."""
        return min(round(self.shape.tasks * _TEST_SHARE), self.shape.websites)


class Run(msgspec.Struct, frozen=True):
    """A run of a stage.

    Attributes:
        seconds: wall time by part of the stage, in order.
        processor: CPU time by part.
        peak: peak memory of the process, bytes.
    """

    seconds: dict[str, float]
    processor: dict[str, float]
    peak: int


class Stage(msgspec.Struct, frozen=True, kw_only=True):
    """A stage, its runs, and its goal for the paper's size on two cores."""

    name: str
    goal: float
    runs: list[Run] = []

    @property
    def seconds(self) -> list[float]:
        """Wall time of each run."""
        return [sum(run.seconds.values()) for run in self.runs]

    @property
    def processor(self) -> list[float]:
        """CPU time of each run."""
        return [sum(run.processor.values()) for run in self.runs]

    @property
    def peak(self) -> int:
        """Peak memory of all runs, bytes."""
        return max((run.peak for run in self.runs), default=0)


class TasksFigures(msgspec.Struct, frozen=True):
    """The results of all stages."""

    bench: TasksBench
    processors: int
    stages: list[Stage]


class _Clock:
    """Times parts of a stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.processor: dict[str, float] = {}

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        wall, processor = time.perf_counter(), time.process_time()
        yield
        self.seconds[name] = time.perf_counter() - wall
        self.processor[name] = time.process_time() - processor


_Work = Callable[[Path, TasksBench, _Clock], None]


def _load_json(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    with clock.part("load"):
        _check_count(len(read_tasks(folder / _JSON).tasks), bench)


def _load_parquet(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    with clock.part("load"):
        _check_count(len(read_tasks(folder / _PARQUET).tasks), bench)


def _split(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.split import SplitConfig, split
    from webgym.taskset.validate import validate

    tasks = read_tasks(folder / _JSON).tasks
    with clock.part("split"):
        results = split(tasks, SplitConfig(test_tasks=bench.test_tasks))
    with clock.part("validate"):
        report = validate(results.tasks)
    if not report.ok:
        raise AssertionError(f"the split leaks: {report.offenders[0]}")


def _sample(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.sampling import Sampler, SamplerConfig, parse_ratio

    sampler = Sampler(read_tasks(folder / _JSON).tasks, SamplerConfig(ratio=parse_ratio("2:1:1")))
    with clock.part(f"first {DRAWN:,}"):
        sampler.draw(min(DRAWN, bench.shape.tasks))


def _decompose(folder: Path, _: TasksBench, clock: _Clock) -> None:
    from webgym.taskset.decompose import decompose

    tasks = read_tasks(folder / _JSON).tasks
    with clock.part("decompose"):
        decompose(tasks)


def _duplicates(folder: Path, _: TasksBench, clock: _Clock) -> None:
    from webgym.taskset.duplicates import drop_duplicates

    tasks = read_tasks(folder / _JSON).tasks
    with clock.part("duplicates"):
        drop_duplicates(tasks)


def _pipeline(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.split import SplitConfig, split
    from webgym.taskset.decompose import decompose
    from webgym.taskset.duplicates import drop_duplicates
    from webgym.taskset.figures import draw_figures
    from webgym.taskset.statistics import describe
    from webgym.taskset.validate import validate

    with clock.part("load"):
        tasks = read_tasks(folder / _JSON).tasks
    with clock.part("decompose"):
        derived = decompose(tasks).derived
    with clock.part("rewrite (no model)"):
        tasks += map(_rewritten, derived)
        del derived
    with clock.part("duplicates"):
        tasks = drop_duplicates(tasks).kept
    with clock.part("split"):
        tasks = split(tasks, SplitConfig(test_tasks=bench.test_tasks)).tasks
    with clock.part("validate"):
        report = validate(tasks)
    if not report.ok:
        raise AssertionError(f"the split leaks: {report.offenders[0]}")
    with clock.part("statistics"):
        results = describe(tasks, make_lengths())
    with clock.part("figures"):
        draw_figures(results, folder / "figures")
    with TemporaryDirectory(dir=folder) as out:
        with clock.part("write JSON lines"):
            write_tasks(Path(out) / _JSON, tasks)
        with clock.part("write Parquet"):
            write_tasks(Path(out) / _PARQUET, tasks)


_STAGES: Final[Mapping[str, tuple[_Work, float]]] = {
    "load": (_load_json, 3.0),
    "load-parquet": (_load_parquet, 3.0),
    "split": (_split, 10.0),
    "sample": (_sample, 0.05),
    "decompose": (_decompose, 10.0),
    "duplicates": (_duplicates, 20.0),
    "pipeline": (_pipeline, 60.0),
}
"""Stages and their goals in seconds. ``split`` includes validation."""
STAGES: Final = tuple(_STAGES)
PEAK_GOAL: Final = 2_000_000_000
"""Goal of the peak memory of every stage, bytes."""


def measure(bench: TasksBench, stages: Sequence[str], say: Callable[[str], None]) -> TasksFigures:
    """Generate a task set in a temporary folder, and run stages on it, in turn.

    Args:
        bench: the size of the benchmark.
        stages: of :data:`STAGES`.
        say: called with a line about the progress.
    """
    with TemporaryDirectory(prefix="webgym-bench-tasks-") as name:
        folder = Path(name)
        say(f"making {bench.shape.tasks:,} tasks")
        tasks = list(make_tasks(bench.shape))
        write_tasks(folder / _JSON, tasks)
        write_tasks(folder / _PARQUET, tasks)
        del tasks
        runs: dict[str, list[Run]] = {stage: [] for stage in stages}
        for number in range(bench.rounds):
            for stage, results in runs.items():
                say(f"round {number + 1} of {bench.rounds}: {stage}")
                results.append(_run_in_process(stage, folder, bench))
    measured = [Stage(name=stage, goal=_STAGES[stage][1], runs=results) for stage, results in runs.items()]
    return TasksFigures(bench, len(os.sched_getaffinity(0)), measured)


def _run_in_process(stage: str, folder: Path, bench: TasksBench) -> Run:
    """Run a stage in a new process, so that its peak memory is that of the stage."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_run, stage, folder, bench).result()


def _run(stage: str, folder: Path, bench: TasksBench) -> Run:
    clock = _Clock()
    _STAGES[stage][0](folder, bench, clock)
    return Run(clock.seconds, clock.processor, _peak())


def _peak() -> int:
    """Peak memory of this process, bytes. Not ``ru_maxrss``, which a child inherits on Linux."""
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _rewritten(task: Task) -> Task:
    """A derived task whose instruction is the list of its facts."""
    asked = ". ".join(fact for group in task.rubric.groups for fact in group.facts)
    return msgspec.structs.replace(task, instruction=f"Find out: {asked}.")


def _check_count(count: int, bench: TasksBench) -> None:
    if count != bench.shape.tasks:
        raise AssertionError(f"{count:,} tasks were read, not {bench.shape.tasks:,}")


# --- tables -----------------------------------------------------------------------------------------


def tasks_tables(results: TasksFigures) -> list[Table]:
    """A table of the stages, and of the parts of each stage with several."""
    shape = results.bench.shape
    title = f"{shape.tasks:,} tasks on {shape.websites:,} websites, {results.processors} processors"
    rows = [
        (
            stage.name,
            _spread(stage.seconds),
            _spread(stage.processor),
            f"{stage.goal:g}",
            f"{stage.peak / MEGABYTE:,.0f}",
        )
        for stage in results.stages
    ]
    tables = [
        Table(
            f"{title}: median (min-max) of {results.bench.rounds}",
            ("stage", "seconds", "CPU, s", "goal, s", "peak, MB"),
            rows,
        )
    ]
    for stage in results.stages:
        if len(stage.runs[0].seconds) > 1:
            parts = [
                (part, f"{wall:.2f}", f"{processor:.2f}", f"{100 * share:.0f}")
                for part, wall, processor, share in _parts(stage)
            ]
            columns = ("part", "seconds", "CPU, s", "share, %")
            tables.append(
                Table(f"Parts of {stage.name}; most time: {', '.join(dominating(stage))}", columns, parts)
            )
    return tables


def dominating(stage: Stage) -> list[str]:
    """The longest parts of a stage that make up half of its time, the longest first."""
    named: list[str] = []
    together = 0.0
    for part, _, _, share in sorted(_parts(stage), key=lambda row: -row[3]):
        if together >= 0.5:
            break
        named.append(part)
        together += share
    return named


def missed(results: TasksFigures) -> list[str]:
    """The goals that the medians miss; goals are for the paper's size."""
    late = [
        f"{stage.name}: {_median(stage.seconds):.2f} s, goal {stage.goal:g} s"
        for stage in results.stages
        if _median(stage.seconds) > stage.goal
    ]
    large = [
        f"{stage.name}: {stage.peak / 1e9:.2f} GB, goal {PEAK_GOAL / 1e9:g} GB"
        for stage in results.stages
        if stage.peak > PEAK_GOAL
    ]
    return late + large


def _parts(stage: Stage) -> list[tuple[str, float, float, float]]:
    """Name, wall time, CPU time and share of the wall time of every part; medians of the runs."""
    rows = [
        (
            part,
            _median([run.seconds[part] for run in stage.runs]),
            _median([run.processor[part] for run in stage.runs]),
        )
        for part in stage.runs[0].seconds
    ]
    whole = sum(wall for _, wall, _ in rows)
    return [(part, wall, processor, wall / whole) for part, wall, processor in rows]


def _median(values: Sequence[float]) -> float:
    return sorted(values)[len(values) // 2]


def _spread(values: Sequence[float]) -> str:
    digits = 3 if max(values) < 1 else 1
    return f"{_median(values):.{digits}f} ({min(values):.{digits}f}-{max(values):.{digits}f})"
