"""The pool of slots, with stand-ins for what starts a browser."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from webgym.browser.slot import Slot
from webgym.core.errors import BrowserLaunchFailed
from webgym.server.config import ServerConfig
from webgym.server.pool import Pool


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
    async with asyncio.timeout(5):
        await pool._start_slot(pool._new_slot(pool._config.browser))
    assert pool.load.free == 1
    assert pool.is_healthy
