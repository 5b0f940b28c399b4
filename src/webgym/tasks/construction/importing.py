"""The first stage: every source's records become tasks, are skipped, or stay out for a reason."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass
from datetime import date

import msgspec

from webgym.core.errors import TaskFileError
from webgym.tasks.construction.accounting import TaskAccounting
from webgym.tasks.construction.config import BuildConfig
from webgym.tasks.construction.progress import StageProgress
from webgym.tasks.sources import SOURCES, Skipped, SourceTask, read_source
from webgym.tasks.sources.base import ENCRYPTED_SOURCE

WITHHELD = "plain text not asked for"
OVER_AT_MOST = "over at_most"


class SourceReport(msgspec.Struct, frozen=True, kw_only=True):
    """What a source held, beside what the paper counts (SOURCES.md, pitfall 7).

    Attributes:
        name, path: as given.
        records, tasks, websites: as read; websites by registrable domain, those to be inferred do not count.
        paper_tasks, paper_websites: of the paper's Table 1.
        website_from: tasks by where their website comes from.
        flags: tasks by flag.
        passed_over: files that hold no tasks, and why.
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
    """What the sources held.

    Attributes:
        tasks: to continue with, by source in the order of the paper's Table 1.
        skipped: records that gave none, with their sources.
        reports: one for each source.
    """

    tasks: list[SourceTask]
    skipped: list[tuple[str, Skipped]]
    reports: list[SourceReport]


def import_tasks(
    config: BuildConfig, today: date, accounting: TaskAccounting, stages: StageProgress
) -> Imported:
    """Read the sources.

    Tasks of an encrypted source stay out unless the config names it: neither the model nor any file of the
    build sees them.

    Raises:
        UsageError: a source cannot be read, or holds no task.
    """
    imported = Imported([], [], [])
    came: Counter[str] = Counter()
    lost: Counter[tuple[str, str]] = Counter()
    with stages.stage("import", len(config.sources)) as advance:
        for name, choice in config.sources.items():
            read = read_source(name, choice.path, today=today)
            if not read.tasks:
                raise TaskFileError(
                    f"{choice.path} holds no task of {name}; the first that is none: {read.skipped[0]}",
                    hint=f"webgym tasks sources --read {name}={choice.path} says more",
                )
            came[name] = read.records
            lost[name, "no task"] = len(read.skipped)
            imported.skipped.extend((name, each) for each in read.skipped)
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
                    passed_over=[str(each) for each in read.passed_over],
                )
            )
            advance(1)
    accounting.enter("import", came=came, lost=lost, left=Counter(task.source for task in imported.tasks))
    return imported


def draw(tasks: list[SourceTask], at_most: int | None, seed: int) -> list[SourceTask]:
    """So many tasks, in their order. Drawing more gives the same ones and more."""
    if at_most is None or len(tasks) <= at_most:
        return tasks

    def key(task: SourceTask) -> bytes:
        return hashlib.blake2b(f"{seed}/{task.id}".encode(), digest_size=16).digest()

    chosen = {task.id for task in sorted(tasks, key=key)[:at_most]}
    return [task for task in tasks if task.id in chosen]
