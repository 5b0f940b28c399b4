"""How many sessions one client may hold.

A client is known by the name of its token. Clients that share the server's own token are told apart by what
they call themselves: no wall between enemies, but one that leaks sessions does not take all slots.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from starlette.requests import Request

from webgym.core.errors import TooManySessions
from webgym.server.messages import CLIENT_HEADER
from webgym.server.tokens import OWN


def client_of(request: Request) -> str:
    """Who asks: the name of its token, else what it calls itself, else the address that it calls from."""
    caller = caller_of(request)
    named = f"token {caller['token']}" if caller["token"] != OWN else ""
    return named or caller["client"] or caller["address"]


def caller_of(request: Request) -> dict[str, str]:
    """The name of the caller's ``token``, what the ``client`` calls itself, and its ``address``."""
    return {
        "token": request.state.caller,
        "client": request.headers.get(CLIENT_HEADER, ""),
        "address": request.client.host if request.client else "",
    }


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
