"""Ten thousand sessions opened and closed: afterwards a server is what it was before."""

from __future__ import annotations

import asyncio
from asyncio.subprocess import DEVNULL

import pytest
from tests.soak.disk import small_disk
from tests.soak.leaks import Census
from tests.soak.target import SoakPlan, Target, running_target

from webgym.core.action import Navigate
from webgym.server.client import BrowserClient
from webgym.server.config import ClientLimits

pytestmark = pytest.mark.browser

SLOTS = 4
SESSIONS = 10_000
WARM = 1000
"""Sessions after which pools and caches are as large as they get."""
MEGABYTES = 30
"""By which gateway and workers together may grow after that."""


async def serve(target: Target, pages: str, sessions: int) -> None:
    """Open and close so many, twice as many at once as there are slots; one in fifty looks at a page."""
    numbers = iter(range(sessions))
    limits = ClientLimits(allocate=2 * SLOTS, release=2 * SLOTS, keep_alive_seconds=3)
    async with BrowserClient(target.url, token=target.token, limits=limits) as client:

        async def one_after_the_other() -> None:
            for number in numbers:
                session = await client.open()
                if number % 50 == 0:
                    assert (await session.step(Navigate(pages))).observation.title == "calm"
                await session.close()

        async with asyncio.TaskGroup() as group:
            for _ in range(2 * SLOTS):
                group.create_task(one_after_the_other())


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.asyncio(loop_scope="session")
async def test_sessions_opened_and_closed(pages: str) -> None:
    plan = SoakPlan(slots=SLOTS, workers=2, episodes=100)
    with small_disk(plan.disk_bytes) as disk:
        async with running_target(plan, disk.path, DEVNULL) as target:
            before, unready = await target.settled(None, 120)
            assert before is not None, unready
            await serve(target, pages, WARM)
            before = await rested(target, before)
            began = asyncio.get_running_loop().time()
            await serve(target, pages, SESSIONS)
            seconds = asyncio.get_running_loop().time() - began
            after = await rested(target, before)
            print(f"{SESSIONS} sessions in {seconds:.0f} s", before, after, sep="\n")
            assert after.megabytes < before.megabytes + MEGABYTES
            assert (await target.watched()).granted == WARM + SESSIONS


async def rested(target: Target, before: Census) -> Census:
    """What exists when nothing more is at work: no more than before."""
    census, left = await target.settled(before, 60)
    assert not left
    assert census is not None
    return census
