"""A client of the administration API of a running offline web."""

from __future__ import annotations

import json
from http import HTTPStatus
from typing import Any, Self

import aiohttp

from webgym.core.errors import SitesError
from webgym.offline.app import VISITOR_COOKIE
from webgym.offline.website import TOP_LEVEL_DOMAIN

ANSWER_SECONDS = 30.0
"""Longest time for a response of the administration API."""


class SitesClient:
    """A client of the administration API of a running offline web.

    Args:
        url: base URL of the administration API.
        token: its token.
    """

    def __init__(self, url: str, token: str) -> None:
        self.url = url.rstrip("/")
        headers = {"authorization": f"Bearer {token}"}
        timeout = aiohttp.ClientTimeout(total=ANSWER_SECONDS)
        self._http = aiohttp.ClientSession(headers=headers, timeout=timeout)

    def visitor_cookie(self, visitor: str) -> tuple[str, str, str]:
        """Name, value and domain of the cookie that identifies a browser as this visitor."""
        return VISITOR_COOKIE, visitor, f".{TOP_LEVEL_DOMAIN}"

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a website for a visitor; ``None`` if it has no such visitor.

        Raises:
            SitesError: the offline web does not respond, or responds with an error.
        """
        status, content = await self._get(f"/visitors/{visitor}/{host}")
        if status == HTTPStatus.NOT_FOUND:
            return None
        state: dict[str, Any] = self._json(status, content)
        return state

    async def websites(self) -> list[dict[str, str]]:
        """The websites: ``host``, ``brand``, ``family``, ``split`` and ``digest`` of each.

        Raises:
            SitesError: the offline web does not respond, or responds with an error.
        """
        websites: list[dict[str, str]] = self._json(*await self._get("/websites"))
        return websites

    async def _get(self, path: str) -> tuple[int, bytes]:
        """Status and content of a response."""
        try:
            async with self._http.get(self.url + path, allow_redirects=False) as response:
                return response.status, await response.read()
        except (aiohttp.ClientError, OSError, ValueError) as error:
            raise SitesError(
                f"the offline web at {self.url} does not respond: {type(error).__name__}",
                hint="start it with webgym sites serve",
            ) from error

    def _json(self, status: int, content: bytes) -> Any:
        if status == HTTPStatus.UNAUTHORIZED:
            raise SitesError(
                "the offline web refused the token", hint="give the token that it was started with"
            )
        if status != HTTPStatus.OK:
            raise SitesError(f"the offline web at {self.url} responded with status {status}")
        return json.loads(content)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._http.close()
