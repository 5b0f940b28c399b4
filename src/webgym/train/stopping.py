"""Ends a training before the time of its machines is over, so that the next job goes on without a loss."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import time
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Final

from webgym.core.errors import ConfigError, TrainingError

_UNITS: Final = {"": 1, "s": 1, "m": 60, "h": 3600}
_UNKNOWN: Final = "--ends gives it, such as --ends 2026-11-30T08:00"


@dataclass
class Stop:
    """When a training begins nothing more, and when it must be over.

    ``before`` seconds before the end no attempt and no update begins any more. Half of them before it,
    attempts that still go on are abandoned, and made again after the training was resumed.

    Attributes:
        ends: when everything must be over, Unix time; ``None`` if that is not known.
        before: seconds that are left for what is in progress.
        requested: set when nothing more is to begin.
        started: when the training was started, Unix time.
    """

    ends: float | None = None
    before: float = 0.0
    requested: asyncio.Event = field(default_factory=asyncio.Event)
    started: float = field(default_factory=time.time)

    async def in_time(self, work: asyncio.Task[Any], notify: Callable[[], Awaitable[None]]) -> None:
        """Request the end of work when it is time, unless others did, and cancel it when there is no more.

        Args:
            work: of the training; an update in progress is not interrupted.
            notify: called once the end is requested.
        """
        left = None if self.ends is None else self.ends - self.before - time.time()
        with suppress(TimeoutError):
            async with asyncio.timeout(left):  # not wait_for, which may lose a cancellation
                await self.requested.wait()
        self.requested.set()
        await notify()
        if self.ends is not None:
            await asyncio.sleep(self.ends - self.before / 2 - time.time())
            work.cancel()

    def allow(self, seconds: float) -> bool:
        """Whether work that can only be done as a whole may begin: the end must not cut it off.

        Args:
            seconds: that it takes.

        Raises:
            TrainingError: not even a whole allocation is long enough.
        """
        if self.ends is None or self.requested.is_set():
            return not self.requested.is_set()
        if self.ends - self.started < seconds:
            raise TrainingError(
                f"the last update took {seconds / 60:.0f} min, longer than this training may run",
                hint="ask for a longer allocation; what was collected is kept",
            )
        if time.time() + seconds > self.ends:
            self.requested.set()
        return not self.requested.is_set()


def ends_in_time(before: str, ends: str | None, environment: Mapping[str, str] = os.environ) -> Stop:
    """The stop that ``--stop-before`` and ``--ends`` ask for.

    Args:
        before: a duration such as ``10m``, ``90s`` or ``1h``.
        ends: the end as an ISO 8601 time; ``None`` for the end of Slurm's allocation.
        environment: of the process.

    Raises:
        ConfigError: one of them cannot be read, the end is not known, or it is nearer than ``before``.
    """
    match = re.fullmatch(r"(\d+)([smh]?)", before)
    if match is None:
        raise ConfigError(f"{before!r} is no duration", hint="--stop-before takes one such as 90s, 10m or 1h")
    seconds = float(match[1]) * _UNITS[match[2]]
    end = (
        _read_time(ends, "--ends takes a time such as 2026-11-30T08:00") if ends else _allocation(environment)
    )
    left = end - time.time()
    if left <= seconds:
        raise ConfigError(
            f"only {max(0.0, left) / 60:.1f} min are left, and --stop-before {before} leaves none to train",
            hint="ask for more time, or stop later",
        )
    return Stop(end, seconds)


def _allocation(environment: Mapping[str, str]) -> float:
    """The end of Slurm's allocation, Unix time: of the environment, or of Slurm before 23.02 by its command.

    Raises:
        ConfigError: there is no allocation, or it has no end.
    """
    if end := environment.get("SLURM_JOB_END_TIME"):
        return float(end)
    job = environment.get("SLURM_JOB_ID")
    if job is None:
        raise ConfigError("--stop-before found no Slurm allocation, whose end it needs", hint=_UNKNOWN)
    try:
        command = ("scontrol", "show", "job", "--oneliner", job)
        shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    except (OSError, subprocess.SubprocessError) as error:
        raise ConfigError(f"Slurm did not say when the job {job} ends: {error}", hint=_UNKNOWN) from error
    found = re.search(r"\bEndTime=(\S+)", shown)
    return _read_time(found[1] if found else "", f"the job {job} has no end; {_UNKNOWN}")


def _read_time(text: str, hint: str) -> float:
    """A time as Unix time; without an offset it is local.

    Raises:
        ConfigError: it is none.
    """
    try:
        return datetime.fromisoformat(text).timestamp()
    except ValueError as error:
        raise ConfigError(f"{text!r} is no time", hint=hint) from error
