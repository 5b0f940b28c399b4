"""Terminal output of a training: stage, progress of its runs, time left."""

from __future__ import annotations

import asyncio
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
from webgym.report import write_training_report
from webgym.rollout.live import LINE_SECONDS, REFRESH_SECONDS, duration, line, panel
from webgym.rollout.progress import Progress
from webgym.run_config import Secrets
from webgym.train.loop import TrainConfig
from webgym.train.progress import TrainingProgress
from webgym.train.start import open_training

_FRAME_LINES = 6
"""Of a terminal, for the training itself."""


class TrainingView:
    """Shows a training: live in a terminal, else a line now and then.

    Args:
        console: where.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._training: TrainingProgress | None = None
        self._runs: list[Progress] = []

    def tell(self, said: str) -> None:
        """A line that stays."""
        self._console.print(escape(said), highlight=False, soft_wrap=True)

    @asynccontextmanager
    async def show(self, run: Progress) -> AsyncIterator[None]:
        """A run, for as long as it goes on; see :data:`webgym.runs.Show`."""
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
        with Live(self._drawn(), console=self._console, auto_refresh=False, transient=True) as live:
            async with running_in_background(self._refresh(live)):
                yield

    async def _refresh(self, live: Live) -> None:
        while True:
            live.update(self._drawn(), refresh=True)
            await asyncio.sleep(REFRESH_SECONDS)

    async def _print_lines(self) -> None:
        while True:
            await asyncio.sleep(LINE_SECONDS)
            for said in [f"{self._where()}: {line(run)}" for run in self._runs] or [self._where()]:
                self._console.print(said, highlight=False, soft_wrap=True, markup=False)

    def _where(self) -> str:
        """The iteration and its stage, in words."""
        training = self._training
        if training is None:
            return "starting"
        if training.finished == training.iterations:
            return "finished"
        if not training.doing:
            return f"before iteration {training.finished + 1} of {training.iterations}"
        return ", ".join(
            f"{f'iteration {number}' if number else 'before iteration 1'} of {training.iterations}: {stage}"
            for number, stage in sorted(training.doing.items())
        )

    def _drawn(self) -> RenderableType:
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
        told = Table.grid(padding=(0, 2))
        told.add_row("[dim]now[/]", escape(self._where()))
        for name, said in (("collected", training.collected), ("evaluated", training.evaluated)):
            if said:
                told.add_row(f"[dim]{name}[/]", escape(said))
        frame = Panel(Group(head, told), title="webgym train", title_align="left")
        return Group(
            frame,
            *(panel(run, "attempts", reserved=_FRAME_LINES, among=len(self._runs)) for run in self._runs),
        )


def carry_out(
    settings: TrainConfig, folder: Path, *, resume: bool, secrets: Secrets, console: Console
) -> None:
    """Train, shown in the terminal, and write the report; what it was interrupted at can be resumed."""
    view = TrainingView(console)
    view.tell(f"training {folder}: loading the model, starting browsers")

    async def train() -> None:
        async with (
            open_training(
                settings, folder, resume=resume, secrets=secrets, show=view.show, tell=view.tell
            ) as training,
            view.watching(training.progress),
        ):
            await training.run()

    _run.run(train, resumed_by=("webgym train", folder))
    report = write_training_report(folder)
    view.tell(f"report   {report}")
