"""Progress on a real terminal, and where there is none."""

from __future__ import annotations

import io
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from webgym.core.outcome import Outcome
from webgym.rollout.live import duration, line, panel
from webgym.rollout.progress import Progress

SCRIPT = """
import asyncio
from rich.console import Console
from webgym.core.outcome import Outcome
from webgym.rollout import live
from webgym.rollout.progress import Progress

live.LINE_SECONDS = 0.2

async def main():
    progress = Progress(total=40)
    async with live.showing(progress, Console()):
        progress.move(None, "thinking")
        for _ in range(30):
            progress.stepped()
        progress.outcomes[Outcome.SUCCESS] += 3
        progress.outcomes[Outcome.FAILURE] += 1
        progress.last.appendleft((Outcome.SUCCESS, "offline/fernhill-books/price-1", 7))
        progress.done = 10
        await asyncio.sleep(0.7)

asyncio.run(main())
"""


def test_a_terminal_shows_a_panel_that_is_gone_at_the_end() -> None:
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
    process = subprocess.Popen([sys.executable, "-c", SCRIPT], stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    shown = b""
    while True:
        try:
            part = os.read(ours, 65536)
        except OSError:  # the other side is closed
            break
        if not part:
            break
        shown += part
    os.close(ours)
    assert process.wait(10) == 0
    text = shown.decode()
    assert "10" in text
    assert "/40" in text
    assert "thinking" in text
    assert "fernhill-books" in text
    assert "\x1b[?25l" in text  # the cursor was hidden
    assert "\x1b[?25h" in text  # and came back
    assert "10/40 done, 30 steps" in text.splitlines()[-1]


def test_a_task_id_is_text_and_neither_markup_nor_commands() -> None:
    progress = Progress(total=2, note="the scripted policy is an oracle")
    progress.last.appendleft((Outcome.SUCCESS, "a[/b] \x1b]0;title\x07 [red]c", 7))
    progress.stepped(is_valid=False)
    said = io.StringIO()
    Console(file=said, width=120).print(panel(progress))
    assert "a[/b]" in said.getvalue()
    assert "[red]c" in said.getvalue()
    assert "\x1b" not in said.getvalue()
    assert "oracle" in said.getvalue()
    assert "100.0% of replies invalid" in said.getvalue()
    assert line(progress).endswith("; the scripted policy is an oracle")


def test_a_pipe_gets_plain_lines(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) >= 3
    assert all("10/40 done" in each for each in lines)
    assert "\x1b" not in done.stdout


@pytest.mark.parametrize(
    ("seconds", "expected"), [(None, "–"), (0, "0:00"), (75, "1:15"), (3599.9, "59:59"), (3600, "1:00:00")]
)
def test_durations(seconds: float | None, expected: str) -> None:
    assert duration(seconds) == expected


def test_progress_tells_pace_and_success() -> None:
    progress = Progress(total=10, done=4, earlier=2)
    progress.started -= 10
    progress.outcomes.update({Outcome.SUCCESS: 1, Outcome.TRUNCATED: 1, Outcome.BLOCKED: 5})
    assert progress.successes.of_judged.value == 0.5
    progress.done = 9
    assert progress.successes.of_planned.value == pytest.approx(1 / 7)
    assert "success 50.0% (14.3% of all)" in line(progress)
    progress.done = 4
    left = progress.seconds_left
    assert left is not None
    assert 29 < left < 32  # six samples at a pace of two in ten seconds
    for _ in range(20):
        progress.stepped()
    assert 1.8 < progress.steps_per_second < 2.1
    assert Progress(total=3).seconds_left is None
    assert Progress(total=3).successes.of_judged.value is None
