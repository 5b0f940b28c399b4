"""Requests to a chat endpoint, and the keys by which replies are cached."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, Self

import msgspec

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
