"""The progress of a training, which the loop updates and displays read."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class TrainingProgress:
    """The progress of a training.

    Attributes:
        iterations: number of planned iterations.
        finished: number of finished iterations, including earlier sessions.
        doing: current stages ("collect", "update", ...) by iteration; several if iterations overlap.
        since: when these began, on the monotonic clock, seconds.
        collected: a line about the success of the newest collected iteration.
        evaluated: a line about the success of the newest evaluation.
    """

    iterations: int
    finished: int = 0
    doing: dict[int, str] = field(default_factory=dict)
    since: dict[int, float] = field(default_factory=dict)
    collected: str = ""
    evaluated: str = ""
    _started: float = field(default_factory=time.monotonic)
    _finished_in_session: int = 0

    def begin(self, finished: int) -> None:
        """Start counting this session's iterations."""
        self.finished = finished
        self._started, self._finished_in_session = time.monotonic(), 0

    @contextmanager
    def stage(self, number: int, name: str) -> Iterator[None]:
        """Show an iteration as in a stage for the duration of the block."""
        self.doing[number], self.since[number] = name, time.monotonic()
        try:
            yield
        finally:
            self.doing.pop(number, None)

    def finish(self) -> None:
        """Count a finished iteration."""
        self.finished += 1
        self._finished_in_session += 1

    @property
    def seconds_left(self) -> float | None:
        """Estimated remaining seconds at this session's rate; ``None`` before an iteration is finished."""
        if not self._finished_in_session:
            return None
        elapsed = time.monotonic() - self._started
        return (self.iterations - self.finished) * elapsed / self._finished_in_session
