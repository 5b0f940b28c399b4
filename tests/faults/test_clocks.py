"""Clocks that jump, and a server that stands still."""

from __future__ import annotations

import asyncio
import signal
import time

import pytest

from webgym.core.errors import LeaseLost
from webgym.server.client import BrowserClient
from webgym.server.messages import SessionOptions

from .conftest import Apart, Around

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="session")]


@pytest.mark.parametrize("jump", [-86400.0, 86400.0], ids=["back", "forward"])
async def test_a_wall_clock_that_jumps_a_day_changes_nothing(
    fault: Around, jump: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with fault() as bench:
        session, _ = await bench.open(ttl_seconds=2)
        lease = bench.server.service.leases._leases[session.id]
        real = time.time
        with monkeypatch.context() as patch:
            patch.setattr(time, "time", lambda: real() + jump)
            first = lease.expires
            await bench.until(lambda: lease.expires > first + lease.ttl_seconds)  # the client renews it
            assert (await session.step()).observation.title == "calm"
        await session.close()


async def test_a_server_that_stood_still_blames_no_holder(apart: Apart) -> None:
    """The process is stopped for longer than the leases live: as in a debugger, or a machine that sleeps."""
    async with apart.server(slots=2) as server, BrowserClient(server.url, token=server.token) as client:
        living = await client.open(SessionOptions(ttl_seconds=2))
        dead = await client.open(SessionOptions(ttl_seconds=2))
        server.send(signal.SIGSTOP)
        await dead.abandon()
        await asyncio.sleep(5)
        server.send(signal.SIGCONT)
        for _ in range(5):
            assert (await living.metadata()).url == "about:blank"
        async with asyncio.timeout(100):
            while (await client.pressure()).slots.leased > 1:
                await asyncio.sleep(0.05)
        with pytest.raises(LeaseLost):
            await dead.metadata()
        await living.close()
