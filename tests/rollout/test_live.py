"""Progress on a real terminal, and where there is none."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.console import Console

from webgym.core.outcome import Ending, Outcome
from webgym.core.trajectory import Episode, Failure, Trajectory
from webgym.results.rates import Successes
from webgym.rollout.live import line, panel, style_of
from webgym.rollout.progress import STATES, Progress

SCRIPT = """
import asyncio
import sys
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
        await asyncio.sleep(float(sys.argv[1]))

asyncio.run(main())
"""


def test_a_terminal_shows_a_panel_that_is_gone_at_the_end() -> None:
    ours, theirs = pty.openpty()
    environment = os.environ | {"TERM": "xterm-256color", "COLUMNS": "100", "LINES": "30"}
    script = [sys.executable, "-c", SCRIPT, "0.7"]
    process = subprocess.Popen(script, stdout=theirs, stderr=theirs, env=environment)
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
    assert process.wait(100) == 0
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
    done = subprocess.run([sys.executable, "-c", SCRIPT, "2"], capture_output=True, text=True, check=True)
    lines = done.stdout.splitlines()
    assert len(lines) >= 3
    assert all("10/40 done" in each for each in lines)
    assert "\x1b" not in done.stdout


def test_progress_tells_pace_and_success() -> None:
    progress = Progress(total=10, done=4, earlier=2)
    progress.started -= 10
    progress.outcomes.update({Outcome.SUCCESS: 1, Outcome.TRUNCATED: 1, Outcome.BLOCKED: 5})
    assert progress.successes.of_judged.value == 0.5
    progress.done = 9
    assert progress.successes.of_planned.value == pytest.approx(1 / 9)
    assert "success 50.0% (11.1% of all)" in line(progress)
    progress.done = 4
    left = progress.seconds_left
    assert left is not None
    assert 29 < left < 32  # six samples at a pace of two in ten seconds
    for _ in range(20):
        progress.stepped()
    assert 1.8 < progress.steps_per_second < 2.1
    assert Progress(total=3).seconds_left is None
    assert Progress(total=3).successes.of_judged.value is None


def _many(count: int) -> Progress:
    progress = Progress(total=2 * count, done=3)
    for number in range(count):
        attempt = f"task-{number}[/]#0.0"
        progress.move(None, STATES[number % len(STATES)], attempt)
        progress.cells[attempt].steps = number % 40
    return progress


def _shown(progress: Progress, width: int, height: int) -> list[str]:
    said = io.StringIO()
    Console(file=said, width=width, height=height).print(panel(progress))
    return said.getvalue().splitlines()


def test_every_attempt_has_a_cell_with_its_state_and_its_steps() -> None:
    text = "\n".join(_shown(_many(30), 100, 30))
    cells = re.findall(r"\b([oatj])(\d\d)\b", text)
    letters = [style_of(state)[0] for state in STATES]
    assert cells == [(letters[number % len(STATES)], f"{number:02d}") for number in range(30)]
    assert "o opening 8" in text


@pytest.mark.parametrize(("width", "height"), [(200, 60), (120, 40), (80, 24), (40, 12), (12, 6)])
def test_a_thousand_attempts_fit_any_terminal(width: int, height: int) -> None:
    lines = _shown(_many(1000), width, height)
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    assert lines[-1].startswith("╰")
    if left_out := re.search(r"and (\d+) more", "\n".join(lines)):
        assert int(left_out[1]) + sum(line.count(h) for line in lines for h in "▁▂▃▄▅▆▇█") == 1000


def test_a_cell_keeps_its_place_and_the_lowest_free_one_is_taken() -> None:
    progress = _many(3)
    gone, stays = "task-0[/]#0.0", "task-2[/]#0.0"
    progress.move("opening", None, gone)
    assert progress.cells[gone].state is None  # it waits for its judge
    progress.ended(trajectory(gone))
    assert gone not in progress.cells
    assert progress.cells[stays].place == 2
    progress.move(None, "opening", "new#0.0")
    assert progress.cells["new#0.0"].place == 0
    progress.move(None, "opening", "newer#0.0")
    assert progress.cells["newer#0.0"].place == 3


def test_success_by_difficulty_and_what_went_wrong() -> None:
    progress = Progress(total=9, levels={"a": "easy", "b": "hard"})
    progress.ended(trajectory("a#0.0", Outcome.SUCCESS))
    progress.ended(trajectory("a#1.0", Outcome.FAILURE))
    progress.ended(trajectory("b#0.0", Outcome.ENVIRONMENT_ERROR, "browser_crashed"))
    unjudged = trajectory("b#1.0", Outcome.JUDGE_ERROR, "judge_error")
    progress.ended(unjudged)
    assert progress.successes_of("easy").of_judged.value == 0.5
    progress.ended(trajectory("a#2.0", Outcome.ENVIRONMENT_ERROR))
    progress.ended(trajectory("a#2.1", Outcome.ENVIRONMENT_ERROR))
    progress.done = progress.done_by_level["easy"] = 3  # the third sample was attempted twice
    assert progress.successes_of("easy") == Successes(1, 2, 3)
    assert progress.successes_of("hard").of_judged.value is None
    assert progress.errors == {"browser_crashed": 1, "judge_error": 1}
    progress.judged_again(unjudged, trajectory("b#1.0", Outcome.SUCCESS))
    assert progress.successes_of("hard").of_judged.value == 1
    assert +progress.errors == {"browser_crashed": 1}
    text = "\n".join(_shown(progress, 100, 30))
    assert "easy 50.0%" in text
    assert "hard 100.0%" in text
    assert "browser_crashed 1" in text


def test_errors_in_a_row_are_shown_with_their_reason() -> None:
    progress = Progress(total=9)
    for name in "ab":
        progress.ended(trajectory(name, Outcome.ENVIRONMENT_ERROR, "navigation_failed"))
    progress.ended(trajectory("c", Outcome.CANCELLED, "straggler"))
    assert not progress.warnings
    progress.ended(trajectory("d", Outcome.JUDGE_ERROR, "judge_error", "the endpoint is away"))
    assert progress.warnings == ["the last 3 attempts ended in errors: the endpoint is away"]
    progress.ended(trajectory("e"))
    assert not progress.warnings


def trajectory(
    attempt_id: str, outcome: Outcome = Outcome.SUCCESS, code: str = "", message: str = ""
) -> Trajectory:
    failure = Failure(code, message) if code else None
    episode = Episode(attempt_id, attempt_id[0], 0, 0, 0, "p", 0.0, 1.0, (), Ending.ANSWERED, failure=failure)
    return Trajectory(episode, outcome)
