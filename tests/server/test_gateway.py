"""One address in front of several worker processes: placing, passing on, and what becomes of losses."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import msgspec
import psutil
import pytest
import pytest_asyncio
from prometheus_client.parser import text_string_to_metric_families

from webgym.browser.egress.config import EgressConfig
from webgym.core.action import LeftClick, Navigate, Target
from webgym.core.errors import (
    BrowserNotFound,
    LeaseLost,
    NoCapacity,
    ProtocolError,
    ServerUnreachable,
    TooManySessions,
    TooManyWaiting,
    Unauthorized,
    WorkerLost,
)
from webgym.server.client import BrowserClient, Session, SessionRoute
from webgym.server.config import GatewayConfig, ServerConfig
from webgym.server.fleet import SlotQueue
from webgym.server.gateway import RunningGateway, running_gateway
from webgym.server.messages import (
    GENERATION_HEADER,
    SECRET_HEADER,
    EgressInfo,
    Pressure,
    SessionOptions,
    StepRequest,
    Watched,
)
from webgym.server.operations import METADATA, OPERATIONS, STEP

from .conftest import LOCAL, TOKEN, Site, quick

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]

WORKERS = 2


@pytest.fixture(scope="module")
def profiles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the browsers' profiles are."""
    return tmp_path_factory.mktemp("profiles")


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def gateway(profiles: Path) -> AsyncIterator[RunningGateway]:
    """Two workers of one slot each."""
    config = ServerConfig(
        slots=WORKERS,
        token=TOKEN,
        allocate_seconds=30,
        sessions_per_client=3,
        browser=LOCAL.model_copy(update={"temporary_root": profiles}),
    )
    async with running_gateway(config, GatewayConfig(workers=WORKERS)) as gateway:
        await until_free(gateway)
        yield gateway


@pytest_asyncio.fixture(loop_scope="module")
async def client(gateway: RunningGateway) -> AsyncIterator[BrowserClient]:
    """Goes straight to the workers."""
    async with BrowserClient(gateway.url, token=TOKEN, limits=quick()) as client:
        yield client
    await until_free(gateway)


@pytest_asyncio.fixture(loop_scope="module")
async def relayed(gateway: RunningGateway) -> AsyncIterator[BrowserClient]:
    """Sees nothing but the gateway."""
    async with BrowserClient(gateway.url, token=TOKEN, limits=quick(direct=False)) as client:
        yield client
    await until_free(gateway)


async def until_free(gateway: RunningGateway, slots: int = WORKERS) -> None:
    """Wait until that many slots are free."""
    async with asyncio.timeout(60):
        while sum(worker.room for worker in gateway.gateway.workers) < slots:
            await asyncio.sleep(0.01)


def children() -> dict[int, psutil.Process]:
    """The worker processes that live."""
    found = {}
    for child in psutil.Process().children():
        with contextlib.suppress(psutil.NoSuchProcess):  # a zombie is none either
            if any("webgym.server.subprocess_worker" in part for part in child.cmdline()):
                found[child.pid] = child
    return found


def holder(gateway: RunningGateway, session: Session) -> int:
    """The process that holds a session."""
    [worker] = [one for one in gateway.gateway.workers if session.id.startswith(f"{one.name}-")]
    port = int(worker.url.rpartition(":")[2])
    [pid] = [
        pid
        for pid, child in children().items()
        if any(each.laddr.port == port for each in child.net_connections() if each.status == "LISTEN")
    ]
    return pid


# --- placing ------------------------------------------------------------------------------------------


async def test_sessions_go_where_there_is_room_and_straight_to_it(site: Site, client: BrowserClient) -> None:
    one, two = [await client.open() for _ in range(WORKERS)]
    assert one.id.partition("-")[0] != two.id.partition("-")[0]
    for session in (one, two):
        assert session.is_direct
        assert (await session.step(Navigate(site.url()))).observation.title == "Home"


async def test_through_the_gateway_all_is_the_same(site: Site, relayed: BrowserClient) -> None:
    session = await relayed.open(SessionOptions(text=True))
    assert not session.is_direct
    view = await session.step(Navigate(site.url()))
    assert "Welcome" in (view.observation.text or "")
    assert (await session.step()).image is view.image
    assert (await session.screenshot()).startswith(b"\x89PNG")
    assert (await session.navigate(site.url("/next"))).title == "Next"
    assert (await session.heartbeat()).ttl_seconds > 0
    stale = session.grant
    forged = type(stale)(session.id, "wrong", stale.generation, "", 60)
    with pytest.raises(LeaseLost):
        await relayed.call(STEP, StepRequest(), grant=forged)
    await session.close()
    with pytest.raises(LeaseLost):
        await relayed.call(STEP, StepRequest(), grant=stale)


async def test_one_line_first_come_first_served(gateway: RunningGateway, client: BrowserClient) -> None:
    held = [await client.open() for _ in range(WORKERS)]
    others = [await BrowserClient(gateway.url, token=TOKEN, limits=quick()).__aenter__() for _ in range(4)]
    order: list[int] = []

    async def wait(number: int) -> None:
        session = await others[number].open()
        order.append(number)
        await session.close()

    waiting = []
    for number in range(4):
        waiting.append(asyncio.create_task(wait(number)))
        while (await client.pressure()).slots.waiting <= number:
            await asyncio.sleep(0.01)
    waiting[1].cancel()  # leaves the line, and takes no slot
    while (await client.pressure()).slots.waiting > 3:
        await asyncio.sleep(0.01)
    await held[0].close()
    await asyncio.gather(*waiting, return_exceptions=True)
    assert order == [0, 2, 3]
    await held[1].close()
    for other in others:
        await other.__aexit__()


async def test_the_line_has_an_end() -> None:
    line = SlotQueue({}, 2)
    waiting = [asyncio.create_task(line.turn(10)) for _ in range(2)]
    await asyncio.sleep(0)
    with pytest.raises(TooManyWaiting, match="2 callers wait"):
        await line.turn(10)
    assert len(line) == 2
    again = asyncio.create_task(line.turn(10, again=True))  # its worker went away: it has waited before
    waiting[0].cancel()
    await asyncio.sleep(0)
    assert len(line) == 2
    for task in (*waiting, again):
        task.cancel()
    await asyncio.gather(*waiting, again, return_exceptions=True)


async def test_a_client_has_its_limit_over_all_workers(client: BrowserClient) -> None:
    held = [await client.open() for _ in range(WORKERS)]
    third = asyncio.create_task(client.open())
    while not (await client.pressure()).slots.waiting:
        await asyncio.sleep(0.01)
    with pytest.raises(TooManySessions):
        await client.open()
    await held[0].close()  # the gateway hears of it from the worker
    await third


async def test_a_lease_that_runs_out_makes_room(gateway: RunningGateway, client: BrowserClient) -> None:
    session = await client.open(SessionOptions(ttl_seconds=0.3))
    await session.abandon()  # the client is gone, without goodbye
    await until_free(gateway)
    with pytest.raises(LeaseLost):
        await session.metadata()
    assert not gateway.gateway._quota._holders


async def test_a_connection_that_stays_holds_no_slot(gateway: RunningGateway) -> None:
    """Half open: the caller is gone, and nothing ever closes its connection."""
    port = int(gateway.url.rpartition(":")[2])
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    body = b'{"ttl_seconds": 0.3}'
    writer.write(
        b"POST /v1/sessions HTTP/1.1\r\nhost: x\r\nauthorization: Bearer %s\r\ncontent-length: %d\r\n\r\n%s"
        % (TOKEN.encode(), len(body), body)
    )
    assert b"200" in await reader.readline()
    await until_free(gateway)
    writer.close()


# --- what is seen -------------------------------------------------------------------------------------


async def test_what_is_published(gateway: RunningGateway, client: BrowserClient) -> None:
    info = await client.info()
    assert info.slots == WORKERS
    assert "Chrom" in info.browser
    assert len({worker.url for worker in info.workers}) == WORKERS
    default = EgressConfig()
    assert info.egress == EgressInfo(LOCAL.egress.allow, default.ports, default.rate), (
        "of all workers together"
    )
    session = await client.open()
    await session.metadata()
    pressure = await client.pressure()
    assert (pressure.slots.total, pressure.slots.leased) == (WORKERS, 1)
    assert pressure.operations["metadata"].done >= 1
    headers = {"authorization": f"Bearer {TOKEN}"}
    async with httpx.AsyncClient(base_url=gateway.url, headers=headers, trust_env=False, timeout=60) as http:
        health = await http.get("/healthz")
        assert (health.status_code, health.json()) == (200, {"status": "ok"})
        paths = (await http.get("/openapi.json")).json()["paths"]
        assert set(paths) == {operation.path for operation in OPERATIONS}
        async with http.stream("GET", "/v1/watch") as response:
            watched = msgspec.json.decode(await anext(response.aiter_lines()), type=Watched)
        assert watched.sessions == (session.id,)


async def test_the_load_of_all_workers_adds_up(
    site: Site, gateway: RunningGateway, client: BrowserClient
) -> None:
    """Per type of operation: in ``/pressure``, in ``/metrics`` worker by worker, and as it was done."""
    before = (await client.pressure()).operations
    for session in [await client.open() for _ in range(WORKERS)]:
        await session.navigate(site.url())
        await session.screenshot()
        await session.screenshot()
    pressure = await client.pressure()
    done = {name: load.done - before[name].done for name, load in pressure.operations.items()}
    assert (done["allocate"], done["navigate"], done["screenshot"]) == (WORKERS, WORKERS, 2 * WORKERS)
    headers = {"authorization": f"Bearer {TOKEN}"}
    async with httpx.AsyncClient(base_url=gateway.url, headers=headers, trust_env=False, timeout=60) as http:
        text = (await http.get("/metrics")).text
        each = [
            msgspec.json.decode((await http.get(f"{worker.url}/pressure")).content, type=Pressure)
            for worker in (await client.info()).workers
        ]
    families = list(text_string_to_metric_families(text))
    named = {family.name: family for family in families}
    assert len(named) == len(families), "every family once, whatever the number of workers"
    counted: Counter[str] = Counter()
    for sample in named["webgym_queue_done"].samples:
        assert sample.labels["worker"] in {worker.name for worker in gateway.gateway.workers}
        counted[sample.labels["queue"]] += int(sample.value)
    assert counted == {name: load.done for name, load in pressure.operations.items()}
    assert counted == {name: sum(one.operations[name].done for one in each) for name in counted}
    assert pressure.permits.limit == sum(one.permits.limit for one in each)
    assert [sample.value for sample in named["webgym_gateway_workers"].samples] == [WORKERS]
    assert sum(sample.value for sample in named["webgym_slots"].samples) == pressure.slots.total


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.name)
async def test_nothing_but_health_is_open(gateway: RunningGateway, operation: object) -> None:
    assert isinstance(operation, type(STEP))
    async with httpx.AsyncClient(base_url=gateway.url, trust_env=False, timeout=60) as http:
        response = await http.request(operation.method, operation.path.replace("{id}", "w1-ab"))
    assert response.status_code == (200 if operation.is_open else 401)


async def test_every_call_of_a_session_is_fenced_at_both_doors(
    gateway: RunningGateway, client: BrowserClient
) -> None:
    session = await client.open()
    grant = session.grant
    right = {SECRET_HEADER: grant.secret, GENERATION_HEADER: str(grant.generation)}
    forged: list[tuple[str, dict[str, str]]] = [
        (grant.session_id, {}),
        (grant.session_id, {**right, SECRET_HEADER: "x" * len(grant.secret)}),
        (grant.session_id, {**right, SECRET_HEADER: ""}),
        (grant.session_id, {**right, GENERATION_HEADER: str(grant.generation + 1)}),
        (grant.session_id, {**right, GENERATION_HEADER: f"0{grant.generation}"}),
        (grant.session_id + "0", right),
        (grant.session_id.upper(), right),
    ]
    authorized = {"authorization": f"Bearer {TOKEN}"}
    for door in (gateway.url, grant.endpoint):
        async with httpx.AsyncClient(base_url=door, headers=authorized, trust_env=False, timeout=60) as http:
            for operation in OPERATIONS:
                if operation.has_lease:
                    for name, headers in forged:
                        path = operation.path.replace("{id}", name)
                        answer = await http.request(operation.method, path, headers=headers)
                        assert answer.status_code == 410, (door, operation.name, name, headers)
                        assert answer.json()["error"]["code"] == "lease_lost"
            path = METADATA.path.replace("{id}", grant.session_id)
            assert (await http.request(METADATA.method, path, headers=right)).status_code == 200


async def test_bad_calls_do_not_reach_a_worker(gateway: RunningGateway, client: BrowserClient) -> None:
    headers = {"authorization": f"Bearer {TOKEN}", SECRET_HEADER: "x", GENERATION_HEADER: "1"}
    async with httpx.AsyncClient(base_url=gateway.url, headers=headers, trust_env=False, timeout=60) as http:
        for path, body, status in [
            ("/v1/sessions", b"{", 400),
            ("/v1/sessions", b"x" * 2_000_000, 413),
            ("/v1/sessions/w1-ab/step", b"x" * 2_000_000, 413),
            ("/v1/sessions/nobody/step", b"{}", 410),
            ("/v1/sessions/w999999-ab/step", b"{}", 410),
            ("/v1/sessions/w1-%0d%0aHost:/step", b"{}", 410),
            ("/v1/sessions/w1-..%2f..%2fpressure/step", b"{}", 404),
        ]:
            assert (await http.post(path, content=body)).status_code == status, path
    async with BrowserClient(gateway.url, token="wrong-token-of-tests") as other:
        with pytest.raises(Unauthorized):
            await other.open()
    with pytest.raises(ProtocolError):
        await client.open(SessionOptions(viewport=(0, 0)))
    assert (await client.pressure()).slots.leased == 0


# --- the straight way breaks ----------------------------------------------------------------------------


async def test_a_straight_way_that_is_gone_is_left(site: Site, client: BrowserClient) -> None:
    session = await client.open()
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        nowhere = f"http://127.0.0.1:{listener.getsockname()[1]}"
    session._route = SessionRoute(nowhere, True)
    assert (await session.navigate(site.url())).title == "Home"
    assert not session.is_direct


async def test_nothing_is_done_twice_when_the_straight_way_breaks(site: Site, client: BrowserClient) -> None:
    """A way that carries a call there, and never its answer back."""
    session = await client.open()
    there = session._route.base_url
    await session.navigate(site.url("/counter"))

    async def carry(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        worker = await asyncio.open_connection(*there.removeprefix("http://").split(":"))
        worker[1].write(await reader.read(65536))
        await worker[0].readline()
        worker[1].close()
        writer.close()

    carrier = await asyncio.start_server(carry, "127.0.0.1", 0)
    address = f"http://127.0.0.1:{carrier.sockets[0].getsockname()[1]}"
    async with carrier:
        session._route = SessionRoute(address, True)
        with pytest.raises(ServerUnreachable, match="observe the page before acting again"):
            await session.execute(LeftClick(Target(coordinate=(20, 20))))
        assert not session.is_direct
        assert (await session.metadata()).title == "1"
        session._route = SessionRoute(address, True)
        assert (await session.metadata()).title == "1", "asking again does no harm"


async def test_a_stranger_at_the_workers_address_is_not_taken_for_it(client: BrowserClient) -> None:
    heard: list[bytes] = []

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        heard.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(b'HTTP/1.1 200 OK\r\ncontent-length: 15\r\n\r\n{"status":"ok"}')
        writer.close()

    stranger = await asyncio.start_server(answer, "127.0.0.1", 0)
    address = f"http://127.0.0.1:{stranger.sockets[0].getsockname()[1]}"
    session = await client.open()
    async with stranger:
        grant = msgspec.structs.replace(session.grant, endpoint=address)
        assert not (await client._router.find(grant)).is_direct
    [request] = heard
    assert TOKEN.encode() not in request


# --- losses -------------------------------------------------------------------------------------------


async def test_a_killed_worker_costs_its_own_sessions_alone(
    site: Site, gateway: RunningGateway, client: BrowserClient, relayed: BrowserClient, profiles: Path
) -> None:
    one, two = await client.open(), await relayed.open()
    await asyncio.gather(one.navigate(site.url()), two.navigate(site.url()))
    for victim, other in ((one, two), (two, one)):
        pid = holder(gateway, victim)
        browsers = children()[pid].children(recursive=True)
        assert browsers
        working = asyncio.create_task(victim.navigate(site.url("/held")))
        while not (await client.pressure()).operations["navigate"].running:
            await asyncio.sleep(0.01)
        os.kill(pid, signal.SIGKILL)
        with pytest.raises(WorkerLost, match="open a new session"):
            await working
        with pytest.raises(WorkerLost):
            await victim.metadata()
        if other is two:
            assert (await other.metadata()).title == "Home"
        await asyncio.to_thread(psutil.wait_procs, browsers, 30)
        assert not any(browser.is_running() for browser in browsers)
        await until_free(gateway, 1)
    [again] = [await client.open()]
    assert (await again.navigate(site.url())).title == "Home"
    await again.close()
    await until_free(gateway)
    async with asyncio.timeout(100):
        while len(list((profiles / f"webgym-{os.getuid()}").iterdir())) > WORKERS:
            await asyncio.sleep(0.05)
    assert not gateway.gateway._quota._holders


async def test_a_worker_that_hangs_is_replaced(tmp_path: Path) -> None:
    browser = LOCAL.model_copy(update={"temporary_root": tmp_path})
    config = ServerConfig(slots=1, token=TOKEN, beat_seconds=0.2, browser=browser)
    fleet = GatewayConfig(workers=1, silent_seconds=2, answer_seconds=4, stop_seconds=1)
    async with (
        running_gateway(config, fleet) as gateway,
        BrowserClient(gateway.url, token=TOKEN, limits=quick(direct=False)) as client,
    ):
        session = await client.open()
        pid = holder(gateway, session)
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(WorkerLost):
            await session.metadata()
        assert (await client.health()).status == "no worker is running"
        again = await client.open()
        assert (await again.metadata()).url == "about:blank"
        then = holder(gateway, again)
        assert pid not in children()
    assert then not in children()
    assert list((tmp_path / f"webgym-{os.getuid()}").iterdir()) == []


async def test_a_full_line_is_told_after_a_while() -> None:
    config = ServerConfig(slots=1, token=TOKEN, allocate_seconds=0.2)
    async with (
        running_gateway(config) as gateway,
        BrowserClient(gateway.url, token=TOKEN, limits=quick()) as client,
    ):
        await until_free(gateway, 1)  # its browser is up
        await client.open()
        with pytest.raises(NoCapacity, match="1 slots were in use"):
            await client.open()
        assert gateway.gateway.workers[0].room == 0


async def test_a_client_that_waits_for_less_is_told_so_in_time(client: BrowserClient) -> None:
    for _ in range(WORKERS):
        await client.open()
    limits = quick(wait_seconds=0.1, reply_seconds=2)
    async with BrowserClient(client.base_url, token=TOKEN, limits=limits) as other:
        with pytest.raises(NoCapacity, match=r"in use for 0\.1 s"):
            await other.open()


async def test_where_no_worker_comes_up_it_is_said_why(tmp_path: Path) -> None:
    browser = LOCAL.model_copy(update={"executable": tmp_path / "none"})
    before = set(children())
    with pytest.raises(BrowserNotFound):
        async with running_gateway(ServerConfig(slots=1, browser=browser)):
            raise AssertionError
    assert set(children()) <= before
