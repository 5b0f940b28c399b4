"""Servers that must not be reached, and a way out that can be told what names mean."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from ipaddress import ip_address

from aiodns.error import ARES_ENOTFOUND, DNSError

from webgym.browser.egress.hosts import Address
from webgym.browser.egress.resolver import Machine

HERE = "127.0.0.1"

REPLY = (
    b"HTTP/1.1 200 OK\r\nContent-Length: 6\r\nContent-Type: text/html\r\n"
    b"Access-Control-Allow-Origin: *\r\nConnection: close\r\n\r\nsecret"
)


class Canary:
    """Counts whoever connects, whatever is said, and answers any request with a secret."""

    def __init__(self) -> None:
        self.port = 0
        self.visits = 0
        self.seen = asyncio.Event()

    async def __call__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.visits += 1
        self.seen.set()
        try:
            await reader.readuntil(b"\r\n\r\n")
            writer.write(REPLY)
            await writer.drain()
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            writer.close()


class UdpCanary(asyncio.DatagramProtocol):
    """Counts datagrams."""

    def __init__(self) -> None:
        self.port = 0
        self.visits = 0
        self.seen = asyncio.Event()

    def datagram_received(self, data: bytes, addr: object) -> None:
        self.visits += 1
        self.seen.set()


@asynccontextmanager
async def canary(host: str = HERE, port: int = 0) -> AsyncIterator[Canary]:
    bird = Canary()
    server = await asyncio.start_server(bird, host, port)
    bird.port = server.sockets[0].getsockname()[1]
    async with server:
        yield bird


@asynccontextmanager
async def udp_canary() -> AsyncIterator[UdpCanary]:
    loop = asyncio.get_running_loop()
    transport, bird = await loop.create_datagram_endpoint(UdpCanary, (HERE, 0))
    bird.port = transport.get_extra_info("sockname")[1]
    try:
        yield bird
    finally:
        transport.close()


class Names(Machine):
    """This machine with another name service: no test ever asks a real one.

    Args:
        answers: addresses by name; a list of such answers is given one after the other, the last for ever.
    """

    def __init__(self, answers: Mapping[str, Sequence[str] | Sequence[Sequence[str]]] | None = None) -> None:
        super().__init__()
        self.answers = {name: list(given) for name, given in (answers or {}).items()}
        self.asked: list[str] = []

    async def lookup(self, name: str) -> list[Address]:
        self.asked.append(name)
        if name == "localhost":
            return [ip_address("127.0.0.1"), ip_address("::1")]
        given = self.answers.get(name)
        if not given:
            raise DNSError(ARES_ENOTFOUND, "no such name")
        if isinstance(given[0], str):
            return [ip_address(str(one)) for one in given]
        answer = given.pop(0) if len(given) > 1 else given[0]
        return [ip_address(one) for one in answer]


def has_ipv6() -> bool:
    """Whether this machine can listen on ``::1``."""
    try:
        with socket.create_server(("::1", 0), family=socket.AF_INET6):
            return True
    except OSError:
        return False
