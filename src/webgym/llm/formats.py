"""The ``response_format`` that an endpoint accepts: learned from its refusals, and stored."""

from __future__ import annotations

import sqlite3
from typing import Final, Literal

from webgym.llm.cache import ReplyCache

Format = Literal["json_schema", "json_object", "text"]

FORMATS: Final[tuple[Format, ...]] = ("json_schema", "json_object", "text")
"""From the strictest, which enforces a schema, to none at all."""


class Formats:
    """The strictest format that an endpoint accepts for a model.

    With a cache it is stored: a job that is repeated from the cache must send the same requests as the first
    time, or it would not find its replies.

    Args:
        endpoint: the endpoint's base URL.
        model: the model.
        cache: where to store the format; ``None`` keeps it in memory.
    """

    def __init__(self, endpoint: str = "", model: str = "", cache: ReplyCache | None = None) -> None:
        self._where = (endpoint, model)
        self._cache = cache
        self._known: Format | None = None

    async def known(self) -> Format:
        """The strictest format that is not known to be refused."""
        if self._known is None:
            stored = None if self._cache is None else await self._cache.read(self._select)
            self._known = self._known or stored or FORMATS[0]
        return self._known

    async def learn(self, accepted: Format) -> None:
        """Record that the endpoint accepts this format, and refuses all stricter ones."""
        if self._known == accepted:
            return
        self._known = accepted
        if self._cache is not None:
            row, statement = [*self._where, accepted], "insert or replace into formats values (?, ?, ?)"
            await self._cache.write(lambda connection: connection.execute(statement, row).rowcount)

    def _select(self, connection: sqlite3.Connection) -> Format | None:
        statement = "select format from formats where endpoint = ? and model = ?"
        rows = connection.execute(statement, self._where).fetchall()
        return next((name for name in FORMATS if (name,) in rows), None)
