"""A run that may still be written, as the viewer reads it: new trajectories are read on request."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import msgspec

from webgym.core.trajectory import Trajectory
from webgym.report.overview import Figures, Overview, is_whole, overview_html
from webgym.report.run_index import RunIndex
from webgym.store.files import TASKS, TRAJECTORIES, disk_errors
from webgym.store.records import CorruptLine, Entry, read_at
from webgym.store.runs import RunReader
from webgym.store.verdicts import VerdictReader

_OVERVIEW = "overview"


class LiveRun:
    """A run in its current state. Blocking: call it from a thread, one call at a time.

    Raises:
        RunFolderError: the folder is not a run.
    """

    def __init__(self, path: Path) -> None:
        self.reader = RunReader(path, skip_corrupt=True)
        self.verdicts = VerdictReader(path)
        self.index = RunIndex(path, self.reader.tasks)
        self._overview: Overview | None = None
        self._version = ""

    def refresh(self, progress: Callable[[int], object] = lambda _: None) -> None:
        """Read what was written since; ``progress`` is called with the number of records read of a file."""
        self.index.refresh(progress)

    @property
    def is_whole(self) -> bool:
        """Whether the run is finished."""
        return is_whole(self.reader, len(self.index))

    @property
    def skipped(self) -> list[CorruptLine]:
        """The corrupt lines, which are left out."""
        return [line for line in self.reader.skipped if line.file == TASKS] + self.index.corrupt

    def overview(self) -> str:
        """The figures of all trajectories, as HTML; cached in the index while the run does not change."""
        cached, stamp = self.index.cached(_OVERVIEW, _CachedFigures), self._stamp()
        if cached is None or cached.stamp != stamp:
            if self._overview is None or self._version != self.index.version:
                self._overview, self._version = Overview(self.reader), self.index.version
            for digest in self.index.digests(self._overview.count):
                self._overview.add(digest)
            cached = _CachedFigures(stamp, self._overview.figures())
            self.index.cache(_OVERVIEW, cached)
        return str(overview_html(self.reader, cached.figures, self.skipped))

    def _stamp(self) -> str:
        """A digest of everything that the figures depend on."""
        inputs = [len(self.index), self.index.version, self.reader.summary, self.reader.config]
        return hashlib.sha256(repr(inputs).encode()).hexdigest()

    def entry(self, attempt_id: str) -> Entry:
        """The position of a trajectory's record. An unknown one is searched for in new records.

        Raises:
            KeyError: there is no trajectory with this id.
        """
        try:
            return self.index.entry(attempt_id)
        except KeyError:
            self.refresh()
            return self.index.entry(attempt_id)

    def trajectory(self, attempt_id: str) -> Trajectory:
        """One trajectory.

        Raises:
            KeyError: there is no trajectory with this id.
            StoreCorrupt: its record changed since it was indexed.
        """
        entry = self.entry(attempt_id)
        with disk_errors(f"reading {self.reader.path}"):
            return read_at(self.reader.path / TRAJECTORIES / entry.shard, entry)


class _CachedFigures(msgspec.Struct):
    stamp: str
    figures: Figures
