"""Writes the files of a build: the same bytes for the same replies.

    manifest.json               config, sources, and the counts of every stage
    train.jsonl, test.jsonl     the task set; also as train.parquet, test.parquet
    failed.jsonl                tasks for which no usable reply was given, with reasons and replies
    skipped.jsonl               records that gave no task, and why
    dropped.jsonl               tasks that were left out on purpose, and why
    statistics.json, figures/   SYSTEM.md 1.6
    replies.sqlite              the cache of replies (unless another file is given)

The manifest is written last: a folder that has it is complete.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import date
from pathlib import Path
from typing import Any, Final

import msgspec

from webgym.core.errors import TaskFileError
from webgym.core.task import LEVELS, Task
from webgym.tasks.files import whole_file
from webgym.tasks.formats import write_tasks
from webgym.taskset.construction.accounting import CountMismatch
from webgym.taskset.construction.pipeline import Build
from webgym.taskset.construction.progress import StageProgress
from webgym.taskset.statistics import describe
from webgym.taskset.validate import validate

MANIFEST: Final = "manifest.json"
FAILED: Final = "failed.jsonl"
TASK_FILES: Final = {
    split: tuple(f"{split}.{ending}" for ending in ("jsonl", "parquet")) for split in ("train", "test")
}
"""Names of the files of tasks, by split."""
_FORMAT: Final = 1


def write_build(build: Build, out: Path, today: date, stages: StageProgress) -> list[Path]:
    """Validate the task set and write all files of a build.

    Returns:
        The files written.

    Raises:
        CountMismatch: the set breaks a rule of :mod:`webgym.taskset.validate`, such as a leak between the
            splits.
        TaskFileError: the folder cannot be written.
    """
    # How a source derived its own tasks is its own affair.
    given = {task.id for task in build.imported.tasks if task.parent_id is not None}
    for offender in validate(build.tasks).offenders:
        if offender.rule != "derived" or offender.id not in given:
            raise CountMismatch(f"the task set breaks a rule: {offender}")
    written: list[Path] = []
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / MANIFEST).unlink(missing_ok=True)  # of an earlier build, whose files are replaced now
        with stages.stage("write", len(build.tasks)) as advance:
            for split, names in TASK_FILES.items():
                part = [task for task in build.tasks if task.split == split]
                for name in names:
                    written.append(out / name)
                    write_tasks(written[-1], part)
                advance(len(part))
        for name, rows in _lists(build).items():
            written.append(out / name)
            _write(written[-1], _rows(rows))
        with stages.stage("statistics", len(build.tasks)) as advance:
            statistics = describe(build.tasks)
            written.append(out / "statistics.json")
            _write(written[-1], _indented(statistics))
            if build.config.figures:
                from webgym.taskset.figures import draw_figures  # importing matplotlib takes seconds

                written += draw_figures(statistics, out / "figures")
            advance(len(build.tasks))
        written.append(out / MANIFEST)
        _write(written[-1], _indented(manifest(build, today)))
    except OSError as error:
        raise TaskFileError(f"cannot write to {out}: {error.strerror or error}") from error
    return written


def write_failures(build: Build, out: Path) -> Path:
    """Write only the list of failures, for a build that could not be finished; the path of the file.

    Raises:
        TaskFileError: the folder cannot be written.
    """
    try:
        _write(out / FAILED, _rows(build.failures))
    except OSError as error:
        raise TaskFileError(f"cannot write to {out}: {error.strerror or error}") from error
    return out / FAILED


def _lists(build: Build) -> dict[str, Iterable[msgspec.Struct | dict[str, Any]]]:
    skipped = [
        {"source": source, **msgspec.structs.asdict(record)} for source, record in build.imported.skipped
    ]
    return {
        FAILED: build.failures,
        "skipped.jsonl": skipped,
        "dropped.jsonl": build.dropped,
    }


def manifest(build: Build, today: date) -> dict[str, Any]:
    """The manifest: config, sources and counts of every stage; nothing that differs from run to run."""
    config = build.config.model_dump(
        mode="json", exclude={"budget", "assumptions", "today", "endpoint_failures", "figures"}
    )
    stages: dict[str, dict[str, Any]] = {}
    for row in build.accounting.rows:
        entry = {"came": row.came, "made": row.made, "lost": row.lost, "left": row.left}
        stages.setdefault(row.stage, {})[row.source] = entry
    return {
        "format": _FORMAT,
        "today": today.isoformat(),
        "config": config,
        "sources": {report.name: msgspec.to_builtins(report) for report in build.imported.reports},
        "stages": stages,
        "asked": {purpose: msgspec.to_builtins(tally) for purpose, tally in build.tallies.items()},
        "capped_parents": len(build.capped),
        "tasks": _counts(build.tasks),
    }


def _counts(tasks: Sequence[Task]) -> dict[str, Any]:
    return {
        split: {
            "tasks": len(part),
            "derived": sum(task.parent_id is not None for task in part),
            "levels": {level: sum(task.level == level for task in part) for level in LEVELS},
        }
        for split in ("train", "test")
        for part in [[task for task in tasks if task.split == split]]
    }


def _write(path: Path, data: bytes) -> None:
    with whole_file(path) as file:
        file.write(data)


def _rows(rows: Iterable[Any]) -> bytes:
    return b"".join(msgspec.json.encode(row) + b"\n" for row in rows)


def _indented(value: Any) -> bytes:
    return msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n"
