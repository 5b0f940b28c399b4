"""Callers that stop halfway, hang up, or die without a word: none holds a slot, a lease or a connection."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import socket
import struct
import sys
from asyncio.subprocess import DEVNULL, PIPE
from pathlib import Path

import msgspec
import pytest

from webgym.core.action import Wait
from webgym.core.errors import LeaseLost
from webgym.server.client import Session
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, SessionOptions, StepRequest

from .conftest import Around, Bench

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="session")]

HANG = struct.pack("ii", 1, 0)
"""Linger for no time: closing sends a reset instead of a goodbye."""

TTL_SECONDS = 2


def head(bench: Bench, path: str, length: int, session: Session | None = None) -> bytes:
    """Of a POST whose body has this length."""
    lines = [
        f"POST {path} HTTP/1.1",
        "host: localhost",
        f"authorization: Bearer {bench.server.token}",
        f"content-length: {length}",
    ]
    if session is not None:
        grant = session.grant
        lines += [f"{SECRET_HEADER}: {grant.secret}", f"{GENERATION_HEADER}: {grant.generation}"]
    return "\r\n".join([*lines, "", ""]).encode()


async def dial(bench: Bench, **options: int) -> socket.socket:
    """A bare connection to the server."""
    host, port = bench.server.url.removeprefix("http://").split(":")
    sock = socket.socket()
    sock.setblocking(False)
    if "receive_bytes" in options:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, options["receive_bytes"])
    await asyncio.get_running_loop().sock_connect(sock, (host, int(port)))
    return sock


async def hung_up(sock: socket.socket) -> bytes:
    """What came until the server closed the connection."""
    loop = asyncio.get_running_loop()
    got = b""
    async with asyncio.timeout(100):
        try:
            while part := await loop.sock_recv(sock, 65536):
                got += part
        except ConnectionResetError:
            pass
    sock.close()
    return got


@pytest.mark.parametrize("sent", ["nothing", "half a head", "half a body"])
async def test_half_a_request_takes_no_slot_and_is_hung_up_on(fault: Around, sent: str) -> None:
    async with fault() as bench:
        whole = head(bench, "/v1/sessions", 100)
        sock = await dial(bench)
        sock.send({"nothing": b"", "half a head": whole[:40], "half a body": whole + b'{"mode":'}[sent])
        assert (await bench.client.pressure()).slots.leased == 0
        assert await hung_up(sock) == b""


async def test_half_a_step_does_not_hold_up_its_session(fault: Around) -> None:
    async with fault() as bench:
        session, _ = await bench.open()
        sock = await dial(bench)
        sock.send(head(bench, f"/v1/sessions/{session.id}/step", 100, session) + b'{"action":')
        assert (await session.step()).observation.title == "calm"
        assert await hung_up(sock) == b""
        await session.close()


async def test_who_stops_reading_is_hung_up_on(fault: Around) -> None:
    async with fault() as bench:
        session, _ = await bench.open("/noise", viewport=(2000, 1300))
        picture = len(await session.screenshot())
        assert picture > 6_000_000, "more than fits into the kernel's buffers"
        connections = len(bench.descriptors("socket"))
        sock = await dial(bench, receive_bytes=4096)
        body = msgspec.json.encode(StepRequest())
        sock.send(head(bench, f"/v1/sessions/{session.id}/step", len(body), session) + body)
        await bench.until(lambda: len(bench.descriptors("socket")) == connections + 2)
        assert len(await session.screenshot()) == picture, "others are served meanwhile"
        await session.close()
        await bench.until(lambda: len(bench.descriptors("socket")) <= connections + 1)
        sock.close()


async def test_a_reset_in_the_middle_of_a_step(fault: Around) -> None:
    async with fault() as bench:
        session, _ = await bench.open(ttl_seconds=1)
        sock = await dial(bench)
        body = msgspec.json.encode(StepRequest(Wait(2)))
        sock.send(head(bench, f"/v1/sessions/{session.id}/step", len(body), session) + body)
        await bench.until(lambda: bench.server.service.gate.permits.running)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, HANG)
        sock.close()
        await session.abandon()
        await bench.until(lambda: len(bench.server.service.leases) == 0)
        with pytest.raises(LeaseLost) as caught:
            await session.metadata()
        assert caught.value.hint


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
async def test_a_client_that_dies_loses_its_lease(fault: Around, end: signal.Signals) -> None:
    """Killed, its connections close; stopped (or without power), they stay open and silent."""
    async with fault() as bench:
        client = await asyncio.create_subprocess_exec(
            sys.executable,
            str(Path(__file__).with_name("client_apart.py")),
            bench.server.url,
            bench.server.token,
            bench.pages,
            str(TTL_SECONDS),
            stdout=PIPE,
            stderr=DEVNULL,
        )
        assert client.stdout is not None
        try:
            name = (await client.stdout.readline()).decode().strip()
            leases = bench.server.service.leases
            lease, expired = leases._leases[name], leases.expired
            first = lease.expires
            await bench.until(lambda: lease.expires > first + TTL_SECONDS)  # as it says that it lives
            assert len(leases) == 1
            client.send_signal(end)
            await bench.until(lambda: len(leases) == 0)
            assert leases.expired == expired + 1
        finally:
            with contextlib.suppress(ProcessLookupError):
                client.kill()
            await client.communicate()


async def test_many_connections_come_and_go(fault: Around) -> None:
    async with fault() as bench:
        for _ in range(5):
            socks = await asyncio.gather(*(dial(bench) for _ in range(40)))
            for number, sock in enumerate(socks):
                sock.send(head(bench, "/v1/sessions", 10)[: number * 5])
                if number % 2:
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, HANG)
                sock.close()
        session, _ = await bench.open()
        await session.close()


async def test_who_opens_and_hangs_up_at_once_leaves_no_lease(fault: Around) -> None:
    async with fault() as bench:
        for _ in range(6):
            sock = await dial(bench)
            body = msgspec.json.encode(SessionOptions(ttl_seconds=1))
            sock.send(head(bench, "/v1/sessions", len(body)) + body)
            sock.close()
        await bench.until(lambda: len(bench.server.service.leases) == 0)
