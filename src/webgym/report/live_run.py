"""A run as its pages show it, even while it is written: figures and charts as HTML, and its trajectories."""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup

from webgym.core.task import LEVELS, Task
from webgym.core.trajectory import Trajectory
from webgym.report.charts import Histogram, LogAxis
from webgym.report.template import ENVIRONMENT
from webgym.results.run_index import RunIndex
from webgym.results.summary import Digest, Summary, Tally
from webgym.store.files import TASKS, TRAJECTORIES, disk_errors
from webgym.store.records import CorruptLine, Entry, read_at
from webgym.store.runs import RunReader
from webgym.store.verdicts import VerdictReader

_ORDER = ("navigate", "execute", "settle", "screenshot", "metadata", "policy", "judge")
"""Operations in the order of a step; others follow by name."""


def _operation_order(operation: str) -> tuple[int, str]:
    return (_ORDER.index(operation) if operation in _ORDER else len(_ORDER), operation)


class Figures(msgspec.Struct):
    """The figures of a run.

    Attributes:
        summary: as in ``summary.json``.
        lengths: (steps, outcome, number of attempts), by level.
    """

    summary: Summary
    lengths: dict[str, list[tuple[int, str, int]]]


class Overview:
    """Computes the figures of a run from its trajectories.

    Args:
        reader: of the run; its tasks, settings and summary are read, but not its trajectories.
    """

    def __init__(self, reader: RunReader) -> None:
        self._reader = reader
        self._tasks: Mapping[str, Task] = reader.tasks
        self._tally = Tally(reader.drawn, reader.samples)
        self._lengths: defaultdict[str, Counter[tuple[int, str]]] = defaultdict(Counter)
        self.count = 0

    def add(self, digest: Digest) -> None:
        """Count one trajectory."""
        self.count += 1
        self._tally.add(digest)
        if task := self._tasks.get(digest.task_id):
            self._lengths[task.level][digest.steps, digest.outcome.value] += 1

    def figures(self) -> Figures:
        """The figures so far. What trajectories do not contain is taken from the collector's summary, if
        there is one."""
        collected = self._reader.summary or {}
        config = self._reader.config
        summary = self._tally.summary(
            seed=collected.get("seed", config.get("seed")),
            policy=collected.get("policy") or None,
            judge=collected.get("judge") or None,
            wall_seconds=collected.get("wall_seconds") if is_whole(self._reader, self.count) else None,
            elsewhere=collected.get("elsewhere"),
        )
        lengths = {
            level: [(*key, n) for key, n in counted.items()] for level, counted in self._lengths.items()
        }
        return Figures(summary, lengths)


def is_whole(reader: RunReader, count: int) -> bool:
    """Whether the run is finished: the collector's summary has this number of attempts."""
    return bool((reader.summary or {}).get("attempts") == count)


def overview_html(reader: RunReader, figures: Figures, skipped: Sequence[CorruptLine]) -> Markup:
    """The figures of a run as HTML.

    Args:
        reader: of the run.
        figures: of all its trajectories.
        skipped: corrupt records, which were left out.
    """
    summary = figures.summary
    lengths: dict[str, Counter[tuple[int, str]]] = {
        level: Counter({(steps, outcome): n for steps, outcome, n in figures.lengths[level]})
        for level in LEVELS
        if figures.lengths.get(level)
    }
    operations = dict(
        sorted(summary["operation_milliseconds"].items(), key=lambda item: _operation_order(item[0]))
    )
    timings = {"step": summary["step_milliseconds"], **operations}
    context: dict[str, Any] = {
        "summary": summary,
        "name": reader.path.resolve().name,
        "is_whole": is_whole(reader, summary["attempts"]),
        "started": None if (at := summary["started_at"]) is None else datetime.fromtimestamp(at, UTC),
        "planned": len(reader.tasks),
        "skipped": skipped,
        "rewarded": sum(summary["outcomes"][name] for name in ("success", "failure", "truncated")),
        "levels": list(lengths),
        "histogram": Histogram(lengths),
        "timings": timings,
        "axis": LogAxis(list(timings.values())),
    }
    return Markup(ENVIRONMENT.get_template("overview.html.j2").render(context))  # noqa: S704 - autoescaped


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
        inputs = [len(self.index), self.index.version, self.reader.summary, self.reader.config]
        stamp = hashlib.sha256(repr(inputs).encode()).hexdigest()  # of all that the figures depend on
        cached = self.index.cached(_OVERVIEW, _CachedFigures)
        if cached is None or cached.stamp != stamp:
            cached = _CachedFigures(stamp, self._stored() or self._counted())
            self.index.cache(_OVERVIEW, cached)
        return str(overview_html(self.reader, cached.figures, self.skipped))

    def _stored(self) -> Figures | None:
        """The figures of a finished run, from its summary."""
        outcomes, lengths = self.index.lengths()
        try:
            summary = msgspec.convert(self.reader.summary, Summary)
        except msgspec.ValidationError:
            return None
        return Figures(summary, lengths) if +Counter(summary["outcomes"]) == outcomes else None

    def _counted(self) -> Figures:
        """The figures, from the digests of all trajectories."""
        if self._overview is None or self._version != self.index.version:
            self._overview, self._version = Overview(self.reader), self.index.version
        for digest in self.index.digests(self._overview.count):
            self._overview.add(digest)
        return self._overview.figures()

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
