"""Asking a running offline web what its servers hold."""

from __future__ import annotations

from typing import Any, Self

import httpx

from webgym.core.errors import SitesError
from webgym.offline.app import VISITOR_COOKIE
from webgym.offline.website import TOP_LEVEL_DOMAIN

ANSWER_SECONDS = 30.0
"""How long the administration may take to answer."""


class SitesClient:
    """A client of the administration of a served offline web.

    Args:
        url: base URL of the administration.
        token: of the administration.
    """

    def __init__(self, url: str, token: str) -> None:
        self.url = url
        headers = {"authorization": f"Bearer {token}"}
        self._http = httpx.AsyncClient(base_url=url, headers=headers, timeout=ANSWER_SECONDS, trust_env=False)

    def visitor_cookie(self, visitor: str) -> tuple[str, str, str]:
        """Name, value and domain of the cookie that makes a browser this visitor."""
        return VISITOR_COOKIE, visitor, f".{TOP_LEVEL_DOMAIN}"

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """What a website's server holds for a visitor; ``None`` if it does not know the visitor.

        Raises:
            SitesError: the offline web does not answer as it should.
        """
        answer = await self._get(f"/visitors/{visitor}/{host}")
        if answer.status_code == httpx.codes.NOT_FOUND:
            return None
        found: dict[str, Any] = self._json(answer)
        return found

    async def websites(self) -> list[dict[str, str]]:
        """The websites: ``host``, ``brand``, ``family`` and ``split`` of each.

        Raises:
            SitesError: the offline web does not answer as it should.
        """
        found: list[dict[str, str]] = self._json(await self._get("/websites"))
        return found

    async def _get(self, path: str) -> httpx.Response:
        try:
            return await self._http.get(path)
        except httpx.HTTPError as error:
            raise SitesError(
                f"the offline web at {self.url} does not answer: {type(error).__name__}",
                hint="start it with webgym sites serve",
            ) from error

    def _json(self, answer: httpx.Response) -> Any:
        if answer.status_code == httpx.codes.UNAUTHORIZED:
            raise SitesError("the offline web refused the token", hint="give the token it was started with")
        if answer.status_code != httpx.codes.OK:
            raise SitesError(f"the offline web at {self.url} answered {answer.status_code}")
        return answer.json()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._http.aclose()
