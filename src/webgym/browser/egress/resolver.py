"""Names to addresses, so that a slow name holds up no other."""

from __future__ import annotations

import asyncio
import math
import socket
from collections import OrderedDict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, TypeAlias

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address
from webgym.browser.egress.machine import Machine

Trouble: TypeAlias = Literal["no_such_name", "dns_failed", "dns_timed_out"]
Answer: TypeAlias = tuple[Address, ...] | Trouble

_UNKNOWN = frozenset({socket.EAI_NONAME, socket.EAI_NODATA})
_NEVER_ASKED = ("invalid", "local", "onion")
"""Top-level names that mean nothing to the system's resolver, or that it would shout across the local
network (RFC 6761, 6762, 7686)."""

_LOOPBACK = "localhost"


@dataclass
class _Site:
    """Lookups of the names of one site, those that wait included."""

    turns: asyncio.Semaphore
    lookups: int = 0


class Resolver:
    """Asks the system's resolver in threads of its own.

    A name that is asked for twice at once is looked up once. The names of one site have a share of the
    threads, so that a domain whose servers do not answer cannot take them all.
    """

    def __init__(self, config: EgressConfig, machine: Machine) -> None:
        self._config = config
        self._machine = machine
        self._threads = ThreadPoolExecutor(config.resolver_threads, thread_name_prefix="webgym-dns")
        self._share = max(1, math.floor(config.resolver_threads * config.resolver_share))
        self._sites: dict[str, _Site] = {}
        self._flights: dict[str, asyncio.Task[Answer]] = {}
        self._cache: OrderedDict[str, tuple[float, Answer]] = OrderedDict()

    async def close(self) -> None:
        """Stop asking. A lookup that hangs in the system's resolver is left to end by itself."""
        flights = tuple(self._flights.values())
        for flight in flights:
            flight.cancel()
        await asyncio.gather(*flights, return_exceptions=True)
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def resolve(self, name: str) -> Answer:
        """The addresses of a name, at least one, or why there are none."""
        last = name.rpartition(".")[2]
        if last in _NEVER_ASKED:
            return "no_such_name"
        # RFC 6761: every name below it is loopback, whatever a resolver may say.
        asked = _LOOPBACK if last == _LOOPBACK else name
        now = asyncio.get_running_loop().time()
        known = self._cache.get(asked)
        if known is not None and known[0] > now:
            return known[1]
        try:
            async with asyncio.timeout(self._config.resolve_seconds):
                return await asyncio.shield(self._flight(asked))
        except TimeoutError:
            return "dns_timed_out"

    def _flight(self, name: str) -> asyncio.Task[Answer]:
        flight = self._flights.get(name)
        if flight is None:
            flight = asyncio.get_running_loop().create_task(self._look_up(name))
            self._flights[name] = flight
            flight.add_done_callback(lambda _: self._flights.pop(name))
        return flight

    async def _look_up(self, name: str) -> Answer:
        key = ".".join(name.rsplit(".", 2)[-2:])
        site = self._sites.setdefault(key, _Site(asyncio.Semaphore(self._share)))
        site.lookups += 1
        try:
            async with site.turns:
                answer = await self._ask(name)
        finally:
            site.lookups -= 1
            if not site.lookups:
                del self._sites[key]
        if answer != "dns_failed":  # which may be over the next moment
            self._keep(name, answer)
        return answer

    async def _ask(self, name: str) -> Answer:
        loop = asyncio.get_running_loop()
        try:
            found = await loop.run_in_executor(self._threads, self._machine.lookup, name)
        except socket.gaierror as error:
            return "no_such_name" if error.errno in _UNKNOWN else "dns_failed"
        except (OSError, ValueError):  # of a name that no resolver takes
            return "dns_failed"
        return tuple(found) or "no_such_name"

    def _keep(self, name: str, answer: Answer) -> None:
        until = asyncio.get_running_loop().time() + self._config.cache_seconds
        self._cache[name] = (until, answer)
        self._cache.move_to_end(name)
        if len(self._cache) > self._config.cache_names:
            self._cache.popitem(last=False)
