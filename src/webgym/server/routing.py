"""The two routes to a session: directly to the worker that holds it, or through the gateway.

Screenshots are large, so calls go directly to the worker if the network allows it, which is found out once
per worker. The route through the gateway always works.
"""

from __future__ import annotations

import asyncio
import ipaddress
from urllib.parse import urlsplit

import aiohttp

from webgym.server.config import ClientLimits
from webgym.server.messages import INSTANCE_HEADER, SessionGrant
from webgym.server.operations import HEALTH

DIRECT_SECONDS = 2.0
"""Deadline of the check whether a worker can be reached directly; otherwise the gateway is used."""


class SessionRoute:
    """Where one session's calls are currently sent.

    Attributes:
        base_url: base URL of a worker or gateway.
        is_direct: whether that is the worker's; then the gateway is the alternative.
    """

    def __init__(self, base_url: str, is_direct: bool) -> None:
        self.base_url = base_url
        self.is_direct = is_direct


class SessionRouter:
    """Chooses the route of every session of a client.

    Args:
        http: the client's connections.
        base_url: the client's base URL.
        limits: the client's limits.
    """

    def __init__(self, http: aiohttp.ClientSession, base_url: str, limits: ClientLimits) -> None:
        self._http = http
        self._base_url = base_url
        self._limits = limits
        self._checks: dict[tuple[str, str], asyncio.Task[bool]] = {}

    async def find(self, grant: SessionGrant) -> SessionRoute:
        """The better route to a session."""
        endpoint = grant.endpoint
        if not self._limits.direct or not may_connect_directly(self._base_url, endpoint):
            return SessionRoute(self._base_url, False)
        key = endpoint, grant.instance
        if key not in self._checks:  # sessions that open at the same time share one check
            self._checks[key] = asyncio.create_task(self._is_reachable(endpoint, grant.instance))
        if await asyncio.shield(self._checks[key]):
            return SessionRoute(endpoint, True)
        return SessionRoute(self._base_url, False)

    async def _is_reachable(self, endpoint: str, instance: str) -> bool:
        """Whether this worker, and not some other server, answers there. No token is sent."""
        try:
            async with asyncio.timeout(DIRECT_SECONDS):
                request = self._http.request(HEALTH.method, endpoint + HEALTH.path, allow_redirects=False)
                async with request as response:
                    return response.headers.get(INSTANCE_HEADER) == instance
        except (aiohttp.ClientError, OSError, ValueError):
            return False

    async def close(self) -> None:
        """Cancel checks that are still running."""
        for task in self._checks.values():
            task.cancel()
        await asyncio.gather(*self._checks.values(), return_exceptions=True)


def may_connect_directly(base_url: str, endpoint: str) -> bool:
    """Whether an endpoint may be contacted directly.

    A loopback address means something else on every machine; and a client that uses TLS for its base URL must
    not send the token unencrypted to another.
    """
    if not endpoint or endpoint == base_url:
        return False
    try:
        known, offered = urlsplit(base_url), urlsplit(endpoint)
    except ValueError:
        return False
    if _is_loopback(offered.hostname) and not _is_loopback(known.hostname):
        return False
    return offered.scheme == "https" or known.scheme == "http"


def _is_loopback(host: str | None) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host or "").is_loopback
    except ValueError:
        return False
