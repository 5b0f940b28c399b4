"""A run that may still be written, as the pages read it: what is new is taken in on request."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import msgspec

from webgym.core.trajectory import Trajectory
from webgym.report.overview import Figures, Overview, is_whole, overview_html
from webgym.report.run_index import RunIndex
from webgym.rollout.files import TASKS, TRAJECTORIES, disk_errors
from webgym.rollout.records import CorruptLine, Entry, read_at
from webgym.rollout.store import RunReader
from webgym.rollout.verdicts import VerdictReader

_OVERVIEW = "overview"


class LiveRun:
    """A run as far as it has come. Blocks: call it from a thread, one call at a time.

    Raises:
        RunFolderError: the folder is no run.
    """

    def __init__(self, path: Path) -> None:
        self.reader = RunReader(path, skip_corrupt=True)
        self.verdicts = VerdictReader(path)
        self.index = RunIndex(path, self.reader.tasks)
        self._overview: Overview | None = None
        self._version = ""

    def refresh(self, told: Callable[[int], object] = lambda _: None) -> None:
        """Take in what was written since; ``told`` is how many records of a file were read."""
        self.index.refresh(told)

    @property
    def is_whole(self) -> bool:
        """Whether nothing more is to come."""
        return is_whole(self.reader, len(self.index))

    @property
    def skipped(self) -> list[CorruptLine]:
        """What cannot be trusted."""
        return [line for line in self.reader.skipped if line.file == TASKS] + self.index.corrupt

    def overview(self) -> str:
        """The figures of all trajectories; of a run that has not changed, those that the index keeps."""
        known, stamp = self.index.kept(_OVERVIEW, _Kept), self._stamp()
        if known is None or known.stamp != stamp:
            if self._overview is None or self._version != self.index.version:
                self._overview, self._version = Overview(self.reader), self.index.version
            for digest in self.index.digests(self._overview.count):
                self._overview.add(digest)
            known = _Kept(stamp, self._overview.figures())
            self.index.keep(_OVERVIEW, known)
        return str(overview_html(self.reader, known.figures, self.skipped))

    def _stamp(self) -> str:
        """Of all that the figures are made from."""
        made_from = [len(self.index), self.index.version, self.reader.summary, self.reader.config]
        return hashlib.sha256(repr(made_from).encode()).hexdigest()

    def entry(self, attempt_id: str) -> Entry:
        """Where a trajectory lies; one that is not known may have been written since.

        Raises:
            KeyError: there is none of this id.
        """
        try:
            return self.index.entry(attempt_id)
        except KeyError:
            self.refresh()
            return self.index.entry(attempt_id)

    def trajectory(self, attempt_id: str) -> Trajectory:
        """One trajectory.

        Raises:
            KeyError: there is none of this id.
            StoreCorrupt: its record changed since it was indexed.
        """
        entry = self.entry(attempt_id)
        with disk_errors(f"reading {self.reader.path}"):
            return read_at(self.reader.path / TRAJECTORIES / entry.shard, entry)


class _Kept(msgspec.Struct):
    stamp: str
    figures: Figures
