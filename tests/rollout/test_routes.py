"""An upstream proxy that fails ends attempts as the environment's failure, whoever asked for what."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack

import pytest
from tests.browser.upstream_proxy import NAME, PASSWORD, UpstreamProxy, upstream_proxy
from tests.rollout.test_attribution import MIDDLE, Bench, Deed, Website, website

from webgym.browser.config import BrowserConfig
from webgym.core.action import Answer, Navigate
from webgym.core.errors import RouteFailed
from webgym.core.outcome import Ending
from webgym.server.client import BrowserClient
from webgym.server.config import ServerConfig
from webgym.server.worker import running_server

__all__ = ["website"]  # a fixture

pytestmark = pytest.mark.browser


@pytest.fixture
async def routed(
    website: Website, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[Bench, UpstreamProxy]]:
    monkeypatch.setenv("UPSTREAM", f"{NAME}:{PASSWORD}")
    async with AsyncExitStack() as stack:
        proxy = await stack.enter_async_context(upstream_proxy("http", {"shop.example": website.port}))
        egress = {"upstream": {"zurich": proxy.settings()}}
        browser = BrowserConfig.model_validate({"egress": egress, "navigate_seconds": 6, "settle_seconds": 3})
        server = await stack.enter_async_context(running_server(ServerConfig(slots=1, browser=browser)))
        client = await stack.enter_async_context(BrowserClient(server.url, token=server.token))
        info = await client.info()
        assert info.egress is not None
        assert info.egress.upstream == ("zurich",)
        yield Bench(server, client), proxy


async def test_a_proxy_that_fails_is_nobodys_fault(routed: tuple[Bench, UpstreamProxy]) -> None:
    bench, proxy = routed

    def fail(_: object) -> None:
        proxy.hangs_up = True
        proxy.cut()

    # What a proxy does not reach is answered like any address that fails.
    driver, seen = await bench.attempt(Navigate("http://gone.example/"), MIDDLE, Answer("no"))
    assert (driver.ending, driver.failure) == (Ending.ANSWERED, None)
    assert [view.route for view in seen] == ["zurich"] * len(seen)
    assert [fault.kind for fault in seen[1].faults] == ["connection"]
    assert [notice.kind for notice in seen[1].notices] == ["navigation_failed"]
    # Nor can an agent end an attempt with an address for which the proxy hangs up.
    proxy.hangs_up_on = "dead.example"
    driver, seen = await bench.attempt(Navigate("http://dead.example/"), MIDDLE, Answer("no"))
    assert (driver.ending, driver.failure) == (Ending.ANSWERED, None)
    assert "route" in [fault.kind for fault in seen[1].faults]
    ways: list[list[Deed]] = [[MIDDLE], [Navigate("http://other.example/")]]
    for deeds in ways:
        proxy.hangs_up = False
        driver, _ = await bench.attempt(fail, *deeds, Answer("no"))
        assert driver.ending is Ending.ENVIRONMENT_FAILED
        assert driver.failure is not None
        assert driver.failure.code == "route_failed"
        assert "the upstream proxy zurich hung up" in driver.failure.message
        assert PASSWORD not in driver.failure.message
    with pytest.raises(RouteFailed, match="cannot be opened"):
        await bench.attempt(Answer("no"))
