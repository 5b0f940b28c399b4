"""The books of a tab's loading, without a browser."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any

from webgym.browser.cdp_messages import RequestDone
from webgym.browser.config import BrowserConfig
from webgym.browser.traffic import Traffic


class _Session:
    def on(self, *_: Any) -> None:
        """Nothing is ever told."""


async def test_what_ends_between_two_looks_at_the_clock_has_ended() -> None:
    traffic = Traffic(_Session(), "main", BrowserConfig())  # type: ignore[arg-type]
    traffic._clock = lambda: 0.0
    traffic.begin("request", 5.0)
    clock = itertools.chain([4.9], itertools.repeat(5.1))
    traffic._clock = lambda: next(clock)
    async with asyncio.timeout(100):
        await traffic.idle()


async def test_what_a_socket_sends_all_the_time_is_no_answer() -> None:
    traffic = Traffic(_Session(), "main", BrowserConfig())  # type: ignore[arg-type]
    now = 0.0
    traffic._clock = lambda: now
    waits = []
    for _ in range(2):
        traffic._on_sent(RequestDone("socket"))
        start = now
        while not traffic.is_idle():
            now += 0.15
            traffic._on_received(RequestDone("socket"))
        waits.append(now - start)
        traffic.end_wait()
    assert waits[0] > BrowserConfig().busy_seconds - 0.2
    assert waits[1] < 0.2
