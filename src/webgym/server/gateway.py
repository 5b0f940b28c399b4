"""One address for many workers, with the same operations as a worker.

A session is opened on the worker with the most free slots, and its id names that worker; clients that can
reach the worker then connect to it directly. The calls of other clients are forwarded as bytes.
"""

from __future__ import annotations

import asyncio
import logging
import re
import secrets
from collections.abc import AsyncIterator, Collection, Iterable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager, closing, nullcontext
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import Any

import aiohttp
import msgspec
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from webgym.core.background import BackgroundTasks
from webgym.core.errors import LeaseLost, ServerError, ServerUnreachable, WorkerLost
from webgym.server.callers import Audit, Quota, Tokens, audit_to, caller_of, client_of
from webgym.server.config import GatewayConfig, RayConfig, ServerConfig
from webgym.server.fleet import Fleet, Header, Hosts, NoAnswer, SlotQueue, Worker
from webgym.server.http import Feed, HttpFrontend, decode, while_connected
from webgym.server.listening import listen, serving, url_of
from webgym.server.messages import (
    HEALTHY,
    Health,
    PermitLoad,
    Pressure,
    ServerInfo,
    SessionGrant,
    SessionOptions,
    SlotLoad,
    Watched,
    WorkerInfo,
    error_of,
)
from webgym.server.metrics import CallMetrics, LabelledByWorker
from webgym.server.operations import ALLOCATE, METRICS, PRESSURE, Operation, openapi
from webgym.server.ray_hosts import ray_hosts
from webgym.server.subprocess_worker import LocalHosts
from webgym.server.worker import TOKEN_BYTES, new_instance

log = logging.getLogger(__name__)

_SESSION = re.compile(r"(w\d{1,12})-[0-9a-f]{1,64}")
_FORWARDED_HEADERS = ("authorization", "content-type")
_FORWARDED_PREFIX = "x-webgym-"
_NOT_RETURNED_HEADERS = (b"date", b"connection", b"keep-alive", b"transfer-encoding")
_OPEN_ATTEMPTS = 3
"""How many workers may fail while a caller opens a session, before the call fails."""


class Gateway:
    """Implements each operation over all workers.

    Args:
        config: limits of the gateway itself: the queue, the quota, sizes.
        fleet_config: limits of the workers.
        hosts: where the workers run.
        token: the token of the gateway's calls to workers.
        audit: the audit log.
    """

    def __init__(
        self, config: ServerConfig, fleet_config: GatewayConfig, hosts: Hosts, token: str, audit: Audit
    ) -> None:
        self.config = config
        self._audit = audit
        self.fleet = Fleet(hosts, fleet_config, token, self._on_change)
        self.queue = SlotQueue(self.fleet.workers, config.waiting)
        self.feed = Feed(self._watched, config.beat_seconds)
        self._quota = Quota(config.sessions_per_client)
        self._asked = 0
        self._granted = 0
        self._endings = BackgroundTasks()
        self.observed = CallMetrics(_Load(self.fleet, self.queue), "webgym_gateway")

    def _on_change(self, ended: Collection[str]) -> None:
        for session in ended:
            self._quota.ended(session)
            self._audit.ended(session)
        self.queue.serve()
        self.feed.changed()

    # --- sessions -------------------------------------------------------------------------------------

    async def serve(self, front: HttpFrontend, operation: Operation[Any], request: Request) -> Any:
        """Carry out an operation."""
        if operation is ALLOCATE:
            return await self.allocate(request, front)
        if operation.has_lease:
            return await self.relay(operation, request, front)
        return await getattr(self, operation.name)()

    async def allocate(self, request: Request, front: HttpFrontend) -> SessionGrant:
        """Open a session on the worker with the most free slots."""
        body = await front.body(request)
        options = decode(body, SessionOptions)  # an invalid request must not wait in the queue
        client = client_of(request)
        self._asked += 1
        with self._quota.requesting(client):
            headers = [header for header in _forwarded_headers(request) if header[0] != "authorization"]
            work = self._open(headers, body, options.wait_at_most(self.config.allocate_seconds))
            worker, grant = await while_connected(request, work, self._undo)
            if not worker.is_lost:  # otherwise the session has ended already
                worker.sessions[grant.session_id] = grant.generation
                self._quota.granted(client, grant.session_id)
                self._audit.opened(grant.session_id, **caller_of(request))
        self._granted += 1
        return grant

    async def _open(self, headers: list[Header], body: bytes, seconds: float) -> tuple[Worker, SessionGrant]:
        deadline = asyncio.get_running_loop().time() + seconds
        attempt = 1
        while True:
            remaining = max(0.0, deadline - asyncio.get_running_loop().time())
            worker = await self.queue.turn(remaining, again=attempt > 1)
            opening = asyncio.create_task(self._open_on(worker, headers, body))
            try:
                return worker, await asyncio.shield(opening)
            except asyncio.CancelledError:
                # The call itself is not cancelled: its session must be closed, and its slot counted.
                self._endings.start(self._undo_when_open(worker, opening))
                raise
            except NoAnswer as error:
                await self.fleet.check(worker)
                if attempt == _OPEN_ATTEMPTS:
                    raise ServerUnreachable(f"worker {worker.name} cannot be reached: {error}") from None
                attempt += 1

    async def _open_on(self, worker: Worker, headers: list[Header], body: bytes) -> SessionGrant:
        worker.pending += 1
        try:
            status, reply = await worker.allocate(headers, body)
        except NoAnswer as error:
            worker.sent -= not error.was_sent
            raise
        finally:
            worker.pending -= 1
        if status != 200:
            raise error_of(reply, status, worker.url)
        return msgspec.json.decode(reply, type=SessionGrant)

    async def _undo_when_open(self, worker: Worker, opening: asyncio.Task[SessionGrant]) -> None:
        try:
            grant = await opening
        except (NoAnswer, ServerError):
            return
        await self._undo((worker, grant))

    async def _undo(self, opened: tuple[Worker, SessionGrant]) -> None:
        """Release a session whose caller has disconnected."""
        worker, grant = opened
        try:
            await worker.release(grant)
        except NoAnswer as error:
            log.warning("session %s was not released, it will expire: %s", grant.session_id, error)

    async def stop(self) -> None:
        """Wait for background tasks."""
        await asyncio.gather(*self._endings, return_exceptions=True)

    async def relay(self, operation: Operation[Any], request: Request, front: HttpFrontend) -> Response:
        """Forward a session's call to the worker that holds it."""
        session = request.path_params["id"]
        worker = self._find(session)
        body = await front.body(request)
        async with AsyncExitStack() as stack:
            call = worker.call(operation, _forwarded_headers(request), body, session=session)
            try:
                answer = await stack.enter_async_context(call)
            except NoAnswer as error:
                raise await self._failure(worker, error) from None
            return _ForwardedResponse(answer, stack.pop_all())

    def _find(self, session: str) -> Worker:
        match = _SESSION.fullmatch(session)
        worker = self.fleet.workers.get(match[1]) if match else None
        if worker is not None:
            return worker
        if match and self.fleet.has_been(match[1]):
            raise _gone(match[1])
        raise LeaseLost("the session expired, was closed, or is not yours", hint="open a new one")

    async def _failure(self, worker: Worker, error: Exception) -> ServerError:
        if not await self.fleet.check(worker):
            return _gone(worker.name)
        return ServerUnreachable(
            f"the connection to worker {worker.name} broke: {error}",
            hint="it may have been carried out: observe the page before acting again",
        )

    # --- state and statistics -------------------------------------------------------------------------

    @property
    def workers(self) -> list[Worker]:
        """Running workers, oldest first."""
        return list(self.fleet.workers.values())

    async def health(self) -> Health:
        """Whether sessions can be opened."""
        if any(worker.watched and worker.watched.is_healthy for worker in self.workers):
            return Health(HEALTHY)
        return Health("no browser starts" if self.workers else "no worker is running")

    async def info(self) -> ServerInfo:
        """Information about the workers behind this gateway."""
        workers = self.workers
        if not workers:
            return ServerInfo(
                version("webgym-rl"), 0, "", "", sandboxed=False, sandbox_reason="no worker is running"
            )
        reported = next((worker.info for worker in workers if not worker.info.sandboxed), workers[0].info)
        egress = reported.egress
        if egress is not None:
            rates = [worker.info.egress.rate for worker in workers if worker.info.egress is not None]
            egress = msgspec.structs.replace(egress, rate=round(sum(rates), 6))
        return msgspec.structs.replace(
            reported,
            egress=egress,
            slots=sum(worker.info.slots for worker in workers),
            workers=tuple(WorkerInfo(worker.name, worker.url, worker.info.slots) for worker in workers),
        )

    async def pressure(self) -> Pressure:
        """Load of all workers together, and of the queue for slots."""
        loads = [msgspec.json.decode(body) for body in (await self._query_all(PRESSURE)).values()]
        if not loads:
            return Pressure({}, PermitLoad(0, 0, 0.0), self._slots())
        pressure = msgspec.convert(total(loads), type=Pressure)
        waiting = pressure.slots.waiting + len(self.queue)
        return msgspec.structs.replace(
            pressure, slots=msgspec.structs.replace(pressure.slots, waiting=waiting)
        )

    async def metrics(self) -> bytes:
        """The gateway's own metrics, and every worker's labelled with its name."""
        return self.observed.exposition(LabelledByWorker(await self._query_all(METRICS)))

    async def openapi(self) -> dict[str, Any]:
        """The API's description."""
        return openapi(version("webgym-rl"))

    async def watch(self) -> AsyncIterator[bytes]:
        """The stream of the gateway's state."""
        return self.feed.lines()

    def _watched(self) -> Watched:
        reports = [worker.watched for worker in self.workers if worker.watched]
        sessions = tuple(session for report in reports for session in report.sessions)
        is_healthy = any(report.is_healthy for report in reports)
        return Watched(self._asked, self._granted, self._slots(), sessions, is_healthy)

    def _slots(self) -> SlotLoad:
        loads = [msgspec.to_builtins(worker.watched.slots) for worker in self.workers if worker.watched]
        load = msgspec.convert(total(loads), type=SlotLoad) if loads else SlotLoad(0, 0, 0, 0, 0)
        return msgspec.structs.replace(load, waiting=load.waiting + len(self.queue))

    async def _query_all(self, operation: Operation[Any]) -> dict[str, bytes]:
        """Every worker's answer, by its name; workers that do not answer are left out."""

        async def query(worker: Worker) -> bytes | None:
            try:
                return await worker.read(operation)
            except NoAnswer as error:
                log.warning("worker %s does not report its %s: %s", worker.name, operation.name, error)
                return None

        workers = self.workers
        bodies = await asyncio.gather(*(query(worker) for worker in workers))
        return {worker.name: body for worker, body in zip(workers, bodies, strict=True) if body is not None}


def _gone(name: str) -> WorkerLost:
    return WorkerLost(f"worker {name} is gone, and the session with it", hint="open a new session")


def _forwarded_headers(request: Request) -> Iterable[Header]:
    for header in request.headers.items():
        if header[0] in _FORWARDED_HEADERS or header[0].startswith(_FORWARDED_PREFIX):
            yield header


class _ForwardedResponse(Response):
    """An answer that is forwarded while it arrives. Ends the call at its end."""

    def __init__(self, answer: aiohttp.ClientResponse, call: AsyncExitStack) -> None:
        self.status_code = answer.status
        self.background = None
        self._answer = answer
        self._call = call

    async def __call__(self, _: Scope, __: Receive, send: Send) -> None:
        answer = self._answer
        headers = [(name.lower(), value) for name, value in answer.raw_headers]
        headers = [header for header in headers if header[0] not in _NOT_RETURNED_HEADERS]
        async with self._call:
            await send({"type": "http.response.start", "status": answer.status, "headers": headers})
            # If the worker dies now, the caller sees a truncated body.
            async for chunk in answer.content.iter_any():
                await send({"type": "http.response.body", "body": chunk, "more_body": True})
            await send({"type": "http.response.body", "body": b"", "more_body": False})


@dataclass(frozen=True)
class RunningGateway:
    """A running gateway.

    Attributes:
        url: its base URL.
        token: the bearer token.
        gateway: the gateway.
    """

    url: str
    token: str
    gateway: Gateway


@asynccontextmanager
async def running_gateway(
    config: ServerConfig | None = None, fleet: GatewayConfig | None = None, cluster: RayConfig | None = None
) -> AsyncIterator[RunningGateway]:
    """Serve during the block; afterwards no worker and no browser is left.

    Args:
        config: the settings of a machine's workers together, and the address to listen on.
        fleet: how workers are started and monitored.
        cluster: the Ray cluster to run them on; this machine if not given.

    Raises:
        BrowserNotFound, BrowserLaunchFailed: no worker starts.
        ConfigError: the address cannot be listened on, or Ray is not installed.
        ServerUnreachable: no cluster answers.
        ServerError: the workers are no longer kept running, because of an internal error.
    """
    config = config or ServerConfig()
    fleet = fleet or GatewayConfig()
    token = config.token or secrets.token_urlsafe(TOKEN_BYTES)
    config = config.model_copy(update={"token": token})
    where: AbstractAsyncContextManager[Hosts] = (
        nullcontext(LocalHosts(config, fleet)) if cluster is None else ray_hosts(config, fleet, cluster)
    )
    tokens = Tokens(token, config.tokens_file)
    with closing(listen(config)) as listener, audit_to(config.audit_file) as audit:
        async with where as hosts, _running_fleet(Gateway(config, fleet, hosts, token, audit)) as gateway:
            front = HttpFrontend(tokens, config.body_bytes, new_instance(), gateway.observed)
            app = front.application(partial(gateway.serve, front))
            async with tokens.watching_file(), serving(app, listener, config):
                try:
                    yield RunningGateway(url_of(listener), token, gateway)
                finally:
                    gateway.feed.close()


@asynccontextmanager
async def _running_fleet(gateway: Gateway) -> AsyncIterator[Gateway]:
    """Run the workers during the block, which begins when the first is ready.

    Raises:
        ServerError: no worker is kept running any more, because of an internal error. The block is cancelled.
    """
    owner = asyncio.current_task()
    assert owner is not None
    running = asyncio.create_task(gateway.fleet.run())
    ready = asyncio.create_task(gateway.fleet.ready())
    failed: list[BaseException] = []

    def end(running: asyncio.Task[None]) -> None:
        if not running.cancelled() and (error := running.exception()) is not None:
            failed.append(error)
            owner.cancel()

    try:
        await asyncio.wait({running, ready}, return_when=asyncio.FIRST_COMPLETED)
        if running.done():
            running.result()
        ready.result()
        running.add_done_callback(end)
        yield gateway
        await gateway.stop()
    except asyncio.CancelledError:
        if not failed:
            raise
        owner.uncancel()
        log.critical("workers are no longer started because of an internal error", exc_info=failed[0])
        raise ServerError(f"an internal error ended all workers: {failed[0]!r}") from failed[0]
    finally:
        running.remove_done_callback(end)
        for task in (ready, running):
            task.cancel()
        await asyncio.wait({ready, running})


class _Load(Collector):
    def __init__(self, fleet: Fleet, queue: SlotQueue) -> None:
        self._fleet, self._queue = fleet, queue

    def collect(self) -> Iterable[Metric]:
        """Collect the load at this moment."""
        yield GaugeMetricFamily(
            "webgym_gateway_workers", "Workers that are up", value=len(self._fleet.workers)
        )
        yield GaugeMetricFamily(
            "webgym_gateway_waiting", "Callers who wait for a slot", value=len(self._queue)
        )
        yield CounterMetricFamily(
            "webgym_gateway_workers_lost", "Workers that were up and are gone", value=self._fleet.lost
        )


def total(parts: list[Any]) -> Any:
    """Combine decoded messages: integers are added, mappings combined by key; of other values the first
    counts.

    Shares (of busy processors) are floats, and must not be added: the largest counts, as it matters more to
    an operator than the mean.
    """
    first = parts[0]
    if isinstance(first, dict):
        keys = dict.fromkeys(key for part in parts for key in part)
        return {key: total([part[key] for part in parts if key in part]) for key in keys}
    if isinstance(first, bool):
        return all(parts)
    if isinstance(first, int):
        return sum(parts)
    if isinstance(first, float):
        return max(parts)
    return first
