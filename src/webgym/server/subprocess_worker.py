"""A worker as a process of its own, which lives no longer than whoever started it.

The parent writes one line of settings (never on the command line, which everybody on the machine can read:
the token is in them), reads one line that says that the worker is up or why not, and keeps the pipe open.
The pipe's end is the worker's end: it comes when the parent closes it, and when the parent is killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import select
import signal
import subprocess
import sys
import threading
from asyncio.subprocess import PIPE, Process
from typing import TypeAlias

import msgspec
import uvloop

from webgym.browser.profiles import ProfileRoot
from webgym.core.errors import ServerError, WebGymError, error_from_code
from webgym.server.config import ServerConfig
from webgym.server.fleet import Started
from webgym.server.listening import open_as_many_files_as_may_be
from webgym.server.messages import ErrorBody
from webgym.server.run_worker import running_server

log = logging.getLogger(__name__)


class _Settings(msgspec.Struct, frozen=True):
    """Attributes:
    config: a :class:`ServerConfig`, as JSON.
    stop_seconds: how long the end may take.
    is_detached: whether to become nobody's child.
    """

    config: str
    stop_seconds: float
    is_detached: bool = False


class _Up(msgspec.Struct, frozen=True, tag="up"):
    started: Started


class _Down(msgspec.Struct, frozen=True, tag="down"):
    error: ErrorBody


_Report: TypeAlias = _Up | _Down


_COMMAND = (
    sys.executable,
    "-P",  # the current folder is no place to import from
    "-c",
    f"from {__name__} import main; main()",
)

# --- the parent's side --------------------------------------------------------------------------------


class Child:
    """A worker process, seen by its parent. Get one from :func:`start_child`."""

    def __init__(self, process: Process, config: ServerConfig) -> None:
        self._process = process
        self._config = config

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    async def stop(self, seconds: float) -> None:
        """End it: told first, killed if it has not ended in time. Its browsers and profiles go with it."""
        process = self._process
        assert process.stdin is not None
        process.stdin.close()
        try:
            async with asyncio.timeout(seconds):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()
        if process.returncode:
            log.warning("worker %s ended with exit status %d", self._config.name, process.returncode)
            # Its browsers end when their pipe closes, but what they leave behind is nobody's.
            root = ProfileRoot(self._config.browser.temporary_root)
            await asyncio.to_thread(root.sweep)


async def start_child(config: ServerConfig, stop_seconds: float) -> tuple[Child, Started]:
    """Start a worker process and wait until it is up. Cancelled or failed, it leaves none.

    Args:
        stop_seconds: how long its end may take.

    Raises:
        WebGymError: what the worker itself says.
        ServerError: it ended without a word.
    """
    process = await asyncio.create_subprocess_exec(
        *_COMMAND,
        stdin=PIPE,
        stdout=PIPE,
        stderr=None,  # its log goes where ours goes
        start_new_session=True,  # Ctrl-C is for us to hear, and to pass on in order
    )
    child = Child(process, config)
    try:
        return child, await _introduce(process, _Settings(config.model_dump_json(), stop_seconds))
    except BaseException:
        await asyncio.shield(child.stop(stop_seconds))
        raise


async def _introduce(process: Process, settings: _Settings) -> Started:
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(msgspec.json.encode(settings) + b"\n")
        await process.stdin.drain()
        said = await process.stdout.readline()
    except (ConnectionError, ValueError) as error:
        raise ServerError(f"a worker process was not heard: {error}", hint="its log says why") from error
    return read_report(said)


def read_report(said: bytes) -> Started:
    """What a worker said of itself.

    Raises:
        WebGymError: that it did not come up, and why.
        ServerError: nothing.
    """
    try:
        report: _Report = msgspec.json.decode(said, type=_Report)
    except (msgspec.MsgspecError, ValueError):
        raise ServerError("a worker process ended before it was up", hint="its log says why") from None
    if isinstance(report, _Down):
        raise error_from_code(report.error.code, report.error.message, report.error.hint)
    return report.started


class DetachedChild:
    """A worker process that is not our child, and lives no longer than us all the same.

    For parents whose own parent kills all their children at their end, with no time to clear up: Ray does.
    The pipe's end still reaches this one. For threads: every method blocks.
    """

    def __init__(self, config: str, stop_seconds: float) -> None:
        self._stop_seconds = stop_seconds
        self._process = subprocess.Popen(
            _COMMAND, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
        )
        assert self._process.stdin is not None
        settings = _Settings(config, stop_seconds, is_detached=True)
        self._process.stdin.write(msgspec.json.encode(settings) + b"\n")
        self._process.stdin.flush()

    def report(self) -> bytes:
        """What it says when it is up or will not be; see :func:`read_report`."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def stop(self) -> None:
        """End it: told first, killed if it has not ended in time."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        if not select.select([process.stdout], [], [], self._stop_seconds)[0]:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # it left us, but not the group
        process.wait()  # what was our child, until it split
        process.stdout.close()


# --- the worker's side --------------------------------------------------------------------------------


def main() -> None:
    """Be a worker."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    settings = msgspec.json.decode(sys.stdin.buffer.readline(), type=_Settings)
    if settings.is_detached and os.fork():
        os._exit(0)
    open_as_many_files_as_may_be()
    config = ServerConfig.model_validate_json(settings.config)
    uvloop.run(_serve(config, settings.stop_seconds))


async def _serve(config: ServerConfig, stop_seconds: float) -> None:
    end = asyncio.Event()
    _end_with_parent(asyncio.get_running_loop(), end, stop_seconds)
    starting = asyncio.current_task()
    assert starting is not None
    ending = asyncio.create_task(_cancel_at(end, starting))
    try:
        async with running_server(config) as server:
            _report(_Up(Started(server.url, server.instance, await server.service.info())))
            ending.cancel()
            await end.wait()
    except WebGymError as error:
        _report(_Down(ErrorBody(error.code, error.message, error.hint)))
    except asyncio.CancelledError:
        if not end.is_set():
            raise  # the parent left while we were coming up


async def _cancel_at(end: asyncio.Event, task: asyncio.Task[None]) -> None:
    await end.wait()
    task.cancel()


def _end_with_parent(loop: asyncio.AbstractEventLoop, end: asyncio.Event, stop_seconds: float) -> None:
    """Set ``end`` when the parent is gone or says so. A loop that hangs is no excuse to stay."""

    def wait() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        loop.call_soon_threadsafe(end.set)
        threading.Event().wait(stop_seconds)
        os._exit(1)

    threading.Thread(target=wait, name="end-with-parent", daemon=True).start()


def _report(report: _Report) -> None:
    sys.stdout.buffer.write(msgspec.json.encode(report) + b"\n")
    sys.stdout.buffer.flush()
