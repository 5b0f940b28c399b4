"""The workers behind a gateway: started, monitored, restarted when they end; and the queue for their slots.

A *host* is where worker processes run: this machine, or a node of a Ray cluster. Every run of a worker gets
a unique name, so a session's id always identifies the run that held it.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections import deque
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Mapping
from contextlib import asynccontextmanager
from typing import Any, Protocol

import aiohttp
import msgspec

from webgym.core.errors import NoCapacity, ServerError, TooManyWaiting, WebGymError
from webgym.server.config import GatewayConfig, ServerConfig, usable_cores
from webgym.server.listening import connections
from webgym.server.messages import (
    GENERATION_HEADER,
    INSTANCE_HEADER,
    SECRET_HEADER,
    ServerInfo,
    SessionGrant,
    Watched,
)
from webgym.server.operations import ALLOCATE, HEALTH, RELEASE, WATCH, Operation

log = logging.getLogger(__name__)

CORES_PER_WORKER = 4
"""Cores whose browsers one worker process can keep busy."""

SETTLED_SECONDS = 60.0
"""After a worker has run for this long, its next restart uses the first pause again."""

START_SECONDS = 300.0
"""From starting a worker until its first browser has started: only one that hangs takes so long."""

Header = tuple[str, str]


class NoAnswer(Exception):
    """A call to a worker failed.

    Attributes:
        was_sent: whether the worker may have carried it out.
    """

    def __init__(self, error: Exception | str, *, was_sent: bool) -> None:
        super().__init__(str(error) or "no answer in time")
        self.was_sent = was_sent


class Started(msgspec.Struct, frozen=True):
    """A worker's report that it has started.

    Attributes:
        url: its base URL.
        instance: id of this run of the server.
        info: information about the server.
    """

    url: str
    instance: str
    info: ServerInfo


class Host(Protocol):
    """Where worker processes run."""

    @property
    def id(self) -> str:
        """Unique among hosts."""

    @property
    def place(self) -> str:
        """Its name in messages."""

    @property
    def shares(self) -> tuple[ServerConfig, ...]:
        """The settings of each of its workers, without their names."""

    async def start(self, config: ServerConfig) -> Started:
        """Start a worker and wait until it is ready. Nothing is left of one that fails to start.

        Raises:
            WebGymError: it does not start.
        """

    async def stop(self, name: str, *, at_once: bool) -> None:
        """Stop a worker in any state, or kill it at once. Does nothing if it is gone."""


class Hosts(Protocol):
    """All hosts; they may come and go."""

    def changes(self) -> AsyncIterator[Collection[Host]]:
        """Yield the present hosts, now and after every change. Never ends."""


def shares_of(
    server: ServerConfig, config: GatewayConfig, *, host: str, slots: int, cores: float
) -> tuple[ServerConfig, ...]:
    """The settings of each of the workers of a machine: the configured number of workers, or by its cores.

    Args:
        server: the settings of all workers together, for the processors of this machine.
        config: the number of workers, and their ports.
        host: where they listen.
        slots: number of slots of the machine; every worker gets one.
        cores: number of its processors.
    """
    machine = server.model_copy(update={"host": host, "ports": config.worker_ports})
    workers = min(slots, config.workers or max(1, round(cores / CORES_PER_WORKER)))
    counts = [slots // workers + (number < slots % workers) for number in range(workers)]
    return tuple(
        _share_of(machine, count, cores / workers / usable_cores(), count / slots) for count in counts
    )


def _share_of(config: ServerConfig, slots: int, part: float, share: float) -> ServerConfig:
    """The settings of a worker with a part of this machine's processors, and a share of its own machine's
    sessions."""
    admission, egress = config.admission, config.browser.egress

    def scaled(value: int) -> int:
        return max(1, math.ceil(value * part))

    limits = {name: scaled(getattr(admission, name)) for name in ("fewest", "most", "step")}
    # Websites see all workers of a machine as one visitor.
    egress_share = egress.model_copy(
        update={"rate": egress.rate * share, "burst": max(1, math.ceil(egress.burst * share))}
    )
    return config.model_copy(
        update={
            "port": 0,
            "slots": slots,
            "parallel_launches": scaled(config.parallel_launches),
            "admission": admission.model_copy(update=limits),
            "browser": config.browser.model_copy(update={"egress": egress_share}),
            "sessions_per_client": None,  # counted by the gateway, over all workers
        }
    )


class Worker:
    """The gateway's state of one run of a worker.

    Attributes:
        sent: number of allocate calls sent to it so far.
        pending: number of these calls without an answer yet.
        watched: its last report.
        sessions: generations of the open sessions that were opened through the gateway, by session id.
        is_lost: whether it is gone.
    """

    def __init__(self, name: str, started: Started, config: GatewayConfig, token: str) -> None:
        self.name = name
        self.url = started.url
        self.instance = started.instance
        self.info = started.info
        self.sent = 0
        self.pending = 0
        self.watched: Watched | None = None
        self.sessions: dict[str, int] = {}
        self.is_lost = False
        self._answer_seconds = config.answer_seconds
        self._credentials: list[Header] = [("authorization", f"Bearer {token}")]
        self._was_inconsistent = False
        self._http = connections(config.connect_seconds, config.idle_seconds, config.dead_peer_seconds)
        self._calls: set[asyncio.Timeout] = set()

    @property
    def room(self) -> int:
        """Number of free slots to which no caller was sent yet."""
        if self.watched is None or self.is_lost:
            return 0
        slots = self.watched.slots
        return slots.free - slots.waiting - (self.sent - self.watched.asked)

    def update(self, watched: Watched) -> list[str]:
        """Process a report. Returns the ids of the sessions that have ended."""
        self.watched = watched
        # Without pending calls both counts are equal, unless a call was lost with its connection.
        is_inconsistent = not self.pending and self.sent != watched.asked
        if is_inconsistent and self._was_inconsistent:
            self.sent = watched.asked
        self._was_inconsistent = is_inconsistent
        living = set(watched.sessions)
        ended = [
            session
            for session, generation in self.sessions.items()
            if generation <= watched.granted and session not in living
        ]
        for session in ended:
            del self.sessions[session]
        return ended

    @asynccontextmanager
    async def call(
        self, operation: Operation[Any], headers: Iterable[Header], body: bytes = b"", *, session: str = ""
    ) -> AsyncIterator[aiohttp.ClientResponse]:
        """Make a call; the answer's head has arrived when the block begins, and its body may follow.

        A call is not repeated, unless that does no harm.

        Raises:
            NoAnswer: here or in the block: the connection failed, or the worker is lost.
        """
        if self.is_lost:
            raise NoAnswer("the worker is gone", was_sent=False)
        url = self.url + operation.path.replace("{id}", session)
        try:
            async with asyncio.timeout(None) as until_lost:
                self._calls.add(until_lost)
                async with self._http.request(
                    operation.method, url, headers=tuple(headers), data=body or None, allow_redirects=False
                ) as answer:
                    yield answer
        except (aiohttp.ClientConnectorError, aiohttp.ConnectionTimeoutError) as error:
            raise NoAnswer(error, was_sent=False) from None
        except (aiohttp.ClientError, OSError) as error:
            raise NoAnswer(error, was_sent=True) from None
        finally:
            self._calls.discard(until_lost)

    async def read(
        self, operation: Operation[Any], headers: Iterable[Header] = (), *, session: str = ""
    ) -> bytes:
        """The body of the answer to a call with the gateway's own token.

        Raises:
            NoAnswer: the call failed, or took too long.
        """
        try:
            async with asyncio.timeout(self._answer_seconds):
                async with self.call(operation, [*self._credentials, *headers], session=session) as answer:
                    return await answer.read()
        except TimeoutError as error:
            raise NoAnswer(error, was_sent=True) from None

    async def allocate(self, headers: Iterable[Header], body: bytes) -> tuple[int, bytes]:
        """Request a session with the gateway's own token: workers accept no other. Returns status and body.

        Raises:
            NoAnswer: the call failed.
        """
        async with self.call(ALLOCATE, [*self._credentials, *headers], body) as answer:
            return answer.status, await answer.read()

    async def release(self, grant: SessionGrant) -> None:
        """End a session.

        Raises:
            NoAnswer: the call failed.
        """
        proof = [(SECRET_HEADER, grant.secret), (GENERATION_HEADER, str(grant.generation))]
        await self.read(RELEASE, proof, session=grant.session_id)

    async def is_reachable(self) -> bool:
        """Whether this run of the worker still answers."""
        try:
            async with asyncio.timeout(self._answer_seconds), self.call(HEALTH, ()) as answer:
                return answer.headers.get(INSTANCE_HEADER) == self.instance
        except (NoAnswer, TimeoutError):
            return False

    async def watch(self, silent_seconds: float) -> AsyncIterator[Watched]:
        """Yield its reports until the connection ends.

        Raises:
            NoAnswer, TimeoutError: the connection failed, or there was no report in time.
        """
        async with self.call(WATCH, self._credentials) as answer:
            while True:
                async with asyncio.timeout(silent_seconds):
                    line = await answer.content.readline()
                if not line:
                    return
                yield msgspec.json.decode(line, type=Watched)

    def lose(self) -> None:
        """Mark the worker as gone and interrupt all calls to it."""
        if not self.is_lost:
            self.is_lost = True
            for call in self._calls:
                call.reschedule(0)

    async def close(self) -> None:
        """Mark the worker as gone, and close all connections to it."""
        self.lose()
        await self._http.close()


class SlotQueue:
    """Callers that wait for a worker with a free slot.

    Without polling: :meth:`serve` is called whenever a worker reports; the report and the calls sent since
    say which workers have free slots.

    Args:
        workers: the running workers, by name.
        longest: largest number of waiting callers.
    """

    def __init__(self, workers: Mapping[str, Worker], longest: int) -> None:
        self._workers = workers
        self._longest = longest
        self._waiting: deque[asyncio.Future[Worker]] = deque()

    def __len__(self) -> int:
        return sum(not turn.done() for turn in self._waiting)

    async def turn(self, seconds: float, *, again: bool = False) -> Worker:
        """Wait for a worker with a free slot; its ``sent`` already counts the caller.

        Args:
            seconds: longest wait.
            again: whether the caller's worker was lost, so that it goes to the head of the queue.

        Raises:
            NoCapacity: no worker had a free slot in time.
            TooManyWaiting: no slot is free, and the queue is full.
        """
        turn: asyncio.Future[Worker] = asyncio.get_running_loop().create_future()
        if again:
            self._waiting.appendleft(turn)
        else:
            self._waiting.append(turn)
        self.serve()
        if not (again or turn.done()) and len(self) > self._longest:
            turn.cancel()
            raise TooManyWaiting.of(self._longest)
        try:
            async with asyncio.timeout(seconds):
                return await turn
        except TimeoutError:
            if turn.done() and not turn.cancelled():  # it was granted at the same moment
                return turn.result()
            raise self._no_capacity(seconds) from None
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                turn.result().sent -= 1
                self.serve()
            raise

    def serve(self) -> None:
        """Send callers in order to the worker with the most free slots, while there are free slots."""
        while self._waiting:
            if self._waiting[0].done():  # it gave up
                self._waiting.popleft()
                continue
            best = max(self._workers.values(), key=lambda worker: worker.room, default=None)
            if best is None or best.room <= 0:
                return
            best.sent += 1
            self._waiting.popleft().set_result(best)

    def _no_capacity(self, seconds: float) -> NoCapacity:
        slots = sum(worker.info.slots for worker in self._workers.values())
        if not slots:
            return NoCapacity(
                f"no worker started within {round(seconds, 2):g} s", hint="the server's log says why"
            )
        return NoCapacity(
            f"all {slots} slots were in use for {round(seconds, 2):g} s",
            hint="close sessions, or start the server with more slots",
        )


class Fleet:
    """Keeps every worker of every host running.

    Args:
        hosts: where the workers run.
        config: deadlines and pauses.
        token: the token of the gateway's calls to workers.
        on_change: called when a worker started, reported, or ended; with the ids of sessions that ended.
    """

    def __init__(
        self, hosts: Hosts, config: GatewayConfig, token: str, on_change: Callable[[Collection[str]], None]
    ) -> None:
        self._hosts = hosts
        self._config = config
        self._token = token
        self._on_change = on_change
        self.workers: dict[str, Worker] = {}
        """Running workers, by name."""
        self.lost = 0
        """Number of workers that were running and are gone."""
        self._started = 0
        self._wanted = 0
        self._hosts_known = False
        self._failing: dict[object, WebGymError] = {}
        self._changed = asyncio.Event()

    async def run(self) -> None:
        """Keep all workers running until cancelled; then stop all of them."""
        keepers: dict[str, asyncio.Task[None]] = {}
        places: dict[str, str] = {}
        async with asyncio.TaskGroup() as group:
            async for present in self._hosts.changes():
                hosts = {host.id: host for host in present}
                for gone in keepers.keys() - hosts.keys():
                    log.warning("%s is gone", places.pop(gone))
                    keepers.pop(gone).cancel()
                for new in hosts.keys() - keepers.keys():
                    shares = hosts[new].shares
                    self._wanted += len(shares)
                    places[new] = hosts[new].place
                    keepers[new] = group.create_task(self._keep_all(hosts[new], shares))
                self._hosts_known = True
                self._changed.set()

    async def ready(self) -> None:
        """Wait until a worker is running, or it is known that there is no host.

        Raises:
            WebGymError: all workers failed to start.
        """
        while not self.workers:
            if self._hosts_known and len(self._failing) == self._wanted:
                if not self._wanted:
                    return
                raise next(iter(self._failing.values()))
            self._changed.clear()
            await self._changed.wait()

    async def check(self, worker: Worker) -> bool:
        """Whether a worker is still reachable after a failed connection. If not, it is marked as lost."""
        if not worker.is_lost and not await worker.is_reachable():
            worker.lose()
            self.workers.pop(worker.name, None)
        return not worker.is_lost

    def has_been(self, name: str) -> bool:
        """Whether there was a worker with this name."""
        number = name.removeprefix("w")
        return number.isdecimal() and number.isascii() and int(number) <= self._started

    @property
    def wanted(self) -> int:
        """Number of workers that should be running."""
        return self._wanted

    # --- one worker -----------------------------------------------------------------------------------

    async def _keep_all(self, host: Host, shares: Collection[ServerConfig]) -> None:
        try:
            async with asyncio.TaskGroup() as group:
                for share in shares:
                    group.create_task(self._keep(host, share))
        finally:
            self._wanted -= len(shares)

    async def _keep(self, host: Host, share: ServerConfig) -> None:
        """Keep one worker running: restart it after a pause, which grows while its runs are short."""
        loop = asyncio.get_running_loop()
        key = object()
        pause, longest = self._config.restart_seconds
        try:
            while True:
                started_at = loop.time()
                self._started += 1
                name = f"w{self._started}"
                try:
                    await self._run_once(host, share.model_copy(update={"name": name}), key)
                    log.warning("worker %s on %s ended", name, host.place)
                except Exception as error:  # also OSError: no process, file or memory is left for a moment
                    failure = error if isinstance(error, WebGymError) else None
                    self._failing[key] = failure or ServerError(f"a worker did not start: {error!r}")
                    log.error("worker %s on %s did not start: %s", name, host.place, error)
                self._report_change(())
                if loop.time() - started_at > SETTLED_SECONDS:
                    pause = self._config.restart_seconds[0]
                await asyncio.sleep(pause)
                pause = min(pause * 2, longest)
        finally:
            self._failing.pop(key, None)

    async def _run_once(self, host: Host, config: ServerConfig, key: object) -> None:
        """One run of a worker, from its start until it is gone.

        Raises:
            WebGymError: it did not start.
        """
        is_lost = False
        try:
            try:
                async with asyncio.timeout(START_SECONDS):
                    started = await host.start(config)
            except TimeoutError:
                raise ServerError(f"a worker did not start within {START_SECONDS:g} s") from None
            worker = Worker(config.name, started, self._config, self._token)
            self._failing.pop(key, None)
            try:
                await self._watch(worker)
            finally:
                is_lost = worker.is_lost
                self.workers.pop(worker.name, None)
                self.lost += 1
                await worker.close()
                self._report_change(worker.sessions)
        finally:
            try:
                # One that hangs would not stop in order, and holders of its sessions wait until it is gone.
                await host.stop(config.name, at_once=is_lost)
            except Exception as error:
                log.error("worker %s on %s was not stopped in order: %s", config.name, host.place, error)

    async def _watch(self, worker: Worker) -> None:
        """Process a worker's reports until it is gone. If the connection fails, it is opened again."""
        while not worker.is_lost:
            try:
                async for watched in worker.watch(self._config.silent_seconds):
                    self.workers[worker.name] = worker
                    self._report_change(worker.update(watched))
                return
            except (NoAnswer, TimeoutError, msgspec.MsgspecError, ValueError) as error:
                if await self.check(worker):
                    log.warning("worker %s was silent: %s", worker.name, error)

    def _report_change(self, ended: Collection[str]) -> None:
        self._on_change(ended)
        self._changed.set()
