"""The progress of a training: written by the loop, read by its displays."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class TrainingProgress:
    """How far a training is.

    Attributes:
        iterations: wanted.
        finished: behind it, those of earlier sessions included.
        doing: what is under way, by iteration: "collect", "update", ...; two at once where they overlap.
        collected: success of the newest iteration that was collected, for people.
        evaluated: success of the newest evaluation, for people.
    """

    iterations: int
    finished: int = 0
    doing: dict[int, str] = field(default_factory=dict)
    collected: str = ""
    evaluated: str = ""
    _started: float = field(default_factory=time.monotonic)
    _finished_here: int = 0

    def begin(self, finished: int) -> None:
        """The iterations of this session begin."""
        self.finished = finished
        self._started, self._finished_here = time.monotonic(), 0

    @contextmanager
    def stage(self, number: int, name: str) -> Iterator[None]:
        """While an iteration is in a stage."""
        self.doing[number] = name
        try:
            yield
        finally:
            self.doing.pop(number, None)

    def finish(self) -> None:
        """An iteration is finished."""
        self.finished += 1
        self._finished_here += 1

    @property
    def seconds_left(self) -> float | None:
        """How long the rest takes at this session's pace; ``None`` before an iteration is finished."""
        if not self._finished_here:
            return None
        here = time.monotonic() - self._started
        return (self.iterations - self.finished) * here / self._finished_here
