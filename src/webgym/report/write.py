"""Writes ``report.html``: one file without network access; screenshots are in the run folder or embedded."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final, TypeAlias

from markupsafe import Markup

from webgym.core.errors import StoreCorrupt
from webgym.core.trajectory import Trajectory
from webgym.report.config import ReportConfig
from webgym.report.content import page
from webgym.report.live_run import LiveRun
from webgym.report.template import CHUNK, Page
from webgym.report.thumbnails import thumbnails
from webgym.results.run_index import TrajectoryQuery
from webgym.store.files import REPORT, disk_errors, write_lines

MOST_PAGES: Final = 1_000
"""Trajectories whose pages are in a report: these take two of its seconds. The viewer shows all of a larger
run."""


ReportProgress: TypeAlias = Callable[[str, int, int], None]
"""Called with a kind of items, how many of them are read (``"records"``) or written (``"trajectories"``,
``"pictures"``), and their total; 0 for records, whose total is not known."""


def write_report(
    run_path: Path | str,
    *,
    config: ReportConfig | None = None,
    progress: ReportProgress = lambda *_: None,
) -> Path:
    """Write the report of a run, which may still be going on. Blocks.

    Figures and table come from the run's index. The file holds the pages of all trajectories, of up to
    :data:`MOST_PAGES` of a larger run, evenly spread. Corrupt records are left out and counted on the page.

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
    run = LiveRun(Path(run_path))
    target, config = run.reader.path / REPORT, config or ReportConfig()
    try:
        return write_parts(target, _parts(run, config, progress))
    except StoreCorrupt:  # a record has changed since it was indexed
        run.index.forget()
        return write_parts(target, _parts(run, config, progress))
    finally:
        run.index.close()


def write_parts(target: Path, parts: Iterable[str]) -> Path:
    """Write the parts of a document to a file, atomically; the file's path.

    Raises:
        StoreFull: there is no space.
    """
    with disk_errors("writing the report"):
        write_lines(target, (part.encode() for part in parts))
    return target


def _parts(run: LiveRun, config: ReportConfig, progress: ReportProgress) -> Iterator[str]:
    """The parts of the document, the visible ones first."""
    run.refresh(lambda count: progress("records", count, 0))
    reader, tasks = run.reader, run.reader.tasks
    total, found = run.index.find(TrajectoryQuery(), 0, sys.maxsize)
    rows: list[dict[str, Any]] = [{**row} for row in found]
    with_pages = rows[:: max(1, -(-total // MOST_PAGES))]
    for place, row in enumerate(with_pages):
        row["page"] = place
    shown = [row["id"] for row in with_pages]
    document = Page(reader.path.resolve().name, live=False)
    seen = (name for attempt_id in shown for name in _screenshots(run.trajectory(attempt_id)))
    picture = "" if config.embed else next(seen, "")
    figures = Markup(run.overview())  # noqa: S704 - rendered with autoescape
    yield document.head(figures, rows, whole=run.is_whole, picture=picture)
    names = dict[str, None]()
    for first in range(0, len(shown), CHUNK):
        chunk = shown[first : first + CHUNK]
        read = [(run.trajectory(attempt_id), run.verdicts.of(attempt_id)) for attempt_id in chunk]
        for trajectory, _ in read:
            names |= dict.fromkeys(_screenshots(trajectory))
        pages = [
            page(trajectory, tasks.get(trajectory.episode.task_id), others) for trajectory, others in read
        ]
        yield document.chunk(first // CHUNK, pages)
        progress("trajectories", first + len(chunk), len(shown))
    if config.embed:
        for number, small in enumerate(thumbnails(reader.path, names, config)):
            yield document.picture(small.name, small.data)
            progress("pictures", number + 1, len(names))
    yield document.tail()


def _screenshots(trajectory: Trajectory) -> list[str]:
    return [observation.screenshot for observation in trajectory.episode.observations]
