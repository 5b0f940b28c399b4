"""What a page's connections cost by host, what our own limits refuse, and hosts that are on a block list."""

from __future__ import annotations

from pathlib import Path

import pytest

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.budget import Budget, Politeness
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate, Wait
from webgym.core.errors import ConfigError
from webgym.core.observation import Observation

from .canary import HERE
from .conftest import Site

browser = pytest.mark.browser
pytestmark = pytest.mark.asyncio(loop_scope="package")

PRICE = (
    "<p id=price>price: unknown</p><script>fetch('http://api.prices.test/price', {mode: 'no-cors'})"
    ".then(() => { price.textContent = 'price: $9' }, () => {})</script>"
)


async def seen(
    executable: Path, profiles: ProfileRoot, site: Site, *, again: bool = False, **limits: object
) -> list[Observation]:
    """What a page of shop.test shows that asks another website for its price; then again after a wait."""
    site.page("<p>x" + "y" * 20_000, "/price")
    site.page(PRICE, "/shop")
    rules = tuple(f"{host}={HERE}:{site.port}" for host in ("shop.test", "api.prices.test"))
    async with Egress(EgressConfig(allow=rules, **limits)) as egress:  # type: ignore[arg-type]
        slot = Slot(BrowserConfig(), executable, profiles, egress)
        try:
            await slot.open(PageOptions(text=True))
            looks = [await slot.step(Navigate("http://shop.test/shop")), await slot.step(Wait(0.1))]
            if again:
                looks.append(await slot.step(Navigate("http://shop.test/shop")))
        finally:
            await slot.stop()
    return [look.observation for look in looks]


@browser
async def test_bytes_are_counted_by_host_and_observation(
    executable: Path, profiles: ProfileRoot, site: Site
) -> None:
    first, second, again = await seen(executable, profiles, site, again=True)
    assert first.text == "price: $9"
    assert first.bytes["api.prices.test"] > 20_000
    assert 100 < first.bytes["shop.test"] < 20_000
    assert (second.bytes, first.limited, first.notices) == ({}, {}, ())
    assert again.bytes["shop.test"] > 0


@browser
async def test_what_our_own_limits_refuse_is_told_and_makes_the_observation_suspect(
    executable: Path, profiles: ProfileRoot, site: Site
) -> None:
    first, second = await seen(executable, profiles, site, session_connections=1)
    assert first.text == "price: unknown"
    assert set(first.limited) == {"api.prices.test"}
    (notice,) = [notice for notice in first.notices if notice.kind == "limited"]
    assert "api.prices.test" in notice.text
    assert "The website did not refuse them" in notice.text
    assert second.limited == {}


@browser
async def test_hosts_on_a_block_list_are_not_connected_to(
    executable: Path, profiles: ProfileRoot, site: Site, tmp_path: Path
) -> None:
    list_ = tmp_path / "trackers"
    list_.write_text(
        "# adverts\n0.0.0.0 ads.test API.Prices.test # the worst\n127.0.0.1 localhost\nplain.test\n"
    )
    site.hits.clear()
    first, _ = await seen(executable, profiles, site, block_lists=(list_,))
    assert first.text == "price: unknown"
    assert first.limited == {}  # this was the operator's choice
    assert "/price" not in site.hits
    with pytest.raises(ConfigError, match="cannot read the block list"):
        Egress(EgressConfig(block_lists=(tmp_path / "none",)))


async def test_a_shared_host_is_limited_by_website_and_a_websites_own_host_for_all() -> None:
    polite = Politeness(rate=0.001, burst=2, wait_seconds=0)

    def connects(site: str, host: str) -> bool:
        budget = Budget(EgressConfig())  # of a session of its own
        budget.site = site
        return polite.delay(budget.bucket(host), 0.0) is not None

    assert [connects("shop.test", "img.shop.test") for _ in range(3)] == [True, True, False]
    assert not connects("", "img.shop.test")
    assert [connects("shop.test", "cdn.test") for _ in range(3)] == [True, True, False]
    assert [connects("news.test", "cdn.test") for _ in range(3)] == [True, True, False]
    assert connects("cdn.test", "cdn.test")


async def test_only_connections_that_other_sessions_used_up_excuse_anything() -> None:
    limits = EgressConfig(rate=0.001, burst=3, wait_seconds=0)
    shared, (greedy, modest) = Politeness(0.001, 3, 0), (Budget(limits), Budget(limits))

    def connects(budget: Budget) -> tuple[bool, bool]:
        return budget.may_connect("shop.test", 0.0), shared.delay("shop.test", 0.0) is not None

    assert [connects(greedy) for _ in range(3)] == [(True, True)] * 3
    assert connects(greedy) == (False, False)  # its own doing
    assert connects(modest) == (True, False)  # the other's
