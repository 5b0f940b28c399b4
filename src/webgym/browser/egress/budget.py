"""Limits on one session's use of the proxy, so that no page starves the other sessions of its worker."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from webgym.browser.egress.config import EgressConfig


class Spent(Exception):
    """The session has used all that it may; the message says of what."""


class Budget:
    """One session's use, from its beginning to its end.

    Attributes:
        bytes: passed on so far, in both directions.
    """

    def __init__(self, config: EgressConfig) -> None:
        self._config = config
        self._lookups = 0
        self._names: set[str] = set()
        self._connections = 0
        self.bytes = 0

    def enter(self) -> None:
        """A connection is asked for; it counts until :meth:`leave`.

        Raises:
            Spent: there are as many as may be, or no byte may pass any more.
        """
        if self._connections >= self._config.session_connections:
            raise Spent(f"the session has {self._connections} connections at once")
        if self.bytes >= self._config.session_bytes:
            raise Spent(f"the session has passed {self.bytes / 2**30:.1f} GiB")
        self._connections += 1

    def leave(self) -> None:
        """A connection is gone, or was not to be had."""
        self._connections -= 1

    @contextmanager
    def lookup(self, name: str) -> Iterator[None]:
        """For as long as a name is looked up.

        Raises:
            Spent: as many are looked up as may be at once, or the session has asked for too many names.
        """
        if self._lookups >= self._config.session_lookups:
            raise Spent(f"the session looks up {self._lookups} names at once")
        if name not in self._names and len(self._names) >= self._config.session_names:
            raise Spent(f"the session has asked for {len(self._names)} names")
        self._names.add(name)
        self._lookups += 1
        try:
            yield
        finally:
            self._lookups -= 1

    def take(self, size: int) -> bool:
        """Count bytes that pass; whether more may."""
        self.bytes += size
        return self.bytes < self._config.session_bytes
