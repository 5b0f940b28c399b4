"""Writes ``report.html``: one file without network access; screenshots are in the run folder or embedded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Protocol

from webgym.core.trajectory import Trajectory
from webgym.report.config import ReportConfig
from webgym.report.content import page, row
from webgym.report.overview import Overview, overview_html
from webgym.report.template import CHUNK, Page
from webgym.report.thumbnails import thumbnails
from webgym.results.summary import digest_of
from webgym.store.files import REPORT, disk_errors, write_lines
from webgym.store.runs import RunReader
from webgym.store.verdicts import VerdictReader


class ReportProgress(Protocol):
    """Called with the progress of writing a report."""

    def __call__(self, what: str, done: int, total: int) -> None:
        """``done`` of ``total`` items of this kind (``"trajectories"``, ``"pictures"``) are written."""
        ...


def quiet(what: str, done: int, total: int) -> None:
    """Ignores the progress."""


def write_report(
    run_path: Path | str, *, config: ReportConfig | None = None, progress: ReportProgress = quiet
) -> Path:
    """Write the report of a run, which may still be going on. Blocks.

    Trajectories are read twice, one at a time: for the figures and the table, then for their pages. Corrupt
    records are left out and counted on the page.

    Args:
        run_path: the run folder.
        config: settings of the report.
        progress: called with the progress.

    Returns:
        Path of ``report.html`` in the run folder.

    Raises:
        RunFolderError: the folder is not a run.
        StoreFull: there is no space.
    """
    reader = RunReader(run_path, skip_corrupt=True)
    return write_parts(reader.path / REPORT, _parts(reader, config or ReportConfig(), progress))


def write_parts(target: Path, parts: Iterable[str]) -> Path:
    """Write the parts of a document to a file, atomically; the file's path.

    Raises:
        StoreFull: there is no space.
    """
    with disk_errors("writing the report"):
        write_lines(target, (part.encode() for part in parts))
    return target


def _parts(reader: RunReader, config: ReportConfig, progress: ReportProgress) -> Iterator[str]:
    """The parts of the document, the visible ones first."""
    tasks = reader.tasks
    overview = Overview(reader)
    rows, names = [], dict[str, None]()
    for trajectory in reader.trajectories():
        overview.add(digest_of(trajectory))
        rows.append(row(trajectory, tasks.get(trajectory.episode.task_id)))
        names |= dict.fromkeys(_screenshots(trajectory))
    verdicts = VerdictReader(reader.path)
    document = Page(reader.path.resolve().name, live=False)
    figures = overview_html(reader, overview.figures(), reader.skipped)
    yield document.head(figures, rows, picture="" if config.embed else next(iter(names), ""))
    for first in range(0, len(rows), CHUNK):
        chunk = rows[first : first + CHUNK]
        read = ((reader.trajectory(entry["id"]), verdicts.of(entry["id"])) for entry in chunk)
        pages = [
            page(trajectory, tasks.get(trajectory.episode.task_id), others) for trajectory, others in read
        ]
        yield document.chunk(first // CHUNK, pages)
        progress("trajectories", first + len(chunk), len(rows))
    if config.embed:
        for number, small in enumerate(thumbnails(reader.path, names, config)):
            yield document.picture(small.name, small.data)
            progress("pictures", number + 1, len(names))
    yield document.tail()


def _screenshots(trajectory: Trajectory) -> list[str]:
    return [observation.screenshot for observation in trajectory.episode.observations]
