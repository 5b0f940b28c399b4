"""Workers as processes of this machine, which end with their parent.

The parent writes one line of settings (which contain the token, so they are not passed on the command line,
where other users could read them), reads one line that says that the worker has started or why not, and keeps
the pipe open. The worker ends when the pipe is closed: by the parent, or because the parent was killed.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import logging
import os
import select
import signal
import subprocess
import sys
import threading
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Collection
from typing import TypeAlias

import msgspec
import uvloop

from webgym.browser.profiles import ProfileRoot
from webgym.core.errors import ServerError, WebGymError, error_from_code
from webgym.server.config import GatewayConfig, ServerConfig, usable_cores
from webgym.server.fleet import Host, Started, share_of, split
from webgym.server.listening import raise_open_files_limit
from webgym.server.messages import ErrorBody
from webgym.server.worker import running_server

log = logging.getLogger(__name__)

_PR_SET_PDEATHSIG = 1
"""The option of prctl(2): the signal that the kernel sends a process when its parent ends."""


class _Settings(msgspec.Struct, frozen=True):
    """The line of settings that the parent writes.

    Attributes:
        config: a :class:`ServerConfig`, as JSON.
        stop_seconds: time limit for stopping.
        is_detached: whether to detach from the parent process by a fork.
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
    "-P",  # do not import from the current folder
    "-c",
    f"from {__name__} import main; main()",
)

# --- the parent's side --------------------------------------------------------------------------------


class Child:
    """The parent's handle of a worker process. Create one with :func:`start_child`."""

    def __init__(self, process: Process, config: ServerConfig) -> None:
        self._process = process
        self._config = config

    async def stop(self, seconds: float) -> None:
        """Stop it, and kill it if it has not ended in time. Its browsers and profiles are removed."""
        process = self._process
        assert process.stdin is not None
        process.stdin.close()
        try:
            async with asyncio.timeout(seconds):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):  # it ended at the same moment
                process.kill()
            await process.wait()
        if process.returncode:
            log.warning("worker %s ended with exit status %d", self._config.name, process.returncode)
            # Its browsers end when their pipe closes, but nobody has removed their files.
            root = ProfileRoot(self._config.browser.temporary_root)
            await asyncio.to_thread(root.sweep)


async def start_child(config: ServerConfig, stop_seconds: float) -> tuple[Child, Started]:
    """Start a worker process and wait until it is ready. If that fails or is cancelled, none is left.

    Args:
        config: the worker's settings.
        stop_seconds: time limit for stopping it.

    Raises:
        WebGymError: the error that the worker reported.
        ServerError: it ended without a report.
    """
    process = await asyncio.create_subprocess_exec(
        *_COMMAND,
        stdin=PIPE,
        stdout=PIPE,
        stderr=None,  # its log goes to the parent's stderr
        start_new_session=True,  # Ctrl-C reaches only the parent, which stops the workers in order
    )
    child = Child(process, config)
    try:
        return child, await _send_settings(process, _Settings(config.model_dump_json(), stop_seconds))
    except BaseException:
        await asyncio.shield(child.stop(stop_seconds))
        raise


async def _send_settings(process: Process, settings: _Settings) -> Started:
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(msgspec.json.encode(settings) + b"\n")
        await process.stdin.drain()
        line = await process.stdout.readline()
    except (ConnectionError, ValueError) as error:
        raise ServerError(f"a worker process sent no report: {error}", hint="its log says why") from error
    return read_report(line)


def read_report(line: bytes) -> Started:
    """Parse the report of a worker process.

    Raises:
        WebGymError: the worker reported that it failed to start.
        ServerError: there is no report.
    """
    try:
        report: _Report = msgspec.json.decode(line, type=_Report)
    except (msgspec.MsgspecError, ValueError):
        raise ServerError("a worker process ended before it was ready", hint="its log says why") from None
    if isinstance(report, _Down):
        raise error_from_code(report.error.code, report.error.message, report.error.hint)
    return report.started


class DetachedChild:
    """A worker process that is not a child of this process, but still ends with it.

    For processes whose children are killed at their end without time to clean up, as Ray does. The detached
    worker notices the closed pipe instead. Every method blocks, for use in threads.
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
        """Wait for its report; see :func:`read_report`."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def stop(self, *, at_once: bool) -> None:
        """Stop it, and kill it if it has not ended in time."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        if not select.select([process.stdout], [], [], 0.0 if at_once else self._stop_seconds)[0]:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # it is not our child, but still in the group
        process.wait()  # for the child that forked it
        process.stdout.close()


# --- the worker's side --------------------------------------------------------------------------------


def main() -> None:
    """Run a worker in this process."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    # A worker that is stopped (SIGSTOP) when its parent is killed would never see the pipe close.
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGCONT, 0, 0, 0)
    settings = msgspec.json.decode(sys.stdin.buffer.readline(), type=_Settings)
    if settings.is_detached and os.fork():
        os._exit(0)
    raise_open_files_limit()
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
            raise  # the parent ended while the worker was starting


async def _cancel_at(end: asyncio.Event, task: asyncio.Task[None]) -> None:
    await end.wait()
    task.cancel()


def _end_with_parent(loop: asyncio.AbstractEventLoop, end: asyncio.Event, stop_seconds: float) -> None:
    """Set ``end`` when the parent closes the pipe or ends. If the event loop hangs, exit after the
    deadline."""

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


class LocalHost:
    """This machine.

    Args:
        server: the settings of its workers together.
        config: how workers are started and stopped.
    """

    id = "here"
    place = "this machine"

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._server = server
        self._config = config
        self._children: dict[str, Child] = {}

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """The settings of its workers: the configured number, or by the number of processors."""
        cores = usable_cores()
        machine = self._server.model_copy(
            update={"host": self._config.worker_host, "ports": self._config.worker_ports}
        )
        slots = split(machine.slots, cores, self._config)
        return tuple(
            share_of(machine, count, cores / len(slots), share=count / machine.slots, of_cores=cores)
            for count in slots
        )

    async def start(self, config: ServerConfig) -> Started:
        """Start a worker process."""
        child, started = await start_child(config, self._config.stop_seconds)
        self._children[config.name] = child
        return started

    async def stop(self, name: str, *, at_once: bool) -> None:
        """Stop the process, and kill it if it does not end in time."""
        child = self._children.pop(name, None)
        if child is not None:
            await child.stop(0.0 if at_once else self._config.stop_seconds)


class LocalHosts:
    """This machine as the only host."""

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._host = LocalHost(server, config)

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        """Yields this machine once."""
        yield (self._host,)
        await asyncio.Event().wait()
