"""Progress of the benchmark: a bar in a terminal, otherwise a line every ten seconds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from webgym.bench.soak.counts import Counts
from webgym.bench.soak.report import progress_line
from webgym.bench.soak.run import Watch

_LINE_SECONDS = 10.0


@contextmanager
def progress(console: Console, seconds: float) -> Iterator[Watch]:
    """Show the progress until the block ends.

    Args:
        console: where.
        seconds: the planned duration.

    Yields:
        A function to call every second.
    """
    if not console.is_terminal:
        due = _LINE_SECONDS

        def print_line(counts: Counts, now: float) -> None:
            nonlocal due
            if now >= due:
                due += _LINE_SECONDS
                console.print(f"{now:.0f} of {seconds:.0f} s: {progress_line(counts)}", highlight=False)

        yield print_line
        return
    columns = (BarColumn(), TimeRemainingColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=seconds)
        yield lambda counts, now: bar.update(task, completed=now, description=progress_line(counts))
