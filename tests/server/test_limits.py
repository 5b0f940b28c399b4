"""What a caller may do to the server's front, without a token and with one: nothing holds it up for ever."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import psutil
import pytest
from prometheus_client import CollectorRegistry
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from webgym.core.errors import ProtocolError, WebGymError
from webgym.server.callers import Tokens
from webgym.server.config import ServerConfig
from webgym.server.http import HttpFrontend, decode
from webgym.server.listening import listen, serving
from webgym.server.messages import StepRequest, error_of
from webgym.server.metrics import CallMetrics
from webgym.server.operations import INFO, STEP

TOKEN = "a-token-for-tests-only"
BODY_BYTES = 10_000
HEAD_BYTES = 4_000
LARGE = 32 * 2**20
"""More than the kernel buffers."""
SOON = 10.0
"""Seconds within which what must happen at once has happened, on the slowest machine."""

AUTHORIZED = f"authorization: Bearer {TOKEN}\r\n".encode()


class Served:
    """A front with one operation that takes a body, and what became of its calls."""

    def __init__(self, config: ServerConfig) -> None:
        self.front = HttpFrontend(Tokens(TOKEN), config.body_bytes, "", CallMetrics(CollectorRegistry()))
        self.release = asyncio.Event()
        take = Route("/take", self.front.endpoint(STEP, self._take), methods=["POST"])
        hold = Route("/hold", self.front.endpoint(INFO, self._hold), methods=["GET"])
        large = Route("/large", self.front.endpoint(INFO, self._large), methods=["GET"])
        self._routes = Starlette(routes=[take, hold, large])
        self.in_flight = 0
        self.port = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.in_flight += 1
        try:
            await self._routes(scope, receive, send)
        finally:
            self.in_flight -= 1

    async def _take(self, request: Request) -> bytes:
        return str(len(await self.front.body(request))).encode()

    async def _hold(self, _: Request) -> bytes:
        await self.release.wait()
        return b"released"

    async def _large(self, _: Request) -> bytes:
        return bytes(LARGE)

    def established(self) -> int:
        """Connections that the server's side holds."""
        found = psutil.Process().net_connections(kind="tcp4")
        ours = [one for one in found if one.laddr.port == self.port]
        return sum(one.status == psutil.CONN_ESTABLISHED for one in ours)

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection("127.0.0.1", self.port)

    async def answer(self, request: bytes) -> bytes:
        """What comes back, until the server closes the connection."""
        reader, writer = await self.connect()
        writer.write(request)
        try:
            return await everything(reader)
        finally:
            writer.close()


@asynccontextmanager
async def served(**limits: float) -> AsyncIterator[Served]:
    values = {"body_bytes": BODY_BYTES, "head_bytes": HEAD_BYTES, "token": TOKEN} | limits
    config = ServerConfig.model_validate(values)
    made = Served(config)
    with contextlib.closing(listen(config)) as listener:
        made.port = listener.getsockname()[1]
        async with serving(made, listener, config):
            yield made
            made.release.set()


async def until(holds: Callable[[], bool], seconds: float = SOON) -> None:
    async with asyncio.timeout(seconds):
        while not holds():
            await asyncio.sleep(0.01)


async def everything(reader: asyncio.StreamReader) -> bytes:
    got = bytearray()
    async with asyncio.timeout(SOON):
        with contextlib.suppress(ConnectionResetError):
            while part := await reader.read(65536):
                got += part
    return bytes(got)


def post(body: bytes, *headers: bytes) -> bytes:
    lines = [b"host: x", b"connection: close", *headers]
    return b"POST /take HTTP/1.1\r\n" + AUTHORIZED + b"\r\n".join(lines) + b"\r\n\r\n" + body


def chunked(*parts: bytes) -> bytes:
    return b"".join(b"%x\r\n%b\r\n" % (len(part), part) for part in parts) + b"0\r\n\r\n"


CHUNKED = b"transfer-encoding: chunked"


async def test_bodies_up_to_the_limit_are_taken_however_they_come() -> None:
    whole = b"x" * BODY_BYTES
    async with served() as server:
        plain = await server.answer(post(whole, b"content-length: %d" % len(whole)))
        parts = await server.answer(post(chunked(whole[:1], whole[1:]), CHUNKED))
        bytewise = await server.answer(post(chunked(*[b"x"] * 3000), CHUNKED))
        assert plain.endswith(str(BODY_BYTES).encode())
        assert parts.endswith(str(BODY_BYTES).encode())
        assert bytewise.endswith(b"3000")


@pytest.mark.parametrize("how", ["with its length", "in chunks", "without end"])
async def test_a_body_over_the_limit_is_refused(how: str) -> None:
    large = b"x" * (BODY_BYTES + 1)
    request = {
        "with its length": post(large, b"content-length: %d" % len(large)),
        "in chunks": post(chunked(*[b"x" * 1000] * 11), CHUNKED),
        "without end": post(b"%x\r\n" % 2**40 + large, CHUNKED),
    }[how]
    async with served() as server:
        reader, writer = await server.connect()
        writer.write(request)
        async with asyncio.timeout(SOON):
            head = await reader.readuntil(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 413 ")
        writer.close()


@pytest.mark.parametrize("authorized", [True, False])
async def test_who_goes_on_sending_is_cut_off(authorized: bool) -> None:
    """With a token or without: a refused body does not keep us reading for ever."""
    async with served() as server:
        _, writer = await server.connect()
        head = post(b"", CHUNKED)
        writer.write(head if authorized else head.replace(TOKEN.encode(), b"wrong"))
        part = chunked(b"x" * 1000).removesuffix(b"0\r\n\r\n")

        async def send_for_ever() -> None:
            while True:
                writer.write(part)
                await writer.drain()
                await asyncio.sleep(0)  # to learn of the other end

        with pytest.raises(ConnectionError):
            await asyncio.wait_for(send_for_ever(), SOON)
        writer.close()


@pytest.mark.parametrize(
    "head",
    [
        b"GET /" + b"x" * HEAD_BYTES + b" HTTP/1.1\r\n\r\n",
        b"GET /" + b"x" * HEAD_BYTES,
        b"GET / HTTP/1.1\r\nx: " + b"x" * HEAD_BYTES + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nx: " + b"x" * HEAD_BYTES,
        b"GET / HTTP/1.1\r\n" + b"x: y\r\n" * HEAD_BYTES,
        b"GET / HTTP/1.1\r\n" + b"x" * HEAD_BYTES,
    ],
    ids=["url", "endless url", "header", "endless header", "headers", "endless name"],
)
async def test_a_long_head_is_refused(head: bytes) -> None:
    async with served() as server:
        assert f"larger than {HEAD_BYTES} bytes" in refused(await server.answer(head)).message


@pytest.mark.parametrize(
    "request_",
    [
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"BREW /take HTTP/1.1\r\n\r\n",
        b"GET /ta ke HTTP/1.1\r\n\r\n",
        post(b"", b"content-length: -5"),
        post(b"{}", b"content-length: 2", b"content-length: 3"),
        post(chunked(b"x"), b"content-length: 2", CHUNKED),
        post(b"nonsense\r\n", CHUNKED),
        b"GET / HTTP/1.1\r\nbad\x00name: x\r\n\r\n",
    ],
    ids=["tls", "http2", "method", "path", "below zero", "two lengths", "length and chunks", "chunk", "name"],
)
async def test_what_is_not_http_is_told_so(request_: bytes) -> None:
    async with served() as server:
        assert "HTTP/1.1" in refused(await server.answer(request_)).message


def refused(answer: bytes) -> WebGymError:
    """The typed error of a refusal by the protocol."""
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400 ")
    assert f"content-length: {len(body)}".encode() in head
    error = error_of(body, 400, "")
    assert isinstance(error, ProtocolError)
    return error


async def test_a_long_body_is_not_taken_for_a_long_head() -> None:
    """Three requests over one connection, each with more than a head may have."""
    body = b"x" * BODY_BYTES
    request = post(body, b"content-length: %d" % len(body)).replace(b"connection: close\r\n", b"")
    async with served() as server:
        reader, writer = await server.connect()
        for _ in range(3):
            writer.write(request)
            async with asyncio.timeout(SOON):
                assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200 ")
                assert await reader.readexactly(len(str(BODY_BYTES))) == str(BODY_BYTES).encode()
        writer.close()


@pytest.mark.parametrize(
    ("start", "drop"),
    [
        (b"", b""),
        (b"\r\n", b"\r\n"),
        (b"POST /take HTTP/1.1\r\nx: ", b"x"),
        (post(b"", b"content-length: 1000"), b"x"),
        (post(b"", CHUNKED), b"1\r\nx\r\n"),
        (post(chunked(b"x")[:-2], CHUNKED) + b"x: ", b"x"),
    ],
    ids=["nothing", "empty lines", "head", "body", "chunks", "trailer"],
)
async def test_a_request_that_trickles_in_is_cut_off(start: bytes, drop: bytes) -> None:
    async with served(receive_seconds=0.3) as server:
        reader, writer = await server.connect()
        writer.write(start)
        gone = asyncio.create_task(everything(reader))
        with contextlib.suppress(ConnectionError):
            while not gone.done():
                writer.write(drop)
                await writer.drain()
                await asyncio.sleep(0.02)
        assert await gone == b""
        await until(lambda: server.in_flight == 0)
        writer.close()


async def test_a_call_that_takes_long_is_not_cut_off_for_it() -> None:
    """Only requests must be quick, not what they ask for; nor must a model that thinks between them."""
    async with served(receive_seconds=0.2) as server:
        reader, writer = await server.connect()
        for _ in range(2):
            server.release.clear()
            writer.write(b"GET /hold HTTP/1.1\r\nhost: x\r\n" + AUTHORIZED + b"\r\n")
            await asyncio.sleep(0.5)  # over twice as long as a request may take
            server.release.set()
            async with asyncio.timeout(SOON):
                assert (await reader.readuntil(b"released")).startswith(b"HTTP/1.1 200 ")
            await asyncio.sleep(0.5)
        writer.close()


async def test_connections_are_counted() -> None:
    async with served(connections=3) as server:
        held = [await server.connect() for _ in range(3)]
        held[0][1].write(b"GET /hold HTTP/1.1\r\nhost: x\r\n" + AUTHORIZED + b"\r\n")
        assert await server.answer(b"GET /hold HTTP/1.1\r\n\r\n") == b"", "one too many"
        server.release.set()
        async with asyncio.timeout(SOON):
            assert (await held[0][0].readuntil(b"released")).startswith(b"HTTP/1.1 200 ")
        held[1][1].close()
        async with asyncio.timeout(SOON):  # until it has noticed
            while not await server.answer(b"GET /none HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n"):
                await asyncio.sleep(0.01)
        for _, writer in held:
            writer.close()


async def test_an_answer_that_nobody_reads_is_given_up() -> None:
    """A peer that is there and takes nothing: its kernel acknowledges, its program does not read."""
    async with served(dead_peer_seconds=1) as server:
        with contextlib.closing(socket.socket()) as deaf:
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            deaf.setblocking(False)
            await asyncio.get_running_loop().sock_connect(deaf, ("127.0.0.1", server.port))
            deaf.send(b"GET /large HTTP/1.1\r\nhost: x\r\n" + AUTHORIZED + b"\r\n")
            await until(lambda: server.established() == 1)
            await until(lambda: server.established() == 0, seconds=60)  # the kernel's timers are coarse


@pytest.mark.parametrize("body", [b'{"x":' + b"[" * 100_000, b'{"action":' * 50_000, b"[" * 100_000])
def test_deep_nesting_is_a_broken_request(body: bytes) -> None:
    with pytest.raises(ProtocolError):
        decode(body, StepRequest)


async def test_a_call_that_outlasts_the_servers_end_is_told_so(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.server.listening.SHUTDOWN_SECONDS", 1)
    async with served() as server:
        request = b"GET /hold HTTP/1.1\r\nhost: x\r\nconnection: close\r\n" + AUTHORIZED + b"\r\n"
        answer = asyncio.create_task(server.answer(request))
        await until(lambda: server.in_flight == 1)
        server.release = asyncio.Event()  # the one that the call waits for is never set
    assert b'"server_unreachable"' in await answer
    assert "Exception in ASGI application" not in caplog.text
