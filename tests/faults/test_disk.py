"""The disk with the browsers' profiles is full."""

from __future__ import annotations

import os
import signal

import psutil
import pytest
from tests.soak.disk import small_disk

from webgym.core.action import Navigate
from webgym.core.errors import BrowserCrashed, LeaseLost
from webgym.server.client import BrowserClient

from .conftest import Apart

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="session")]


async def test_a_full_disk_stops_nobody(pages: str) -> None:
    """An episode's state is in memory, and a browser that is replaced leaves its room to the next."""
    with small_disk(256 * 1024 * 1024) as disk:
        if not disk.can_be_filled:
            pytest.skip(disk.why_not)
        async with (
            Apart(disk.path).server(slots=1) as server,
            BrowserClient(server.url, token=server.token) as client,
        ):
            disk.fill()
            for _ in range(2):
                session = await client.open()
                assert (await session.step(Navigate(pages))).observation.title == "calm"
                [browser] = psutil.Process(server.process.pid).children()
                os.killpg(browser.pid, signal.SIGKILL)
                with pytest.raises((BrowserCrashed, LeaseLost)) as caught:
                    await session.step(Navigate(pages))
                assert caught.value.hint
            disk.clear()
            session = await client.open()
            assert (await session.step(Navigate(pages))).observation.title == "calm"
            await session.close()
            assert len(list(disk.path.glob("webgym-*/*/*"))) == 1
