"""Collects the problems that delay a job's requests to model endpoints, from every client that it opens."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from contextvars import ContextVar
from typing import Final, Protocol

from webgym.core.background import running_in_background

_POLL_SECONDS: Final = 0.5
_REPEAT_SECONDS: Final = 30.0
"""Between two reports of a problem that persists."""


class Client(Protocol):
    """A client of an endpoint."""

    @property
    def problem(self) -> str:
        """What delays its requests at this moment; empty if nothing does."""
        ...


_clients: ContextVar[set[Client] | None] = ContextVar("clients", default=None)


@contextmanager
def watch_clients() -> Iterator[Callable[[], str]]:
    """Collect the problems of every client that is opened in the block, also by tasks that it starts.

    Yields:
        A function that returns what delays their requests at this moment; an empty string if nothing does.
    """
    clients = set[Client]()
    token = _clients.set(clients)
    try:
        yield lambda: "; ".join(dict.fromkeys(problem for client in clients if (problem := client.problem)))
    finally:
        _clients.reset(token)


_cut_off: ContextVar[list[str] | None] = ContextVar("cut_off", default=None)


@contextmanager
def collect_cut_off() -> Iterator[list[str]]:
    """Collect what delayed the requests that are cancelled in the block, also in tasks that it starts.

    Yields:
        The reasons so far, in the order of the cancellations.
    """
    reasons = list[str]()
    token = _cut_off.set(reasons)
    try:
        yield reasons
    finally:
        _cut_off.reset(token)


def note_cut_off(reason: str) -> None:
    """Tell the enclosing :func:`collect_cut_off`, if there is one, what delayed a cancelled request."""
    if (reasons := _cut_off.get()) is not None:
        reasons.append(reason)


def register_client(client: Client) -> None:
    """Make an open client known to the enclosing :func:`watch_clients`, if there is one."""
    if (clients := _clients.get()) is not None:
        clients.add(client)


@asynccontextmanager
async def report_problems(problem: Callable[[], str], tell: Callable[[str], None]) -> AsyncIterator[None]:
    """Report problems while the block lasts: when one begins, and every 30 seconds while it persists.

    Args:
        problem: the function that :func:`watch_clients` yields.
        tell: called with each message.
    """

    async def poll() -> None:
        while True:
            await asyncio.sleep(_POLL_SECONDS)
            if message := problem():
                tell(message)
                await asyncio.sleep(_REPEAT_SECONDS)

    async with running_in_background(poll()):
        yield
