"""Many requests at once, over pools of few connections."""

from __future__ import annotations

import asyncio

import pytest
import uvicorn
from tests.llm.endpoint import Endpoint

from webgym.llm import pools as pools_module
from webgym.llm.pools import POOL, Pools


async def test_a_connection_is_let_go_before_a_server_closes_it(
    endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert uvicorn.Config("").timeout_keep_alive > pools_module._IDLE_SECONDS
    for seconds, peers in ((0.0, 2), (60.0, 3)):
        monkeypatch.setattr(pools_module, "_IDLE_SECONDS", seconds)
        pools = Pools(1)
        for _ in range(2):
            async with pools.post(f"{endpoint.url('fine')}/chat/completions", b"{}") as response:
                await response.aread()
        await pools.aclose()
        assert len(endpoint.peers) == peers


async def test_requests_are_spread_evenly_and_connections_are_kept(
    endpoint: Endpoint, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pools_module, "_IDLE_SECONDS", 60.0)  # however long the other requests take
    pools, count = Pools(12 * POOL, timeout=60), 12 * POOL - 5
    gathered = asyncio.Event()
    waiting = 0

    async def ask() -> int:
        nonlocal waiting
        async with pools.post(f"{endpoint.url('fine')}/chat/completions", b"{}") as response:
            waiting += 1
            if waiting == count:
                gathered.set()
            await gathered.wait()  # all are in flight at once
            await response.aread()
        return response.status_code

    try:
        for _ in range(2):
            gathered.clear()
            waiting = 0
            async with asyncio.timeout(60):
                assert set(await asyncio.gather(*(ask() for _ in range(count)))) == {200}
        assert max(pools._in_flight) == 0
        assert len(endpoint.peers) == count
    finally:
        await pools.aclose()
