"""What `webgym train` shows while it trains, and how it stops."""

from __future__ import annotations

import asyncio
import io
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from rich.console import Console
from tests.conftest import Calls
from tests.documented import documented
from tests.report.training import World, build_training, tasks
from tests.train.worlds import training_of

from webgym.cli import _training_output
from webgym.cli._training_output import TrainingView
from webgym.core.errors import StoreFull
from webgym.rollout.progress import Progress
from webgym.train.figures import iteration_line
from webgym.train.folder import TrainingFolder
from webgym.train.progress import TrainingProgress


def shown(console: Console) -> str:
    file = console.file
    assert isinstance(file, io.StringIO)
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", file.getvalue())


@pytest.mark.parametrize("is_terminal", [True, False])
def test_one_sees_iteration_stage_success_and_time_left(
    monkeypatch: pytest.MonkeyPatch, is_terminal: bool
) -> None:
    monkeypatch.setattr(_training_output, "LINE_SECONDS", 0.01)
    monkeypatch.setattr(_training_output, "REFRESH_SECONDS", 0.01)
    console = Console(file=io.StringIO(), force_terminal=is_terminal, width=110)
    progress = TrainingProgress(
        iterations=4, finished=1, collected="success 40.0%", evaluated="success 31.0%"
    )
    view = TrainingView(console)

    async def until(text: str) -> None:
        async with asyncio.timeout(100):
            while text not in shown(console):
                await asyncio.sleep(0.01)

    async def watch() -> None:
        progress.begin(1)
        async with view.watching(progress):
            with progress.stage(2, "update"), progress.stage(3, "collect"):
                async with view.show(Progress(total=7, done=3)):
                    await until("3/7")
            progress.finish()
            view.print_line("iteration 2 of 4: [done]")
            await until("2/4 iterations, 0:00 left" if is_terminal else "[done]")
            progress.finished = 4
            await until("finished")

    asyncio.run(watch())
    said = shown(console)
    assert re.search(r"iteration 2 of 4: update for 0:\d\d, iteration 3 of 4: collect for 0:\d\d", said)
    assert "3/7" in said
    assert "iteration 5" not in said
    assert "finished" in said
    assert "iteration 2 of 4: [done]" in said, "brackets in a line are no markup"
    if is_terminal:
        assert "2/4 iterations, 0:00 left" in said
        assert "success 40.0%" in said
        assert "success 31.0%" in said


def test_time_left_follows_from_this_session(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    progress = TrainingProgress(iterations=10)
    progress.begin(4)
    before = progress.seconds_left
    now[0] = 130.0
    progress.finish()
    assert (before, progress.finished, progress.seconds_left) == (None, 5, 150.0)


def test_an_iteration_is_told_on_one_line(tmp_path: Path) -> None:
    import json

    build_training(tmp_path / "first", iterations=2, count=8, distinct=1)
    rows = [json.loads(line) for line in (tmp_path / "first/metrics.jsonl").read_bytes().splitlines()]
    line = iteration_line(rows[1], TrainingProgress(iterations=2))
    assert re.fullmatch(
        r"iteration 2 of 2: success \d+\.\d% \(\d+\.\d% to \d+\.\d%\) of 7 judged attempts, "
        r"easy .*; \d+ steps, loss 0\.7 \(left out: .*2 request too long\); 0:0\d",
        line,
    )
    nothing = rows[0] | {"update": {}}
    assert "; nothing to train on (left out:" in iteration_line(nothing, TrainingProgress(iterations=2))


def test_the_pages_commands_train_and_go_on(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    resumed: list[bool] = []

    @asynccontextmanager
    async def opened(settings: Any, folder: Path, *, resume: bool, **_: Any) -> AsyncIterator[Any]:
        resumed.append(resume)
        if not resume:
            TrainingFolder(folder).create(settings.model_dump(mode="json"))
        yield training_of(folder, World(1), settings, tasks(2))

    monkeypatch.setattr(_training_output, "open_training", opened)
    monkeypatch.chdir(tmp_path)
    settings = {"learn": {"model": "m"}, "loop": {"iterations": 1, "tasks": 2}}
    Path("CONFIG").write_text(yaml.safe_dump(settings))
    started, continued = (
        documented("webgym train CONFIG --out training/first"),
        documented("webgym train --resume training/first"),
    )
    stored = Path("training/first/config.yaml")
    assert calls.run(*started)[0] == 0
    said = calls.printed(*continued)
    assert "the training is complete: all iterations (1); for more, raise loop.iterations in" in said
    assert resumed == [False], "neither model nor browsers start for nothing"
    stored.write_text(stored.read_text().replace("iterations: 1", "iterations: 2"))
    calls.printed(*continued)
    assert resumed == [False, True]
    assert len(Path("training/first/metrics.jsonl").read_text().splitlines()) == 2


@pytest.mark.parametrize(
    ("stop", "code", "said"),
    [
        (KeyboardInterrupt(), 130, ""),
        (StoreFull("no space left", hint="resume with --resume"), 1, "webgym: no space left"),
    ],
)
def test_a_stop_says_how_to_go_on(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch, stop: BaseException, code: int, said: str
) -> None:
    @asynccontextmanager
    async def begun(settings: Any, folder: Path, **_: Any) -> AsyncIterator[Any]:
        folder.mkdir()
        (folder / "config.yaml").write_text("learn: {}")
        if folder.exists():
            raise stop
        yield

    monkeypatch.setattr(_training_output, "open_training", begun)
    settings = tmp_path / "train.yaml"
    settings.write_text(yaml.safe_dump({"learn": {"model": "m"}}))
    folder = tmp_path / "a training"
    found, printed = calls.run("train", settings, "--out", folder)
    assert found == code
    assert said in printed
    (line,) = [each for each in printed.splitlines() if "resume with:" in each]
    assert line == f"finished work is stored; resume with: webgym train --resume '{folder}'"
    assert "Traceback" not in printed


def test_a_warm_start_begins_a_training_and_continues_none(calls: Calls, tmp_path: Path) -> None:
    said = calls.printed("train", "--resume", tmp_path, "--from", tmp_path, code=2)
    assert "give either settings and --out, or --resume" in said
