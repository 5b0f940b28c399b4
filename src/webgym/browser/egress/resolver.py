"""Names to addresses, so that a slow name holds up no other.

Nothing waits in a thread: a name whose servers never answer costs a question that is still open, and nothing
at all once nobody waits for it. How many a session may ask at once is its budget's (``budget.py``).
"""

from __future__ import annotations

import asyncio
from collections import OrderedDict
from typing import Literal, TypeAlias

from aiodns.error import ARES_ENODATA, ARES_ENOTFOUND, ARES_ETIMEOUT, DNSError

from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address
from webgym.browser.egress.machine import Machine

Trouble: TypeAlias = Literal["no_such_name", "dns_failed", "dns_timed_out"]
Answer: TypeAlias = tuple[Address, ...] | Trouble

_UNKNOWN = frozenset({ARES_ENODATA, ARES_ENOTFOUND})
_NEVER_ASKED = ("invalid", "local", "onion")
"""Top-level names that mean nothing to the system's resolver, or that it would shout across the local
network (RFC 6761, 6762, 7686)."""

_LOOPBACK = "localhost"


class Resolver:
    """Asks the machine's name servers. A name that is asked for twice at once is looked up once."""

    def __init__(self, config: EgressConfig, machine: Machine) -> None:
        self._config = config
        self._machine = machine
        self._flights: dict[str, asyncio.Task[Answer]] = {}
        self._waiting: dict[str, int] = {}
        self._cache: OrderedDict[str, tuple[float, Answer]] = OrderedDict()

    async def close(self) -> None:
        """Stop asking."""
        flights = tuple(self._flights.values())
        for flight in flights:
            flight.cancel()
        await asyncio.gather(*flights, return_exceptions=True)
        await self._machine.close()

    async def resolve(self, name: str) -> Answer:
        """The addresses of a name, at least one, or why there are none.

        Cancelled, as when the browser has hung up, it no longer asks, unless somebody else waits.
        """
        last = name.rpartition(".")[2]
        if last in _NEVER_ASKED:
            return "no_such_name"
        # RFC 6761: every name below it is loopback, whatever a resolver may say.
        asked = _LOOPBACK if last == _LOOPBACK else name
        now = asyncio.get_running_loop().time()
        known = self._cache.get(asked)
        if known is not None and known[0] > now:
            return known[1]
        flight = self._flight(asked)
        self._waiting[asked] = self._waiting.get(asked, 0) + 1
        try:
            async with asyncio.timeout(self._config.resolve_seconds):
                return await asyncio.shield(flight)
        except TimeoutError:
            return "dns_timed_out"
        finally:
            self._waiting[asked] -= 1
            if not self._waiting[asked]:
                del self._waiting[asked]
                flight.cancel()

    def _flight(self, name: str) -> asyncio.Task[Answer]:
        flight = self._flights.get(name)
        if flight is None or flight.cancelling():
            flight = asyncio.get_running_loop().create_task(self._look_up(name))
            self._flights[name] = flight
            flight.add_done_callback(lambda done: self._land(name, done))
        return flight

    def _land(self, name: str, flight: asyncio.Task[Answer]) -> None:
        if self._flights.get(name) is flight:
            del self._flights[name]

    async def _look_up(self, name: str) -> Answer:
        answer = await self._ask(name)
        if answer not in ("dns_failed", "dns_timed_out"):  # which may be over the next moment
            self._keep(name, answer)
        return answer

    async def _ask(self, name: str) -> Answer:
        try:
            found = await self._machine.lookup(name)
        except DNSError as error:
            number = error.args[0] if error.args else None
            if number == ARES_ETIMEOUT:
                return "dns_timed_out"
            return "no_such_name" if number in _UNKNOWN else "dns_failed"
        except (OSError, ValueError):  # of a name that no resolver takes
            return "dns_failed"
        return tuple(found) or "no_such_name"

    def _keep(self, name: str, answer: Answer) -> None:
        until = asyncio.get_running_loop().time() + self._config.cache_seconds
        self._cache[name] = (until, answer)
        self._cache.move_to_end(name)
        if len(self._cache) > self._config.cache_names:
            self._cache.popitem(last=False)
