"""Progress of a build: a progress bar per stage in a terminal, plain lines elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

_LINES: Final = 4
"""Number of plain lines per stage: one after every such fraction of it."""


class StageProgress:
    """Shows the stages of a build, one after the other.

    Args:
        console: where the progress is printed.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bars: Progress | None = None

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show progress bars inside of this context, if the console is a terminal."""
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
        """Show one stage with this total; yields a function that advances it by a number of items."""
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
            self._print()

    def advance(self, count: int) -> None:
        self._done += count
        if self._total and (self._done >= self._next or self._done == self._total):
            self._next = self._done + max(1, -(-self._total // _LINES))
            self._print()

    def _print(self) -> None:
        line = f"{self._name}: {self._done:,} of {self._total:,}"
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)
