"""How far a build is: a bar per stage on a terminal, plain lines elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

_LINES: Final = 4
"""Plain lines on the way through a stage: one for every such part of it."""


class StageProgress:
    """Shows the stages of a build, one after the other.

    Args:
        console: where to.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bars: Progress | None = None

    @contextmanager
    def shown(self) -> Iterator[None]:
        """While stages run."""
        if not self._console.is_terminal:
            yield
            return
        bars = Progress(
            TextColumn("{task.description:<21}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(elapsed_when_finished=True),
            console=self._console,
        )
        with bars:
            self._bars = bars
            try:
                yield
            finally:
                self._bars = None

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Callable[[int], None]]:
        """A stage of so many things; what is given counts that many more of them as done."""
        if self._bars is None:
            yield _PlainStage(self._console, name, total).advance
            return
        bars, bar = self._bars, self._bars.add_task(name, total=total)
        yield lambda count: bars.advance(bar, count)


class _PlainStage:
    def __init__(self, console: Console, name: str, total: int) -> None:
        self._console, self._name, self._total = console, name, total
        self._done = 0
        self._next = max(1, -(-total // _LINES))
        if total == 0:
            self._tell()

    def advance(self, count: int) -> None:
        self._done += count
        if self._total and (self._done >= self._next or self._done == self._total):
            self._next = self._done + max(1, -(-self._total // _LINES))
            self._tell()

    def _tell(self) -> None:
        line = f"{self._name}: {self._done:,} of {self._total:,}"
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)
