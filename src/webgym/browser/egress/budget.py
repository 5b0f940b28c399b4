"""Limits on one session's use of the proxy, so that no page starves the other sessions of its worker."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.upstream import SessionRoute
from webgym.core.websites import site_or_text


class Politeness:
    """A token bucket per host, stored as the time at which the bucket is full again.

    Args:
        rate: tokens per second.
        burst: capacity of a bucket, tokens.
        wait_seconds: longest delay.
    """

    _MOST_HOSTS = 4096

    def __init__(self, rate: float, burst: int, wait_seconds: float) -> None:
        self._interval = 1 / rate
        self._depth = (burst - 1) / rate
        self._wait_seconds = wait_seconds
        self._full_at: OrderedDict[str, float] = OrderedDict()

    def delay(self, host: str, now: float) -> float | None:
        """Take a token: seconds until it may be used; ``None`` if that is too long, and none was taken."""
        full_at = max(self._full_at.get(host, now), now)
        delay = max(0.0, full_at - self._depth - now)
        if delay > self._wait_seconds:
            return None
        self._full_at[host] = full_at + self._interval
        self._full_at.move_to_end(host)
        if len(self._full_at) > self._MOST_HOSTS:
            self._full_at.popitem(last=False)  # the least recently used
        return delay


class BudgetExceeded(Exception):
    """The session has reached a limit; the message says which."""


class Budget:
    """One session's use of the proxy.

    Args:
        config: the limits.

    Attributes:
        bytes: bytes forwarded so far, in both directions.
        site: the website of the page that was opened last, as from :func:`webgym.core.websites.site_of`.
        route: the upstream proxy that its connections take.
    """

    def __init__(self, config: EgressConfig) -> None:
        self._config = config
        self._lookups = 0
        self._names: set[str] = set()
        self._connections = 0
        self.bytes = 0
        self.site = ""
        self._bytes_of: Counter[str] = Counter()
        self._limited: Counter[str] = Counter()
        self._crowded: Counter[str] = Counter()
        self._alone = Politeness(config.rate, config.burst, config.wait_seconds)
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

    def take(self, size: int, host: str) -> bool:
        """Count bytes forwarded to or from a host; returns whether more may be forwarded."""
        self.bytes += size
        self._bytes_of[host] += size
        may_go_on = self.bytes < self._config.session_bytes
        if not may_go_on:
            self.limit(host)
        return may_go_on

    def limit(self, host: str) -> None:
        """Count a connection to a host that our own limits refused or ended."""
        self._limited[host] += 1

    def may_connect(self, bucket: str, now: float) -> bool:
        """Count a connection: whether the rate would allow it if there were no other sessions.

        Only a refusal that others brought about can excuse anything: an agent that hammers a website has
        itself to thank for its own.
        """
        return self._alone.delay(bucket, now) is not None

    def crowd(self, host: str) -> None:
        """Count a connection to a host that was refused because of other sessions' connections alone."""
        self._crowded[host] += 1

    def bucket(self, host: str) -> str:
        """What a new connection to a host counts as for the limit on its rate.

        A host of the page's own website is one for all sessions. Another, such as a CDN that websites share,
        is one for all sessions at this website: otherwise popular websites would use up what others need.
        """
        is_own = not self.site or site_or_text(host) == self.site
        return host if is_own else f"{host} for {self.site}"

    def counted(self) -> tuple[dict[str, int], dict[str, int], dict[str, int]]:
        """Bytes, connections that our own limits refused, and those of these that were refused because of
        other sessions alone, by host, since the last call."""
        counters = self._bytes_of, self._limited, self._crowded
        sent, limited, crowded = map(dict, counters)
        for counter in counters:
            counter.clear()
        return sent, limited, crowded
