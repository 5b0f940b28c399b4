"""The client of a browser server.

>>> async with BrowserClient(url, token=token) as client:
...     session = await client.open(SessionOptions(mode="marks"))
...     view = await session.step(Navigate("http://example.com"))
...     await session.close()
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import time
from collections import OrderedDict
from collections.abc import Coroutine, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import aiohttp
import msgspec

from webgym.browser.document import Document, ReadRequest
from webgym.browser.gestures import AnyAction
from webgym.core.action import Navigate
from webgym.core.calls import CallQueue, call_queues
from webgym.core.errors import LeaseLost, ProtocolError, ServerUnreachable, WebGymError
from webgym.core.observation import Probed
from webgym.core.storage import StorageState
from webgym.core.websites import is_loopback
from webgym.server import operations
from webgym.server.config import ClientLimits
from webgym.server.listening import connections
from webgym.server.messages import (
    CLIENT_HEADER,
    GENERATION_HEADER,
    INSTANCE_HEADER,
    SECRET_HEADER,
    UNHEALTHY_STATUS,
    ExecuteRequest,
    Health,
    NavigateRequest,
    PageMetadata,
    Pressure,
    Renewed,
    ServerInfo,
    SessionGrant,
    SessionOptions,
    StepRequest,
    View,
    error_of,
)
from webgym.server.operations import MSGPACK, Operation, QueueName, Reply

log = logging.getLogger(__name__)

_NAME_BYTES = 8
_SLOW_SECONDS = 30.0
"""A call that is not answered for longer is reported as a problem."""

HEARTBEAT_SHARE = 0.3
"""A session without a call for this share of its lease's time to live is renewed."""

DIRECT_SECONDS = 2.0
"""Deadline of the check whether a worker can be reached directly; otherwise the gateway is used."""

RELEASE_SECONDS = 10.0
"""Releasing a session. Short, because the lease expires by itself."""


@dataclass(eq=False)
class _Call:
    """A call: what is sent, its queue, its deadline without the time in the server's queues in seconds; and
    where and when it was sent."""

    operation: Operation[Any]
    body: msgspec.Struct | None
    grant: SessionGrant | None
    queue: QueueName | None
    seconds: float
    server: str = ""
    sent: float = 0.0


class _CallFailed(Exception):
    """A call failed on its route.

    Attributes:
        error: the error for the caller.
        was_sent: whether the server may have carried out the call.
    """

    def __init__(self, error: ServerUnreachable, *, was_sent: bool) -> None:
        super().__init__(error.message)
        self.error = error
        self.was_sent = was_sent


class _Response(NamedTuple):
    """A complete HTTP response."""

    status: int
    content_type: str
    content: bytes
    host: str

    @property
    def is_success(self) -> bool:
        return 200 <= self.status < 300


class BrowserClient:
    """A client of one browser server, for any number of sessions at once.

    Args:
        base_url: the server's base URL.
        token: its bearer token.
        limits: concurrency per operation type, and deadlines.
        name: name of this client, by which the server counts its sessions; ``None`` generates one.
        calls: a queue for each type of operation; by default created from the limits.

    Raises:
        ServerUnreachable: by every method: nothing answers, or not in time.
        Unauthorized: by every method: the token is invalid.
        ProtocolError: by every method: the answer is not that of a browser server; by the constructor: the
            token is not ASCII.
    """

    def __init__(
        self,
        base_url: str,
        *,
        token: str,
        limits: ClientLimits | None = None,
        name: str | None = None,
        calls: Mapping[str, CallQueue] | None = None,
    ) -> None:
        if not token.isascii():
            raise ProtocolError("the token is not plain ASCII", hint="copy it from `webgym serve`")
        self.limits = limits or ClientLimits()
        self.base_url = base_url.rstrip("/")
        self._headers = {
            "authorization": f"Bearer {token}",
            CLIENT_HEADER: name or secrets.token_hex(_NAME_BYTES),
        }
        self.calls = calls or call_queues(self.limits.calls)
        self._sessions: set[Session] = set()
        self._unanswered: set[_Call] = set()
        self._connections: aiohttp.ClientSession | None = None

    async def __aenter__(self) -> BrowserClient:
        limits = self.limits
        self._connections = connections(
            limits.connect_seconds, limits.keep_alive_seconds, limits.dead_peer_seconds
        )
        self._router = SessionRouter(self._connections, self.base_url, self.limits)
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.gather(*(session.close() for session in tuple(self._sessions)))
        await self._router.close()
        await self._http.close()

    @property
    def _http(self) -> aiohttp.ClientSession:
        if self._connections is None:
            raise RuntimeError("the client is not open: use it in an async with statement")
        return self._connections

    @property
    def problem(self) -> str:
        """Which server is silent at this moment, as a message for users; empty if none is. A request for a
        browser may wait for a free slot."""
        now = time.monotonic()
        overdue = [
            call
            for call in self._unanswered
            if now - call.sent >= _SLOW_SECONDS + max(0.0, call.seconds - self.limits.reply_seconds)
        ]
        if not overdue:
            return ""
        oldest = min(overdue, key=lambda call: call.sent)
        calls = "1 call" if len(overdue) == 1 else f"{len(overdue)} calls"
        waited = f"{oldest.operation.name} for {now - oldest.sent:.0f} s"
        return f"the browser server {oldest.server} leaves {calls} without an answer, {waited}"

    async def open(self, options: SessionOptions | None = None) -> Session:
        """Lease a browser with a fresh, blank page. The lease is renewed in the background until it is
        closed.

        Args:
            options: viewport, marks, cookies and so on; the server's defaults if not given.

        Raises:
            NoCapacity: no slot became free in time.
            TooManySessions: this client has reached its limit on sessions.
        """
        options = options or SessionOptions()
        wait = options.wait_at_most(self.limits.wait_seconds)
        options = msgspec.structs.replace(options, wait_seconds=wait)  # so that the server answers in time
        grant = await self.call(operations.ALLOCATE, options, seconds=wait + self.limits.reply_seconds)
        try:
            route = await self._router.find(grant)
        except asyncio.CancelledError:
            await asyncio.shield(self.give_back(grant))
            raise
        session = Session(self, grant, route)
        self._sessions.add(session)
        return session

    @property
    def grants(self) -> list[SessionGrant]:
        """The leases of the open sessions."""
        return [session.grant for session in self._sessions]

    async def give_back(self, grant: SessionGrant) -> None:
        """End the session of a lease, if it still exists.

        Args:
            grant: the lease, as the server granted it.
        """
        with contextlib.suppress(WebGymError):  # the lease expires by itself
            await self.call(operations.RELEASE, grant=grant, seconds=RELEASE_SECONDS)

    async def info(self) -> ServerInfo:
        """Information about the server."""
        return await self.call(operations.INFO)

    async def health(self) -> Health:
        """Whether the server can open sessions. Needs no token."""
        call = _Call(operations.HEALTH, None, None, None, self.limits.reply_seconds)
        response = await self._send(call, SessionRoute(self.base_url, False))
        if response.status == UNHEALTHY_STATUS:
            with contextlib.suppress(ProtocolError):  # then it is handled like any other error
                return self._decode(operations.HEALTH, response)
        return self._answer(operations.HEALTH, response)

    async def pressure(self) -> Pressure:
        """Its load per operation type."""
        return await self.call(operations.PRESSURE)

    def forget(self, session: Session) -> None:
        """Forget a session that is over.

        Args:
            session: a session of this client; no request is sent.
        """
        self._sessions.discard(session)

    # --- one call -----------------------------------------------------------------------------------

    async def call(
        self,
        operation: Operation[Reply],
        body: msgspec.Struct | None = None,
        *,
        grant: SessionGrant | None = None,
        route: SessionRoute | None = None,
        queue: QueueName | None = None,
        seconds: float | None = None,
    ) -> Reply:
        """Make one call, in the queue of its type.

        Args:
            operation: an operation of :mod:`webgym.server.operations`.
            body: the request's body, if the operation has one.
            grant: the session, for operations on a session.
            route: where to send it; by default the client's base URL. If a direct route fails, the base URL
                replaces it, but calls that may have been carried out are not repeated.
            queue: the queue, if it is not the operation's own.
            seconds: deadline, if it is not the default.
        """
        call = _Call(operation, body, grant, queue or operation.queue, seconds or self.limits.reply_seconds)
        response = await self._send(call, route or SessionRoute(self.base_url, False))
        return self._answer(operation, response)

    async def _send(self, call: _Call, route: SessionRoute) -> _Response:
        """Send a call on its route, and on the other route if that fails."""
        was_direct = route.is_direct
        try:
            return await self._send_to(route.base_url, call)
        except _CallFailed as failed:
            if not was_direct:
                raise failed.error from None
            route.base_url, route.is_direct = self.base_url, False
            again = not failed.was_sent or call.operation.is_repeatable
            # The server's answer about the session is more specific than the failure of the route.
            fallback = call if again else replace(call, operation=operations.HEARTBEAT, body=None)
            try:
                response = await self._send_to(self.base_url, fallback)
            except _CallFailed as other:
                raise (other.error if again else failed.error) from None
            if again or not response.is_success:
                return response
            raise failed.error from None

    def _answer(self, operation: Operation[Reply], response: _Response) -> Reply:
        if not response.is_success:
            raise error_of(response.content, response.status, response.host)
        return self._decode(operation, response)

    def _decode(self, operation: Operation[Reply], response: _Response) -> Reply:
        try:
            if operation.reply is bytes:
                return response.content  # type: ignore[return-value]
            if response.content_type.startswith(MSGPACK):
                return msgspec.msgpack.decode(response.content, type=operation.reply)
            return msgspec.json.decode(response.content, type=operation.reply)
        except (msgspec.MsgspecError, ValueError) as error:
            raise ProtocolError(
                f"{operation.name}: the answer cannot be parsed: {error}",
                hint=f"is {self.base_url} a WebGym server of this version?",
            ) from None

    async def _send_to(self, base_url: str, call: _Call) -> _Response:
        """One call to one server.

        Raises:
            _CallFailed: there was no answer.
        """
        operation, grant = call.operation, call.grant
        path, headers = operation.path, self._headers
        if grant is not None:
            path = path.replace("{id}", grant.session_id)
            headers = headers | {SECRET_HEADER: grant.secret, GENERATION_HEADER: str(grant.generation)}
        content = None if call.body is None else msgspec.json.encode(call.body)
        try:
            async with self.calls[call.queue].turn() if call.queue else contextlib.nullcontext():
                call.server, call.sent = base_url, time.monotonic()
                self._unanswered.add(call)
                exchange = self._exchange(operation.method, base_url + path, content, headers)
                if grant is None or operation in (operations.HEARTBEAT, operations.RELEASE):
                    async with asyncio.timeout(call.seconds):
                        return await exchange
                return await self._answer_in_time(exchange, call, grant)
        except (aiohttp.InvalidURL, ValueError) as error:
            failure = ServerUnreachable(f"{base_url} is not an http address: {error}", hint="check --server")
            raise _CallFailed(failure, was_sent=False) from None
        except (aiohttp.ClientConnectorError, aiohttp.ConnectionTimeoutError):
            failure = ServerUnreachable(
                f"nothing answers at {base_url}", hint="start one with `webgym serve`"
            )
            raise _CallFailed(failure, was_sent=False) from None
        except TimeoutError:
            failure = ServerUnreachable(f"{operation.name}: no answer from {base_url} in time")
            raise _CallFailed(failure, was_sent=True) from None
        except (aiohttp.ClientError, OSError) as error:
            failure = ServerUnreachable(
                f"{operation.name}: the connection to {base_url} broke ({type(error).__name__})",
                hint="it may have been carried out: observe the page before acting again",
            )
            raise _CallFailed(failure, was_sent=True) from None
        finally:
            self._unanswered.discard(call)

    async def _answer_in_time(
        self, exchange: Coroutine[Any, Any, _Response], call: _Call, grant: SessionGrant
    ) -> _Response:
        """The answer to a session's call. Time in the server's queues does not count, but only the server
        knows it: it is queried by a heartbeat at the deadline. If that fails, its error is the answer.

        Raises:
            TimeoutError: the call took longer than the limit, without waiting in queues.
        """
        answer, started, remaining = asyncio.create_task(exchange), time.monotonic(), call.seconds
        try:
            while not (await asyncio.wait({answer}, timeout=remaining))[0]:
                renewal = _Call(operations.HEARTBEAT, None, grant, None, call.seconds)
                try:
                    heartbeat = await self._send_to(call.server, renewal)
                except _CallFailed as failed:
                    raise TimeoutError from failed
                if not heartbeat.is_success:
                    return heartbeat
                queued = self._decode(operations.HEARTBEAT, heartbeat).queued_seconds
                remaining = call.seconds + queued - (time.monotonic() - started)
                if remaining <= 0 and not answer.done():
                    raise TimeoutError
            return answer.result()
        finally:
            answer.cancel()
            await asyncio.gather(answer, return_exceptions=True)

    async def _exchange(
        self, method: str, url: str, content: bytes | None, headers: dict[str, str]
    ) -> _Response:
        sent = self._http.request(method, url, data=content, headers=headers, allow_redirects=False)
        async with sent as response:
            data = await response.read()
            kind = response.headers.get("content-type", "")
            return _Response(response.status, kind, data, response.url.host or "")


class Session:
    """A leased browser. Open one with :meth:`BrowserClient.open`; close it when done.

    Not for concurrent calls: the server handles them one after the other.

    Raises (every method, besides the client's errors):
        LeaseLost: the session expired or was closed.
        BrowserCrashed, BrowserTimeout: the browser failed; the session is over.
    """

    def __init__(self, client: BrowserClient, grant: SessionGrant, route: SessionRoute) -> None:
        self._client = client
        self.grant = grant
        """The session's lease, with the secret that authorizes its calls."""
        self._route = route
        self._pictures: OrderedDict[str, bytes] = OrderedDict()
        self._is_closed = False
        self._used = asyncio.Event()
        self._renewal = asyncio.get_running_loop().create_task(self._keep_alive())

    @property
    def id(self) -> str:
        """The session's id, for tracing a fault."""
        return self.grant.session_id

    @property
    def is_direct(self) -> bool:
        """Whether its calls are sent directly to the worker that holds it."""
        return self._route.is_direct

    async def step(self, action: AnyAction | None = None) -> View:
        """Carry out an action (if any), wait until the page is quiet, and observe it, in one round trip."""
        queue: QueueName = "navigate" if isinstance(action, Navigate) else "execute"
        if action is None:
            queue = "screenshot"
        request = StepRequest(action, tuple(self._pictures))
        reply = await self._call(operations.STEP, request, queue)
        calls, observation = self._client.calls, reply.observation
        calls[queue].waited_elsewhere(observation.seconds("queued"))
        calls[queue].included(calls["metadata"], 0.0, observation.seconds("metadata"))
        if queue != "screenshot":
            waited = observation.seconds("queued_screenshot")
            calls[queue].included(calls["screenshot"], waited, observation.seconds("screenshot"))
        name = observation.screenshot
        image = self._pictures.get(name) if reply.image is None else reply.image
        if image is None:
            raise ProtocolError("the server left out a screenshot that it has never sent")
        self._pictures[name] = image
        self._pictures.move_to_end(name)
        if len(self._pictures) > self._client.limits.pictures:
            self._pictures.popitem(last=False)
        return View(observation, image)

    async def navigate(self, url: str) -> PageMetadata:
        """Open a URL, without an observation."""
        return await self._call(operations.NAVIGATE, NavigateRequest(url))

    async def execute(self, action: AnyAction) -> PageMetadata:
        """Carry out an action, without an observation."""
        return await self._call(operations.EXECUTE, ExecuteRequest(action))

    async def metadata(self) -> PageMetadata:
        """The page's URL, title, status and scroll position."""
        return await self._call(operations.METADATA)

    async def read(self, request: ReadRequest) -> Document:
        """Read the whole document, not only the part in the viewport."""
        return await self._call(operations.READ, request)

    async def storage(self) -> StorageState:
        """What websites keep in the session's browser: whoever has it is signed in as the session is."""
        return await self._call(operations.STORAGE)

    async def probe(self, url: str) -> Probed:
        """Ask for a page from outside the session, to see whether its website is there."""
        return await self._call(operations.PROBE, NavigateRequest(url))

    async def screenshot(self) -> bytes:
        """A screenshot without marks and without waiting, PNG (or JPEG)."""
        return await self._call(operations.SCREENSHOT)

    async def heartbeat(self) -> Renewed:
        """Renew the lease. This also happens in the background."""
        return await self._call(operations.HEARTBEAT)

    async def abandon(self) -> None:
        """Stop renewing the session without releasing its browser, as a client that dies would.

        The server releases the browser when the lease expires; until then, calls still work and renew it.
        """
        self._renewal.cancel()
        await asyncio.wait({self._renewal})

    async def close(self) -> None:
        """Release the browser. Safe to call twice. Never raises, so that it does not hide the caller's own
        error: a lease that cannot be released expires by itself."""
        if self._is_closed:
            return
        self._is_closed = True
        self._client.forget(self)
        await self.abandon()
        try:
            seconds = RELEASE_SECONDS
            await self._client.call(operations.RELEASE, grant=self.grant, route=self._route, seconds=seconds)
        except LeaseLost:
            return
        except WebGymError as error:  # also one that the server raised, such as an internal error
            log.warning("session %s was not released: %s", self.id, error)

    async def _call(
        self,
        operation: Operation[Reply],
        body: msgspec.Struct | None = None,
        queue: QueueName | None = None,
    ) -> Reply:
        if self._is_closed:
            raise LeaseLost("the session was closed here", hint="open a new one")
        self._used.set()
        return await self._client.call(operation, body, grant=self.grant, route=self._route, queue=queue)

    async def _keep_alive(self) -> None:
        """Renew the lease when there was no call for a while, for example because the model is thinking."""
        interval = self.grant.ttl_seconds * HEARTBEAT_SHARE
        while True:
            self._used.clear()
            try:
                async with asyncio.timeout(interval):
                    await self._used.wait()
                continue
            except TimeoutError:
                pass
            try:
                await self._client.call(operations.HEARTBEAT, grant=self.grant, route=self._route)
            except LeaseLost:
                return  # the next call raises it
            except WebGymError as error:
                log.warning("session %s was not renewed: %s", self.id, error)


@dataclass(eq=False)
class SessionRoute:
    """Where one session's calls are currently sent.

    Attributes:
        base_url: base URL of a worker or gateway.
        is_direct: whether that is the worker's; then the gateway is the alternative.
    """

    base_url: str
    is_direct: bool


class SessionRouter:
    """Chooses the route of every session of a client.

    Args:
        http: the client's connections.
        base_url: the client's base URL.
        limits: the client's limits.
    """

    def __init__(self, http: aiohttp.ClientSession, base_url: str, limits: ClientLimits) -> None:
        self._http = http
        self._base_url = base_url
        self._limits = limits
        self._checks: dict[tuple[str, str], asyncio.Task[bool]] = {}

    async def find(self, grant: SessionGrant) -> SessionRoute:
        """The better route to a session."""
        endpoint = grant.endpoint
        if not self._limits.direct or not may_connect_directly(self._base_url, endpoint):
            return SessionRoute(self._base_url, False)
        key = endpoint, grant.instance
        if key not in self._checks:  # sessions that open at the same time share one check
            self._checks[key] = asyncio.create_task(self._is_reachable(endpoint, grant.instance))
        if await asyncio.shield(self._checks[key]):
            return SessionRoute(endpoint, True)
        return SessionRoute(self._base_url, False)

    async def _is_reachable(self, endpoint: str, instance: str) -> bool:
        """Whether this worker, and not some other server, answers there. No token is sent."""
        try:
            async with asyncio.timeout(DIRECT_SECONDS):
                request = self._http.request(
                    operations.HEALTH.method, endpoint + operations.HEALTH.path, allow_redirects=False
                )
                async with request as response:
                    return response.headers.get(INSTANCE_HEADER) == instance
        except (aiohttp.ClientError, OSError, ValueError):
            return False

    async def close(self) -> None:
        """Cancel checks that are still running."""
        for task in self._checks.values():
            task.cancel()
        await asyncio.gather(*self._checks.values(), return_exceptions=True)


def may_connect_directly(base_url: str, endpoint: str) -> bool:
    """Whether an endpoint may be contacted directly.

    A loopback address means something else on every machine; and a client that uses TLS for its base URL must
    not send the token unencrypted to another.
    """
    if not endpoint or endpoint == base_url:
        return False
    try:
        known, offered = urlsplit(base_url), urlsplit(endpoint)
    except ValueError:
        return False
    if is_loopback(offered.hostname) and not is_loopback(known.hostname):
        return False
    return offered.scheme == "https" or known.scheme == "http"
