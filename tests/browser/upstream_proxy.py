"""Stand-ins for the upstream proxies that people rent: HTTP CONNECT and SOCKS5, with a password."""

from __future__ import annotations

import asyncio
import base64
import contextlib
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any, Literal

from .canary import HERE
from .test_egress_proxy import serve

NAME, PASSWORD = "ann", "s3cret-of-the-proxy"
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class UpstreamProxy:
    """Looks names up in a table of ports of this machine; what it does not know cannot be reached.

    Attributes:
        asked: the tunnels that were opened or refused: user name, host and port.
        refusal: what is answered to every request: an HTTP status, or a reply of SOCKS; ``None`` to connect.
        hangs_up: whether it hangs up on everybody at once.
        hangs_up_on: the host for which it does so instead of an answer (HTTP alone).
    """

    def __init__(self, kind: Literal["http", "socks5"], places: Mapping[str, int]) -> None:
        self.kind, self.places = kind, places
        self.port = 0
        self.asked: list[tuple[str, str, int]] = []
        self.refusal: int | None = None
        self.hangs_up = False
        self.hangs_up_on = ""
        self.password = PASSWORD
        self._writers: set[asyncio.StreamWriter] = set()

    def settings(self, **more: Any) -> dict[str, Any]:
        return {"address": f"{self.kind}://{HERE}:{self.port}", "credentials": "$UPSTREAM", **more}

    def cut(self) -> None:
        """Drop all tunnels, in the middle of whatever they carry."""
        for writer in tuple(self._writers):
            writer.transport.abort()

    async def __call__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            if not self.hangs_up:
                await (self._http if self.kind == "http" else self._socks)(reader, writer)
        finally:
            self._writers.discard(writer)

    async def _http(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        lines = dict(line.split(": ", 1) for line in head.split("\r\n")[1:] if line)
        user, _, password = (
            base64.b64decode(lines.get("Proxy-Authorization", "").rpartition(" ")[2]).decode().partition(":")
        )
        host, _, port = head.split()[1].rpartition(":")
        if password != self.password:
            writer.write(b"HTTP/1.1 407 Proxy Authentication Required\r\nContent-Length: 0\r\n\r\n")
            return
        if host == self.hangs_up_on:
            return
        streams = await self._reach(user, host.strip("[]"), int(port))
        if streams is None:
            writer.write(f"HTTP/1.1 {self.refusal or 502} no\r\n\r\n".encode())
            return
        parts = (b"HTTP/1.1 20", b"0 Connection established\r\nVia: x\r", b"\n\r", b"\n")
        await self._join((reader, writer), streams, parts)

    async def _socks(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        _, count = await reader.readexactly(2)
        if 2 not in await reader.readexactly(count):
            writer.write(b"\5\xff")
            return
        writer.write(b"\5\2")
        user, password = [
            (await reader.readexactly(size)).decode()
            for size in ((await reader.readexactly(2))[1], 0)
            for size in (size or (await reader.readexactly(1))[0],)
        ]
        writer.write(b"\1\0" if password == self.password else b"\1\1")
        if password != self.password:
            return
        kind = (await reader.readexactly(4))[3]
        size = {1: 4, 4: 16}.get(kind) or (await reader.readexactly(1))[0]
        address = await reader.readexactly(size)
        host = address.decode() if kind == 3 else ".".join(map(str, address))
        port = int.from_bytes(await reader.readexactly(2), "big")
        streams = await self._reach(user, host, port)
        if streams is None:
            writer.write(bytes((5, self.refusal or 4, 0, 3, 4)) + b"exit\0\0")
        else:
            await self._join((reader, writer), streams, (b"\5\0\0", b"\3\4ex", b"it\0\0"))

    async def _reach(self, user: str, host: str, port: int) -> Streams | None:
        self.asked.append((user, host, port))
        place = self.places.get(f"{host}:{port}") or self.places.get(host)
        return await asyncio.open_connection(HERE, place) if place and self.refusal is None else None

    async def _join(self, one: Streams, other: Streams, answer: tuple[bytes, ...]) -> None:
        """Answer in pieces, and forward both ways."""

        async def forward(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            with contextlib.suppress(ConnectionError):
                while data := await reader.read(65536):
                    writer.write(data)
                    await writer.drain()
            writer.close()

        try:
            for part in answer:
                one[1].write(part)
                await asyncio.sleep(0.001)
            await asyncio.gather(forward(one[0], other[1]), forward(other[0], one[1]))
        finally:
            other[1].close()


@asynccontextmanager
async def upstream_proxy(
    kind: Literal["http", "socks5"], places: Mapping[str, int]
) -> AsyncIterator[UpstreamProxy]:
    proxy = UpstreamProxy(kind, places)
    async with serve(proxy) as proxy.port:
        yield proxy
