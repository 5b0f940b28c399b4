"""What the agent is told of a connection that failed, and of addresses that are not the web's."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio
from aiodns.error import ARES_ESERVFAIL, DNSError
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.hosts import Address
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import LeftClick, Navigate

from .canary import HERE, Names
from .conftest import Site, Tab, serving
from .test_tab import free_port

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

WEB = "http://web.test"


class Network(Names):
    """A name service that fails by name, and a machine that can be taken off the network."""

    is_plugged_in = True

    async def lookup(self, name: str) -> list[Address]:
        if name == "broken.test":
            raise DNSError(ARES_ESERVFAIL, "try again")
        return await super().lookup(name)

    def is_online(self) -> bool:
        return self.is_plugged_in


class Told:
    """A tab on the network of this module."""

    def __init__(self, tab: Tab, egress: Egress, network: Network, site: Site) -> None:
        self.tab, self.egress, self.network, self.site = tab, egress, network, site

    async def goto(self, url: str) -> list[str]:
        await self.tab.goto(url)
        return [text for kind, text in self.tab.notices if kind == "navigation_failed"]


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def started(
    executable: Path, profiles: ProfileRoot
) -> AsyncIterator[tuple[Slot, Egress, Network, Site]]:
    async def go(request: Request) -> Response:
        return RedirectResponse(request.query_params["to"])

    network = Network({"polite.test": [HERE], "closed.test": [HERE], "inside.test": ["10.0.0.7"]})
    async with serving() as site:
        site.on("/go", go)
        rules = (f"web.test={HERE}:{site.port}", "gone.test=nowhere", "closed.test", f"{HERE}:{site.port}")
        async with Egress(EgressConfig(allow=rules), network) as egress:
            # A form or a window that leads nowhere keeps the page waiting: not for long, here.
            config = BrowserConfig(settle_seconds=1, long_poll_seconds=0.3)
            slot = Slot(config, executable, profiles, egress)
            yield slot, egress, network, site
            await slot.stop()


@pytest_asyncio.fixture(loop_scope="package")
async def told(started: tuple[Slot, Egress, Network, Site]) -> AsyncIterator[Told]:
    slot, egress, network, site = started
    options = PageOptions(text=True, elements=True)
    await slot.open(options)
    yield Told(Tab(slot, options), egress, network, site)
    network.is_plugged_in = True
    await slot.close()


# --- reasons --------------------------------------------------------------------------------------------


async def test_each_failure_is_told_as_what_it_is(told: Told) -> None:
    closed = f"http://closed.test:{free_port()}/"
    expected = {
        "http://no-such-name.test/": "net::ERR_NAME_NOT_RESOLVED",
        "http://gone.test/": "net::ERR_NAME_NOT_RESOLVED",
        "http://broken.test/": "net::ERR_NAME_RESOLUTION_FAILED",
        closed: "net::ERR_CONNECTION_REFUSED",
        "http://inside.test/": "refused by the egress policy: 10.0.0.7 is a private address",
        "http://polite.test:9/": "net::ERR_UNSAFE_PORT",
        f"http://8.8.8.8:{free_port()}/": "refused by the egress policy: port",
    }
    for url, why in expected.items():
        [text] = await told.goto(url)
        assert text.startswith(f"{url}: {why}")
    told.network.is_plugged_in = False
    assert await told.goto("http://broken.test/") == ["http://broken.test/: net::ERR_INTERNET_DISCONNECTED"]


async def test_it_is_told_of_the_place_that_a_redirect_leads_to(told: Told) -> None:
    [text] = await told.goto(f"{WEB}/go?to=http://gone.test/there")
    assert text == (
        f"{WEB}/go?to=http://gone.test/there (which leads to http://gone.test/there): "
        "net::ERR_NAME_NOT_RESOLVED"
    )
    told.site.page("<a href='/go?to=http://inside.test/x'>Go</a>", "/linked")
    await told.goto(f"{WEB}/linked")
    await told.tab.step(LeftClick(told.tab.at("Go")))
    # A slow machine may also say that the page was still loading at the deadline.
    assert [text for kind, text in told.tab.notices if kind == "navigation_failed"] == [
        "http://inside.test/x: refused by the egress policy: 10.0.0.7 is a private address"
    ]


async def test_a_page_that_opens_again_is_not_said_to_have_failed(told: Told) -> None:
    told.site.page("<p>here</p>", "/here")
    told.network.answers["late.test"] = []
    assert await told.goto(f"http://late.test:{told.site.port}/here")
    told.network.answers["late.test"] = [HERE]
    # A name that does not exist is remembered for a while, but not for the test's sake.
    told.egress._dialer._resolver._cache.clear()
    assert await told.goto(f"http://late.test:{told.site.port}/here") == []
    assert told.tab.text == ["here"]


@contextlib.asynccontextmanager
async def rude(say: bytes) -> AsyncIterator[int]:
    """A server that reads a request, says something, and resets the connection."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(asyncio.IncompleteReadError):
            await reader.readuntil(b"\r\n\r\n")
        writer.write(say)
        await writer.drain()
        raw = writer.get_extra_info("socket")
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        writer.close()

    async with await asyncio.start_server(serve, HERE, 0) as server:
        yield server.sockets[0].getsockname()[1]


async def test_what_happens_after_the_connection_comes_through_untouched(told: Told) -> None:
    async with rude(b"") as port:
        [text] = await told.goto(f"http://closed.test:{port}/")
        assert text.endswith("net::ERR_CONNECTION_RESET")
    [text] = await told.goto(f"https://closed.test:{told.site.port}/")
    assert "net::ERR_SSL" in text


async def test_too_many_connections_to_one_host(executable: Path, profiles: ProfileRoot) -> None:
    network = Network()
    network.answers["crowded.test"] = ["8.8.8.8"]
    async with Egress(EgressConfig(burst=1, rate=0.01, wait_seconds=0), network) as egress:
        # The one connection there is has been taken, so that this one is not even tried.
        assert egress._dialer._politeness.delay("crowded.test", asyncio.get_running_loop().time()) == 0
        slot = Slot(BrowserConfig(), executable, profiles, egress)
        try:
            await slot.open(PageOptions())
            look = await slot.step(Navigate("http://crowded.test/"))
            [notice] = look.observation.notices
            assert "too many new connections to crowded.test at the moment" in notice.text
        finally:
            await slot.stop()


# --- addresses that are not the web's -------------------------------------------------------------------

SCHEMES = [
    "file://$secret", "file:$secret", "view-source:file://$secret", "ftp://$place/", "chrome://version/",
    "chrome://settings", "devtools://devtools/bundled/inspector.html", "about:version", "chrome-error://x/",
    "blob:file:///1", "filesystem:file://$secret", "data:text/html,here", "mailto:a@b.test", "gopher://$place/",
    "ws://$place/", "jar:file://$secret",
]  # fmt: skip


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    file = tmp_path / "secret.html"
    file.write_text("<title>secret</title><p>secret")
    return file


def written(scheme: str, secret: Path, site: Site) -> str:
    return scheme.replace("$secret", str(secret)).replace("$place", f"{HERE}:{site.port}")


async def test_the_agent_opens_nothing_but_the_web(told: Told, secret: Path) -> None:
    told.site.page("<title>Home</title><p>home</p>", "/home")
    await told.goto(f"{WEB}/home")
    told.site.hits.clear()
    for scheme in SCHEMES:
        url = written(scheme, secret, told.site)
        [text] = await told.goto(url)
        assert "only http and https addresses are" in text, url
        assert told.tab.last is not None
        assert told.tab.last.observation.title == "Home"
    assert told.site.hits == []


LEADS = {
    "a link": "<a href='$url' id=a>start</a><script>a.click()</script>",
    "a link for a new window": "<a href='$url' target=_blank id=a>start</a><script>a.click()</script>",
    "a script": "<script>location = '$url'</script>",
    "a window": "<script>open('$url')</script>",
    "a window that is led": "<script>w = open('/home'); w.location = '$url'</script>",
    "a meta refresh": "<meta http-equiv=refresh content='0; url=$url'>",
    "a frame": "<iframe src='$url'></iframe>",
    "an object": "<object data='$url'></object>",
    "a form": "<form action='$url'></form><script>document.forms[0].submit()</script>",
}


FOREIGN = [
    "file://$secret",
    "view-source:file://$secret",
    "ftp://$place/",
    "chrome://version/",
    "about:version",
]
"""Of these schemes, one of each way that a browser treats them."""


@pytest.mark.parametrize("lead", LEADS)
async def test_no_page_leads_out_of_the_web(told: Told, secret: Path, lead: str) -> None:
    """One page each: none shows a thing, none takes the tab with it; a window for it stays blank."""
    told.site.page("<title>Home</title>", "/home")
    for scheme in FOREIGN:
        url = written(scheme, secret, told.site)
        told.site.page(f"<title>Start</title><p>start</p>{LEADS[lead].replace('$url', url)}", "/start")
        look = await told.tab.goto(f"{WEB}/start")
        seen = look.observation.url
        assert seen in (f"{WEB}/start", f"{WEB}/home") or seen.startswith("about:"), url
        assert look.observation.title in ("Start", "Home", ""), url
        assert set(told.tab.text) <= {"start", ""}, url


async def test_no_redirect_leads_out_of_the_web(told: Told, secret: Path) -> None:
    for scheme in SCHEMES:
        url = written(scheme, secret, told.site)
        await told.tab.goto(f"{WEB}/go?to={url}")
        assert told.tab.last is not None
        assert not told.tab.last.observation.title, url
        assert not any(told.tab.text), url


async def test_scripts_read_no_file(told: Told, secret: Path) -> None:
    told.site.page(
        f"<script>fetch('file://{secret}').then((r) => r.text()).catch(() => 'none')"
        ".then((said) => { document.title = said; })</script>",
        "/reads",
    )
    look = await told.tab.goto(f"{WEB}/reads")
    assert look.observation.title == "none"
