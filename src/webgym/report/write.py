"""``report.html``: one file that needs no network; its pictures lie beside it, or inside."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

from webgym.core.trajectory import Trajectory
from webgym.report.config import ReportConfig
from webgym.report.content import page, row
from webgym.report.overview import Overview, overview_html
from webgym.report.template import CHUNK, Page
from webgym.report.thumbnails import thumbnails
from webgym.rollout.files import REPORT, TORN, disk_errors
from webgym.rollout.store import RunReader
from webgym.rollout.summary import digest_of
from webgym.rollout.verdicts import VerdictReader


class ReportProgress(Protocol):
    """Is told how far the writing has come."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """``done`` of ``total`` things of this kind (``"trajectories"``, ``"pictures"``) are written."""
        ...


def quiet(what: str, done: int, total: int) -> None:
    """For those who do not ask."""


def write_report(
    run_path: Path, *, config: ReportConfig | None = None, progress: ReportProgress = quiet
) -> Path:
    """Write the report of a run, which may still be going on. Blocks.

    Trajectories are read twice, one in memory at a time: for the figures and the table, then for their
    pages. Corrupt records are left out and counted on the page.

    Args:
        run_path: the run folder.
        config: what the report may cost.
        progress: is told how far it has come.

    Returns:
        Path of ``report.html`` in the run folder.

    Raises:
        RunFolderError: the folder is no run.
        StoreFull: there is no space.
    """
    reader = RunReader(run_path, skip_corrupt=True)
    return write_parts(run_path / REPORT, _parts(reader, config or ReportConfig(), progress))


def write_parts(target: Path, parts: Iterable[str]) -> Path:
    """Write a document as its parts come, whole or not at all.

    Raises:
        StoreFull: there is no space.
    """
    torn = target.with_name(f".{target.name}.{uuid.uuid4().hex}{TORN}")
    with disk_errors("writing the report"):
        try:
            with torn.open("w", encoding="utf-8") as file:
                for part in parts:
                    file.write(part)
                file.flush()
                os.fsync(file.fileno())
            torn.replace(target)
        finally:
            torn.unlink(missing_ok=True)
    return target


def _parts(reader: RunReader, config: ReportConfig, progress: ReportProgress) -> Iterator[str]:
    """The document, piece by piece: what is seen first stands first."""
    tasks = reader.tasks
    overview = Overview(reader)
    rows, names = [], dict[str, None]()
    for trajectory in reader.trajectories():
        overview.add(digest_of(trajectory))
        rows.append(row(trajectory, tasks.get(trajectory.episode.task_id)))
        names |= dict.fromkeys(_shown(trajectory))
    verdicts = VerdictReader(reader.path)
    document = Page(reader.path.resolve().name, live=False)
    figures = overview_html(reader, overview.figures(), reader.skipped)
    yield document.head(figures, rows, picture="" if config.embed else next(iter(names), ""))
    for first in range(0, len(rows), CHUNK):
        chunk = rows[first : first + CHUNK]
        shown = ((reader.trajectory(told["id"]), verdicts.of(told["id"])) for told in chunk)
        yield document.chunk(
            first // CHUNK, [page(one, tasks.get(one.episode.task_id), others) for one, others in shown]
        )
        progress("trajectories", first + len(chunk), len(rows))
    if config.embed:
        for number, small in enumerate(thumbnails(reader.path, names, config)):
            yield document.picture(small.name, small.data)
            progress("pictures", number + 1, len(names))
    yield document.tail()


def _shown(trajectory: Trajectory) -> list[str]:
    return [observation.screenshot for observation in trajectory.episode.observations]
