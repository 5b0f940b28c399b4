"""Clients whose calls are accounted to a purpose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from webgym.llm.completion import Completion
from webgym.llm.config import Sampling
from webgym.llm.formats import Formats


@runtime_checkable
class EndpointClient(Protocol):
    """A client with default sampling parameters and known formats."""

    @property
    def sampling(self) -> Sampling:
        """Default sampling parameters of requests."""

    @property
    def formats(self) -> Formats:
        """Formats that the endpoint accepts as ``response_format``."""


class PurposeAwareClient(EndpointClient, Protocol):
    """A client whose calls can be labelled with a purpose."""

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None, *, purpose: str = ""
    ) -> Completion:
        """One reply to these messages."""
        ...


class Labelled:
    """A wrapper of a client that labels all calls with one purpose.

    Args:
        client: the wrapped client.
        purpose: label under which the ledger counts the calls.
    """

    def __init__(self, client: PurposeAwareClient, purpose: str) -> None:
        self._client = client
        self._purpose = purpose

    @property
    def sampling(self) -> Sampling:
        """Default sampling parameters of requests."""
        return self._client.sampling

    @property
    def formats(self) -> Formats:
        """Formats that the endpoint accepts as ``response_format``."""
        return self._client.formats

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """One reply to these messages; raises what the client raises."""
        return await self._client.complete(messages, sampling, purpose=self._purpose)
