"""Resolves names to addresses, so that a slow name does not delay others.

Nothing waits in a thread: a name whose servers never answer costs one pending query, which is cancelled once
nobody waits for it. The number of concurrent lookups of a session is limited by its budget (``budget.py``).
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import OrderedDict
from ipaddress import ip_address
from typing import Literal, TypeAlias

import psutil
from aiodns import DNSResolver
from aiodns.error import ARES_ENODATA, ARES_ENOTFOUND, ARES_ETIMEOUT, DNSError

from webgym.browser.egress.hosts import Address

_REMOTE_ADDRESSES = ((socket.AF_INET, "198.51.100.1"), (socket.AF_INET6, "2001:db8::1"))
"""Addresses reserved for documentation: no host has them, but they are reached by the default route."""

_ANY_PORT = 9


_DNS_SECONDS = 1.5
"""Deadline of a name server's answer, before it or the next one is queried again."""

_DNS_TRIES = 3

CACHE_NAMES = 4096
"""Largest number of cached names, and of stored failures."""

CACHE_SECONDS = 30.0
"""How long the result of a lookup is cached. Addresses are checked again at every connection."""

RESOLVE_SECONDS = 5.0
"""Resolving a name to its addresses."""


class Machine:
    """This machine's network configuration: its hosts file and its name servers (c-ares).

    Args:
        resolver: resolver to use instead of the system's name servers.
    """

    def __init__(self, resolver: DNSResolver | None = None) -> None:
        self._resolver = resolver

    async def lookup(self, name: str) -> list[Address]:
        """The addresses of a name, in order of preference (RFC 6724).

        Raises:
            aiodns.error.DNSError: there are none; with the reason.
        """
        if self._resolver is None:  # created here, because it belongs to the running event loop
            self._resolver = DNSResolver(timeout=_DNS_SECONDS, tries=_DNS_TRIES)
        answer = await self._resolver.getaddrinfo(name, type=socket.SOCK_STREAM)
        return [ip_address(node.addr[0].decode().partition("%")[0]) for node in answer.nodes]

    async def close(self) -> None:
        """Close the resolver."""
        resolver, self._resolver = self._resolver, None
        if resolver is not None:
            await resolver.close()

    def own_addresses(self) -> frozenset[Address]:
        """The addresses of all its network interfaces."""
        families = (socket.AF_INET, socket.AF_INET6)
        return frozenset(
            ip_address(interface.address.partition("%")[0])
            for addresses in psutil.net_if_addrs().values()
            for interface in addresses
            if interface.family in families
        )

    def is_online(self) -> bool:
        """Whether there is a default route. Sends nothing."""
        for family, address in _REMOTE_ADDRESSES:
            with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_DGRAM) as probe:
                probe.connect((address, _ANY_PORT))
                return True
        return False


LookupFailure: TypeAlias = Literal["no_such_name", "dns_failed", "dns_timed_out"]
Answer: TypeAlias = tuple[Address, ...] | LookupFailure

_UNKNOWN = frozenset({ARES_ENODATA, ARES_ENOTFOUND})
_NOT_RESOLVED = ("invalid", "local", "onion")
"""Top-level domains that are not resolved by DNS, or that would be broadcast in the local network (RFC 6761,
6762, 7686)."""

_LOOPBACK = "localhost"


class Resolver:
    """Queries the machine's name servers. Concurrent requests for the same name share one lookup."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._lookups: dict[str, asyncio.Task[Answer]] = {}
        self._waiting: dict[str, int] = {}
        self._cache: OrderedDict[str, tuple[float, Answer]] = OrderedDict()

    async def close(self) -> None:
        """Cancel all lookups."""
        lookups = tuple(self._lookups.values())
        for lookup in lookups:
            lookup.cancel()
        await asyncio.gather(*lookups, return_exceptions=True)
        await self._machine.close()

    async def resolve(self, name: str) -> Answer:
        """The addresses of a name, at least one, or why there are none.

        If it is cancelled, such as when the browser has closed its connection, the lookup is cancelled too,
        unless another caller waits for it.
        """
        last = name.rpartition(".")[2]
        if last in _NOT_RESOLVED:
            return "no_such_name"
        # RFC 6761: every name below it is loopback, whatever a resolver may say.
        target = _LOOPBACK if last == _LOOPBACK else name
        now = asyncio.get_running_loop().time()
        cached = self._cache.get(target)
        if cached is not None and cached[0] > now:
            return cached[1]
        lookup = self._shared_lookup(target)
        self._waiting[target] = self._waiting.get(target, 0) + 1
        try:
            async with asyncio.timeout(RESOLVE_SECONDS):
                return await asyncio.shield(lookup)
        except TimeoutError:
            return "dns_timed_out"
        finally:
            self._waiting[target] -= 1
            if not self._waiting[target]:
                del self._waiting[target]
                lookup.cancel()

    def _shared_lookup(self, name: str) -> asyncio.Task[Answer]:
        lookup = self._lookups.get(name)
        if lookup is None or lookup.cancelling():
            lookup = asyncio.get_running_loop().create_task(self._lookup(name))
            self._lookups[name] = lookup
            lookup.add_done_callback(lambda done: self._on_done(name, done))
        return lookup

    def _on_done(self, name: str, lookup: asyncio.Task[Answer]) -> None:
        if self._lookups.get(name) is lookup:
            del self._lookups[name]

    async def _lookup(self, name: str) -> Answer:
        answer = await self._query(name)
        if answer not in ("dns_failed", "dns_timed_out"):  # these may be temporary
            self._store(name, answer)
        return answer

    async def _query(self, name: str) -> Answer:
        try:
            addresses = await self._machine.lookup(name)
        except DNSError as error:
            number = error.args[0] if error.args else None
            if number == ARES_ETIMEOUT:
                return "dns_timed_out"
            return "no_such_name" if number in _UNKNOWN else "dns_failed"
        except (OSError, ValueError):  # the resolver rejects the name
            return "dns_failed"
        return tuple(addresses) or "no_such_name"

    def _store(self, name: str, answer: Answer) -> None:
        until = asyncio.get_running_loop().time() + CACHE_SECONDS
        self._cache[name] = (until, answer)
        self._cache.move_to_end(name)
        if len(self._cache) > CACHE_NAMES:
            self._cache.popitem(last=False)
