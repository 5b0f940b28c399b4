"""Waits for a server or an offline web that is away for a moment, or for a server that starts no browser; and
gives back the browsers of a collector that was killed."""

from __future__ import annotations

import asyncio
import math
import os
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self, TypeVar

import msgspec

from webgym.core.errors import BrowserError, NoCapacity, ServerError, SitesError, Unauthorized, WebGymError
from webgym.rollout.config import CollectorConfig
from webgym.rollout.driver import BrowserSession
from webgym.server.client import BrowserClient
from webgym.server.messages import SessionGrant, SessionOptions

T = TypeVar("T")


@dataclass(frozen=True)
class Places:
    """Places for attempts, which runs that follow each other may share.

    Attributes:
        free: as many attempts go on at the same time, of all these runs.
        spare: set once the run has begun all of its attempts, so that the next one may begin. Until then a
            later run would only take places from an earlier one.
        enough: set once ``straggler_share`` of the run's samples is done. Where it is waited for, the rest
            goes on, and nobody is ended as a straggler.
    """

    free: asyncio.Semaphore
    spare: asyncio.Event = field(default_factory=asyncio.Event)
    enough: asyncio.Event = field(default_factory=asyncio.Event)


async def patiently(
    call: Callable[[], Awaitable[T]],
    config: CollectorConfig,
    *,
    tell: Callable[[str], None],
    held: Callable[[], float] = lambda: -math.inf,
) -> T:
    """The result of a call to a server or an offline web that has been reached before, so that whatever it
    answers may pass, but a token that it refuses.

    Args:
        call: repeated until it succeeds.
        config: how long to wait, and how often to ask.
        tell: called with the reason before each pause, and with an empty string at the end of the waiting.
        held: when the caller last held a session, on the monotonic clock. Waiting for a slot counts from then
            on.

    Raises:
        WebGymError: the last failure, if none succeeded in time.
    """
    since, pause, has_failed = time.monotonic(), config.server_retry_seconds, False
    while True:
        try:
            result = await call()
        except WebGymError as error:
            may_pass = is_of_server(error) or isinstance(error, BrowserError | SitesError)
            if not may_pass or isinstance(error, Unauthorized):
                raise
            if isinstance(error, NoCapacity):
                since = max(since, held())
            elif not has_failed:  # a try without an answer may itself take longer than the patience
                since = time.monotonic()
            has_failed = True
            if time.monotonic() + pause > since + config.server_patience_seconds:
                raise
            tell(error.message)
            await asyncio.sleep(pause)
            pause = min(pause * 2, longest_pause(config))
        else:
            tell("")
            return result


def longest_pause(config: CollectorConfig) -> float:
    """The longest pause before a server is asked again, seconds."""
    return 8 * config.server_retry_seconds


def is_of_server(error: WebGymError) -> bool:
    """Whether the server failed: an error of unknown type is one of the server's."""
    return isinstance(error, ServerError) or type(error) is WebGymError


class KeptLeases:
    """Opens sessions of a server that outlives the collector, and keeps their leases in the run folder: a
    resumed collector gives back those of the one that was killed, instead of waiting until they expire.

    Whoever writes to a run holds its lock, so the one before it is dead.

    Args:
        client: opens the sessions.
        file: of the leases. Only its owner can read it, because their secrets are in it; they are worthless
            once the leases have expired.
    """

    def __init__(self, client: BrowserClient, file: Path) -> None:
        self._client = client
        self._file = file

    async def open(self, options: SessionOptions | None = None) -> BrowserSession:
        """Open a session."""
        session = await self._client.open(options)
        with suppress(OSError):  # of a lease that is not kept, the next collector waits for the end
            self._write(self._client.grants)
        return session

    def _write(self, grants: list[SessionGrant]) -> None:
        """Write the file, a few kilobytes. In the event loop: a session that waits for a thread holds a slot
        that nobody uses."""
        descriptor = os.open(self._file, os.O_WRONLY | os.O_CREAT, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.truncate(file.write(msgspec.json.encode(grants)))

    async def __aenter__(self) -> Self:
        """Give back what an earlier collector has left."""
        try:
            left = msgspec.json.decode(
                await asyncio.to_thread(self._file.read_bytes), type=list[SessionGrant]
            )
        except (OSError, ValueError):  # there is none, or its writing was interrupted: the leases will expire
            return self
        async with asyncio.TaskGroup() as group:
            for grant in left:
                group.create_task(self._client.give_back(grant))
        return self

    async def __aexit__(self, *exc: object) -> None:
        with suppress(OSError):
            self._file.unlink()
