"""The figures and charts of a run, as HTML."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import msgspec
from markupsafe import Markup

from webgym.core.task import LEVELS, Task
from webgym.report.charts import Histogram, LogAxis
from webgym.report.template import ENVIRONMENT
from webgym.results.summary import Digest, Summary, Tally
from webgym.store.records import CorruptLine
from webgym.store.runs import RunReader

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
        "started": _moment(summary["started_at"]),
        "planned": len(reader.tasks),
        "skipped": skipped,
        "rewarded": sum(summary["outcomes"][name] for name in ("success", "failure", "truncated")),
        "levels": list(lengths),
        "histogram": Histogram(lengths),
        "timings": timings,
        "axis": LogAxis(list(timings.values())),
    }
    return Markup(ENVIRONMENT.get_template("overview.html.j2").render(context))  # noqa: S704 - autoescaped


def _moment(unix: float | None) -> datetime | None:
    return None if unix is None else datetime.fromtimestamp(unix, UTC)
