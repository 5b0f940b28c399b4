"""Opening sessions and the pool of slots, with stand-ins for what starts a browser."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from webgym.browser.slot import Slot
from webgym.core.errors import BrowserLaunchFailed, NoCapacity, ProtocolError
from webgym.server.config import ServerConfig
from webgym.server.messages import SessionOptions
from webgym.server.pool import Pool
from webgym.server.worker import Service


async def test_a_caller_waits_no_longer_than_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Pool, "is_healthy", True)
    service = Service(ServerConfig(slots=1), Path("browser"))
    with pytest.raises(NoCapacity, match=r"in use for 0\.01 s"):
        async with asyncio.timeout(100):
            await service.allocate(SessionOptions(wait_seconds=0.01))


@pytest.mark.parametrize("ttl", [-1.0, 0.0, 0.001])
async def test_a_lease_that_would_be_over_before_its_first_call_is_refused(ttl: float) -> None:
    service = Service(ServerConfig(slots=1), Path("browser"))
    with pytest.raises(ProtocolError, match=r"ttl_seconds must be 0\.1 or more"):
        await service.allocate(SessionOptions(ttl_seconds=ttl))


@pytest.mark.parametrize("error", [BrowserLaunchFailed("none"), OSError(24, "no files"), IndexError("0")])
async def test_a_slot_is_started_again_whatever_its_start_raised(
    monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    errors = [error]

    async def make_ready(_: Slot) -> None:
        if errors:
            raise errors.pop()

    pool = Pool(ServerConfig(slots=1, relaunch_seconds=(0.01, 0.01)), Path("browser"))
    monkeypatch.setattr(pool, "_make_ready", make_ready)
    async with asyncio.timeout(100):
        await pool._start_slot(pool._new_slot(pool._config.browser))
    assert pool.load.free == 1
    assert pool.is_healthy
