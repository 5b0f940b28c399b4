"""Connections to one endpoint, in several small pools.

For every request, and again when it ends, httpcore iterates over all connections of its pool. With 500
requests in flight, a request took three times as much CPU with a single pool as with pools of 50, and
blocked the event loop for that time.
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import cache
from typing import Any, Final

import httpx

POOL: Final = 10
"""Connections per pool."""

_IDLE_SECONDS: Final = 3.0
"""How long a connection is kept without a request. Servers such as vLLM's close it after 5 s, and a request
that is sent at that moment fails."""

_certificates = cache(httpx.create_ssl_context)
"""Those that are trusted; reading them takes 30 ms."""


class Pools:
    """HTTP clients over which requests are distributed evenly.

    Args:
        connections: largest number of concurrent requests.
        options: arguments of every :class:`httpx.AsyncClient`.
    """

    def __init__(self, connections: int, **options: Any) -> None:
        limits = httpx.Limits(
            max_connections=None, max_keepalive_connections=POOL, keepalive_expiry=_IDLE_SECONDS
        )
        options |= {"limits": limits, "verify": _certificates()}
        self._clients = [httpx.AsyncClient(**options) for _ in range(-(-connections // POOL))]
        self._in_flight = [0] * len(self._clients)

    @asynccontextmanager
    async def post(self, url: str, content: bytes) -> AsyncIterator[httpx.Response]:
        """Send a request; yields its response while the body arrives.

        Raises:
            httpx.HTTPError: the request failed.
        """
        index = self._in_flight.index(min(self._in_flight))
        self._in_flight[index] += 1
        try:
            async with self._clients[index].stream("POST", url, content=content) as response:
                yield response
        finally:
            self._in_flight[index] -= 1

    async def aclose(self) -> None:
        """Close all connections."""
        for client in self._clients:
            await client.aclose()
