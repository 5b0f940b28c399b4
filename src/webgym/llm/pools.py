"""Connections to one endpoint, in several small pools.

For every request, and again when it ends, httpcore looks at all connections of its pool. With 500 requests in
flight one took three times the CPU over a single pool that it took over pools of 50, and meanwhile the event
loop did nothing else.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import cache
from typing import Any, Final

import httpx

POOL: Final = 10
"""Connections of a pool."""

_certificates = cache(httpx.create_ssl_context)
"""Those that are trusted; reading them takes 30 ms."""


class Pools:
    """As many connections as are needed, to which requests are spread evenly.

    Args:
        connections: requests at once.
        options: of every :class:`httpx.AsyncClient`.
    """

    def __init__(self, connections: int, **options: Any) -> None:
        limits = httpx.Limits(max_connections=None, max_keepalive_connections=POOL)
        options |= {"limits": limits, "verify": _certificates()}
        self._clients = [httpx.AsyncClient(**options) for _ in range(-(-connections // POOL))]
        self._in_flight = [0] * len(self._clients)

    @asynccontextmanager
    async def post(self, url: str, content: bytes) -> AsyncIterator[httpx.Response]:
        """The response to a request, as its body comes in.

        Raises:
            httpx.HTTPError: there is none.
        """
        place = self._in_flight.index(min(self._in_flight))
        self._in_flight[place] += 1
        try:
            async with self._clients[place].stream("POST", url, content=content) as response:
                yield response
        finally:
            self._in_flight[place] -= 1

    async def aclose(self) -> None:
        """Close all connections."""
        for client in self._clients:
            await client.aclose()
