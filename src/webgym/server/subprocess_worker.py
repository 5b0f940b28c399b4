"""Workers as processes of this machine, which end with their parent.

The parent writes one line of settings (which contain the token, so they are not passed on the command line,
where other users could read them), reads one line that says that the worker has started or why not, and keeps
the pipe open (:mod:`webgym.core.child`).
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
from collections.abc import AsyncIterator, Collection

import msgspec
import uvloop

from webgym.browser.profiles import ProfileRoot
from webgym.core.background import in_daemon_thread
from webgym.core.child import call_at_parents_end
from webgym.core.errors import ServerError, WebGymError, error_from_code
from webgym.server.config import GatewayConfig, ServerConfig, usable_cores
from webgym.server.fleet import Host, Started, shares_of
from webgym.server.listening import raise_open_files_limit
from webgym.server.messages import ErrorBody
from webgym.server.worker import running_server

log = logging.getLogger(__name__)


class _Settings(msgspec.Struct, frozen=True):
    """The line of settings that the parent writes.

    Attributes:
        config: a :class:`ServerConfig`, as JSON.
        stop_seconds: time limit for stopping.
        is_detached: whether to detach from the parent process by a fork.
    """

    config: str
    stop_seconds: float
    is_detached: bool


class _Report(msgspec.Struct, frozen=True, omit_defaults=True):
    """The line that the worker writes: that it has started, or why not."""

    started: Started | None = None
    error: ErrorBody | None = None


_COMMAND = (
    sys.executable,
    "-P",  # do not import from the current folder
    "-c",
    f"from {__name__} import main; main()",
)

# --- the parent's side --------------------------------------------------------------------------------


class WorkerProcess:
    """The parent's handle of a worker process. Its methods block, for use in threads.

    Args:
        config: the worker's settings.
        stop_seconds: time limit for stopping it.
        is_detached: whether it must not be a child of this process, for processes whose children are killed
            at their end without time to clean up, as Ray does.
    """

    def __init__(self, config: ServerConfig, stop_seconds: float, *, is_detached: bool = False) -> None:
        self._config = config
        self._stop_seconds = stop_seconds
        self._process = subprocess.Popen(
            _COMMAND,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C reaches only the parent, which stops the workers in order
        )
        settings = _Settings(config.model_dump_json(), stop_seconds, is_detached)
        with contextlib.suppress(BrokenPipeError):  # it has ended: then there is no report
            assert self._process.stdin is not None
            self._process.stdin.write(msgspec.json.encode(settings) + b"\n")
            self._process.stdin.flush()

    def report(self) -> bytes:
        """Wait for its report; see :func:`read_report`."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def stop(self, *, at_once: bool) -> None:
        """Stop it, and kill it if it has not ended in time. Its browsers and profiles are removed."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        if not select.select([process.stdout], [], [], 0.0 if at_once else self._stop_seconds)[0]:
            with contextlib.suppress(ProcessLookupError):  # it ended at the same moment
                os.killpg(process.pid, signal.SIGKILL)  # also a detached one, which is still in the group
        status = process.wait()
        process.stdout.close()
        if status:
            log.warning("worker %s ended with exit status %d", self._config.name, status)
            # Its browsers end when their pipe closes, but nobody has removed their files.
            ProfileRoot(self._config.browser.temporary_root).sweep()


def read_report(line: bytes) -> Started:
    """Parse the report of a worker process.

    Raises:
        WebGymError: the worker reported that it failed to start.
        ServerError: there is no report.
    """
    try:
        report = msgspec.json.decode(line, type=_Report)
    except (msgspec.MsgspecError, ValueError):
        report = _Report()
    if report.error is not None:
        raise error_from_code(report.error.code, report.error.message, report.error.hint)
    if report.started is None:
        raise ServerError("a worker process ended before it was ready", hint="its log says why")
    return report.started


# --- the worker's side --------------------------------------------------------------------------------


def main() -> None:
    """Run a worker in this process."""
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(message)s")
    settings = msgspec.json.decode(sys.stdin.buffer.readline(), type=_Settings)
    if settings.is_detached and os.fork():
        os._exit(0)
    raise_open_files_limit()
    config = ServerConfig.model_validate_json(settings.config)
    with contextlib.suppress(asyncio.CancelledError):  # the parent has ended
        uvloop.run(_serve(config, settings.stop_seconds))


async def _serve(config: ServerConfig, stop_seconds: float) -> None:
    loop, serving = asyncio.get_running_loop(), asyncio.current_task()
    assert serving is not None
    call_at_parents_end(lambda: loop.call_soon_threadsafe(serving.cancel), stop_seconds)
    try:
        async with running_server(config) as server:
            _report(_Report(started=Started(server.url, server.instance, await server.service.info())))
            await loop.create_future()
    except WebGymError as error:
        _report(_Report(error=ErrorBody(error.code, error.message, error.hint)))


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
        self._children: dict[str, WorkerProcess] = {}

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """The settings of its workers: the configured number, or by the number of processors."""
        host, slots = self._config.worker_host, self._server.slots
        return shares_of(self._server, self._config, host=host, slots=slots, cores=usable_cores())

    async def start(self, config: ServerConfig) -> Started:
        """Start a worker process."""
        child = self._children[config.name] = WorkerProcess(config, self._config.stop_seconds)
        return read_report(await in_daemon_thread(child.report))

    async def stop(self, name: str, *, at_once: bool) -> None:
        """Stop the process, and kill it if it does not end in time."""
        child = self._children.pop(name, None)
        if child is not None:
            await in_daemon_thread(lambda: child.stop(at_once=at_once))


class LocalHosts:
    """This machine as the only host."""

    def __init__(self, server: ServerConfig, config: GatewayConfig) -> None:
        self._host = LocalHost(server, config)

    async def changes(self) -> AsyncIterator[Collection[Host]]:
        """Yields this machine once."""
        yield (self._host,)
        await asyncio.Event().wait()
