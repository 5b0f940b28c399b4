"""A collector's progress in a terminal: a live panel, or plain lines where there is no terminal."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from itertools import groupby
from typing import Final

from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from webgym.core.background import running_in_background
from webgym.core.outcome import Outcome
from webgym.core.task import LEVELS
from webgym.core.text import duration, plain
from webgym.rollout.progress import STATES, Cell, Progress, Queue, State

REFRESH_SECONDS = 0.5
LINE_SECONDS = 10.0
DRAWING_SHARE = 0.04
"""Largest share of the event loop's time for drawing: large grids and slow terminals are drawn less often."""

COLORS = {
    Outcome.SUCCESS: "green",
    Outcome.FAILURE: "red",
    Outcome.TRUNCATED: "yellow",
    Outcome.BLOCKED: "magenta",
    Outcome.ENVIRONMENT_ERROR: "bright_black",
    Outcome.POLICY_ERROR: "dark_orange",
    Outcome.JUDGE_ERROR: "cyan",
    Outcome.CANCELLED: "bright_black",
}


def _success(progress: Progress) -> str:
    """Both rates: over the judged attempts, and over all samples that are done."""
    rates = progress.successes
    judged, done = (
        "–" if rate.value is None else f"{rate.value:.1%}" for rate in (rates.of_judged, rates.of_planned)
    )
    return f"{judged} ({done} of all)"


def line(progress: Progress) -> str:
    """The progress on one line."""
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in progress.outcomes.most_common() if count)
    return (
        f"{progress.done}/{progress.total} done, {progress.steps} steps, "
        f"{progress.steps_per_second:.1f} steps/s, {progress.trajectories_per_minute:.1f} trajectories/min, "
        f"success {_success(progress)}, "
        f"{duration(progress.seconds_left)} left ({outcomes or 'nothing ended yet'})"
        + "".join(f"; {plain(warning)}" for warning in progress.warnings)
    )


class panel:  # noqa: N801 - used like a function, but needs the terminal's size when it is rendered
    """The progress as a panel that fits the terminal: figures, then the attempts, then those that ended last.

    Args:
        progress: the progress to show.
        title: title of the panel.
        reserved: lines of the terminal for other output.
        among: number of panels that share the rest.
    """

    def __init__(
        self, progress: Progress, title: str = "webgym", *, reserved: int = 0, among: int = 1
    ) -> None:
        self._progress = progress
        self._title = title
        self._reserved = reserved
        self._among = among

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        progress, width = self._progress, max(1, options.max_width - _FRAME_COLUMNS)
        height = (options.max_height - self._reserved) // max(1, self._among) - _FRAME_LINES
        lines = _figures(progress, width)
        for warning in progress.warnings:
            lines += Text(plain(warning), style="yellow").wrap(console, width)
        remaining = height - 1 - len(lines)  # of the bar
        cells = grid(progress.cells.values(), width, remaining)
        remaining -= len(cells.plain.splitlines())
        last = [_ended(*ended) for ended in progress.last][: max(0, remaining)]
        parts = [*lines, *([cells] if cells else []), *last][: max(1, height - 1)]
        yield Panel(Group(_bar(progress), *parts), title=self._title, title_align="left")


_FRAME_LINES, _FRAME_COLUMNS, _NAME_COLUMNS, _GAP = 2, 4, 10, 3


def _bar(progress: Progress) -> RenderableType:
    head = Table.grid(padding=(0, 2), expand=True)
    head.add_column(ratio=1)
    head.add_column(justify="right")
    head.add_row(
        ProgressBar(total=max(progress.total, 1), completed=progress.done),
        f"[bold]{progress.done}[/]/{progress.total}",
    )
    return head


def _figures(progress: Progress, width: int) -> list[Text]:
    """Lines for each kind of figure that has values."""
    figures = {
        "success": _success(progress),
        "steps/s": f"{progress.steps_per_second:.1f}",
        "trajectories/min": f"{progress.trajectories_per_minute:.1f}",
        "steps": f"{progress.steps}",
        "elapsed": duration(progress.seconds),
        "left": duration(progress.seconds_left),
    }
    successes = {level: progress.successes_of(level).of_judged for level in LEVELS}
    ended = [outcome for outcome in Outcome if progress.outcomes[outcome]]
    sections: dict[str, Iterable[tuple[str, str, str]]] = {
        "": ((name, "dim", value) for name, value in figures.items()),
        "by level": (
            (level, "dim", f"{rate.value:.1%}") for level, rate in successes.items() if rate.value is not None
        ),
        "now": (
            (f"{letter} {state}", color, str(progress.states[state]))
            for state in STATES
            for letter, color in [style_of(state)]
        ),
        "queues": ((plain(kind), "dim", _queue(queue)) for kind, queue in progress.queues().items()),
        "outcomes": ((outcome.value, COLORS[outcome], str(progress.outcomes[outcome])) for outcome in ended),
        "errors": ((plain(code), "yellow", str(n)) for code, n in progress.errors.most_common() if n),
    }
    return [line for name, values in sections.items() for line in _figure_lines(name, values, width)]


def _queue(queue: Queue) -> str:
    times = "".join(
        f", {name} {f'{value:.1f} s' if value >= 1 else f'{1000 * value:.0f} ms'}"
        for name, value in (("waited", queue.wait), ("took", queue.service))
        if value is not None
    )
    return f"{queue.waiting}+{queue.running}{times}"


def _figure_lines(name: str, values: Iterable[tuple[str, str, str]], width: int) -> list[Text]:
    """Lines of figures ``(label, style, value)``, broken only between figures."""
    lines: list[Text] = []
    for label, style, value in values:
        figure = Text.assemble((label, style), " ", (value, "bold"))
        if not lines or lines[-1].cell_len + _GAP + figure.cell_len > width:
            head = "" if not name else f"{'' if lines else name:<{_NAME_COLUMNS}}"
            lines.append(Text(head, no_wrap=True, overflow="ellipsis"))
        else:
            lines[-1].append(" " * _GAP)
        lines[-1].append_text(figure)
    return lines


def _ended(outcome: Outcome, task_id: str, steps: int) -> Text:
    """A line for an attempt that ended. Without markup, because a task's id may contain brackets."""
    text = Text(f"{outcome:<18}", style=COLORS[outcome], no_wrap=True, overflow="ellipsis")
    return text.append(f"{steps:>3} steps  ", style="dim").append(plain(task_id), style="default")


@asynccontextmanager
async def showing(progress: Progress, console: Console) -> AsyncIterator[None]:
    """Show the progress until the block ends: a live panel in a terminal, else a line at intervals."""
    try:
        if console.is_terminal:
            with Live(panel(progress), console=console, auto_refresh=False, transient=True) as live:
                async with running_in_background(_refresh(live, progress)):
                    yield
        else:
            async with running_in_background(_print_lines(progress, console)):
                yield
    finally:  # also if the run was stopped
        console.print(line(progress), highlight=False, soft_wrap=True, markup=False)


async def _refresh(live: Live, progress: Progress) -> None:
    while True:
        started = time.perf_counter()
        live.update(panel(progress), refresh=True)
        drawn = time.perf_counter() - started
        await asyncio.sleep(max(REFRESH_SECONDS, drawn / DRAWING_SHARE))


async def _print_lines(progress: Progress, console: Console) -> None:
    while True:
        await asyncio.sleep(LINE_SECONDS)
        console.print(line(progress), highlight=False, soft_wrap=True, markup=False)


STYLES: Final[dict[State | None, tuple[str, str]]] = {
    "opening": ("o", "yellow"),
    "acting": ("a", "green"),
    "thinking": ("t", "bright_blue"),
    "judging": ("j", "magenta"),
    None: ("·", "bright_black"),
}
"""Letter and color of a state; ``None`` is between two states."""

_WIDE: Final = 4
"""Width of a cell with a letter and a number, including the gap, characters."""
_HEIGHTS: Final = "▁▂▃▄▅▆▇█"
_STEPS_PER_HEIGHT: Final = 4
"""Steps per level of a cell's height: the longest budget in training, 30 steps, fills a cell."""


def style_of(state: State | None) -> tuple[str, str]:
    """Letter and color of a state."""
    return STYLES.get(state, STYLES[None])


def grid(cells: Iterable[Cell], width: int, height: int) -> Text:
    """The grid of attempts in progress, each at its place.

    Args:
        cells: the attempts.
        width: width of a line, characters.
        height: most lines.

    Returns:
        At most ``height`` lines; empty if there is no attempt or no space.
    """
    by_place = {cell.place: cell for cell in cells}
    places = max(by_place, default=-1) + 1
    if not places or height < 1 or width < 1:
        return Text()
    columns = max(1, (width + 1) // _WIDE)
    is_wide = width >= _WIDE and -(-places // columns) <= height
    columns = columns if is_wide else width
    fitting = columns * height
    if places > fitting:  # the last line is for the number of the others
        fitting -= columns
    lines = [
        _line([by_place.get(place) for place in range(first, min(first + columns, places))], is_wide)
        for first in range(0, min(places, fitting), columns)
    ]
    if others := sum(place >= fitting for place in by_place) if places > fitting else 0:
        lines.append(Text(f"and {others} more"[:width], style="dim"))
    return Text("\n").join(lines)


def _line(cells: list[Cell | None], is_wide: bool) -> Text:
    line = Text(no_wrap=True)
    draw = _wide if is_wide else _narrow
    for style, group in groupby(cells, lambda cell: style_of(cell.state)[1] if cell else ""):
        line.append("".join(map(draw, group)), style=style)
    line.rstrip()
    return line


def _wide(cell: Cell | None) -> str:
    return f"{style_of(cell.state)[0]}{min(cell.steps, 99):02d} " if cell else " " * _WIDE


def _narrow(cell: Cell | None) -> str:
    if cell is None:
        return " "
    return _HEIGHTS[min(cell.steps // _STEPS_PER_HEIGHT, len(_HEIGHTS) - 1)]
