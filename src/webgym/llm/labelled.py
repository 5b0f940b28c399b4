"""A model whose calls are counted for a purpose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from webgym.llm.completion import Completion
from webgym.llm.config import Sampling
from webgym.llm.formats import Formats


@runtime_checkable
class EndpointClient(Protocol):
    """What clients tell of themselves, beyond completing."""

    @property
    def sampling(self) -> Sampling:
        """Used where a request names none."""

    @property
    def formats(self) -> Formats:
        """What the endpoint takes as ``response_format``."""


class PurposeAwareClient(EndpointClient, Protocol):
    """A client that is told what a call is for."""

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None, *, purpose: str = ""
    ) -> Completion:
        """One reply to these messages."""
        ...


class Labelled:
    """A client, seen from one purpose: its calls are counted for that, and all else is the client's.

    Args:
        client: whom to ask.
        purpose: what the ledger counts the calls for.
    """

    def __init__(self, client: PurposeAwareClient, purpose: str) -> None:
        self._client = client
        self._purpose = purpose

    @property
    def sampling(self) -> Sampling:
        """Used where a request names none."""
        return self._client.sampling

    @property
    def formats(self) -> Formats:
        """What the endpoint takes as ``response_format``."""
        return self._client.formats

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None
    ) -> Completion:
        """One reply to these messages; raises what the client raises."""
        return await self._client.complete(messages, sampling, purpose=self._purpose)
