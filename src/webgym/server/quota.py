"""How many sessions one client may hold.

All clients hold the same token, so this is no wall between enemies: it keeps a client that leaks sessions
from taking every slot of the others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from starlette.requests import Request

from webgym.core.errors import TooManySessions
from webgym.server.messages import CLIENT_HEADER


def client_of(request: Request) -> str:
    """Who asks: the name that the client gives itself, else the address that it calls from."""
    return request.headers.get(CLIENT_HEADER) or (request.client.host if request.client else "")


class Quota:
    """Who holds which session, and who may have another.

    Args:
        limit: sessions per client; ``None`` for as many as there are.
    """

    def __init__(self, limit: int | None) -> None:
        self._limit = limit
        self._held: Counter[str] = Counter()
        self._holders: dict[str, str] = {}

    @contextmanager
    def asking(self, client: str) -> Iterator[None]:
        """Count a session that is asked for, for as long as the block lasts.

        Raises:
            TooManySessions: the client has all that it may have.
        """
        if self._limit is not None and self._held[client] >= self._limit:
            raise TooManySessions(
                f"this client holds {self._held[client]} sessions, as many as it may",
                hint="close some, or let the server allow more with --sessions-per-client",
            )
        self._held[client] += 1
        try:
            yield
        finally:
            self._give(client)

    def granted(self, client: str, session_id: str) -> None:
        """The client holds this session."""
        self._held[client] += 1
        self._holders[session_id] = client

    def ended(self, session_id: str) -> None:
        """Nobody holds this session any more."""
        client = self._holders.pop(session_id, None)
        if client is not None:
            self._give(client)

    def _give(self, client: str) -> None:
        self._held[client] -= 1
        if not self._held[client]:
            del self._held[client]
