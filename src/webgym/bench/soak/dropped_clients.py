"""Clients that disconnect, stop in the middle of a request, or keep a connection open.

They write HTTP by hand, as our client cannot do such things.
"""

from __future__ import annotations

import asyncio
import json
import socket
import struct
from random import Random

from webgym.bench.soak.counts import Counts
from webgym.bench.soak.target import Target
from webgym.core.errors import ProtocolError
from webgym.server.messages import GENERATION_HEADER, SECRET_HEADER, error_of

_TTL_SECONDS = 2.0
_ANSWER_SECONDS = 60.0
_CLOSED_SECONDS = 20.0
"""Time limit until the server must have closed a half-open connection; it waits two seconds for the rest."""
_RESET = struct.pack("ii", 1, 0)
"""SO_LINGER with a time of zero: closing the socket sends a reset."""


def _head(target: Target, path: str, length: int, more: dict[str, str] | None = None) -> bytes:
    headers = {
        "host": "localhost",
        "authorization": f"Bearer {target.token}",
        "content-length": str(length),
        **(more or {}),
    }
    lines = [f"POST {path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode()


class _Connection:
    """A connection that can be reset."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def open(cls, target: Target) -> _Connection:
        host, port = target.url.removeprefix("http://").split(":")
        return cls(*await asyncio.open_connection(host, int(port)))

    async def read_response(self) -> tuple[int, bytes]:
        """Read a response.

        Returns:
            Status and body.
        """
        head = (await self.reader.readuntil(b"\r\n\r\n")).decode("latin-1").lower()
        lengths = [line for line in head.split("\r\n") if line.startswith("content-length:")]
        body = await self.reader.readexactly(int(lengths[0].partition(":")[2])) if lengths else b""
        return int(head.split(" ", 2)[1]), body

    def reset(self) -> None:
        """Reset the connection, as a machine does that has crashed and restarted."""
        sock: socket.socket = self.writer.get_extra_info("socket")
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
        self.writer.transport.abort()


async def vanish(target: Target, counts: Counts, random: Random, over: asyncio.Event) -> bool:
    """Open a session and drop it: by a reset, by silence, or by a reset in the middle of a step.

    Returns:
        Whether a session was opened.
    """
    try:
        connection = await _Connection.open(target)
    except OSError:
        return False  # the gateway is down
    try:
        body = json.dumps({"ttl_seconds": _TTL_SECONDS}).encode()
        connection.writer.write(_head(target, "/v1/sessions", len(body)) + body)
        async with asyncio.timeout(_ANSWER_SECONDS):
            status, response = await connection.read_response()
        if status != 200:
            counts.count_refused(error_of(response, status, "the server"))
            return False
    except (OSError, EOFError, TimeoutError):
        return False  # killed: whether it opened a session is unknown, even to itself
    else:
        counts.opened += 1
        counts.vanished += 1
        grant = json.loads(response)
        how = random.choice(("reset", "silence", "in a step"))
        if how == "in a step":
            step = json.dumps({"action": {"name": "wait", "time": 3}}).encode()
            proof = {SECRET_HEADER: grant["secret"], GENERATION_HEADER: str(grant["generation"])}
            connection.writer.write(
                _head(target, f"/v1/sessions/{grant['session_id']}/step", len(step), proof) + step
            )
        elif how == "silence":
            await over.wait()  # the connection stays open without data
        return True
    finally:
        connection.reset()


async def stop_halfway(target: Target, counts: Counts, random: Random) -> bool:
    """Send a part of a request and wait until the server closes the connection.

    Returns:
        Whether the server accepted the connection.
    """
    try:
        connection = await _Connection.open(target)
    except OSError:
        return False  # the gateway is down
    counts.half_open += 1
    whole = _head(target, "/v1/sessions", 100)
    connection.writer.write(random.choice((b"", whole[: len(whole) // 2], whole + b'{"mode":')))
    try:
        async with asyncio.timeout(_CLOSED_SECONDS):
            response = await connection.reader.read()
    except ConnectionError:
        response = b""
    except TimeoutError:
        return True
    finally:
        connection.reset()
    if response:
        counts.untyped.append(repr(ProtocolError(f"an incomplete request got a response: {response[:80]!r}")))
    counts.hung_up_on += 1
    return True
