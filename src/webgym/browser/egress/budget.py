"""Limits on one session's use of the proxy, so that no page starves the other sessions of its worker."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.upstream import SessionRoute


class BudgetExceeded(Exception):
    """The session has reached a limit; the message says which."""


class Budget:
    """One session's use of the proxy.

    Args:
        config: the limits.

    Attributes:
        bytes: bytes forwarded so far, in both directions.
        route: the upstream proxy that its connections take.
    """

    def __init__(self, config: EgressConfig) -> None:
        self._config = config
        self._lookups = 0
        self._names: set[str] = set()
        self._connections = 0
        self.bytes = 0
        self.route = SessionRoute()

    def enter(self) -> None:
        """Count a new connection, until :meth:`leave`.

        Raises:
            BudgetExceeded: the limit of connections or of bytes is reached.
        """
        if self._connections >= self._config.session_connections:
            raise BudgetExceeded(f"the session has {self._connections} connections at once")
        if self.bytes >= self._config.session_bytes:
            raise BudgetExceeded(f"the session has transferred {self.bytes / 2**30:.1f} GiB")
        self._connections += 1

    def leave(self) -> None:
        """A connection was closed, or could not be opened."""
        self._connections -= 1

    @contextmanager
    def lookup(self, name: str) -> Iterator[None]:
        """Count a lookup during the block.

        Raises:
            BudgetExceeded: the limit of concurrent lookups or of different names is reached.
        """
        if self._lookups >= self._config.session_lookups:
            raise BudgetExceeded(f"the session looks up {self._lookups} names at once")
        if name not in self._names and len(self._names) >= self._config.session_names:
            raise BudgetExceeded(f"the session has asked for {len(self._names)} names")
        self._names.add(name)
        self._lookups += 1
        try:
            yield
        finally:
            self._lookups -= 1

    def take(self, size: int) -> bool:
        """Count forwarded bytes; returns whether more may be forwarded."""
        self.bytes += size
        return self.bytes < self._config.session_bytes
