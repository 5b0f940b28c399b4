"""A server in a child process: started, monitored and stopped; it ends with this process."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import sys
from asyncio.subprocess import PIPE, STDOUT, Process
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Self

from webgym.core.errors import ConfigError, StoreError, TrainingError

_WATCHDOG: Final = Path(__file__).with_name("watchdog.py")
_LOG_TAIL_BYTES: Final = 16 * 1024
_QUOTED_CHARS: Final = 300


class ManagedServer:
    """A running server. Create one with :meth:`start`.

    Args:
        process: process of its watchdog (:mod:`webgym.inference.watchdog`).
        name: name of the command, for errors.
        log: file with the server's output.
        stop_seconds: how long stopping may take before it is killed.
    """

    def __init__(self, process: Process, name: str, log: Path, stop_seconds: float) -> None:
        self._process = process
        self._name = name
        self._log = log
        self._stop_seconds = stop_seconds

    @classmethod
    async def start(
        cls, command: Sequence[str], env: Mapping[str, str], log: Path, *, stop_seconds: float = 30.0
    ) -> Self:
        """Start a server, without waiting until it is ready.

        Args:
            command: its program and arguments, which other users of the machine can see.
            env: environment variables to add to this process's environment.
            log: file to which its output is appended.
            stop_seconds: how long stopping may take before it is killed.

        Raises:
            ConfigError: there is no such program.
            StoreError: the log cannot be written.
        """
        program = shutil.which(command[0])
        if program is None:
            raise ConfigError(
                f"there is no command {command[0]}",
                hint="install vLLM (pip install vllm), or name a running server: vllm.base_url",
            )
        try:
            output = log.open("ab")
        except OSError as error:
            raise StoreError(f"cannot write {log}: {error.strerror}") from error
        with output:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-I", str(_WATCHDOG), str(stop_seconds), program, *command[1:]),
                stdin=PIPE,
                stdout=output,
                stderr=STDOUT,
                env={**os.environ, **env},
                start_new_session=True,  # Ctrl-C reaches only this process, which stops the server in order
            )
        return cls(process, command[0], log, stop_seconds)

    @property
    def is_alive(self) -> bool:
        """Whether it has not ended."""
        return self._process.returncode is None

    async def wait(self) -> None:
        """Wait until it has ended."""
        await self._process.wait()

    async def stop(self) -> None:
        """Stop it, and every process that it started."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            async with asyncio.timeout(self._stop_seconds + 5):
                await self._process.wait()
        except TimeoutError:
            pass
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            await self._process.wait()

    def failure(self, what: str) -> TrainingError:
        """An error with this description and the end of the log."""
        return TrainingError(
            f"{self._name} {what}; its log ends: {self._last_log_line()}", hint=f"read {self._log}"
        )

    def _last_log_line(self) -> str:
        """The last line that mentions an error, or else the last line."""
        try:
            with self._log.open("rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - _LOG_TAIL_BYTES))
                lines = [line.strip() for line in file.read().decode(errors="replace").splitlines()]
        except OSError:
            lines = []
        lines = [line for line in lines if line] or ["(nothing)"]
        return next((line for line in reversed(lines) if "rror" in line), lines[-1])[-_QUOTED_CHARS:]


def free_port(host: str, port: int | None) -> int:
    """A port that is not in use: the given one, or any.

    Raises:
        ConfigError: the given port is in use.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port or 0))
        except OSError as error:
            raise ConfigError(
                f"cannot listen at {host}:{port}: {error.strerror}",
                hint="set vllm.port to a free one, or leave it out",
            ) from error
        return int(probe.getsockname()[1])
