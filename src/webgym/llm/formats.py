"""Which ``response_format`` an endpoint accepts: learned from its refusals, and remembered."""

from __future__ import annotations

import sqlite3
from typing import Final, Literal

from webgym.llm.cache import ReplyCache

Format = Literal["json_schema", "json_object", "text"]

FORMATS: Final[tuple[Format, ...]] = ("json_schema", "json_object", "text")
"""From the strictest, which holds the model to a schema, to none at all."""


class Formats:
    """The strictest format that an endpoint takes for a model.

    With a cache it outlasts the process: a job that is repeated from the cache must ask for what it asked for
    the first time, or it would not find its replies.
    """

    def __init__(self, endpoint: str = "", model: str = "", cache: ReplyCache | None = None) -> None:
        self._where = (endpoint, model)
        self._cache = cache
        self._known: Format | None = None

    async def known(self) -> Format:
        """The strictest that is not known to be refused."""
        if self._known is None:
            found = None if self._cache is None else await self._cache.read(self._select)
            self._known = self._known or found or FORMATS[0]
        return self._known

    async def learn(self, taken: Format) -> None:
        """Note that the endpoint takes this format, and refuses all that are stricter."""
        if self._known == taken:
            return
        self._known = taken
        if self._cache is not None:
            where = self._where
            await self._cache.write(
                lambda connection: (
                    connection.execute(
                        "insert or replace into formats values (?, ?, ?)", [*where, taken]
                    ).rowcount
                )
            )

    def _select(self, connection: sqlite3.Connection) -> Format | None:
        row = connection.execute(
            "select format from formats where endpoint = ? and model = ?", self._where
        ).fetchone()
        return next((each for each in FORMATS if row is not None and each == row[0]), None)
