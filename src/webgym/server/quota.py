"""Limits the number of sessions of one client.

A client is identified by the name of its token. Clients that share the server's own token are distinguished
by
the names that they give: no protection against malicious clients, but one that leaks sessions does not use up
all slots.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from starlette.requests import Request

from webgym.core.errors import TooManySessions
from webgym.server.messages import CLIENT_HEADER
from webgym.server.tokens import SERVER_CALLER


def client_of(request: Request) -> str:
    """The client of a request: the name of its token, else the name that it gives, else its address."""
    caller = caller_of(request)
    named = f"token {caller['token']}" if caller["token"] != SERVER_CALLER else ""
    return named or caller["client"] or caller["address"]


def caller_of(request: Request) -> dict[str, str]:
    """The name of the caller's ``token``, the name that the ``client`` gives, and its ``address``."""
    return {
        "token": request.state.caller,
        "client": request.headers.get(CLIENT_HEADER, ""),
        "address": request.client.host if request.client else "",
    }


class Quota:
    """Counts the sessions of clients.

    Args:
        limit: sessions per client; ``None`` for no limit.
    """

    def __init__(self, limit: int | None) -> None:
        self._limit = limit
        self._counts: Counter[str] = Counter()
        self._holders: dict[str, str] = {}

    @contextmanager
    def requesting(self, client: str) -> Iterator[None]:
        """Count a requested session during the block.

        Raises:
            TooManySessions: the client has reached the limit.
        """
        if self._limit is not None and self._counts[client] >= self._limit:
            raise TooManySessions(
                f"this client holds {self._counts[client]} sessions, which is the limit",
                hint="close some, or let the server allow more with --sessions-per-client",
            )
        self._counts[client] += 1
        try:
            yield
        finally:
            self._decrement(client)

    def granted(self, client: str, session_id: str) -> None:
        """Count a session that was opened."""
        self._counts[client] += 1
        self._holders[session_id] = client

    def ended(self, session_id: str) -> None:
        """Stop counting a session that has ended."""
        client = self._holders.pop(session_id, None)
        if client is not None:
            self._decrement(client)

    def _decrement(self, client: str) -> None:
        self._counts[client] -= 1
        if not self._counts[client]:
            del self._counts[client]
