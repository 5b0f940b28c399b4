"""How long it takes to work on a task set of the paper's size, and how much memory.

Every stage runs in a process of its own, several times; what it reads first is neither timed nor, where that
can be told apart, counted. No model is asked: where the pipeline has a derived task rewritten, its facts are
strung together.
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
from benchmarks.task_set.made_up import Shape, make_lengths, make_tasks

from webgym.bench.usage import MEGABYTE
from webgym.core.task import Task
from webgym.tables import Table
from webgym.tasks.formats import read_tasks, write_tasks

DRAWN: Final = 1_024
"""Tasks of an iteration (paper §5)."""
_JSON, _PARQUET = "tasks.jsonl", "tasks.parquet"
_TEST_SHARE: Final = 1_167 / 300_000


class TasksBench(msgspec.Struct, frozen=True, kw_only=True):
    """How much is measured.

    Attributes:
        shape: of the task set.
        rounds: how many times each stage runs.
    """

    shape: Shape = Shape()
    rounds: int = 3

    @property
    def test_tasks(self) -> int:
        """As many of the tasks as in the paper."""
        return min(round(self.shape.tasks * _TEST_SHARE), self.shape.websites)


class Run(msgspec.Struct, frozen=True):
    """One run of a stage.

    Attributes:
        seconds: wall time by part of the stage, in order.
        processor: the same in processor time.
        peak: the most memory its process ever held, bytes.
    """

    seconds: dict[str, float]
    processor: dict[str, float]
    peak: int


class Stage(msgspec.Struct, frozen=True, kw_only=True):
    """What is measured, and what it should stay below at the paper's size on two cores."""

    name: str
    goal: float
    runs: list[Run] = []

    @property
    def seconds(self) -> list[float]:
        """Wall time of each run."""
        return [sum(run.seconds.values()) for run in self.runs]

    @property
    def processor(self) -> list[float]:
        """Processor time of each run; on an idle machine little less than the wall time."""
        return [sum(run.processor.values()) for run in self.runs]

    @property
    def peak(self) -> int:
        """The most memory of all runs, bytes."""
        return max((run.peak for run in self.runs), default=0)


class TasksFigures(msgspec.Struct, frozen=True):
    """What was measured."""

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
        _expect(len(read_tasks(folder / _JSON).tasks), bench)


def _load_parquet(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    with clock.part("load"):
        _expect(len(read_tasks(folder / _PARQUET).tasks), bench)


def _split(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.split import SplitConfig, split
    from webgym.tasks.validate import validate

    tasks = read_tasks(folder / _JSON).tasks
    with clock.part("split"):
        found = split(tasks, SplitConfig(test_tasks=bench.test_tasks))
    with clock.part("validate"):
        report = validate(found.tasks)
    if not report.ok:
        raise AssertionError(f"the split leaks: {report.offenders[0]}")


def _sample(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.sampling import Sampler, SamplerConfig, parse_ratio

    sampler = Sampler(read_tasks(folder / _JSON).tasks, SamplerConfig(ratio=parse_ratio("2:1:1")))
    with clock.part(f"first {DRAWN:,}"):
        sampler.draw(min(DRAWN, bench.shape.tasks))


def _decompose(folder: Path, _: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.decompose import decompose

    tasks = read_tasks(folder / _JSON).tasks
    with clock.part("decompose"):
        decompose(tasks)


def _duplicates(folder: Path, _: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.duplicates import drop_duplicates

    tasks = read_tasks(folder / _JSON).tasks
    with clock.part("duplicates"):
        drop_duplicates(tasks)


def _pipeline(folder: Path, bench: TasksBench, clock: _Clock) -> None:
    from webgym.tasks.decompose import decompose
    from webgym.tasks.duplicates import drop_duplicates
    from webgym.tasks.figures import draw_figures
    from webgym.tasks.split import SplitConfig, split
    from webgym.tasks.statistics import describe
    from webgym.tasks.validate import validate

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
        found = describe(tasks, make_lengths())
    with clock.part("figures"):
        draw_figures(found, folder / "figures")
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
"""What is measured, and its goal in seconds. ``split`` validates, too."""
STAGES: Final = tuple(_STAGES)
PEAK_GOAL: Final = 2_000_000_000
"""Bytes that no stage may hold."""


def measure(bench: TasksBench, stages: Sequence[str], say: Callable[[str], None]) -> TasksFigures:
    """Make a task set in a folder that is removed afterwards, and run stages over it, in turn.

    Args:
        stages: of :data:`STAGES`.
        say: told what is done next.
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
            for stage, found in runs.items():
                say(f"round {number + 1} of {bench.rounds}: {stage}")
                found.append(_apart(stage, folder, bench))
    measured = [Stage(name=stage, goal=_STAGES[stage][1], runs=found) for stage, found in runs.items()]
    return TasksFigures(bench, len(os.sched_getaffinity(0)), measured)


def _apart(stage: str, folder: Path, bench: TasksBench) -> Run:
    """Run a stage in a fresh process, so that its memory is its own."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        return pool.submit(_run, stage, folder, bench).result()


def _run(stage: str, folder: Path, bench: TasksBench) -> Run:
    clock = _Clock()
    _STAGES[stage][0](folder, bench, clock)
    return Run(clock.seconds, clock.processor, _peak())


def _peak() -> int:
    """The most memory this process has held, bytes. Not ``ru_maxrss``, which a child inherits on Linux."""
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _rewritten(task: Task) -> Task:
    """A derived task that asks for its facts in a row, for want of a model."""
    asked = ". ".join(fact for group in task.rubric.groups for fact in group.facts)
    return msgspec.structs.replace(task, instruction=f"Find out: {asked}.")


def _expect(found: int, bench: TasksBench) -> None:
    if found != bench.shape.tasks:
        raise AssertionError(f"{found:,} tasks were read, not {bench.shape.tasks:,}")


# --- tables -----------------------------------------------------------------------------------------


def tasks_tables(found: TasksFigures) -> list[Table]:
    """The stages, and what the time of those goes into that have parts."""
    shape = found.bench.shape
    title = f"{shape.tasks:,} tasks on {shape.websites:,} websites, {found.processors} processors"
    rows = [
        (
            stage.name,
            _spread(stage.seconds),
            _spread(stage.processor),
            f"{stage.goal:g}",
            f"{stage.peak / MEGABYTE:,.0f}",
        )
        for stage in found.stages
    ]
    tables = [
        Table(
            f"{title}: median (lowest-highest) of {found.bench.rounds}",
            ("stage", "seconds", "processor, s", "goal, s", "peak, MB"),
            rows,
        )
    ]
    for stage in found.stages:
        if len(stage.runs[0].seconds) > 1:
            parts = [
                (part, f"{wall:.2f}", f"{processor:.2f}", f"{100 * share:.0f}")
                for part, wall, processor, share in _parts(stage)
            ]
            columns = ("part", "seconds", "processor, s", "share, %")
            tables.append(
                Table(f"What dominates in {stage.name}: {', '.join(dominating(stage))}", columns, parts)
            )
    return tables


def dominating(stage: Stage) -> list[str]:
    """The parts that take most of a stage's time, the longest first: as few as make half of it."""
    named: list[str] = []
    together = 0.0
    for part, _, _, share in sorted(_parts(stage), key=lambda row: -row[3]):
        if together >= 0.5:
            break
        named.append(part)
        together += share
    return named


def missed(found: TasksFigures) -> list[str]:
    """The goals that were not met, by the median; they are meant for the paper's size."""
    late = [
        f"{stage.name}: {_median(stage.seconds):.2f} s, goal {stage.goal:g} s"
        for stage in found.stages
        if _median(stage.seconds) > stage.goal
    ]
    large = [
        f"{stage.name}: {stage.peak / 1e9:.2f} GB, goal {PEAK_GOAL / 1e9:g} GB"
        for stage in found.stages
        if stage.peak > PEAK_GOAL
    ]
    return late + large


def _parts(stage: Stage) -> list[tuple[str, float, float, float]]:
    """Name, wall and processor time, and share of the wall time, medians over the runs."""
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
