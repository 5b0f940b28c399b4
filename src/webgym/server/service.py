"""What each operation does. Knows nothing of HTTP."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from webgym.browser import Slot
from webgym.core.action import BrowserAction, Navigate
from webgym.core.errors import BrowserError, ProtocolError
from webgym.server.admission import Gates
from webgym.server.config import ServerConfig
from webgym.server.leases import Lease, Leases
from webgym.server.messages import (
    Closed,
    ExecuteRequest,
    Health,
    NavigateRequest,
    PageMetadata,
    Pressure,
    Renewed,
    ServerInfo,
    SessionGrant,
    SessionOptions,
    StepReply,
    StepRequest,
)
from webgym.server.metrics import Metrics
from webgym.server.operations import QueueName, openapi
from webgym.server.pool import Pool

log = logging.getLogger(__name__)

T = TypeVar("T")

_OPEN_ATTEMPTS = 2
"""A browser that died while it stood idle costs one attempt; the second gets a fresh one."""


class Service:
    """One worker: slots, leases and queues. An async context manager; browsers live inside it."""

    def __init__(self, config: ServerConfig, executable: Path) -> None:
        self.config = config
        self.pool = Pool(config, executable)
        self.leases = Leases(self.pool.give_back)
        self.gates = Gates(config.admission)
        self._metrics = Metrics(self.gates, self.pool, self.leases)

    async def __aenter__(self) -> Service:
        try:
            await self.pool.start()
        except BaseException:
            await self.pool.stop()
            raise
        self.leases.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.leases.stop()
        await self.pool.stop()

    @property
    def observed(self) -> Metrics:
        """Where the front counts time and errors."""
        return self._metrics

    # --- sessions -----------------------------------------------------------------------------------

    async def allocate(self, options: SessionOptions) -> SessionGrant:
        """Lease a slot with a fresh page."""
        lease = await self._lease(options)
        return SessionGrant(lease.id, lease.secret, lease.generation, "", lease.ttl_seconds)

    async def _lease(self, options: SessionOptions) -> Lease:
        self._check_options(options)
        slot = await self.pool.acquire()
        try:
            async with self.gates["allocate"].permit():
                await self._open(slot, options)
            ttl = min(options.ttl_seconds or self.config.ttl_seconds, self.config.longest_ttl_seconds)
            return self.leases.grant(slot, ttl, self.config.session_seconds)
        except BaseException:
            await asyncio.shield(self.pool.give_back(slot))
            raise

    async def _open(self, slot: Slot, options: SessionOptions) -> None:
        for attempt in range(1, _OPEN_ATTEMPTS + 1):
            try:
                return await slot.open(options)
            except BrowserError as error:
                if attempt == _OPEN_ATTEMPTS:
                    raise
                log.warning("a slot's browser failed and is replaced: %s", error)
                await slot.stop()
        return None

    def _check_options(self, options: SessionOptions) -> None:
        width, height = options.viewport
        if width < 1 or height < 1 or width * height > self.config.pixels:
            raise ProtocolError(
                f"a viewport of {width}x{height} is not possible",
                hint=f"at most {self.config.pixels} pixels in all",
            )
        if options.ttl_seconds is not None and options.ttl_seconds <= 0:
            raise ProtocolError("ttl_seconds must be above 0")

    async def release(self, lease: Lease) -> Closed:
        """End a session."""
        async with self.gates["release"].permit():
            await self.leases.end(lease)
        return Closed(lease.id)

    async def heartbeat(self, lease: Lease) -> Renewed:
        """Renew a lease."""
        return Renewed(lease.renew())

    # --- calls of a session -------------------------------------------------------------------------

    async def step(self, lease: Lease, request: StepRequest) -> StepReply:
        """Act, then look. The picture is left out where the caller has it."""

        async def work() -> StepReply:
            if request.action is not None:
                await self._act(lease.slot, request.action)
            async with self.gates["screenshot"].permit():
                look = await lease.slot.observe()
            has_it = look.observation.screenshot in request.have
            return StepReply(look.observation, None if has_it else look.image)

        return await self._run(lease, work)

    async def navigate(self, lease: Lease, request: NavigateRequest) -> PageMetadata:
        """Open a URL."""
        return await self._act_and_tell(lease, Navigate(request.url))

    async def execute(self, lease: Lease, request: ExecuteRequest) -> PageMetadata:
        """Carry an action out."""
        return await self._act_and_tell(lease, request.action)

    async def metadata(self, lease: Lease) -> PageMetadata:
        """Where the page is."""

        async def work() -> PageMetadata:
            return await self._tell(lease.slot)

        return await self._run(lease, work)

    async def screenshot(self, lease: Lease) -> bytes:
        """The bare picture, PNG."""

        async def work() -> bytes:
            async with self.gates["screenshot"].permit():
                return await lease.slot.screenshot()

        return await self._run(lease, work)

    async def _act(self, slot: Slot, action: BrowserAction) -> None:
        queue: QueueName = "navigate" if isinstance(action, Navigate) else "execute"
        async with self.gates[queue].permit():
            await slot.act(action)

    async def _act_and_tell(self, lease: Lease, action: BrowserAction) -> PageMetadata:
        async def work() -> PageMetadata:
            await self._act(lease.slot, action)
            return await self._tell(lease.slot)

        return await self._run(lease, work)

    async def _tell(self, slot: Slot) -> PageMetadata:
        async with self.gates["metadata"].permit():
            seen = await slot.metadata()
        return msgspec.convert(seen, PageMetadata, from_attributes=True)

    async def _run(self, lease: Lease, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """One call in its turn. A browser that failed ends the lease: its slot gets a fresh one."""
        try:
            return await lease.run(work)
        except BrowserError as error:
            log.warning("session %s ended: %s", lease.id, error)
            await lease.slot.stop()
            await self.leases.end(lease)
            raise

    # --- what is seen -------------------------------------------------------------------------------

    async def health(self) -> Health:
        """Whether sessions can be had."""
        return Health("ok" if self.pool.is_healthy else "no browser comes up")

    async def info(self) -> ServerInfo:
        """What this server is."""
        return ServerInfo(
            version=version("webgym-rl"),
            slots=self.config.slots,
            browser=self.pool.browser,
            executable=str(self.pool.executable),
            sandboxed=self.pool.sandbox.on,
            sandbox_reason=self.pool.sandbox.reason,
        )

    async def pressure(self) -> Pressure:
        """Load at this moment."""
        return Pressure(self.gates.load, self.pool.load)

    async def metrics(self) -> bytes:
        """For Prometheus."""
        return self._metrics.exposition()

    async def openapi(self) -> dict[str, Any]:
        """The API's description."""
        return openapi(version("webgym-rl"))
