"""What holds up a job's requests, for a person who waits: whichever part of the job has sent them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from contextvars import ContextVar
from typing import Final, Protocol

from webgym.core.background import beside

_LOOK_SECONDS: Final = 0.5
_REPEAT_SECONDS: Final = 30.0
"""Between two lines about trouble that lasts."""


class Asks(Protocol):
    """A client of an endpoint."""

    @property
    def trouble(self) -> str:
        """What holds its requests up at this moment; empty for nothing."""
        ...


_clients: ContextVar[set[Asks] | None] = ContextVar("clients", default=None)


@contextmanager
def watched() -> Iterator[Callable[[], str]]:
    """Note every client that is opened in the block, also by tasks that it starts.

    Yields:
        What says what holds up their requests at this moment; empty for nothing.
    """
    clients = set[Asks]()
    token = _clients.set(clients)
    try:
        yield lambda: "; ".join(dict.fromkeys(told for client in clients if (told := client.trouble)))
    finally:
        _clients.reset(token)


def note_opened(client: Asks) -> None:
    """A client is open: whoever watches sees it from now on."""
    if (clients := _clients.get()) is not None:
        clients.add(client)


@asynccontextmanager
async def telling(trouble: Callable[[], str], tell: Callable[[str], None]) -> AsyncIterator[None]:
    """Tell of trouble for as long as the block lasts: when it begins, and now and then while it goes on."""

    async def look() -> None:
        while True:
            await asyncio.sleep(_LOOK_SECONDS)
            if told := trouble():
                tell(told)
                await asyncio.sleep(_REPEAT_SECONDS)

    async with beside(look()):
        yield
