"""One worker: what each operation does with its slots, leases and queues, and its HTTP application.

The routes come from the table of operations.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AbstractAsyncContextManager, asynccontextmanager, closing
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from starlette.requests import Request

from webgym.browser import remote
from webgym.browser.config import CAPTURE_SCALES
from webgym.browser.document import Document, ReadRequest
from webgym.browser.gestures import AnyAction
from webgym.browser.observe import Metadata
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.errors import BrowserError, ProtocolError, Unauthorized
from webgym.core.observation import Probed
from webgym.core.storage import StorageState
from webgym.server.admission import AdmissionController, Permit
from webgym.server.callers import SERVER_CALLER, Quota, Tokens, client_of
from webgym.server.config import ServerConfig
from webgym.server.http import Feed, HttpFrontend, decode, while_connected
from webgym.server.leases import Lease, Leases
from webgym.server.listening import is_wildcard, listen, serving, url_of
from webgym.server.messages import (
    GENERATION_HEADER,
    HEALTHY,
    SECRET_HEADER,
    Closed,
    EgressInfo,
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
    Watched,
)
from webgym.server.metrics import CallMetrics, Load
from webgym.server.operations import ALLOCATE, Operation, QueueName, openapi
from webgym.server.pool import Pool

log = logging.getLogger(__name__)

T = TypeVar("T")

SHORTEST_TTL_SECONDS = 0.1
"""Shortest time to live that a client may request: with less, a lease expires before its first call."""

_OPEN_ATTEMPTS = 2
"""If a browser has died while it was idle, the second attempt gets a fresh one."""

LEASE_LOOK_SECONDS = 1.0
"""Longest interval between two checks of the leases. If the worker itself was stopped for longer, that time
does not count against leases, because it could not receive heartbeats. Those that a stopped gateway did not
forward are missed."""


class Service:
    """One worker: slots, leases and queues. An async context manager; its browsers run while it is entered.

    Args:
        config: the worker's settings.
        executable: the Chromium to run.
    """

    def __init__(self, config: ServerConfig, executable: Path) -> None:
        self.config = config
        self.pool = Pool(config, executable)
        self.leases = Leases(self._take_back, config.name, check_seconds=LEASE_LOOK_SECONDS)
        self.feed = Feed(self._watched, config.beat_seconds)
        self.pool.on_change = self.feed.changed
        self.leases.on_end = self._ended
        self.on_end: Callable[[str], None] = lambda _: None
        """Called with the id of every session that ends."""
        self._asked = 0
        self.gate = AdmissionController(config.admission)
        self.observed = CallMetrics(Load(self.gate, self.pool, self.leases))
        """The metrics, where the HTTP layer records times and errors."""

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
        await self.gate.stop()
        await self.pool.stop()

    @asynccontextmanager
    async def _running(
        self, slot: Slot, queue: QueueName, on_queue: Callable[[Permit], None] = lambda _: None
    ) -> AsyncIterator[Permit]:
        """Wait for a run permit, and let the slot's processes run during the block."""
        async with self.gate.permit(queue, on_queue) as permit:
            with slot.awake():
                yield permit

    def _serving(self, lease: Lease, queue: QueueName) -> AbstractAsyncContextManager[Permit]:
        """The same for a call of a session; its heartbeat reports how long the call has waited."""

        def note(permit: Permit) -> None:
            lease.permit = permit

        return self._running(lease.slot, queue, note)

    async def _take_back(self, slot: Slot) -> None:
        try:
            async with self._running(slot, "release"):
                await self.pool.clean(slot)
        finally:
            self.pool.give_back(slot)

    # --- sessions -----------------------------------------------------------------------------------

    async def allocate(self, options: SessionOptions) -> SessionGrant:
        """Lease a slot with a fresh page."""
        self._asked += 1
        lease = await self._lease(options)
        return SessionGrant(lease.id, lease.secret, lease.generation, "", lease.ttl_seconds)

    async def _lease(self, options: SessionOptions) -> Lease:
        self._check_options(options)
        slot = await self.pool.acquire(options.wait_at_most(self.config.allocate_seconds))
        try:
            async with self._running(slot, "allocate"):
                await self._open(slot, options)
            ttl = min(options.ttl_seconds or self.config.ttl_seconds, self.config.longest_ttl_seconds)
            return self.leases.grant(slot, ttl, self.config.session_seconds)
        except BaseException:
            await asyncio.shield(self._take_back(slot))
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
        if options.jpeg_quality is not None and not 1 <= options.jpeg_quality <= 100:
            raise ProtocolError("jpeg_quality is 1 to 100, or null for PNG")
        least, most = CAPTURE_SCALES
        if options.capture_scale is not None and not least <= options.capture_scale <= most:
            raise ProtocolError(f"capture_scale is {least:g} to {most:g}, or null for the server's own")
        if options.ttl_seconds is not None and options.ttl_seconds < SHORTEST_TTL_SECONDS:
            raise ProtocolError(f"ttl_seconds must be {SHORTEST_TTL_SECONDS:g} or more")

    async def release(self, lease: Lease) -> Closed:
        """End a session."""
        await self.leases.end(lease)
        return Closed(lease.id)

    async def heartbeat(self, lease: Lease) -> Renewed:
        """Renew a lease."""
        return Renewed(lease.renew(), lease.permit.waited if lease.permit else 0.0)

    # --- calls of a session -------------------------------------------------------------------------

    async def step(self, lease: Lease, request: StepRequest) -> StepReply:
        """Carry out an action and observe the page, with a run permit for each. The screenshot is left out if
        the caller has it."""
        slot, action = lease.slot, request.action

        async def work() -> StepReply:
            async with self._serving(lease, _queue_of(action)) as permit:
                waited = permit.waited
                look = await slot.step(action, between=lambda: permit.exchange("screenshot", slot.asleep))
            turns = {"queued": waited * 1000, "queued_screenshot": (permit.waited - waited) * 1000}
            observation = msgspec.structs.replace(
                look.observation, milliseconds=look.observation.milliseconds | turns
            )
            has_it = observation.screenshot in request.have
            return StepReply(observation, None if has_it else look.image)

        return await self._run(lease, work)

    async def navigate(self, lease: Lease, request: NavigateRequest) -> PageMetadata:
        """Open a URL."""
        return await self._act(lease, Navigate(request.url))

    async def execute(self, lease: Lease, request: ExecuteRequest) -> PageMetadata:
        """Carry out an action."""
        return await self._act(lease, request.action)

    async def metadata(self, lease: Lease) -> PageMetadata:
        """The page's URL, title, status and scroll position."""
        return _page_metadata(await self._work(lease, "metadata", lease.slot.metadata))

    async def read(self, lease: Lease, request: ReadRequest) -> Document:
        """Read the whole document."""
        return await self._work(lease, "metadata", lambda: lease.slot.read(request))

    async def storage(self, lease: Lease) -> StorageState:
        """What websites keep in the session's browser."""
        return await self._work(lease, "metadata", lease.slot.storage)

    async def probe(self, lease: Lease, request: NavigateRequest) -> Probed:
        """Ask for a page from outside the session. No browser runs for it."""
        return await lease.run(lambda: lease.slot.probe(request.url))

    async def screenshot(self, lease: Lease) -> bytes:
        """A screenshot without marks."""
        return await self._work(lease, "screenshot", lease.slot.screenshot)

    async def _act(self, lease: Lease, action: AnyAction) -> PageMetadata:
        async def work() -> PageMetadata:
            await lease.slot.act(action)
            return _page_metadata(await lease.slot.metadata())

        return await self._work(lease, _queue_of(action), work)

    async def _work(self, lease: Lease, queue: QueueName, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Carry out one call of a session with a run permit."""

        async def permitted() -> T:
            async with self._serving(lease, queue):
                return await work()

        return await self._run(lease, permitted)

    async def _run(self, lease: Lease, work: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Run one call of a session. If its browser fails, the lease ends, and the slot gets a fresh
        browser."""

        async def stop_on_failure() -> T:
            try:
                return await work()
            except BrowserError:
                await lease.slot.stop()  # while the lease still owns the slot
                raise

        try:
            return await lease.run(stop_on_failure)
        except BrowserError as error:
            log.warning("session %s ended: %s", lease.id, error)
            await self.leases.end(lease)
            raise

    # --- state and statistics -----------------------------------------------------------------------

    async def health(self) -> Health:
        """Whether sessions can be opened."""
        return Health(HEALTHY if self.pool.is_healthy else "no browser starts")

    async def info(self) -> ServerInfo:
        """Information about this server."""
        egress = self.config.browser.egress
        return ServerInfo(
            version=version("webgym-rl"),
            slots=self.config.slots,
            browser=self.pool.browser,
            executable=str(self.pool.executable),
            sandboxed=self.pool.sandbox.on,
            sandbox_reason=self.pool.sandbox.reason,
            egress=EgressInfo(egress.allow, egress.ports, egress.rate, tuple(egress.upstream)),
            without=remote.WITHOUT if self.config.browser.remote else (),
        )

    async def pressure(self) -> Pressure:
        """Load at this moment."""
        return Pressure(self.gate.load, self.gate.permits, self.pool.load)

    async def metrics(self) -> bytes:
        """The metrics in Prometheus's text format."""
        return self.observed.exposition()

    async def watch(self) -> AsyncIterator[bytes]:
        """The stream of the worker's state, for a gateway."""
        return self.feed.lines()

    def _watched(self) -> Watched:
        pool, leases = self.pool, self.leases
        return Watched(self._asked, leases.granted, pool.load, leases.ids, pool.is_healthy)

    def _ended(self, session_id: str) -> None:
        self.on_end(session_id)
        self.feed.changed()

    async def openapi(self) -> dict[str, Any]:
        """The API's description."""
        return openapi(version("webgym-rl"))


def _queue_of(action: AnyAction | None) -> QueueName:
    """The queue of a call with this action; without an action, that of screenshots."""
    if action is None:
        return "screenshot"
    return "navigate" if isinstance(action, Navigate) else "execute"


def _page_metadata(metadata: Metadata) -> PageMetadata:
    return msgspec.convert(metadata, PageMetadata, from_attributes=True)


TOKEN_BYTES = 32
_INSTANCE_BYTES = 8


@dataclass(frozen=True)
class RunningServer:
    """A running worker.

    Attributes:
        url: its base URL.
        token: the bearer token.
        service: its service.
        instance: id of this run of the server.
    """

    url: str
    token: str
    service: Service
    instance: str


def new_instance() -> str:
    """A unique id for a run of a server."""
    return secrets.token_hex(_INSTANCE_BYTES)


@asynccontextmanager
async def running_server(config: ServerConfig | None = None) -> AsyncIterator[RunningServer]:
    """Serve during the block; afterwards no browser is left.

    Args:
        config: the settings; by default loopback, a free port, a random token.

    Raises:
        BrowserNotFound, BrowserLaunchFailed: no browser can be started.
        ConfigError: the address cannot be listened on.
    """
    config = config or ServerConfig()
    token = config.token or secrets.token_urlsafe(TOKEN_BYTES)
    tokens = Tokens(token, config.tokens_file)
    instance = new_instance()
    executable = await asyncio.to_thread(remote.executable_of, config.browser)
    with closing(listen(config)) as listener:
        url = url_of(listener)
        async with Service(config, executable) as service:
            endpoint = "" if is_wildcard(config.host) else url
            front = HttpFrontend(tokens, config.body_bytes, instance, service.observed)
            app = front.application(_Calls(service, front, endpoint).serve)
            async with tokens.watching_file(), serving(app, listener, config):
                try:
                    yield RunningServer(url, token, service, instance)
                finally:
                    service.feed.close()  # the streams of subscribers never end by themselves


class _Calls:
    """Calls of a service by HTTP. ``endpoint`` is its base URL for other machines; empty if unknown."""

    def __init__(self, service: Service, front: HttpFrontend, endpoint: str) -> None:
        self._service = service
        self._front = front
        self._endpoint = endpoint
        self._quota = Quota(service.config.sessions_per_client)
        service.on_end = self._quota.ended

    async def serve(self, operation: Operation[Any], request: Request) -> Any:
        """Carry out an operation."""
        arguments: list[Any] = []
        if operation.has_lease:
            arguments.append(
                self._service.leases.check(
                    request.path_params["id"],
                    request.headers.get(SECRET_HEADER, ""),
                    request.headers.get(GENERATION_HEADER, ""),
                )
            )
        if operation.request is not None:
            arguments.append(decode(await self._front.body(request), operation.request))
        if operation is ALLOCATE:
            return await self._allocate(request, arguments[0])
        return await getattr(self._service, operation.name)(*arguments)

    async def _allocate(self, request: Request, options: SessionOptions) -> SessionGrant:
        if self._service.config.name and request.state.caller != SERVER_CALLER:
            raise Unauthorized(
                "a worker opens sessions only for its gateway, which counts them", hint="call the gateway"
            )
        client = client_of(request)
        with self._quota.requesting(client):
            grant = await while_connected(request, self._service.allocate(options), self._undo)
            self._quota.granted(client, grant.session_id)
            if grant.session_id not in self._service.leases:  # it has expired in the meantime
                self._quota.ended(grant.session_id)
        return msgspec.structs.replace(grant, endpoint=self._endpoint, instance=self._front.instance)

    async def _undo(self, grant: SessionGrant) -> None:
        leases = self._service.leases
        await leases.end(leases.check(grant.session_id, grant.secret, str(grant.generation)))
