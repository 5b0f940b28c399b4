"""Requests as they are sent, and the keys by which replies are cached."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import msgspec

from webgym.llm.config import Sampling


class Request:
    """One request to a chat endpoint.

    Args:
        url: of the endpoint, ``.../chat/completions``.
        model: the model's name.
        messages: in the shape of the OpenAI chat API.
        sampling: how to draw the reply.

    Attributes:
        url, model, messages, sampling: as given.
        body: the request's fields.
    """

    def __init__(
        self, url: str, model: str, messages: Sequence[Mapping[str, Any]], sampling: Sampling
    ) -> None:
        self.url = url
        self.model = model
        self.messages = messages
        self.sampling = sampling
        fields = {"model": model, "messages": messages, "stream": False} | sampling.body()
        # The fields' own order does not matter to anybody, and must not to the key. Further in it does: a
        # schema's properties are written by the model in the order in which they are given.
        self.body: dict[str, Any] = dict(sorted(fields.items()))

    @cached_property
    def content(self) -> bytes:
        """The body as it is sent."""
        return msgspec.json.encode(self.body)

    @cached_property
    def key(self) -> bytes:
        """The SHA-256 of all that a reply depends on: address, model, messages, sampling, sample."""
        name = hashlib.sha256(f"{self.url}\n{self.sampling.sample}\n".encode())
        name.update(self.content)
        return name.digest()

    @property
    def longest_reply(self) -> int | None:
        """Tokens that the reply may have at most, if the request limits them."""
        limits = (self.body.get("max_completion_tokens"), self.body.get("max_tokens"))
        return next((limit for limit in limits if isinstance(limit, int)), None)
