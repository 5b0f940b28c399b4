"""Benchmarks that policies are evaluated on: whose public file is read as it is, and which judge is theirs.

No rubric is written. A task of DeepShop has the requirements that its own record lists (attribute, filter,
sort); a task of the other benchmarks is judged whole. The published set brings its rubrics.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

from webgym.core.task import WHOLE_TASK, FactGroup, Rubric, Task
from webgym.tasks.files import BrokenRecord, TaskCollector, TaskFile
from webgym.tasks.formats import read_tasks
from webgym.tasks.sources import SourceTask, read_source

BenchmarkName: TypeAlias = Literal[
    "online-mind2web", "webvoyager", "deepshop", "webgym-test", "mind2web-live"
]


class Benchmark(NamedTuple):
    """A benchmark.

    Attributes:
        source: key of its reader in :data:`webgym.tasks.sources.SOURCES`.
        judge: name of the judge that its papers report.
    """

    source: str
    judge: str


BENCHMARKS: Final[dict[BenchmarkName, Benchmark]] = {
    "online-mind2web": Benchmark("online-mind2web", "webjudge"),
    "webvoyager": Benchmark("pae-webvoyager", "webvoyager"),
    "deepshop": Benchmark("deepshop", "deepshop"),
    "webgym-test": Benchmark("webgym", "rubric"),
    # Its own key nodes name elements by their paths in the pages of 2024, which no run records.
    "mind2web-live": Benchmark("mind2web-live", "webjudge"),
}


def read_benchmark(name: BenchmarkName, where: Path | str) -> TaskFile:
    """The tasks of a benchmark's public file.

    Args:
        name: of the benchmark.
        where: the file, a folder of such files, or an address on the hub (:mod:`webgym.tasks.hub`).

    Raises:
        TaskFileError: it cannot be read, or holds no record of the benchmark.
    """
    source = BENCHMARKS[name].source
    if source == "webgym":
        return read_tasks(where)
    read, collector = read_source(source, where), TaskCollector()
    for skipped in read.skipped:
        place = skipped.place.removeprefix("line ")
        collector.broken.append(BrokenRecord(Path(skipped.file), place, skipped.reason))
    for found in read.tasks:
        if found.website is None:
            collector.skip(Path(where), found.id, "it has no website to start on")
        else:
            collector.add(Path(where), found.id, _task(found, found.website))
    return TaskFile(list(collector.tasks.values()), collector.broken, collector.set_aside)


def _task(found: SourceTask, website: str) -> Task:
    return Task(
        id=found.id,
        instruction=found.instruction,
        website=website,
        domain=found.domain or "Misc.",
        subdomain=found.subdomain or "General Info.",
        rubric=_requirements(found) if found.source == "deepshop" else WHOLE_TASK,
        source=found.source,
        reference_answer=found.reference_answer,
        example_answer=found.example_answer,
        website_from=found.website_from,
        flags=found.flags,
        stated_level=found.level,
    )


def _requirements(found: SourceTask) -> Rubric:
    """The requirements that a record of DeepShop lists, a fact each."""
    listed = [hint.partition(": ") for hint in found.hints]
    groups = [FactGroup(number, kind, (text,)) for number, (kind, _, text) in enumerate(listed, 1)]
    return Rubric(tuple(groups)) if groups else WHOLE_TASK
