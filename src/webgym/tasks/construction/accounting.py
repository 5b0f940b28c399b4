"""Counts of tasks through a build: every task that enters a stage leaves it, or is removed for a reason."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Final

import msgspec

from webgym.core.errors import WebGymError

IN: Final = "in"
OUT: Final = "out"


class CountMismatch(WebGymError):
    """A stage lost or invented tasks: a fault of ours, never of the input."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One source in one stage. ``came + made == left + sum(lost.values())``.

    Attributes:
        stage, source: which.
        came: tasks, or records, that came into the stage.
        made: tasks that the stage made.
        lost: those that did not go on, by reason.
        left: those that went on.
    """

    stage: str
    source: str
    came: int
    made: int
    lost: dict[str, int]
    left: int


class TaskAccounting:
    """The rows of a build, stage by stage; each is checked when it is entered.

    Args:
        sources: names, in the order in which they are told.
    """

    def __init__(self, sources: Iterable[str]) -> None:
        self._sources = tuple(sources)
        self._left: Counter[str] | None = None
        self.rows: list[Row] = []

    def enter(
        self,
        stage: str,
        *,
        came: Counter[str],
        left: Counter[str],
        lost: Counter[tuple[str, str]] | None = None,
        made: Counter[str] | None = None,
    ) -> None:
        """Enter a stage.

        Args:
            stage: its name.
            came, left, made: numbers by source.
            lost: numbers by (source, reason).

        Raises:
            CountMismatch: not all that left the stage before came, or came and was made is lost or left.
        """
        lost = lost or Counter()
        made = made or Counter()
        if self._left is not None and +came != +self._left:
            raise CountMismatch(f"{stage}: {dict(came)} tasks came, but {dict(self._left)} had left before")
        unknown = {*came, *left, *made, *(source for source, _ in lost)} - set(self._sources)
        if unknown:
            raise CountMismatch(f"{stage}: tasks of unknown sources: {', '.join(sorted(unknown))}")
        for source in self._sources:
            reasons = {why: count for (name, why), count in sorted(lost.items()) if name == source and count}
            if came[source] + made[source] != left[source] + sum(reasons.values()):
                raise CountMismatch(
                    f"{stage}: of {source}, {came[source]} came and {made[source]} were made, "
                    f"but {left[source]} left and {sum(reasons.values())} were lost"
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
