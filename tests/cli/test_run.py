"""What a command that was stopped says."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import itertools
import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from benchmarks.stand_ins import TOKEN
from pydantic import SecretStr
from tests.rollout.running import Model, World, a_world, until

from webgym.cli import _run
from webgym.core.errors import ConfigError, RunFolderError, StoreCorrupt, StoreFull, StoreLocked, WebGymError
from webgym.judge.config import JudgeChoice
from webgym.offline.web import OfflineWeb
from webgym.run import collect as runs
from webgym.run.config import PolicyChoice, RunConfig, Secrets, ServerChoice
from webgym.store.runs import RunWriter


async def interrupted(number: int = signal.SIGINT) -> None:
    os.kill(os.getpid(), number)
    await asyncio.sleep(10)


async def hung_up() -> None:
    await interrupted(signal.SIGHUP)


async def finishing_or_not(finishing: asyncio.Event, presses: int) -> str:
    for _ in range(presses):
        os.kill(os.getpid(), signal.SIGINT)
        await asyncio.sleep(0.05)
    async with asyncio.timeout(100):
        await finishing.wait()
    return "finished"


async def full() -> None:
    raise StoreFull("no space left")


async def whole() -> None:
    return None


@pytest.mark.parametrize(
    ("job", "stop"), [(interrupted, KeyboardInterrupt), (hung_up, KeyboardInterrupt), (full, StoreFull)]
)
def test_a_stopped_run_says_how_to_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], job: Callable[[], Any], stop: type[BaseException]
) -> None:
    run = tmp_path / "a run"
    run.mkdir()
    with pytest.raises(stop):
        _run.run(job, resumed_by=("webgym rollout", run))
    assert not capsys.readouterr().err, "nothing is there yet"
    (run / "config.yaml").touch()
    with pytest.raises(stop):
        _run.run(job, resumed_by=("webgym rollout", run))
    assert capsys.readouterr().err == (
        f"finished work is stored; resume with: webgym rollout --resume '{run}'\n"
    )
    _run.run(whole, resumed_by=("webgym rollout", run))
    for refusal in (RunFolderError, ConfigError, StoreLocked, StoreCorrupt):

        async def refused(refusal: type[WebGymError] = refusal) -> None:
            raise refusal("holds a run already")

        with pytest.raises(refusal):
            _run.run(refused, resumed_by=("webgym rollout", run))
    assert not capsys.readouterr().err


async def test_a_resumed_run_keeps_the_servers_that_are_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    server = ServerChoice(url="http://127.0.0.1:9", sites_url="http://127.0.0.1:10", queues="global")
    tasks = [next(OfflineWeb(per_family=2, collection="small").tasks())]
    settings = RunConfig(server=server).model_dump(mode="json")
    async with await RunWriter.create(tmp_path / "run", {"run_id": "a", **settings}, tasks):
        pass
    chosen = []

    def start(config: RunConfig, *_: object, **named: object) -> None:
        assert named == {"is_resumed": True}
        chosen.append(config.server)
        raise StoreFull("that will do")

    monkeypatch.setattr(runs, "_run_services", start)
    for given in ({}, {"server": {"sites_url": "http://127.0.0.1:11"}}, {"server": {"url": "http://b.test"}}):
        job = _run.resume_job(tmp_path / "run", given, skip_corrupt=False, retry_errors=False)
        with pytest.raises(StoreFull):
            await job(secrets=Secrets())
    new_sites = server.model_copy(update={"sites_url": "http://127.0.0.1:11"})
    assert chosen == [server, new_sites, server.model_copy(update={"url": "http://b.test"})]


async def test_a_run_of_a_policy_without_a_name_is_not_resumed_by_name(tmp_path: Path) -> None:
    settings = RunConfig(policy=PolicyChoice(name="weights")).model_dump(mode="json")
    tasks = [next(OfflineWeb(per_family=2, collection="small").tasks())]
    async with await RunWriter.create(tmp_path / "run", {"run_id": "a", **settings}, tasks):
        pass
    with pytest.raises(RunFolderError, match="'weights'") as refused:
        await runs.resume(tmp_path / "run")
    assert "webgym train --resume" in refused.value.hint


def test_tokens_come_from_the_environment_in_python_as_on_the_command_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("WEBGYM_TOKEN", "of the server")
    monkeypatch.setenv("WEBGYM_SITES_TOKEN", "")
    assert Secrets() == Secrets(server_token=SecretStr("of the server"), sites_token=None) == _run.secrets()


def test_under_nohup_a_hangup_does_not_stop_a_run() -> None:
    async def hung_up_and_done() -> str:
        os.kill(os.getpid(), signal.SIGHUP)
        await asyncio.sleep(0.05)
        return "done"

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert _run.run(hung_up_and_done) == "done"
    finally:
        signal.signal(signal.SIGHUP, before)


async def test_a_run_whose_output_nobody_reads_any_more_goes_on(tmp_path: Path) -> None:
    async with a_world() as world:
        arguments = rollout(world, tmp_path, tmp_path / "run")
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "webgym", *arguments),
            stdout=(writes := os.pipe())[1],
            stderr=asyncio.subprocess.PIPE,
            env=os.environ | {"WEBGYM_TOKEN": TOKEN},
        )
        for end in writes:
            os.close(end)
        _, said = await process.communicate()
    assert (process.returncode, said) == (0, b"")
    assert json.loads((tmp_path / "run/summary.json").read_text())["attempts"] == 12
    assert (tmp_path / "run/report.html").is_file()


def rollout(world: World, path: Path, run: Path) -> list[str]:
    """Arguments of a run of 12 tasks."""
    held = world.config(path, 12).model_copy(update={"judge": JudgeChoice(name="operator:eq")})
    settings = path / "run.yaml"
    settings.write_text(yaml.safe_dump(held.model_dump(mode="json", exclude={"sites": {"token"}})))
    return ["rollout", "--config", str(settings), "--out", str(run)]


@pytest.mark.parametrize("presses", [1, 2])
def test_ctrl_c_once_lets_a_run_finish_and_twice_abandons_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], presses: int
) -> None:
    ends: list[str] = []
    (tmp_path / "config.yaml").touch()
    finishing = asyncio.Event()

    async def work() -> None:
        try:
            ends.append(await finishing_or_not(finishing, presses))
        except asyncio.CancelledError:
            ends.append("abandoned")
            raise

    def command() -> None:
        _run.run(work, finishing=finishing)
        ends.append("told")
        _run.raise_if_interrupted(finishing, ("webgym rollout", tmp_path))

    with pytest.raises(KeyboardInterrupt):
        command()
    assert ends == {1: ["finished", "told"], 2: ["abandoned"]}[presses]
    said = capsys.readouterr().err
    assert "Ctrl-C again to abandon" in said
    assert ("resume with: webgym rollout --resume" in said) == (presses == 1)


def test_ctrl_c_before_anything_is_in_flight_ends_a_run_at_once(tmp_path: Path) -> None:
    async def checking_the_endpoint(**_: object) -> Any:
        await interrupted()

    with pytest.raises(KeyboardInterrupt):
        _run.make_run(
            checking_the_endpoint,
            resumed_by=("webgym rollout", tmp_path),
            console=_run.lasting_console(),
            token_file=None,
            report=False,
        )


def test_a_command_that_came_to_its_end_says_nothing_of_going_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _run.raise_if_interrupted(asyncio.Event(), ("webgym rollout", tmp_path))
    assert not capsys.readouterr().err


class Terminal:
    """A command with a terminal of its own, where Ctrl-C can be pressed."""

    def __init__(self, arguments: list[str], environment: dict[str, str]) -> None:
        self._ours, self._theirs = pty.openpty()
        self._before = termios.tcgetattr(self._theirs)
        self.process = subprocess.Popen(
            [sys.executable, "-m", "webgym", *arguments],
            stdin=self._theirs,
            stdout=self._theirs,
            stderr=self._theirs,
            env=os.environ | {"TERM": "xterm-256color", "COLUMNS": "200", "LINES": "30"} | environment,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        )
        self.raw = b""
        os.set_blocking(self._ours, False)
        asyncio.get_running_loop().add_reader(self._ours, self._read)

    def _read(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                self.raw += os.read(self._ours, 65536)

    @property
    def shown(self) -> str:
        """Without colours and moves of the cursor."""
        return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", self.raw.decode(errors="replace"))

    def press_ctrl_c(self) -> None:
        os.write(self._ours, b"\x03")

    async def end(self) -> tuple[int, bool]:
        """The exit code, and whether lines and keys work as they did before."""
        try:
            await until(lambda: self.process.poll() is not None)
            return int(self.process.returncode), termios.tcgetattr(self._theirs) == self._before
        finally:
            asyncio.get_running_loop().remove_reader(self._ours)
            if self.process.poll() is None:
                self.process.kill()
                self.process.wait()
            os.close(self._ours)
            os.close(self._theirs)


@pytest.mark.parametrize("presses", [pytest.param(1, marks=pytest.mark.slow), 2])
async def test_ctrl_c_leaves_the_terminal_whole_and_tells_what_is_kept(tmp_path: Path, presses: int) -> None:
    """Two attempts end; the others think when Ctrl-C is pressed."""
    answers, run = asyncio.Event(), tmp_path / "run"
    async with a_world() as world:
        world.model = Model(steps=1)
        reply, numbers = world.model._reply, itertools.count(1)

        async def two_answer(request: Any) -> Any:
            if next(numbers) > 2:
                await answers.wait()
            return await reply(request)

        world.model._reply = two_answer  # type: ignore[method-assign]
        await world.stop("model")
        await world.start("model")
        terminal = Terminal(rollout(world, tmp_path, run), {"WEBGYM_TOKEN": TOKEN})
        try:
            await until(lambda: "2/12" in terminal.shown)
            assert b"\x1b[?25l" in terminal.raw, "the cursor is hidden"
            terminal.press_ctrl_c()
            await until(lambda: "Ctrl-C again to abandon" in terminal.shown)
            terminal.press_ctrl_c() if presses == 2 else answers.set()
            await until(lambda: str(run) in terminal.shown.rpartition("--resume")[2])
        finally:
            ended = await terminal.end()
    kept = 2 if presses == 2 else 6
    told = terminal.shown.splitlines()
    assert ended == (130, True)
    assert told[-1] == f"{kept} attempts are stored; resume with: webgym rollout --resume {run}"
    assert f"{kept}/12 done" in terminal.shown
    assert terminal.raw.rindex(b"\x1b[?25h") > terminal.raw.rindex(b"\x1b[?25l")
    assert json.loads((run / "summary.json").read_text())["attempts"] == 6
    assert (run / "report.html").is_file()
