"""Programs that vanish, stop halfway, or hold the line.

They speak HTTP by hand, as no client of ours would.
"""

from __future__ import annotations

import asyncio
import json
import socket
import struct
from random import Random

from webgym.bench.soak.books import Books
from webgym.bench.soak.target import Target
from webgym.core.errors import ProtocolError
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, error_of

_TTL_SECONDS = 2.0
_ANSWER_SECONDS = 60.0
_HUNG_UP_SECONDS = 20.0
"""Until a connection that stopped halfway must be closed; the server has two seconds to wait for the rest."""
_RESET = struct.pack("ii", 1, 0)
"""Linger for no time: closing sends a reset instead of a goodbye."""


def _head(target: Target, path: str, length: int, more: dict[str, str] | None = None) -> bytes:
    headers = {
        "host": "localhost",
        "authorization": f"Bearer {target.token}",
        "content-length": str(length),
        **(more or {}),
    }
    lines = [f"POST {path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode()


class _Line:
    """A connection that can be torn off."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def dial(cls, target: Target) -> _Line:
        host, port = target.url.removeprefix("http://").split(":")
        return cls(*await asyncio.open_connection(host, int(port)))

    async def answer(self) -> tuple[int, bytes]:
        """Status and body."""
        head = (await self.reader.readuntil(b"\r\n\r\n")).decode("latin-1").lower()
        lengths = [line for line in head.split("\r\n") if line.startswith("content-length:")]
        body = await self.reader.readexactly(int(lengths[0].partition(":")[2])) if lengths else b""
        return int(head.split(" ", 2)[1]), body

    def reset(self) -> None:
        """As if its machine had crashed and come up again."""
        sock: socket.socket = self.writer.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
        self.writer.transport.abort()


async def vanish(target: Target, books: Books, random: Random, over: asyncio.Event) -> bool:
    """Open a session and go without goodbye: reset, silent, or in the middle of a step.

    Returns:
        Whether there was a session to go from.
    """
    try:
        line = await _Line.dial(target)
    except OSError:
        return False  # the gateway is down: there is nobody to vanish from
    try:
        body = json.dumps({"ttl_seconds": _TTL_SECONDS}).encode()
        line.writer.write(_head(target, "/v1/sessions", len(body)) + body)
        async with asyncio.timeout(_ANSWER_SECONDS):
            status, said = await line.answer()
        if status != 200:
            books.refuse(error_of(said, status, "the server"))
            return False
    except (OSError, EOFError, TimeoutError):
        return False  # it is killed: whether it gave a session nobody will know, itself included
    else:
        books.opened += 1
        books.vanished += 1
        grant = json.loads(said)
        how = random.choice(("reset", "silence", "in a step"))
        if how == "in a step":
            step = json.dumps({"action": {"name": "wait", "time": 3}}).encode()
            proof = {SECRET_HEADER: grant["secret"], GENERATION_HEADER: str(grant["generation"])}
            line.writer.write(
                _head(target, f"/v1/sessions/{grant['session_id']}/step", len(step), proof) + step
            )
        elif how == "silence":
            await over.wait()  # the connection stays open, and nothing comes
        return True
    finally:
        line.reset()


async def stop_halfway(target: Target, books: Books, random: Random) -> bool:
    """Send half a request and wait. The server must hang up.

    Returns:
        Whether there was a server to leave waiting.
    """
    try:
        line = await _Line.dial(target)
    except OSError:
        return False  # the gateway is down
    books.half_open += 1
    whole = _head(target, "/v1/sessions", 100)
    line.writer.write(random.choice((b"", whole[: len(whole) // 2], whole + b'{"mode":')))
    try:
        async with asyncio.timeout(_HUNG_UP_SECONDS):
            said = await line.reader.read()
    except ConnectionError:
        said = b""
    except TimeoutError:
        return True
    finally:
        line.reset()
    if said:
        books.untyped.append(repr(ProtocolError(f"half a request was answered: {said[:80]!r}")))
    books.hung_up_on += 1
    return True
