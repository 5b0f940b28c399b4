"""Counts of tasks at each stage of a build: every task is passed on, or removed for a recorded reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

import msgspec

from webgym.core.errors import WebGymError

IN: Final = "in"
OUT: Final = "out"


class CountMismatch(WebGymError):
    """A stage lost or added tasks without a record: a bug of WebGym, never a problem of the input."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """Counts of one source in one stage. ``came + made == left + sum(lost.values())``.

    Attributes:
        stage: name of the stage.
        source: name of the source.
        came: number of tasks, or records, that entered the stage.
        made: number of tasks that the stage created.
        lost: number of tasks that were removed, by reason.
        left: number of tasks that were passed on.
    """

    stage: str
    source: str
    came: int
    made: int
    lost: dict[str, int]
    left: int


class TaskAccounting:
    """The counts of a build, stage by stage; each stage is checked when it is recorded.

    Args:
        sources: names of the sources, in the order of the rows.
    """

    def __init__(self, sources: Iterable[str]) -> None:
        self._sources = tuple(sources)
        self._left: Counter[str] | None = None
        self.rows: list[Row] = []

    def record(
        self,
        stage: str,
        *,
        came: Counter[str],
        left: Counter[str],
        lost: Counter[tuple[str, str]] | None = None,
        made: Counter[str] | None = None,
    ) -> None:
        """Record the counts of a stage.

        Args:
            stage: its name.
            came: number of tasks that entered it, by source.
            left: number of tasks that it passed on, by source.
            lost: number of tasks that it removed, by (source, reason).
            made: number of tasks that it created, by source.

        Raises:
            CountMismatch: the numbers do not add up, or do not continue the stage before.
        """
        lost = lost or Counter()
        made = made or Counter()
        if self._left is not None and +came != +self._left:
            raise CountMismatch(
                f"{stage}: {dict(came)} tasks entered, but {dict(self._left)} left the stage before"
            )
        unknown = {*came, *left, *made, *(source for source, _ in lost)} - set(self._sources)
        if unknown:
            raise CountMismatch(f"{stage}: tasks of unknown sources: {', '.join(sorted(unknown))}")
        for source in self._sources:
            reasons = {
                reason: count for (name, reason), count in sorted(lost.items()) if name == source and count
            }
            if came[source] + made[source] != left[source] + sum(reasons.values()):
                raise CountMismatch(
                    f"{stage}: of {source}, {came[source]} entered and {made[source]} were created, "
                    f"but {left[source]} left and {sum(reasons.values())} were removed"
                )
            self.rows.append(
                Row(
                    stage=stage,
                    source=source,
                    came=came[source],
                    made=made[source],
                    lost=reasons,
                    left=left[source],
                )
            )
        self._left = left
