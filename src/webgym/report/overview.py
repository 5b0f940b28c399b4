"""The figures and charts of a run, as HTML."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from markupsafe import Markup

from webgym.core.task import LEVELS, Task
from webgym.core.trajectory import Trajectory
from webgym.report.charts import Histogram, LogAxis
from webgym.report.template import ENVIRONMENT
from webgym.rollout.store import RunReader
from webgym.rollout.summary import Summary, Tally

_ORDER = ("navigate", "execute", "settle", "screenshot", "metadata", "policy", "judge")
"""Operations in the order of a turn; others follow by name."""


def _place(operation: str) -> tuple[int, str]:
    return (_ORDER.index(operation) if operation in _ORDER else len(_ORDER), operation)


class Overview:
    """Counts trajectories as they come and shows what was counted.

    Args:
        reader: of the run.
    """

    def __init__(self, reader: RunReader) -> None:
        self._reader = reader
        self._tasks: Mapping[str, Task] = reader.tasks
        self._tally = Tally(reader.drawn, int(reader.config.get("samples") or 1))
        self._lengths: defaultdict[str, Counter[tuple[int, str]]] = defaultdict(Counter)

    def add(self, trajectory: Trajectory) -> None:
        """Count one trajectory."""
        self._tally.add(trajectory)
        if task := self._tasks.get(trajectory.episode.task_id):
            length = (len(trajectory.episode.steps), trajectory.outcome.value)
            self._lengths[task.level][length] += 1

    def summary(self) -> Summary:
        """The figures so far. Names, seed and wall time are the collector's own where it has told them."""
        told = self._reader.summary or {}
        config = self._reader.config
        return self._tally.summary(
            seed=told.get("seed", config.get("seed")),
            policy=told.get("policy") or None,
            judge=told.get("judge") or None,
            wall_seconds=told.get("wall_seconds") if self.is_whole else None,
        )

    @property
    def is_whole(self) -> bool:
        """Whether the collector has summed up all that is there, so that nothing more is to come."""
        return (self._reader.summary or {}).get("attempts") == len(self._reader.attempts)

    def html(self) -> Markup:
        """The whole section."""
        summary = self.summary()
        levels = [level for level in LEVELS if self._lengths[level]]
        operations = dict(sorted(summary["operation_milliseconds"].items(), key=lambda item: _place(item[0])))
        timings = {"step": summary["step_milliseconds"], **operations}
        shown: dict[str, Any] = {
            "summary": summary,
            "name": self._reader.path.resolve().name,
            "is_whole": self.is_whole,
            "started": _moment(summary["started_at"]),
            "planned": len(self._tasks),
            "skipped": self._reader.skipped,
            "rewarded": sum(summary["outcomes"][name] for name in ("success", "failure", "truncated")),
            "levels": levels,
            "histogram": Histogram({level: self._lengths[level] for level in levels}),
            "timings": timings,
            "axis": LogAxis(list(timings.values())),
        }
        return Markup(ENVIRONMENT.get_template("overview.html.j2").render(shown))  # noqa: S704 - autoescaped


def _moment(unix: float | None) -> datetime | None:
    return None if unix is None else datetime.fromtimestamp(unix, UTC)
