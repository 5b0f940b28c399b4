"""Requests to a chat endpoint: the keys by which replies are cached, and the ``response_format`` that the
endpoint accepts, which is learned from its refusals and stored; and clients whose calls are labelled."""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Awaitable, Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Final, Literal, Self

import msgspec

from webgym.llm.cache import ReplyCache
from webgym.llm.completion import Completion
from webgym.llm.config import ChatConfig, Sampling


class Request:
    """One request to a chat endpoint.

    Args:
        url: the endpoint's URL, ``.../chat/completions``.
        model: the model's name.
        messages: the messages, in the format of the OpenAI chat API.
        sampling: the sampling parameters.

    Attributes:
        url, model, messages, sampling: as given.
        body: the fields of the request.
    """

    def __init__(
        self, url: str, model: str, messages: Sequence[Mapping[str, Any]], sampling: Sampling
    ) -> None:
        self.url = url
        self.model = model
        self.messages = messages
        self.sampling = sampling
        fields = {"model": model, "messages": messages, "stream": False} | sampling.body()
        # The order of the fields has no meaning, so it must not change the key. Inside of fields it has: a
        # model writes a schema's properties in the given order.
        self.body: dict[str, Any] = dict(sorted(fields.items()))

    @classmethod
    def of(
        cls, config: ChatConfig, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Self:
        """A request to the endpoint and the model of a config, with its parameters where ``sampling`` sets
        none."""
        url = f"{config.base_url}/chat/completions"
        return cls(url, config.model, messages, (sampling or Sampling()).over(config.sampling))

    @cached_property
    def content(self) -> bytes:
        """The body as it is sent."""
        return msgspec.json.encode(self.body)

    @cached_property
    def key(self) -> bytes:
        """The SHA-256 of everything that a reply depends on: URL, model, messages, sampling, sample index."""
        digest = hashlib.sha256(f"{self.url}\n{self.sampling.sample}\n".encode())
        digest.update(self.content)
        return digest.digest()

    @property
    def longest_reply(self) -> int | None:
        """Most tokens of the reply, if the request limits them."""
        limits = (self.body.get("max_completion_tokens"), self.body.get("max_tokens"))
        return next((limit for limit in limits if isinstance(limit, int)), None)


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


class Labelled:
    """A client of an endpoint, its calls counted for one purpose.

    Args:
        ask: the client's method ``complete``.
        purpose: label under which the ledger counts the calls.
        sampling: the client's default sampling parameters.
        formats: formats that the endpoint accepts as ``response_format``.
    """

    def __init__(
        self, ask: Callable[..., Awaitable[Completion]], purpose: str, sampling: Sampling, formats: Formats
    ) -> None:
        self.sampling = sampling
        self.formats = formats
        self._ask = ask
        self._purpose = purpose

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """One reply to these messages; raises what the client raises."""
        return await self._ask(messages, sampling, purpose=self._purpose)
