"""All of it together: a server, its clients, its faults, and the reckoning."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import msgspec

from webgym.bench.hostile import serving_hostile_pages
from webgym.bench.soak.books import Books
from webgym.bench.soak.clients import Agent
from webgym.bench.soak.disk import Disk, small_disk
from webgym.bench.soak.faults import Faults
from webgym.bench.soak.leaks import Census, left_behind
from webgym.bench.soak.plan import SoakPlan
from webgym.bench.soak.target import Target, running_target
from webgym.core.errors import ServerError
from webgym.server.client import BrowserClient

_READY_SECONDS = 120.0
_REST_SECONDS = 90.0
"""Until every slot serves again and nothing is left of what was. On an idle machine it takes a few."""
_TICK_SECONDS = 1.0

Watch = Callable[[Books, float], None]
"""Called every second with the books and the seconds so far."""


class Soak(msgspec.Struct, frozen=True):
    """What was done, and whether it adds up.

    Attributes:
        before: what existed when every slot was ready and nobody had come.
        after: what exists when everybody has left; ``None`` if the server was never at rest again.
        granted: sessions that the last run of the gateway says it gave, and that its clients say they got.
        rest_seconds: from the last call until every slot served again, and until nothing was left over.
        disk: why the disk was not filled; empty if it could be.
        problems: all that does not add up.
    """

    plan: SoakPlan
    books: Books
    before: Census
    after: Census | None
    granted: tuple[int, int]
    rest_seconds: tuple[float, float]
    disk: str
    problems: list[str]


async def soak(plan: SoakPlan, executable: Path | None, watch: Watch, log: Path = Path(os.devnull)) -> Soak:
    """Soak a server.

    Args:
        executable: the Chromium to run; ``None`` looks for one.
        watch: told every second where it stands.
        log: where the server's log is added to.

    Raises:
        ServerError: it was not ready in time, before anything was done to it.
        ServerUnreachable: it did not come up.
    """
    with small_disk(plan.disk_bytes) as disk, log.open("ab") as log_file:
        async with running_target(plan, disk.path, executable, log_file.fileno()) as target:
            found = await _soak(plan, target, disk, watch)
        found.problems.extend(left_behind(disk.path))
    return found


async def _soak(plan: SoakPlan, target: Target, disk: Disk, watch: Watch) -> Soak:
    before, unready = await target.settled(None, _READY_SECONDS)
    if before is None or unready:
        raise ServerError(f"the server was not ready within {_READY_SECONDS:g} s: {'; '.join(unready)}")
    books = Books()
    await _life(plan, target, disk, books, watch)
    clock = asyncio.get_running_loop().time
    began = clock()
    await target.settled(None, _REST_SECONDS)
    served = clock() - began
    after, left = await target.settled(before, _REST_SECONDS)
    rest = served, clock() - began
    granted = (await target.watched()).granted, books.opened - target.opened_before
    problems = [*books.problems(), *(f"left behind: {one}" for one in left)]
    if granted[0] != granted[1]:
        problems.append(f"the gateway gave {granted[0]} sessions, and {granted[1]} arrived")
    return Soak(plan, books, before, after, granted, rest, disk.why_not, problems)


async def _life(plan: SoakPlan, target: Target, disk: Disk, books: Books, watch: Watch) -> None:
    """Clients come and faults happen, for as long as is planned; then everybody leaves in order."""
    over = asyncio.Event()
    async with AsyncExitStack() as stack:
        site = await stack.enter_async_context(serving_hostile_pages())
        ways = [
            await stack.enter_async_context(
                BrowserClient(target.url, token=target.token, limits=plan.client(direct=direct))
            )
            for direct in (True, False)
        ]
        ticking = asyncio.create_task(_tick(books, watch))
        try:
            async with asyncio.TaskGroup() as group:
                for number in range(plan.clients):
                    agent = Agent(plan, books, ways[number % 2], site, f"{plan.seed} client {number}")
                    group.create_task(agent.run(over))
                await Faults(target, books, disk, f"{plan.seed} faults").run(plan.seconds)
                over.set()
        finally:
            ticking.cancel()
            await asyncio.wait({ticking})


async def _tick(books: Books, watch: Watch) -> None:
    clock = asyncio.get_running_loop().time
    began = clock()
    while True:
        await asyncio.sleep(_TICK_SECONDS)
        watch(books, clock() - began)
