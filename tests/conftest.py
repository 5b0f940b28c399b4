"""What tests of several rooms share."""

from __future__ import annotations

import asyncio
import gc
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from itertools import pairwise
from pathlib import Path

import psutil
import pytest
from hypothesis import settings

from webgym.browser.find import find_browser
from webgym.cli import main
from webgym.core.errors import BrowserNotFound


def pytest_configure(config: pytest.Config) -> None:
    """Before anything is collected, which is when hypothesis's decorators read their settings.

    A busy machine is no reason to fail; and ``make test`` tries fewer examples than ``make test-all``.
    """
    examples = 40 if config.getoption("markexpr") == "not slow" else 100
    settings.register_profile("webgym", deadline=None, max_examples=examples)
    settings.load_profile("webgym")


# What tests write is nobody else's: test_consent.py takes this away.
os.environ.setdefault("WEBGYM_TRUST_SETTINGS", "1")
# Nothing here comes from the hub: one that does not answer is asked for most of a minute.
os.environ.setdefault("HF_HUB_OFFLINE", "1")
# Threads that wait for a busy processor make tiny work a hundred times slower, also in what we start.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Neither we nor the commands that we start compile everything again, whatever the surroundings say.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is imported lives to the end: it is not looked through for garbage, now or later.

    What tests leave behind is looked through seldom: there is memory enough, and little of it is garbage.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 20, 20)
        gc.enable()


MODELS = {"inference", "study", "train"} | {
    f"test_{name}.py"
    for name in ("docs_run", "docs_shell", "repository", "settings", "slime", "token_rollout")
}
"""Folders and files whose tests import transformers' models, which takes a worker 3 s."""


@pytest.hookimpl(trylast=True)  # when those that do not run are out
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Tests with models come first, so that one worker has them all: others take over what a worker has last.

    Every worker's share begins with files in which a test has more than the usual time: left to the end, it
    would keep one worker busy and let all others wait.

    Tests that drive a browser are skipped, and say why, where there is none.
    """
    items.sort(key=lambda item: MODELS.isdisjoint((item.path.name, item.path.parent.name)))
    workers = getattr(config, "workerinput", {}).get("workercount", 1)
    bounds = [len(items) * number // workers for number in range(workers + 1)]
    long = {item.path for item in items if takes_long(item)}
    shares = (items[one:other] for one, other in pairwise(bounds))
    items[:] = [item for share in shares for item in sorted(share, key=lambda item: item.path not in long)]
    if not any(item.get_closest_marker("browser") for item in items):
        return
    try:
        find_browser()
    except BrowserNotFound as error:
        skip = pytest.mark.skip(reason=f"{error}")
        for item in items:
            if item.get_closest_marker("browser"):
                item.add_marker(skip)


def takes_long(item: pytest.Item) -> bool:
    """Whether a test has more than the usual time."""
    marker = item.get_closest_marker("timeout")
    return marker is not None and bool(marker.args[0] > float(item.config.getini("timeout")))


def webgym(*arguments: object) -> list[str]:
    """The command line that runs this checkout's ``webgym``."""
    return [sys.executable, "-c", "from webgym.cli import main; main()", *(str(each) for each in arguments)]


class Commands:
    """Starts ``webgym`` commands as processes of their own, and ends them all."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch
        self._started: list[subprocess.Popen[str]] = []
        # Whatever a command starts carries this mark in its environment.
        self.mark = f"webgym-test-{os.getpid()}-{time.monotonic_ns()}"

    def start(self, *arguments: object, **environment: str) -> subprocess.Popen[str]:
        """A command in the background; its output goes to ``<pid>.log`` in the scratch folder."""
        log = (self.scratch / f"{len(self._started)}.log").open("w")
        process = subprocess.Popen(
            webgym(*arguments),
            stdout=log,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | environment | {"WEBGYM_TEST_MARK": self.mark},
        )
        log.close()
        self._started.append(process)
        return process

    def run(self, *arguments: object, seconds: float = 100, **environment: str) -> tuple[int, str]:
        """A command to its end: (exit code, what it printed)."""
        process = self.start(*arguments, **environment)
        code = process.wait(seconds)
        return code, self.output(process)

    def output(self, process: subprocess.Popen[str]) -> str:
        """What a command has printed so far."""
        return (self.scratch / f"{self._started.index(process)}.log").read_text()

    def left_over(self) -> list[str]:
        """Command lines of all living processes that these commands started, themselves included."""
        found = []
        for process in psutil.process_iter():
            try:
                if process.status() != psutil.STATUS_ZOMBIE and self.mark == process.environ().get(
                    "WEBGYM_TEST_MARK"
                ):
                    found.append(" ".join(process.cmdline())[:120])
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
        return found

    def end(self) -> None:
        """End what still runs."""
        for process in self._started:
            if process.poll() is None:
                process.terminate()
        for process in self._started:
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def commands(tmp_path: Path) -> Iterator[Commands]:
    """``webgym`` commands as processes; none is left behind."""
    scratch = tmp_path / "logs"
    scratch.mkdir()
    made = Commands(scratch)
    yield made
    made.end()


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of twelve trajectories. Not to be changed."""
    from tests.report.conftest import build_run  # most workers need no Playwright

    return asyncio.run(build_run(tmp_path_factory.mktemp("runs") / "2026-03-demo"))


@pytest.fixture
def run(run_folder: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return shutil.copytree(run_folder, tmp_path / "run")


class Calls:
    """``webgym`` commands in this process, for what a process of its own would add nothing to but seconds."""

    def __init__(self, captured: pytest.CaptureFixture[str], patch: pytest.MonkeyPatch) -> None:
        self._captured = captured
        self._patch = patch

    def run(self, *arguments: object, **environment: str) -> tuple[int, str]:
        """A command to its end: (exit code, what it printed)."""
        code, out, err = self.apart(*arguments, **environment)
        return code, out + err

    def printed(self, *arguments: object, code: int = 0, **environment: str) -> str:
        """What a command prints that ends with this exit code."""
        found, said = self.run(*arguments, **environment)
        assert found == code, said
        return said

    def apart(self, *arguments: object, **environment: str) -> tuple[int, str, str]:
        """A command to its end: (exit code, standard output, standard error)."""
        with self._patch.context() as patch:
            for name, value in environment.items():
                patch.setenv(name, value)
            with pytest.raises(SystemExit) as ended:
                main([str(argument) for argument in arguments])
        printed = self._captured.readouterr()
        assert isinstance(ended.value.code, int)
        return ended.value.code, printed.out, printed.err


@pytest.fixture
def calls(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Calls:
    """``webgym`` commands in this process."""
    return Calls(capsys, monkeypatch)


def command_of(process: psutil.Process) -> list[str]:
    """A process's command line; empty if it has ended meanwhile."""
    try:
        return process.cmdline()
    except psutil.NoSuchProcess:  # zombies are a kind of them
        return []


def wait_until(holds: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait until something holds.

    Raises:
        AssertionError: it does not within the time.
    """
    deadline = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < deadline, "it did not come about in time"
        time.sleep(0.05)
