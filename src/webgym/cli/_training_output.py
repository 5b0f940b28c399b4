"""Terminal output of ``webgym train``: stage, progress of its runs, time left."""

from __future__ import annotations

import asyncio
import shlex
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table

from webgym.cli import _run
from webgym.core.background import running_in_background
from webgym.core.text import duration
from webgym.report.training import write_training_report
from webgym.rollout.live import LINE_SECONDS, REFRESH_SECONDS, line, panel
from webgym.rollout.progress import Progress
from webgym.run.config import Secrets
from webgym.store.files import CONFIG
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.progress import TrainingProgress
from webgym.train.rehearsal import rehearse
from webgym.train.start import is_complete, open_training
from webgym.train.stopping import Stop

_FRAME_LINES = 6
"""Lines of the terminal that the panel of the training takes."""


class TrainingView:
    """Shows a training's progress: a live panel in a terminal, else a line every few seconds."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._training: TrainingProgress | None = None
        self._runs: list[Progress] = []

    def print_line(self, text: str) -> None:
        """Print a line that remains in the terminal."""
        self._console.print(escape(text), highlight=False, soft_wrap=True)

    @asynccontextmanager
    async def show(self, run: Progress) -> AsyncIterator[None]:
        """Show a run's progress until the block ends; see :data:`webgym.run.collect.Show`."""
        self._runs.append(run)
        try:
            yield
        finally:
            self._runs.remove(run)

    @asynccontextmanager
    async def watching(self, training: TrainingProgress) -> AsyncIterator[None]:
        """Show the training until the block ends."""
        self._training = training
        if not self._console.is_terminal:
            async with running_in_background(self._print_lines()):
                yield
            return
        with Live(self._panel(), console=self._console, auto_refresh=False, transient=True) as live:
            async with running_in_background(self._refresh(live)):
                yield

    async def _refresh(self, live: Live) -> None:
        while True:
            live.update(self._panel(), refresh=True)
            await asyncio.sleep(REFRESH_SECONDS)

    async def _print_lines(self) -> None:
        while True:
            await asyncio.sleep(LINE_SECONDS)
            for text in [f"{self._stage()}: {line(run)}" for run in self._runs] or [self._stage()]:
                self._console.print(text, highlight=False, soft_wrap=True, markup=False)

    def _stage(self) -> str:
        """The iteration, its stage and for how long: ``iteration 2 of 4: update for 0:42``."""
        training = self._training
        if training is None:
            return "starting"
        if training.finished == training.iterations:
            return "finished"
        if not training.doing:
            return f"before iteration {training.finished + 1} of {training.iterations}"
        now = time.monotonic()
        return ", ".join(
            f"{f'iteration {number}' if number else 'before iteration 1'} of {training.iterations}: {stage} "
            f"for {duration(now - training.since[number])}"
            for number, stage in sorted(training.doing.items())
        )

    def _panel(self) -> RenderableType:
        training = self._training
        assert training is not None
        head = Table.grid(padding=(0, 2), expand=True)
        head.add_column(ratio=1)
        head.add_column(justify="right")
        done = f"[bold]{training.finished}[/]/{training.iterations} iterations"
        head.add_row(
            ProgressBar(total=training.iterations, completed=training.finished),
            f"{done}, {duration(training.seconds_left)} left",
        )
        details = Table.grid(padding=(0, 2))
        details.add_row("[dim]now[/]", escape(self._stage()))
        for name, text in (("collected", training.collected), ("evaluated", training.evaluated)):
            if text:
                details.add_row(f"[dim]{name}[/]", escape(text))
        frame = Panel(Group(head, details), title="webgym train", title_align="left")
        return Group(
            frame,
            *(panel(run, "attempts", reserved=_FRAME_LINES, among=len(self._runs)) for run in self._runs),
        )


def run_training(
    settings: TrainConfig,
    folder: Path,
    *,
    resume: bool,
    secrets: Secrets,
    console: Console,
    stop: Stop | None = None,
) -> None:
    """Train with progress in the terminal, and write the report.

    Args:
        settings: of the training.
        folder: of the training; new, or with ``resume`` an unfinished one.
        resume: whether to continue the training in the folder.
        secrets: tokens of servers.
        console: where progress is shown.
        stop: ends the training in time.

    Raises:
        KeyboardInterrupt: the training was cancelled; how to resume it is printed.
    """
    view = TrainingView(console)
    if resume and is_complete(settings, folder, view.print_line):
        more = f"for more, raise loop.iterations in {folder / CONFIG}"
        view.print_line(f"the training is complete: all iterations ({settings.loop.iterations}); {more}")
        view.print_line(f"report   {write_training_report(folder)}")
        return
    view.print_line(f"training {folder}: loading the model, starting browsers")

    async def train() -> None:
        async with (
            open_training(
                settings,
                folder,
                resume=resume,
                secrets=secrets,
                show=view.show,
                tell=view.print_line,
                stop=stop,
            ) as training,
            view.watching(training.progress),
        ):
            await training.run()

    _run.run(train, resumed_by=("webgym train", folder))
    report = write_training_report(folder)
    view.print_line(f"report   {report}")
    if TrainingFolder(folder).stopped:
        again = f"webgym train --resume {shlex.quote(str(folder))}"
        view.print_line(f"stopped in time, nothing is lost; continue with: {again}")


def run_check(
    settings: TrainConfig, folder: Path, *, resume: bool, secrets: Secrets, console: Console
) -> None:
    """Try everything that a training needs, and print what was found; see :func:`run_training`."""
    view = TrainingView(console)
    view.print_line("loading the model, starting browsers")
    _run.run(lambda: rehearse(settings, folder, resume=resume, secrets=secrets, tell=view.print_line))
    view.print_line("the check passed: without --check, the training starts")
