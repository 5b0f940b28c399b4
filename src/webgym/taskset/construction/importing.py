"""The first stage of a build: every record of the sources becomes a task, or is left out for a reason."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass, field
from datetime import date

import msgspec

from webgym.core.errors import TaskFileError
from webgym.taskset.construction.accounting import TaskAccounting
from webgym.taskset.construction.config import BuildConfig
from webgym.taskset.construction.progress import StageProgress
from webgym.taskset.sources import SOURCES, Skipped, SourceTask, read_source
from webgym.taskset.sources.base import ENCRYPTED_SOURCE

WITHHELD = "plain text not asked for"
OVER_AT_MOST = "over at_most"


class SourceReport(msgspec.Struct, frozen=True, kw_only=True):
    """Contents of a source, together with the paper's counts (SOURCES.md, pitfall 7).

    Attributes:
        name: of the source.
        path: where it was read from.
        records, tasks: number of records, and of tasks made from them.
        websites: number of registrable domains, without those still to be inferred.
        paper_tasks, paper_websites: counts in the paper's Table 1.
        website_from: number of tasks by the origin of their website.
        flags: number of tasks by flag.
        passed_over: files without tasks, and why.
    """

    name: str
    path: str
    records: int
    tasks: int
    websites: int
    paper_tasks: int
    paper_websites: int
    website_from: dict[str, int]
    flags: dict[str, int]
    passed_over: list[str]


@dataclass(frozen=True)
class Imported:
    """Contents of all sources.

    Attributes:
        tasks: the tasks of the build, by source in the order of the paper's Table 1.
        skipped: records that gave no task, with the names of their sources.
        reports: one per source.
        test_tasks: the sources' own test tasks, also those over ``at_most``.
    """

    tasks: list[SourceTask]
    skipped: list[tuple[str, Skipped]]
    reports: list[SourceReport]
    test_tasks: list[SourceTask] = field(default_factory=list)


def import_tasks(
    config: BuildConfig, today: date, accounting: TaskAccounting, stages: StageProgress
) -> Imported:
    """Read the sources.

    Tasks of an encrypted source are left out unless the config lists it in ``plaintext``: they are neither
    sent to a model nor written to a file.

    Raises:
        UsageError: a source cannot be read, or has no task.
    """
    imported = Imported([], [], [])
    came: Counter[str] = Counter()
    lost: Counter[tuple[str, str]] = Counter()
    with stages.stage("import", len(config.sources)) as advance:
        for name, choice in config.sources.items():
            read = read_source(name, choice.path, today=today)
            if not read.tasks:
                raise TaskFileError(
                    f"{choice.path} contains no task of {name}; the first skipped record: {read.skipped[0]}",
                    hint=f"webgym tasks sources --read {name}={choice.path} lists the reasons",
                )
            imported.test_tasks.extend(task for task in read.tasks if task.split == "test")
            came[name] = read.records
            lost[name, "no task"] = len(read.skipped)
            imported.skipped.extend((name, record) for record in read.skipped)
            tasks = [
                task for task in read.tasks if name in config.plaintext or ENCRYPTED_SOURCE not in task.flags
            ]
            lost[name, WITHHELD] = len(read.tasks) - len(tasks)
            chosen = draw(tasks, choice.at_most, config.seed)
            lost[name, OVER_AT_MOST] = len(tasks) - len(chosen)
            imported.tasks.extend(chosen)
            imported.reports.append(
                SourceReport(
                    name=name,
                    path=choice.path,
                    records=read.records,
                    tasks=len(read.tasks),
                    websites=read.websites(),
                    paper_tasks=SOURCES[name].paper_tasks,
                    paper_websites=SOURCES[name].paper_websites,
                    website_from=dict(sorted(read.websites_from().items())),
                    flags=dict(sorted(read.flags().items())),
                    passed_over=[str(file) for file in read.passed_over],
                )
            )
            advance(1)
    accounting.record("import", came=came, lost=lost, left=Counter(task.source for task in imported.tasks))
    return imported


def draw(tasks: list[SourceTask], at_most: int | None, seed: int) -> list[SourceTask]:
    """At most ``at_most`` of the tasks, in their order. A larger ``at_most`` gives the same tasks and
    more."""
    if at_most is None or len(tasks) <= at_most:
        return tasks

    def key(task: SourceTask) -> bytes:
        return hashlib.blake2b(f"{seed}/{task.id}".encode(), digest_size=16).digest()

    chosen = {task.id for task in sorted(tasks, key=key)[:at_most]}
    return [task for task in tasks if task.id in chosen]
