"""The books of a tab's loading, without a browser."""

from __future__ import annotations

import asyncio
import itertools
from typing import Any

import msgspec
import pytest

from webgym.browser.cdp_messages import RequestDone, RequestWillBeSent
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
    async with asyncio.timeout(30):
        await traffic.idle()


def _asks(traffic: Traffic, number: int) -> None:
    url = f"https://tiles.example/7/{number}.png"
    told = {
        "requestId": f"request {number}",
        "loaderId": "document",
        "documentURL": "https://tiles.example/",
        "request": {"url": url, "method": "GET", "initialPriority": "High"},
        "type": "Image",
        "frameId": "main",
    }
    traffic._on_request(msgspec.convert(told, RequestWillBeSent))


@pytest.mark.parametrize(("seconds_between", "is_awaited"), [(0.001, True), (0.5, False)])
async def test_a_map_that_asks_for_its_tiles_at_once_does_not_poll(
    seconds_between: float, is_awaited: bool
) -> None:
    traffic = Traffic(_Session(), "main", BrowserConfig())  # type: ignore[arg-type]
    now = 0.0
    traffic._clock = lambda: now
    traffic._site = "tiles.example"
    for number in range(20):
        _asks(traffic, number)
        now += seconds_between
    traffic.give_up(all_of_it=True)  # the deadline of a wait
    assert traffic.is_idle()
    _asks(traffic, 20)
    assert traffic.is_idle() is not is_awaited


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
        traffic.give_up()
    assert waits[0] > BrowserConfig().stir_seconds - 0.2
    assert waits[1] < 0.2
