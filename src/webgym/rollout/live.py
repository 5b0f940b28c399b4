"""A collector's progress in a terminal: a live panel, or plain lines where there is no terminal."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from webgym.core.outcome import Outcome
from webgym.core.text import plain
from webgym.rollout.progress import STATES, Progress

REFRESH_SECONDS = 0.25
LINE_SECONDS = 10.0

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


def duration(seconds: float | None) -> str:
    """``75`` as ``1:15``; a dash for ``None``."""
    if seconds is None:
        return "–"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def _success(progress: Progress) -> str:
    """Both rates: over the judged attempts, and over all samples that are done."""
    rates = progress.successes
    judged, done = (
        "–" if rate.value is None else f"{rate.value:.1%}" for rate in (rates.of_judged, rates.of_planned)
    )
    return f"{judged} ({done} of all)"


def line(progress: Progress) -> str:
    """The progress on one line."""
    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in progress.outcomes.most_common())
    return (
        f"{progress.done}/{progress.total} done, {progress.steps} steps, "
        f"{progress.steps_per_second:.1f} steps/s, success {_success(progress)}, {_invalid(progress)}"
        f"{duration(progress.seconds_left)} left ({outcomes or 'nothing ended yet'})"
        + "".join(f"; {plain(told)}" for told in (progress.note, progress.trouble()) if told)
    )


def _invalid(progress: Progress) -> str:
    """The share of replies without an action, where there are any."""
    return f"{progress.invalid / progress.steps:.1%} of replies invalid, " if progress.invalid else ""


def panel(progress: Progress, title: str = "webgym") -> RenderableType:
    """The progress as a panel."""
    head = Table.grid(padding=(0, 2), expand=True)
    head.add_column(ratio=1)
    head.add_column(justify="right")
    head.add_row(
        ProgressBar(total=max(progress.total, 1), completed=progress.done),
        f"[bold]{progress.done}[/]/{progress.total}",
    )
    figures = Table.grid(padding=(0, 3))
    figures.add_row(
        f"[dim]success[/] [bold]{_success(progress)}[/]",
        f"[dim]steps/s[/] [bold]{progress.steps_per_second:.1f}[/]",
        f"[dim]steps[/] {progress.steps}",
        f"[dim]elapsed[/] {duration(progress.seconds)}",
        f"[dim]left[/] {duration(progress.seconds_left)}",
    )
    states = Text("now       ")
    for state in STATES:
        states.append(f"{state} ", style="dim")
        states.append(f"{progress.states[state]}   ", style="bold" if progress.states[state] else "dim")
    outcomes = Text("outcomes  ")
    for outcome in Outcome:
        if count := progress.outcomes[outcome]:
            outcomes.append(f"{outcome} ", style=COLORS[outcome])
            outcomes.append(f"{count}   ", style="bold")
    last = Table.grid(padding=(0, 2))
    for outcome, task_id, steps in progress.last:
        # As text: a task may come from anywhere, and square brackets in its id are no markup.
        last.add_row(
            Text(outcome, style=COLORS[outcome]), Text(f"{steps} steps", style="dim"), Text(plain(task_id))
        )
    told = (progress.note, _invalid(progress).rstrip(", "), progress.trouble())
    warnings = [Text(plain(each), style="yellow") for each in told if each]
    return Panel(Group(head, figures, states, outcomes, *warnings, last), title=title, title_align="left")


@asynccontextmanager
async def showing(progress: Progress, console: Console) -> AsyncIterator[None]:
    """Show the progress until the block ends: live in a terminal, else a line now and then."""
    if console.is_terminal:
        with Live(panel(progress), console=console, auto_refresh=False, transient=True) as live:
            task = asyncio.create_task(_refresh(live, progress))
            try:
                yield
            finally:
                await _stop(task)
    else:
        task = asyncio.create_task(_print_lines(progress, console))
        try:
            yield
        finally:
            await _stop(task)
    console.print(line(progress), highlight=False, soft_wrap=True, markup=False)


async def _refresh(live: Live, progress: Progress) -> None:
    while True:
        live.update(panel(progress), refresh=True)
        await asyncio.sleep(REFRESH_SECONDS)


async def _print_lines(progress: Progress, console: Console) -> None:
    while True:
        await asyncio.sleep(LINE_SECONDS)
        console.print(line(progress), highlight=False, soft_wrap=True, markup=False)


async def _stop(task: asyncio.Task[None]) -> None:
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
