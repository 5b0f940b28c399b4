"""The front: authentication, limits, typed errors, what is published; and a client that finds none of it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
import pytest_asyncio
from prometheus_client.parser import text_string_to_metric_families

from webgym.core.errors import (
    BrowserLaunchFailed,
    ConfigError,
    ProtocolError,
    ServerUnreachable,
    TooManySessions,
    TooManyWaiting,
    Unauthorized,
)
from webgym.server.client import BrowserClient
from webgym.server.config import ServerConfig
from webgym.server.http import error_response
from webgym.server.messages import SessionOptions, Watched
from webgym.server.operations import OPERATIONS
from webgym.server.pool import Pool
from webgym.server.worker import RunningServer, running_server

from .conftest import TOKEN, quick

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


@pytest_asyncio.fixture(loop_scope="module")
async def http(server: RunningServer) -> AsyncIterator[httpx.AsyncClient]:
    headers = {"authorization": f"Bearer {TOKEN}"}
    async with httpx.AsyncClient(
        base_url=server.url, headers=headers, trust_env=False, timeout=60, verify=False
    ) as http:
        yield http


def error(response: httpx.Response) -> tuple[int, str]:
    return response.status_code, response.json()["error"]["code"]


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda operation: operation.name)
@pytest.mark.parametrize("authorization", ["", "Bearer wrong", f"Basic {TOKEN}", TOKEN, "Bearer ü"])
async def test_nothing_but_health_is_open(
    http: httpx.AsyncClient, operation: Any, authorization: str
) -> None:
    path = operation.path.replace("{id}", "x")
    headers = {"authorization": authorization.encode()}
    response = await http.request(operation.method, path, headers=headers)  # type: ignore[arg-type]
    if operation.name == "health":
        assert response.json() == {"status": "ok"}
    else:
        assert error(response) == (401, "unauthorized")


@pytest.mark.parametrize(
    "body",
    [
        b"{",
        b"[]",
        b'{"action": {"name": "fly"}}',
        b'{"action": {"name": "answer", "text": "x"}}',
        b'{"action": {"name": "left_click", "target": {"coordinate": [5000, 1]}}}',
        b'{"action": {"name": "left_click", "target": {}}}',
        b"\xff\xfe",
    ],
)
async def test_a_broken_request_is_a_protocol_error(http: httpx.AsyncClient, body: bytes) -> None:
    grant = (await http.post("/v1/sessions", json={})).json()
    headers = {"x-webgym-secret": grant["secret"], "x-webgym-generation": str(grant["generation"])}
    path = f"/v1/sessions/{grant['session_id']}"
    assert error(await http.post(f"{path}/step", content=body, headers=headers)) == (400, "protocol_error")
    assert (await http.delete(path, headers=headers)).json() == {"session_id": grant["session_id"]}
    assert error(await http.delete(path, headers=headers)) == (410, "lease_lost")


@pytest.mark.parametrize(
    "part",
    [
        {"name": ""},
        {"name": "a;b"},
        {"name": "a b"},
        {"name": "__Host-a"},
        {"value": "two\nlines"},
        {"value": "x" * 5000},
        {"domain": ""},
        {"domain": "http://a.test"},
        {"domain": "999.1.1.1"},
        {"domain": "[::"},
        {"path": "nowhere"},
        {"path": "/" + "x" * 2000},
    ],
)
async def test_a_malformed_cookie_is_refused_before_a_browser_sees_it(
    http: httpx.AsyncClient, server: RunningServer, part: dict[str, str]
) -> None:
    cookie = {"name": "visitor", "value": "v 17", "domain": ".a.test"}
    slots = server.service.pool.slots
    while not all(slot.launches for slot in slots):  # the second starts beside the first requests
        await asyncio.sleep(0.01)
    before = [slot.launches for slot in slots]
    refused = await http.post("/v1/sessions", json={"cookies": [cookie, cookie | part]})
    assert error(refused) == (400, "protocol_error")
    assert [slot.launches for slot in slots] == before
    taken = (await http.post("/v1/sessions", json={"cookies": [cookie]})).json()
    headers = {"x-webgym-secret": taken["secret"], "x-webgym-generation": str(taken["generation"])}
    assert (await http.delete(f"/v1/sessions/{taken['session_id']}", headers=headers)).is_success


async def test_a_large_body_is_refused(http: httpx.AsyncClient) -> None:
    response = await http.post("/v1/sessions", content=b"x" * 2_000_000)
    assert error(response) == (413, "protocol_error")


async def test_unknown_paths_and_methods(http: httpx.AsyncClient) -> None:
    assert error(await http.get("/v2/sessions")) == (404, "protocol_error")
    assert error(await http.get("/v1/sessions")) == (405, "protocol_error")
    for path in ("/v1/info/", "//v1/info", "/v1/../../etc/passwd", "/v1/sessions/a%2fb/step"):
        assert error(await http.get(path)) == (404, "protocol_error"), path


async def test_what_is_published(http: httpx.AsyncClient) -> None:
    info = (await http.get("/v1/info")).json()
    assert info["slots"] == 2
    assert "Chrom" in info["browser"]
    assert info["sandboxed"] or info["sandbox_reason"], "never silently without a sandbox"
    pressure = (await http.get("/pressure")).json()
    assert set(pressure["operations"]) == {
        "navigate",
        "execute",
        "screenshot",
        "metadata",
        "allocate",
        "release",
    }
    answer = await http.get("/metrics")
    assert answer.headers["content-type"] == "text/plain; version=0.0.4; charset=utf-8"
    families = {family.name: family for family in text_string_to_metric_families(answer.text)}
    assert families["webgym_operation_seconds"].type == "histogram"
    assert families["webgym_browser_launches"].type == "counter"
    assert families["webgym_egress_open"].type == "gauge"
    waiting = {
        sample.labels["queue"]: sample.value
        for sample in families["webgym_queue_calls"].samples
        if sample.labels["state"] == "waiting"
    }
    assert waiting == {name: load["waiting"] for name, load in pressure["operations"].items()}


async def test_the_openapi_document_holds_together(http: httpx.AsyncClient) -> None:
    text = (await http.get("/openapi.json")).text
    document = json.loads(text)
    assert document["openapi"].startswith("3.1")
    assert set(document["paths"]) == {operation.path for operation in OPERATIONS}
    ids = [call["operationId"] for path in document["paths"].values() for call in path.values()]
    assert sorted(ids) == sorted(operation.name for operation in OPERATIONS)
    schemas = document["components"]["schemas"]
    assert _references(document) <= {f"#/components/schemas/{name}" for name in schemas}
    assert {"SessionOptions", "StepRequest", "LeftClick", "Observation", "ErrorReply"} <= set(schemas)
    for path, calls in document["paths"].items():
        for call in calls.values():
            named = {one["name"] for one in call.get("parameters", ()) if one["in"] == "path"}
            assert named == ({"id"} if "{id}" in path else set())


def _references(node: object) -> set[str]:
    if isinstance(node, dict):
        here = {node["$ref"]} if "$ref" in node else set()
        return here.union(*(_references(value) for value in node.values()))
    if isinstance(node, list):
        return set().union(*(_references(value) for value in node))
    return set()


async def test_a_wrong_token(server: RunningServer) -> None:
    async with BrowserClient(server.url, token="wrong") as client:
        assert (await client.health()).status == "ok"
        with pytest.raises(Unauthorized):
            await client.open()
    with pytest.raises(ProtocolError):
        BrowserClient(server.url, token="tökén–")


async def test_nobody_is_there() -> None:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        port = listener.getsockname()[1]
    for address in (f"http://127.0.0.1:{port}", "http://no-such-host.invalid", "ftp://x", "nonsense"):
        async with BrowserClient(address, token=TOKEN, limits=quick()) as client:
            with pytest.raises(ServerUnreachable):
                await client.health()


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (b"HTTP/1.1 200 OK\r\ncontent-length: 6\r\n\r\n<html>", ProtocolError),
        (b"HTTP/1.1 500 Oh\r\ncontent-length: 6\r\n\r\n<html>", ProtocolError),
        (b"HTTP/1.1 200 OK\r\ncontent-length: 100\r\n\r\n{", ServerUnreachable),
        (b"", ServerUnreachable),
        (b"SSH-2.0\r\n\r\n", ServerUnreachable),
        (None, ServerUnreachable),
    ],
    ids=["html", "500", "cut off", "nothing", "no http", "silence"],
)
async def test_something_else_is_there(answer: bytes | None, expected: type[Exception]) -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        if answer is None:  # which is not waited for long
            await reader.read()
        writer.write(answer or b"")
        await writer.drain()
        writer.close()

    stranger = await asyncio.start_server(serve, "127.0.0.1", 0)
    address = f"http://127.0.0.1:{stranger.sockets[0].getsockname()[1]}"
    limits, why = (quick(reply_seconds=0.3), "in time") if answer is None else (quick(), None)
    async with stranger, BrowserClient(address, token=TOKEN, limits=limits) as client:
        with pytest.raises(expected, match=why):
            await client.info()


async def test_a_taken_port_is_said(server: RunningServer) -> None:
    port = int(server.url.rsplit(":", 1)[1])
    with pytest.raises(ConfigError, match="cannot be listened on"):
        async with running_server(ServerConfig(port=port, slots=1)):
            raise AssertionError


async def test_a_random_token_is_made_and_stays_out_of_sight() -> None:
    config = ServerConfig(slots=1, token=TOKEN)
    assert TOKEN not in repr(config)
    async with running_server(ServerConfig(slots=1)) as one, running_server(ServerConfig(slots=1)) as two:
        assert one.token != two.token
        assert len(one.token) >= 32


async def test_health_says_which_run_of_the_server_it_is(server: RunningServer) -> None:
    async with httpx.AsyncClient(base_url=server.url, trust_env=False, timeout=60) as http:
        response = await http.get("/healthz")
        assert response.headers["x-webgym-instance"] == server.instance
        assert len(server.instance) == 16


async def test_health_is_503_where_no_browser_comes_up() -> None:
    config = ServerConfig(slots=1, token=TOKEN, relaunch_seconds=(0.05, 0.05))
    async with (
        running_server(config) as server,
        BrowserClient(server.url, token=TOKEN, limits=quick()) as client,
    ):
        pool = server.service.pool
        [slot] = pool.slots
        slot.executable = slot.executable.with_name("is-no-more")
        await slot.stop()
        with pytest.raises(BrowserLaunchFailed):
            await client.open()
        async with asyncio.timeout(100):
            while (await client.health()).status == "ok":
                await asyncio.sleep(0.01)
        async with httpx.AsyncClient(trust_env=False, timeout=60) as http:
            response = await http.get(f"{server.url}/healthz")
        assert response.status_code == 503
        assert response.json() == {"status": "no browser starts"}


@pytest.mark.parametrize("part", ["line", "headers"])
async def test_an_endless_head_is_cut_off(server: RunningServer, part: str) -> None:
    host, port = server.url.removeprefix("http://").split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    start, more = {"line": (b"GET /", b"x" * 4096), "headers": (b"GET / HTTP/1.1\r\n", b"a: b\r\n" * 700)}[
        part
    ]
    writer.write(start)
    sent = 0
    with contextlib.suppress(ConnectionError):
        while not reader.at_eof() and sent < 100 * 2**20:
            writer.write(more)
            await writer.drain()
            sent += len(more)
            if await _has_answer(reader):
                break
    assert sent < 2**20, "the server keeps what has no end"
    writer.close()


async def _has_answer(reader: asyncio.StreamReader) -> bool:
    try:
        async with asyncio.timeout(0.001):
            return b"400" in await reader.read(100)
    except TimeoutError:
        return False


async def test_one_client_may_not_take_every_slot(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("webgym.server.worker.SHORTEST_TTL_SECONDS", 0)
    config = ServerConfig(slots=3, token=TOKEN, sessions_per_client=1)
    async with (
        running_server(config) as server,
        BrowserClient(server.url, token=TOKEN, limits=quick()) as one,
        BrowserClient(server.url, token=TOKEN, limits=quick()) as two,
        BrowserClient(server.url, token=TOKEN, limits=quick()) as three,
    ):
        session = await one.open()
        with pytest.raises(TooManySessions):
            await one.open()
        await two.open()
        await session.close()
        await one.open()
        for _ in range(3):  # each has run out before it is written down
            await three.open(SessionOptions(ttl_seconds=1e-9))


async def test_whoever_watches_hears_of_every_change(http: httpx.AsyncClient, client: BrowserClient) -> None:
    async with http.stream("GET", "/v1/watch") as response:
        lines = response.aiter_lines()
        first = msgspec.json.decode(await anext(lines), type=Watched)
        assert first.sessions == ()
        session = await client.open()
        async with asyncio.timeout(100):
            async for line in lines:
                now = msgspec.json.decode(line, type=Watched)
                if now.sessions:
                    break
        assert now.sessions == (session.id,)
        assert now.slots.leased == 1
        assert (now.asked, now.granted) == (first.asked + 1, first.granted + 1)
        await session.close()
        async with asyncio.timeout(100):
            while msgspec.json.decode(await anext(lines), type=Watched).slots.free < 2:
                pass


async def test_who_finds_the_line_full_is_told_when_to_come_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pool, "is_healthy", True)  # without a browser
    with pytest.raises(TooManyWaiting, match="0 callers wait for a slot already") as refused:
        await Pool(ServerConfig(waiting=0), Path("browser")).acquire()
    answer = error_response(refused.value)
    assert (answer.status_code, answer.headers["retry-after"]) == (429, "5")
