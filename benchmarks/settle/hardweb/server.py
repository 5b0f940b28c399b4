"""The server of the pages, which responds late, in chunks, with redirects, or never, and is deterministic.

It serves one request per connection, so that results do not depend on the browser's sharing of connections.
Delays are given in the address, in milliseconds, and are multiplied by ``pace``.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import hashlib
import re
import struct
import zlib
from collections.abc import Awaitable, Callable
from urllib.parse import parse_qsl, urlsplit

from benchmarks.settle.hardweb.pages import OTHER_HOST, PAGES, WORKER, page_html

_PAUSE = re.compile(r"<!--pause (\d+)-->")
_WEBSOCKET_KEY = "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"  # RFC 6455, section 1.3
_TEXT_FRAME, _CLOSE_FRAME = 0x81, 0x88

# A font of 832 bytes whose characters are all blocks, so that screenshots are the same on every machine.
_FONT = zlib.decompress(
    base64.b64decode(
        "eNrVUj1LA0EQfXt7JhoSJWCj1QmCdoJKsBCEGKwEIdYSz9yZQO5MyAfEJlgEsbCwE0HwD/gPDGIpov4Eg2CRWrDU8+3lEjSC"
        "1r5j9/bN7My82V0IABEcQMLY2JybT3lrd4CYpXU765olZMQ1+Qn5a87Z320/tO8B7Zh8MW+b1s7H6jnXlxyJPA3hiDzk+oVj"
        "Ou9W6/o6LMYfkYecYtbEJGKMbyrumvUSdIToHyY39kzXfj6NntF/Q75VKlaq1EVIQ/mhtHJczVw8ZsaW3yBlB4NgNdnUWioI"
        "WmATKoO3xLlDvyWbfqavEL5Fo5quR/uRl7V4CkPc8Te+ZV8hfPUNvwvVy+3AfqOnrF9bdT3OWfh/HU/864G6huepGH8Wvh7x"
        "rz+FGN+F6qN3e+x/IT4Vt6Shtd5Tv3nUuSSCLEK9pf4Nhsl4gvoILVFW6K41jGIiyadYqKTtXM0xy0jCQRFZFFBBGjZyqNFi"
        "oozgJn7BJ1utT4w="
    )
)


class Exchange:
    """A request, with methods to respond to it."""

    def __init__(self, head: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        lines = head.split("\r\n")
        address = urlsplit(lines[0].split(" ")[1])
        self.path = address.path
        self.query = dict(parse_qsl(address.query, keep_blank_values=True))
        self.headers = {
            name.strip().lower(): value.strip()
            for name, _, value in (line.partition(":") for line in lines[1:])
        }
        self.pace = float(self.query.get("pace", "1"))
        self.port: int = writer.get_extra_info("sockname")[1]
        self.reader = reader
        self._writer = writer

    async def delay(self, milliseconds: float | None = None) -> None:
        """Wait for a time, by default the one in the address."""
        asked = float(self.query.get("ms", "0")) if milliseconds is None else milliseconds
        await asyncio.sleep(asked * self.pace / 1000)

    async def write(self, data: bytes) -> None:
        """Send bytes."""
        self._writer.write(data)
        await self._writer.drain()

    async def head(self, status: str, **headers: str) -> None:
        """Send the response's head."""
        fields = {"Connection": "close", "Cache-Control": "no-store", **headers}
        lines = [f"HTTP/1.1 {status}", *(f"{name.replace('_', '-')}: {fields[name]}" for name in fields)]
        await self.write(("\r\n".join(lines) + "\r\n\r\n").encode())

    async def reply(self, body: str | bytes, kind: str = "text/plain", **headers: str) -> None:
        """Send a complete response."""
        content = body.encode() if isinstance(body, str) else body
        await self.head("200 OK", Content_Type=kind, Content_Length=str(len(content)), **headers)
        await self.write(content)

    async def open_stream(self, kind: str) -> None:
        """Send the head of a response that ends when the connection is closed."""
        await self.head("200 OK", Content_Type=kind)

    async def ended(self) -> None:
        """Wait until the client has disconnected."""
        while await self.reader.read(4096):
            pass


async def _page(exchange: Exchange) -> None:
    """``/p/<name>``: a page, in chunks if it requires it."""
    await exchange.delay()
    other = f"http://{OTHER_HOST}:{exchange.port}"
    html = page_html(PAGES[exchange.path.removeprefix("/p/")], exchange.pace, other)
    await exchange.open_stream("text/html; charset=utf-8")
    first, *rest = _PAUSE.split(html)
    await exchange.write(first.encode())
    for pause, piece in zip(rest[::2], rest[1::2], strict=True):
        await exchange.delay(float(pause))
        await exchange.write(piece.encode())
    if exchange.path == "/p/endless-document":
        await exchange.ended()


async def _data(exchange: Exchange) -> None:
    """``/data?ms&text``: a text, after ``ms``."""
    await exchange.delay()
    await exchange.reply(exchange.query.get("text", "data"), Access_Control_Allow_Origin="*")


async def _hang(exchange: Exchange) -> None:
    """``/hang``: never responds."""
    await exchange.ended()


async def _hop(exchange: Exchange) -> None:
    """``/hop?left&to&ms``: a chain of redirects."""
    await exchange.delay()
    left, to, pace = int(exchange.query["left"]), exchange.query["to"], exchange.pace
    again = f"/hop?left={left - 1}&to={to}&ms={exchange.query.get('ms', '0')}&pace={pace}"
    await exchange.head("302 Found", Location=again if left else f"{to}?pace={pace}", Content_Length="0")


async def _image(exchange: Exchange) -> None:
    """``/image?ms``: an image, after ``ms``."""
    await exchange.delay()
    await exchange.reply(
        "<svg xmlns='http://www.w3.org/2000/svg' width='160' height='90'>"
        "<rect width='160' height='90' fill='teal'/></svg>",
        "image/svg+xml",
    )


async def _font(exchange: Exchange) -> None:
    """``/font?ms``: a font, after ``ms``."""
    await exchange.delay()
    await exchange.reply(_FONT, "font/ttf", Access_Control_Allow_Origin="*")


async def _script(exchange: Exchange) -> None:
    """``/script?ms``: a module that renders content, after ``ms``."""
    await exchange.delay()
    await exchange.reply("globalThis.render && render()", "text/javascript")


async def _worker(exchange: Exchange) -> None:
    """``/worker.js``: the script of the dedicated worker and the service worker."""
    await exchange.reply(WORKER, "text/javascript")


async def _events(exchange: Exchange) -> None:
    """``/events?ms&every``: server-sent events, the first after ``ms``, then one per ``every``."""
    await exchange.open_stream("text/event-stream")
    await exchange.delay()
    number = 1
    while True:
        await exchange.write(f"data: {number}\n\n".encode())
        number += 1
        await exchange.delay(float(exchange.query["every"]))


async def _chunks(exchange: Exchange) -> None:
    """``/chunks?ms&count``: a text in ``count`` chunks, with pauses of ``ms``."""
    await exchange.open_stream("text/plain")
    for number in range(int(exchange.query["count"])):
        await exchange.delay()
        await exchange.write(f"part {number} ".encode())


async def _websocket(exchange: Exchange) -> None:
    """``/ws?ms&unasked&count``: responds to every message after ``ms``, ``count`` times one after the
    other; with ``unasked``, sends a message first."""
    digest = hashlib.sha1((exchange.headers["sec-websocket-key"] + _WEBSOCKET_KEY).encode()).digest()
    await exchange.head(
        "101 Switching Protocols",
        Connection="Upgrade",
        Upgrade="websocket",
        Sec_WebSocket_Accept=base64.b64encode(digest).decode(),
    )
    if "unasked" in exchange.query:
        await exchange.delay()
        await exchange.write(bytes((_TEXT_FRAME, 4)) + b"push")
    while True:
        first, second = await exchange.reader.readexactly(2)
        length = second & 0x7F
        if length == 126:  # RFC 6455, section 5.2
            (length,) = struct.unpack("!H", await exchange.reader.readexactly(2))
        await exchange.reader.readexactly(4 + length)  # the mask and the masked payload
        if first == _CLOSE_FRAME:
            return
        for _ in range(int(exchange.query.get("count", "1"))):
            await exchange.delay()
            await exchange.write(bytes((_TEXT_FRAME, 5)) + b"reply")


_ROUTES: dict[str, Callable[[Exchange], Awaitable[None]]] = {
    "/p": _page,
    "/data": _data,
    "/hang": _hang,
    "/hop": _hop,
    "/image": _image,
    "/font": _font,
    "/script": _script,
    "/worker.js": _worker,
    "/events": _events,
    "/chunks": _chunks,
    "/ws": _websocket,
}


class HardSite:
    """The server, on a free port of the loopback interface, until its context ends."""

    def __init__(self) -> None:
        self.port = 0
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def __aenter__(self) -> HardSite:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    async def __aexit__(self, *_: object) -> None:
        assert self._server is not None
        self._server.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self._server.wait_closed()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            with contextlib.suppress(OSError, asyncio.IncompleteReadError, asyncio.CancelledError):
                await self._answer(reader, writer)  # a client that disconnected needs no response
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().rstrip()
        exchange = Exchange(head, reader, writer)
        path = "/p" if exchange.path.removeprefix("/p/") in PAGES else exchange.path
        route = _ROUTES.get(path)
        if route is None:
            await exchange.head("404 Not Found", Content_Length="0")
        else:
            await route(exchange)
