"""Pages that try to reach what they must not: each attempt against a canary on this machine.

Every case is played twice. Behind the policy, the attempt must arrive at the proxy and be refused there,
and the canary must see nothing. With everything allowed, the same attempt must reach the canary: a case
that could not fail proves nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from pathlib import Path
from string import Template

import psutil
import pytest
import pytest_asyncio
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress, ProxyListener
from webgym.browser.observe import Look
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate

from .canary import HERE, Canary, Names, UdpCanary, canary, has_ipv6, udp_canary
from .conftest import Site, serving

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

EVIL = "http://evil.localhost"
"""The attacker's website. As a name below localhost it is a secure context: service workers run."""

SECONDS = 15.0

RTC = (
    "const p = new RTCPeerConnection({iceServers: [{urls: '$server', username: 'a', credential: 'b'}]});"
    "p.onicecandidate = (event) => { if (!event.candidate) document.title = 'done'; };"
    "p.createDataChannel('x'); p.createOffer().then((offer) => p.setLocalDescription(offer));"
)

PARTS = {
    "image": "<img src='$url'>",
    "picture of a style": "<div style='background: url($url); width: 9px; height: 9px'></div>",
    "svg image": "<svg><image href='$url'/></svg>",
    "frame": "<iframe src='$url'></iframe>",
    "frame of a frame": "<iframe srcdoc=\"<iframe src='$url'></iframe>\"></iframe>",
    "object": "<object data='$url'></object>",
    "embed": "<embed src='$url'>",
    "script": "<script src='$url'></script>",
    "module": "<script type=module src='$url'></script>",
    "style sheet": "<link rel=stylesheet href='$url'>",
    "import of a style": "<style>@import url('$url');</style>",
    "font": "<style>@font-face {font-family: odd; src: url('$url')}</style><p style='font-family: odd'>x",
    "video": "<video src='$url' autoplay muted></video>",
    "audio": "<audio src='$url' autoplay muted></audio>",
    "preload": "<link rel=preload as=image href='$url'>",
    "prefetch": "<link rel=prefetch href='$url'>",
    "module preload": "<link rel=modulepreload href='$url'>",
    "fetch": "<script>fetch('$url', {mode: 'no-cors'})</script>",
    "fetch that outlives its page": "<script>fetch('$url', {mode: 'no-cors', keepalive: true})</script>",
    "XHR": "<script>{const x = new XMLHttpRequest(); x.open('GET', '$url'); x.send()}</script>",
    "beacon": "<script>navigator.sendBeacon('$url', 'x')</script>",
    "event source": "<script>new EventSource('$url')</script>",
    "web socket": "<script>new WebSocket('ws://$place/')</script>",
    "secure web socket": "<script>new WebSocket('wss://$place/')</script>",
    "worker": "<script>new Worker(URL.createObjectURL("
    "new Blob([`fetch('$url', {mode: 'no-cors'})`])))</script>",
    "form into a frame": "<iframe name=f></iframe><form method=post action='$url' target=f></form>"
    "<script>document.forms[0].submit()</script>",
    "TURN over TCP": "<script>{" + RTC.replace("$server", "turn:$place?transport=tcp") + "}</script>",
    "service worker": "<script>navigator.serviceWorker.register('/worker?to=$url')</script>",
    "redirect 301": "<img src='/go?status=301&to=$url'>",
    "redirect 302": "<img src='/go?status=302&to=$url'>",
    "redirect 303": "<img src='/go?status=303&to=$url'>",
    "redirect 307": "<iframe src='/go?status=307&to=$url'></iframe>",
    "redirect 308": "<script src='/go?status=308&to=$url'></script>",
}
"""Ways to ask for a URL that leave the page where it is. All stand in one page."""

MOVES = {
    "the agent itself": "$url",
    "a name that is a user's": "http://evil.localhost@$place/",
    "backslashes": r"<a href='http:\\$place\' id=a>x</a><script>a.click()</script>",
    "a redirect": "/go?status=302&to=$url",
    "a meta refresh": "<meta http-equiv=refresh content='0; url=$url'>",
    "a script": "<script>location = '$url'</script>",
    "a form": "<form method=post action='$url'></form><script>document.forms[0].submit()</script>",
    "a second window": "<script>open('$url')</script>",
    "a link that is clicked": "<a href='$url' id=a>x</a><script>a.click()</script>",
}
"""Ways to take the whole tab there."""

SPELLINGS = {
    "dotted": ("127.0.0.1", HERE),
    "another loopback": ("127.1.2.3", "127.1.2.3"),
    "decimal": ("2130706433", HERE),
    "hexadecimal": ("0x7f000001", HERE),
    "hexadecimal octets": ("0x7f.0x0.0x0.0x1", HERE),
    "octal": ("017700000001", HERE),
    "octal octets": ("0177.0.0.01", HERE),
    "two parts": ("127.1", HERE),
    "three parts": ("127.0.1", HERE),
    "mixed": ("0x7f.1", HERE),
    "trailing dot": ("127.0.0.1.", HERE),
    "full width": ("１２７．０．０．１", HERE),
    "circled": ("①②⑦.⓪.⓪.①", HERE),
    "ideographic stops": ("127。0。0。1", HERE),
    "percent": ("%31%32%37%2e0.0.1", HERE),
    "name": ("localhost", "localhost"),
    "name in capitals": ("LocalHost", "localhost"),
    "name with a dot": ("localhost.", "localhost"),
    "name below": ("anything.localhost", "anything.localhost"),
    "a name that leads here": ("leads-here.test", "leads-here.test"),
    "a name that leads here, mapped": ("mapped.test", "mapped.test"),
    "mapped": ("[::ffff:127.0.0.1]", "::ffff:127.0.0.1"),
    "mapped in hexadecimal": ("[0:0:0:0:0:ffff:7f00:1]", "::ffff:7f00:1"),
}
"""Of a place on this machine: as it is written, and as the proxy knows it."""

SIX = {"IPv6": ("[::1]", "::1"), "IPv6 at length": ("[0000:0:0::0001]", "::1")}

ELSEWHERE = [
    "10.0.0.1", "172.16.0.1", "172.31.255.254", "192.168.1.1", "100.64.0.1", "169.254.1.1", "169.254.169.254",
    "168.63.129.16", "100.100.100.200", "198.18.0.1", "[fd00::1]", "[fe80::1]", "[fd00:ec2::254]",
    "[64:ff9b::a9fe:a9fe]", "[64:ff9b::7f00:1]", "[2002:7f00:1::]", "[2001:0:7f00:1::1]", "[::127.0.0.1]",
    "[::ffff:169.254.169.254]", "[ff02::1]", "metadata.test", "inside.test",
]  # fmt: skip
"""Places where no canary can sit."""

NAMES = {
    "leads-here.test": ["127.0.0.1"],
    "mapped.test": ["::ffff:127.0.0.1"],
    "metadata.test": ["169.254.169.254"],
    "inside.test": ["10.1.2.3", "fd12::1"],
}


@dataclass
class Way:
    """A browser and its way out."""

    egress: Egress
    slot: Slot
    names: Names
    opened: bool
    """Whether everything is allowed."""

    async def goto(self, url: str) -> Look:
        return await self.slot.step(Navigate(url))


@dataclass
class Played:
    """One page's attempts: a canary each, and how each ended behind the policy and without."""

    refusals: dict[str, str] = field(default_factory=dict)
    leaks: dict[str, int] = field(default_factory=dict)
    reached: dict[str, bool] = field(default_factory=dict)


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def evil() -> AsyncIterator[Site]:
    async def go(request: Request) -> Response:
        return RedirectResponse(request.query_params["to"], int(request.query_params["status"]))

    async def worker(request: Request) -> Response:
        script = f"fetch('{request.query_params['to']}', {{mode: 'no-cors'}})"
        return Response(script, media_type="text/javascript")

    async with serving() as site:
        site.on("/go", go)
        site.on("/worker", worker)
        yield site


async def _way(evil: Site, executable: Path, profiles: ProfileRoot, opened: bool) -> AsyncIterator[Way]:
    names = Names(NAMES)
    allow = (f"evil.localhost=127.0.0.1:{evil.port}", "127.0.0.2", *(("*",) if opened else ()))
    # Any port, no cache: only the address can be what is refused, and every connection is looked up anew.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("webgym.browser.egress.resolver.CACHE_SECONDS", 0.0)
        async with Egress(EgressConfig(allow=allow, ports=()), names) as egress:
            slot = Slot(BrowserConfig(), executable, profiles, egress)
            yield Way(egress, slot, names, opened)
            await slot.stop()


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def guarded(evil: Site, executable: Path, profiles: ProfileRoot) -> AsyncIterator[Way]:
    async for way in _way(evil, executable, profiles, opened=False):
        yield way


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def opened(evil: Site, executable: Path, profiles: ProfileRoot) -> AsyncIterator[Way]:
    async for way in _way(evil, executable, profiles, opened=True):
        yield way


# That what is tried here succeeds where it may is a test of these tests.
@pytest_asyncio.fixture(
    loop_scope="package", params=["guarded", pytest.param("opened", marks=pytest.mark.slow)]
)
async def way(request: pytest.FixtureRequest, guarded: Way, opened: Way) -> AsyncIterator[Way]:
    chosen = guarded if request.param == "guarded" else opened
    await chosen.slot.open(PageOptions(text=True))
    yield chosen
    await chosen.slot.close()


async def until(what: Callable[[], object]) -> None:
    async with asyncio.timeout(SECONDS):
        while not what():
            await asyncio.sleep(0.01)


def reason(egress: Egress, host: str, port: int) -> str:
    place = f"[{host}]" if ":" in host else host
    failure = egress.failure(f"http://{place}:{port}/")
    return failure.reason if failure else ""


async def tried(way: Way, birds: dict[str, Canary], hosts: dict[str, str]) -> Played:
    """Wait until every attempt has got as far as it can."""
    played = Played()

    def is_over(name: str) -> bool:
        return bool(birds[name].visits if way.opened else reason(way.egress, hosts[name], birds[name].port))

    with contextlib.suppress(TimeoutError):  # the assertions say which
        await until(lambda: all(is_over(name) for name in birds))
    for name, bird in birds.items():
        played.leaks[name] = bird.visits
        played.refusals[name] = reason(way.egress, hosts[name], bird.port)
    return played


def verdict(way: Way, played: Played) -> None:
    if way.opened:
        missed = [name for name, visits in played.leaks.items() if not visits]
        assert not missed, "these attempts reach nothing even when they may"
    else:
        assert not {name: visits for name, visits in played.leaks.items() if visits}
        assert {name: why for name, why in played.refusals.items() if why != "forbidden"} == {}


async def test_no_part_of_a_page_reaches_this_machine(evil: Site, way: Way) -> None:
    async with AsyncExitStack() as stack:
        birds = {name: await stack.enter_async_context(canary()) for name in PARTS}
        body = [
            Template(html).substitute(url=f"http://{HERE}:{bird.port}/", place=f"{HERE}:{bird.port}")
            for (name, html), bird in zip(PARTS.items(), birds.values(), strict=True)
        ]
        evil.page("".join(body), "/parts")
        await way.goto(f"{EVIL}/parts")
        verdict(way, await tried(way, birds, dict.fromkeys(birds, HERE)))


@pytest.mark.parametrize("move", MOVES)
async def test_no_way_takes_the_tab_to_this_machine(evil: Site, way: Way, move: str) -> None:
    async with canary() as bird:
        url = f"http://{HERE}:{bird.port}/"
        written = Template(MOVES[move]).substitute(url=url, place=f"{HERE}:{bird.port}")
        if written.startswith("<"):
            evil.page(written, "/move")
            written = "/move"
        look = await way.goto(EVIL + written if written.startswith("/") else written)
        said = [notice.text for notice in look.observation.notices if notice.kind == "navigation_failed"]
        if way.opened:
            assert bird.visits
            assert look.observation.text == "secret"
            assert not said
        else:
            assert not bird.visits
            assert len(said) == 1, "told once"
            assert said[0].endswith(": refused by the egress policy: 127.0.0.1 is a loopback address")
            assert f"{HERE}:{bird.port}" in said[0]


async def test_no_spelling_of_this_machine_is_overlooked(evil: Site, way: Way) -> None:
    spellings = {**SPELLINGS, **(SIX if has_ipv6() else {})}
    async with AsyncExitStack() as stack:
        birds = {
            name: await stack.enter_async_context(
                canary("::1" if name in SIX else known if known == "127.1.2.3" else HERE)
            )
            for name, (_, known) in spellings.items()
        }
        images = [f"<img src='http://{spellings[name][0]}:{bird.port}/'>" for name, bird in birds.items()]
        evil.page("".join(images), "/spellings")
        await way.goto(f"{EVIL}/spellings")
        verdict(way, await tried(way, birds, {name: known for name, (_, known) in spellings.items()}))


@pytest.mark.parametrize("spelling", ["decimal", "octal octets", "full width", "name below", "mapped"])
async def test_nor_does_the_agent_get_there_by_spelling(guarded: Way, spelling: str) -> None:
    await guarded.slot.open(PageOptions())
    async with canary() as bird:
        look = await guarded.goto(f"http://{SPELLINGS[spelling][0]}:{bird.port}/")
        assert not bird.visits
    [notice] = look.observation.notices
    assert "refused by the egress policy: 127.0.0.1 is a loopback address" in notice.text
    await guarded.slot.close()


async def test_no_private_or_reserved_place_is_even_tried(evil: Site, guarded: Way) -> None:
    await guarded.slot.open(PageOptions())
    connected = guarded.egress.load.results.get("connected", 0)
    evil.page("".join(f"<img src='http://{host}/'>" for host in ELSEWHERE), "/elsewhere")
    await guarded.goto(f"{EVIL}/elsewhere")
    known = [host.strip("[]") for host in ELSEWHERE]
    await until(lambda: all(reason(guarded.egress, host, 80) for host in known))
    assert {host: why for host in known if (why := reason(guarded.egress, host, 80)) != "forbidden"} == {}
    assert guarded.egress.load.results["connected"] == connected + 1, "the page itself"
    await guarded.slot.close()


# --- names that change ----------------------------------------------------------------------------------


@pytest_asyncio.fixture(loop_scope="package")
async def pair() -> AsyncIterator[tuple[int, Canary]]:
    """A website on 127.0.0.2, which is allowed, and a canary with the same port on 127.0.0.1."""
    page = b"<script>(async () => {for (let i = 0; i < 4; i++) await fetch('/again?' + i)})()</script>"
    head = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nConnection: close\r\n"

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(head + b"Content-Length: %d\r\n\r\n" % len(page) + page)
        writer.close()

    async with canary() as bird, await asyncio.start_server(serve, "127.0.0.2", bird.port):
        yield bird.port, bird


async def test_a_name_that_turns_private_is_not_followed(way: Way, pair: tuple[int, Canary]) -> None:
    port, bird = pair
    way.names.answers["rebind.test"] = [["127.0.0.2"], ["127.0.0.2"], ["127.0.0.1"]]
    await way.goto(f"http://rebind.test:{port}/")
    await until(lambda: bird.visits if way.opened else reason(way.egress, "rebind.test", port))
    assert bool(bird.visits) == way.opened
    assert reason(way.egress, "rebind.test", port) == ("" if way.opened else "forbidden")


async def test_of_several_addresses_only_the_allowed_are_tried(way: Way, pair: tuple[int, Canary]) -> None:
    _, bird = pair
    # Nobody listens at the first, so that whoever may goes on to the second.
    way.names.answers["both.test"] = ["127.0.0.2", "127.0.0.1"]
    async with canary("127.0.0.1") as second:
        await way.goto(f"http://both.test:{second.port}/")
        assert bool(second.visits) == way.opened
    assert not bird.visits
    assert reason(way.egress, "both.test", second.port) == ("" if way.opened else "refused")


# --- what is not HTTP -----------------------------------------------------------------------------------


class _WithoutFlags(ProxyListener):
    @property
    def browser_flags(self) -> tuple[str, ...]:
        return ()


class _Unproxied(Egress):
    """The way out without what keeps packets in."""

    async def open_listener(self) -> ProxyListener:
        listener = await super().open_listener()
        listener.__class__ = _WithoutFlags
        return listener


DATAGRAMS = {
    "STUN": "<script>" + RTC.replace("$server", "stun:$place") + "</script>",
    "TURN": "<script>" + RTC.replace("$server", "turn:$place") + "</script>",
    "web transport": "<script>new WebTransport('https://$place/').ready.catch("
    "() => {document.title = 'done'})</script>",
    "a peer": """<script>(async () => {
        const one = new RTCPeerConnection(), two = new RTCPeerConnection();
        one.createDataChannel('x');
        await one.setLocalDescription(await one.createOffer());
        await two.setRemoteDescription(one.localDescription);
        await two.setLocalDescription(await two.createAnswer());
        await one.setRemoteDescription(two.localDescription);
        const candidate = 'candidate:1 1 udp 2122260223 $host $port typ host';
        await one.addIceCandidate({candidate, sdpMid: '0', sdpMLineIndex: 0});
        document.title = 'done';
    })()</script>""",
}


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def unproxied(executable: Path, profiles: ProfileRoot) -> AsyncIterator[Slot]:
    async with _Unproxied() as egress:
        slot = Slot(BrowserConfig(), executable, profiles, egress)
        yield slot
        await slot.stop()


def datagrams(evil: Site, name: str, bird: UdpCanary) -> None:
    place = f"{HERE}:{bird.port}"
    body = Template(DATAGRAMS[name]).substitute(place=place, host=HERE, port=bird.port)
    evil.page(body, "/datagrams")


@pytest.mark.parametrize("name", DATAGRAMS)
async def test_no_datagram_leaves_the_browser(evil: Site, guarded: Way, unproxied: Slot, name: str) -> None:
    async with udp_canary() as bird:
        datagrams(evil, name, bird)
        await guarded.slot.open(PageOptions())
        await guarded.goto(f"{EVIL}/datagrams")
        async with asyncio.timeout(SECONDS):
            while (await guarded.slot.metadata()).title != "done":
                await asyncio.sleep(0.02)
        assert not bird.visits
        await guarded.slot.close()
    async with udp_canary() as bird:
        datagrams(evil, name, bird)
        await unproxied.open(PageOptions())
        await unproxied.step(Navigate(evil.url("/datagrams")))
        await asyncio.wait_for(bird.seen.wait(), SECONDS)
        await unproxied.close()


async def test_all_that_a_browser_connects_to_is_the_proxy(evil: Site, guarded: Way) -> None:
    async def never(_: Request) -> Response:
        await asyncio.Event().wait()
        raise AssertionError

    evil.on("/never", never)
    evil.page("<script>for (let i = 0; i < 3; i++) fetch('/never?' + i)</script>", "/busy")
    await guarded.slot.open(PageOptions())
    await guarded.goto(f"{EVIL}/busy")
    assert guarded.slot.process is not None
    found = []
    for pid in guarded.slot.process.processes():
        found += psutil.Process(pid).net_connections("inet")
    assert found
    [said] = [
        flag
        for flag in psutil.Process(guarded.slot.process.pid).cmdline()
        if flag.startswith("--proxy-server=")
    ]
    assert {f"{HERE}:{one.raddr.port}" for one in found if one.raddr} == {said.rpartition("/")[2]}
    await guarded.slot.close()


async def test_without_the_proxy_there_is_no_way_at_all(
    evil: Site, executable: Path, profiles: ProfileRoot
) -> None:
    egress = Egress()
    await egress.start()
    slot = Slot(BrowserConfig(), executable, profiles, egress)
    try:
        await slot.open(PageOptions())
        await egress.stop()
        evil.hits.clear()
        look = await slot.step(Navigate(evil.url("/go")))
        assert look.observation.notices[0].kind == "navigation_failed"
        assert evil.hits == []
    finally:
        await slot.stop()


async def test_the_proxy_is_never_led_to_itself(evil: Site, opened: Way) -> None:
    await opened.slot.open(PageOptions())
    for host in (HERE, "localhost", "[::ffff:127.0.0.1]", "0.0.0.0"):
        look = await opened.goto(f"http://{host}:{opened.egress.port}/")
        assert any("this is the proxy itself" in one.text for one in look.observation.notices), host
    await opened.slot.close()
