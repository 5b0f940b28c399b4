"""The whole soak: a server, clients, faults, and the check afterwards."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path

import msgspec
from tests.hostile import serving_hostile_pages
from tests.soak.clients import Agent
from tests.soak.counts import Counts
from tests.soak.disk import Disk, small_disk
from tests.soak.faults import Faults
from tests.soak.leaks import Census, left_behind
from tests.soak.target import SoakPlan, Target, running_target

from webgym.core.background import running_in_background
from webgym.core.errors import ServerError
from webgym.server.client import BrowserClient

_READY_SECONDS = 120.0
_REST_SECONDS = 90.0
"""Time limit until every slot serves again and nothing is left over; an idle machine takes a few seconds."""
_REPORT_SECONDS = 10.0


class Soak(msgspec.Struct, frozen=True):
    """The result of the soak.

    Attributes:
        plan: of the soak.
        counts: of sessions, errors and faults.
        before: what existed when every slot was ready, before the first client.
        after: what existed after the last client; ``None`` if the server was never idle again.
        granted: the sessions since the gateway's last start: as counted by it, and by its clients.
        rest_seconds: time from the last call until every slot served again, and until nothing was left over.
        disk: why the disk was not filled; empty if it was.
        problems: everything that is lost, left over or does not add up.
    """

    plan: SoakPlan
    counts: Counts
    before: Census
    after: Census | None
    granted: tuple[int, int]
    rest_seconds: tuple[float, float]
    disk: str
    problems: list[str]


async def soak(plan: SoakPlan, report: Callable[[str], None], log: Path) -> Soak:
    """Soak a server.

    Args:
        plan: its size.
        report: called with a line about the progress every ten seconds.
        log: file to append the server's log to.

    Raises:
        ServerError: the server was not ready in time at the start.
        ServerUnreachable: the server did not start.
    """
    with small_disk(plan.disk_bytes) as disk, log.open("ab") as log_file:
        async with running_target(plan, disk.path, log_file.fileno()) as target:
            result = await _soak(plan, target, disk, report)
        result.problems.extend(left_behind(disk.path))
    return result


async def _soak(plan: SoakPlan, target: Target, disk: Disk, report: Callable[[str], None]) -> Soak:
    before, unready = await target.settled(None, _READY_SECONDS)
    if before is None or unready:
        raise ServerError(f"the server was not ready within {_READY_SECONDS:g} s: {'; '.join(unready)}")
    counts = Counts()
    async with running_in_background(_report(counts, report)):
        await _run_clients_and_faults(plan, target, disk, counts)
    clock = asyncio.get_running_loop().time
    began = clock()
    await target.settled(None, _REST_SECONDS)
    served = clock() - began
    after, left = await target.settled(before, _REST_SECONDS)
    rest = served, clock() - began
    granted = (await target.watched()).granted, counts.opened - target.opened_before
    problems = [*counts.problems(), *(f"left behind: {item}" for item in left)]
    if granted[0] != granted[1]:
        problems.append(f"the gateway granted {granted[0]} sessions, but clients received {granted[1]}")
    return Soak(plan, counts, before, after, granted, rest, disk.why_not, problems)


async def _run_clients_and_faults(plan: SoakPlan, target: Target, disk: Disk, counts: Counts) -> None:
    """Run clients and faults for the planned time; then all clients close their sessions."""
    over = asyncio.Event()
    async with AsyncExitStack() as stack:
        site = await stack.enter_async_context(serving_hostile_pages())
        connections = [
            await stack.enter_async_context(
                BrowserClient(target.url, token=target.token, limits=plan.client(direct=direct))
            )
            for direct in (True, False)
        ]
        async with asyncio.TaskGroup() as group:
            for number in range(plan.clients):
                agent = Agent(plan, counts, connections[number % 2], site, f"{plan.seed} client {number}")
                group.create_task(agent.run(over))
            await Faults(target, counts, disk, f"{plan.seed} faults").run(plan.seconds)
            over.set()


async def _report(counts: Counts, report: Callable[[str], None]) -> None:
    while True:
        await asyncio.sleep(_REPORT_SECONDS)
        report(
            f"{counts.opened} opened, {counts.closed} closed, {counts.lost.total()} lost, "
            f"{counts.vanished} dropped, {counts.live} live; {counts.steps} steps; "
            f"{counts.faults.total()} faults"
        )
