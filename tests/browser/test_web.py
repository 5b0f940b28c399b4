"""What the web answers, or fails to: told to the agent as what it is."""

from __future__ import annotations

import asyncio
import contextlib
import io
import shutil
import socket
import ssl
import struct
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest
import trustme
from PIL import Image
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response, StreamingResponse

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.observe import Look
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import GoBack, LeftClick, Target, Wait

from .conftest import VIEWPORT, Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

FULL = shutil.which("chromium")

Peer = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@asynccontextmanager
async def raw(peer: Peer, context: ssl.SSLContext | None = None) -> AsyncIterator[str]:
    """A server that does with each connection what it likes; its host and port."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
                await peer(reader, writer)
        finally:
            writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0, ssl=context)
    async with server:
        yield f"127.0.0.1:{server.sockets[0].getsockname()[1]}"


def certified(host: str, until: datetime | None = None) -> ssl.SSLContext:
    """For a server certified by an authority that no browser knows.

    Args:
        host: that the certificate is for.
        until: the end of its time; far away if not given.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    begin = datetime(2020, 1, 1, tzinfo=UTC)
    trustme.CA().issue_cert(host, not_before=begin, not_after=until).configure_cert(context)
    return context


RESET = struct.pack("ii", 1, 0)
"""Linger for no time: the connection ends with a reset."""


def says(data: bytes, *, reset: bool = False) -> Peer:
    """Read a request, answer with these bytes, and end the connection."""

    async def peer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.readuntil(b"\r\n\r\n")
        writer.write(data)
        await writer.drain()
        if reset:
            writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)

    return peer


def answers(
    body: str, status: int = 200, headers: dict[str, str] | None = None
) -> Callable[[Request], Awaitable[Response]]:
    async def answer(_: Request) -> Response:
        return HTMLResponse(body, status, headers)

    return answer


async def both_ways(site: Site, tab: Tab, url: str) -> AsyncIterator[str]:
    """Go there by address, then by a link."""
    home = site.page(f"<title>Home</title><a href='{url}'>Go</a>")
    await tab.goto(home)
    await tab.goto(url)
    yield home
    await tab.goto(home)
    await tab.step(LeftClick(tab.at("Go")))
    yield home


# --- the server answers -------------------------------------------------------------------------------


ANSWERS: dict[str, tuple[str, int, dict[str, str]]] = {
    "a page that is refused": ("<h1>Says so</h1>", 403, {}),
    "a page that is not there": ("<h1>Says so</h1>", 404, {}),
    "a page of a broken server": ("<h1>Says so</h1>", 503, {}),
    "a page that wants a password": ("<h1>Says so</h1>", 401, {"www-authenticate": 'Basic realm="Staff"'}),
    "an error without a page": ("", 404, {}),  # Chromium with a window would show a page of its own
    "an empty page": ("", 200, {}),
}


@pytest.mark.parametrize("name", one_in(2, ANSWERS))
async def test_a_status_and_what_comes_with_it(site: Site, tab: Tab, name: str) -> None:
    body, status, headers = ANSWERS[name]
    url = site.on("/answer", answers(body, status, headers))
    async for _ in both_ways(site, tab, url):
        assert tab.last is not None
        assert tab.last.observation.status == status
        assert tab.last.observation.url == url
        assert tab.text == (["Says so"] if body else [""])
        notices = [(kind, "asks for a user name and a password" in text) for kind, text in tab.notices]
        assert notices == ([("browser", True)] if status == 401 else [])


@pytest.mark.parametrize("status", [204, 205])
async def test_an_answer_without_content_leaves_the_page(site: Site, tab: Tab, status: int) -> None:
    async def nothing(_: Request) -> Response:
        return Response(status_code=status)

    url = site.on("/nothing", nothing)
    async for home in both_ways(site, tab, url):
        assert tab.last is not None
        assert tab.last.observation.url == home
        assert tab.last.observation.status == 200
        [(kind, text)] = tab.notices
        assert kind == "navigation_failed"
        assert f"{status}" in text
        assert url in text


async def test_a_refresh_and_a_chain_of_redirects(site: Site, tab: Tab) -> None:
    async def hop(request: Request) -> Response:
        left = int(request.query_params["left"])
        return RedirectResponse(f"/hop?left={left - 1}" if left else "/end")

    site.on("/hop", hop)
    site.page("<title>End</title><p>here</p>", "/end")
    home = site.page("<title>Home</title><p>here</p>")
    await tab.goto(home)
    look = await tab.goto(site.url("/hop?left=5"))
    assert (look.observation.url, look.observation.status) == (site.url("/end"), 200)
    look = await tab.step(GoBack())
    assert look.observation.url == home
    await tab.goto(site.url("/hop?left=50"))
    [(kind, text)] = tab.notices
    assert kind == "navigation_failed"
    assert text.endswith("net::ERR_TOO_MANY_REDIRECTS")


# --- the server fails ---------------------------------------------------------------------------------

FAILURES = {
    "says nothing": (says(b""), "net::ERR_EMPTY_RESPONSE"),
    "resets": (says(b"", reset=True), "net::ERR_CONNECTION_RESET"),
    "speaks no http": (says(b"\x00\x01\x02garbage\r\n\r\n" * 9), "net::ERR_INVALID_HTTP_RESPONSE"),
    "breaks its headers": (
        says(b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nContent-Length: 9\r\n\r\nhello"),
        "net::ERR_RESPONSE_HEADERS_MULTIPLE_CONTENT_LENGTH",
    ),
    "endless headers": (
        says(b"HTTP/1.1 200 OK\r\nX: " + b"x" * 400_000),
        "net::ERR_RESPONSE_HEADERS_TOO_BIG",
    ),
}


@pytest.mark.parametrize("name", one_in(2, FAILURES))
async def test_a_server_that_fails(site: Site, tab: Tab, name: str) -> None:
    peer, word = FAILURES[name]
    async with raw(peer) as place:
        async for _ in both_ways(site, tab, f"http://{place}/"):
            assert tab.last is not None
            assert tab.notices == [("navigation_failed", f"http://{place}/: {word}")]
            assert tab.last.observation.status is None


async def test_a_page_that_breaks_off(site: Site, tab: Tab) -> None:
    page = b"<!doctype html><title>Half</title><p>the first half</p><img src=/read>" + b"<!-- -->" * 200
    head = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 90000\r\n\r\n"
    is_read = asyncio.Event()

    async def peer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Break off once the first half was read: what comes together with the end is never shown."""
        if b"/read " in await reader.readuntil(b"\r\n\r\n"):
            is_read.set()
            return
        is_read.clear()
        writer.write(head + page)
        await is_read.wait()

    async with raw(peer) as place:
        async for _ in both_ways(site, tab, f"http://{place}/"):
            assert tab.last is not None
            assert tab.text == ["the first half"]
            assert tab.last.observation.status == 200
            [(kind, text)] = tab.notices
            assert kind == "navigation_failed"
            assert "net::ERR_CONTENT_LENGTH_MISMATCH" in text


IMPATIENT = BrowserConfig(settle_seconds=0.6, screenshot_try_seconds=0.6)
COMMENTS = "<!-- -->" * 300  # Chromium reads the first part of a page when it has this much


def is_white(look: Look) -> bool:
    with Image.open(io.BytesIO(look.image)) as image:
        assert image.size == VIEWPORT
        return image.convert("L").getextrema() == (255, 255)


HEADS = {
    "nothing at all": "",
    "a part of its head": f"<!doctype html><title>Late</title>{COMMENTS}",
    "a script to wait for": f"<!doctype html><title>Late</title><script src='/late.js'></script>{COMMENTS}",
}


@pytest.mark.parametrize("head", HEADS.values(), ids=HEADS.keys())
async def test_a_page_that_is_late_with_its_body(site: Site, open_tab: Open, head: str) -> None:
    """Chromium draws nothing before there is a body, and answers no request for a picture."""
    going_on = asyncio.Event()

    async def page(_: Request) -> Response:
        async def parts() -> AsyncIterator[str]:
            yield head
            if "/late.js" not in head:
                await going_on.wait()
            yield "<body><p>here it is</p>"

        return StreamingResponse(parts(), media_type="text/html")

    async def late(_: Request) -> Response:
        await going_on.wait()
        return Response("", media_type="text/javascript")

    site.on("/late.js", late)
    tab = await open_tab(config=IMPATIENT, jpeg_quality=None if head else 80)
    look = await tab.goto(site.on("/late", page))
    assert is_white(look)
    assert [kind for kind, _ in tab.notices] == ["still_loading", "navigation_failed"]
    assert tab.notices[1][1] == f"{site.url('/late')} has nothing to show yet"
    assert look.observation.url == site.url("/late")
    going_on.set()
    look = await tab.step(Wait(time=1))
    assert not is_white(look)
    assert tab.text == ["here it is"]
    assert tab.notices == []


BLOCKING = {
    "a style sheet": "<link rel=stylesheet href=/late.css>",
    "an imported one": "<style>@import url(/late.css)</style>",
    "a script": "<script async blocking=render src=/late.js></script>",
}


@pytest.mark.parametrize("blocking", BLOCKING.values(), ids=BLOCKING.keys())
async def test_a_page_is_shown_while_it_waits_for(site: Site, open_tab: Open, blocking: str) -> None:
    going_on = asyncio.Event()

    async def late(request: Request) -> Response:
        await going_on.wait()
        if request.url.path == "/late.css":
            return Response("p { display: none }", media_type="text/css")
        return Response("document.querySelector('p').textContent = 'new'", media_type="text/javascript")

    for path in ("/late.css", "/late.js"):
        site.on(path, late)
    tab = await open_tab(config=IMPATIENT)
    url = site.page(f"<head><title>T</title>{blocking}</head><body><p>here</p><button>b</button>")
    assert not is_white(await tab.goto(url))
    assert tab.text == ["here", "b"]
    assert [kind for kind, _ in tab.notices] == ["still_loading"]
    await tab.step(LeftClick(tab.at("b")))
    assert "action_failed" not in [kind for kind, _ in tab.notices]
    going_on.set()
    await tab.step(Wait(time=1))
    assert tab.text == (["new", "b"] if "script" in blocking else ["b"])
    assert site.hits.count("/late.css") + site.hits.count("/late.js") == 1


@pytest.mark.parametrize("part", ["", "<!doctype html>", f"<!doctype html><title>Half</title>{COMMENTS}"])
async def test_a_page_that_breaks_off_before_its_body(site: Site, open_tab: Open, part: str) -> None:
    head = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 90000\r\n\r\n"
    tab = await open_tab(config=IMPATIENT)
    async with raw(says(head + part.encode())) as place:
        async for home in both_ways(site, tab, f"http://{place}/"):
            assert tab.last is not None
            assert is_white(tab.last)
            assert "navigation_failed" in [kind for kind, _ in tab.notices]
            await tab.step(GoBack())
            assert tab.last.observation.url == home


async def test_a_part_of_a_page_that_breaks_off_is_recorded(site: Site, open_tab: Open) -> None:
    """For its own website; an agent is not told."""
    head = b"HTTP/1.1 200 OK\r\nContent-Type: text/html\r\nContent-Length: 90\r\n\r\n"
    tab = await open_tab(config=IMPATIENT)
    async with raw(says(head)) as place:
        gone = f"http://{place}/gone"
        parts = {"<script src={}></script>": 1, "<iframe src={}></iframe>": 1, "<p>{}": 0}
        for part, count in parts.items():
            look = await tab.goto(site.page("<p>here" + part.format(f"{gone}?a=b")))
            faults = look.observation.faults
            assert [(fault.kind, fault.url, fault.is_typed) for fault in faults] == [
                ("part", gone, False)
            ] * count
            assert all("net::ERR_" in fault.why for fault in faults)
            assert not [text for _, text in tab.notices if gone in text]

        async def fails(_: Request) -> Response:
            return Response(status_code=503)

        failing = site.on("/failing", fails)
        look = await tab.goto(site.page(f"<p>here<iframe src={failing}></iframe>"))
        assert [(fault.kind, fault.url) for fault in look.observation.faults] == [("part", failing)]
        assert "HTTP status 503" in look.observation.faults[0].why
        elsewhere = gone.replace("127.0.0.1", "localhost")
        assert (await tab.goto(site.page(f"<script src={elsewhere}></script>"))).observation.faults == ()
        assert (await tab.step(Wait(time=0.1))).observation.faults == ()


SYNCHRONOUS = "const ask = new XMLHttpRequest(); ask.open('GET', '/late', false); ask.send()"


@pytest.mark.parametrize("when", ["onclick", "onload", "later"])
async def test_a_script_that_waits_for_a_synchronous_request(site: Site, open_tab: Open, when: str) -> None:
    """Nothing ends it but the end of the request."""

    async def late(_: Request) -> Response:
        await asyncio.sleep(60)
        return Response()

    site.on("/late", late)
    script = {
        "onclick": "document.querySelector('button').onclick = ask",
        "onload": "ask()",
        "later": "setTimeout(ask, 50)",
    }[when]
    page = f"<p>here</p><button>b</button><script>function ask() {{ {SYNCHRONOUS} }} {script}</script>"
    tab = await open_tab(config=BrowserConfig(settle_seconds=1, execute_seconds=1))
    look = await tab.goto(site.page(page))
    look = await tab.step(LeftClick(Target(coordinate=(30, 90))) if when == "onclick" else Wait(time=1))
    assert look.observation.text == "here\nb"
    await tab.goto(site.page("<p>another"))
    assert tab.text == ["another"]
    assert site.hits.count("/late") >= 1


async def test_the_page_after_a_synchronous_request_is_not_cut(site: Site, open_tab: Open) -> None:
    async def silent(reader: asyncio.StreamReader, _: asyncio.StreamWriter) -> None:
        await reader.read(-1)

    async def following(_: Request) -> Response:
        await asyncio.sleep(1)
        return HTMLResponse("<p>next")

    site.on("/next", following)
    tab = await open_tab(config=BrowserConfig(execute_seconds=1))
    async with raw(silent) as place:
        script = SYNCHRONOUS.replace("/late", f"http://{place}/")
        script = f"document.links[0].onclick = () => {{ {script} }}"
        await tab.goto(site.page(f"<a href=/next>on</a><script>{script}</script>"))
        await tab.step(LeftClick(tab.at("on")))
    assert tab.text == ["next"]


async def test_a_script_that_is_ended_costs_no_other_request(site: Site, open_tab: Open) -> None:
    going_on = asyncio.Event()

    async def late(_: Request) -> Response:
        await going_on.wait()
        return Response("the answer")

    site.on("/late", late)
    page = (
        "<p>here</p><button onclick='for (;;);'>b</button><script>const ask = new XMLHttpRequest();"
        "ask.open('GET', '/late'); ask.send();"
        "ask.onloadend = () => { document.querySelector('p').textContent = ask.responseText }</script>"
    )
    tab = await open_tab(config=BrowserConfig(settle_seconds=1, execute_seconds=1))
    await tab.goto(site.page(page))
    await tab.step(LeftClick(tab.at("b")))
    assert any("script" in text for _, text in tab.notices)
    await asyncio.sleep(1)
    going_on.set()
    await tab.step(Wait(time=1))
    assert tab.text == ["the answer", "b"]


async def test_a_service_worker_that_never_answers(site: Site, open_tab: Open) -> None:
    """While the page is replaced by what the worker does not give, Chromium asks it nothing."""

    async def worker(_: Request) -> Response:
        script = "onfetch = (event) => event.respondWith(new Promise(() => {}))"
        return Response(script, media_type="text/javascript")

    site.on("/worker.js", worker)
    page = site.page(
        "<p>here</p><script>navigator.serviceWorker.register('/worker.js')"
        ".then(() => setTimeout(() => location.reload(), 500))</script>"
    )
    tab = await open_tab(config=BrowserConfig(settle_seconds=2, execute_seconds=1))
    await tab.goto(page)
    await tab.step(Wait(time=1))
    assert tab.text == ["here"]
    await tab.step(Wait(time=1))
    assert tab.text == ["here"]
    await tab.goto("about:blank")
    await tab.goto(site.elsewhere(page))
    assert tab.text == ["here"]


async def test_names_that_do_not_exist(site: Site, tab: Tab) -> None:
    async for _ in both_ways(site, tab, "http://no-such-host.invalid/"):
        [(kind, text)] = tab.notices
        assert kind == "navigation_failed"
        assert "no-such-host.invalid" in text


CERTIFICATES = {
    "of no known authority": certified("127.0.0.1"),
    "expired": certified("127.0.0.1", until=datetime(2020, 2, 1, tzinfo=UTC)),
    "of another host": certified("other.example"),
}


@pytest.mark.parametrize("context", CERTIFICATES.values(), ids=CERTIFICATES.keys())
async def test_certificates_that_are_not_to_be_trusted(site: Site, tab: Tab, context: ssl.SSLContext) -> None:
    async with raw(says(b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\nhi"), context) as place:
        async for _ in both_ways(site, tab, f"https://{place}/"):
            assert tab.last is not None
            [(kind, text)] = tab.notices
            assert kind == "navigation_failed"
            assert "net::ERR_CERT_AUTHORITY_INVALID" in text, "the gravest of its faults"
            assert tab.last.observation.status is None


async def test_offline(site: Site, new_tab: Tab) -> None:
    home = site.page("<title>Home</title><p>here</p>")
    page = new_tab.slot.page
    offline = {"offline": True, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
    await page.session.do("Network.emulateNetworkConditions", offline, seconds=5)
    await new_tab.goto(home)
    [(kind, text)] = new_tab.notices
    assert kind == "navigation_failed"
    assert "net::ERR_INTERNET_DISCONNECTED" in text


# --- elsewhere than the web ---------------------------------------------------------------------------

ELSEWHERE = {
    "mail": "<a href=mailto:a@b.example>Go</a>",
    "an app": "<button onclick=\"location = 'app://x'\">Go</button>",
    "a file": "<a href=file:///etc/passwd>Go</a>",
    "data": "<a href=data:text/html,hi>Go</a>",
    "a form to a file": "<form action=file:///etc/passwd><button>Go</button></form>",
    "the browser itself": "<a href=chrome://version>Go</a>",
}


@pytest.mark.parametrize("lead", ELSEWHERE.values(), ids=ELSEWHERE.keys())
async def test_what_is_no_web_address_is_not_opened_and_told(site: Site, tab: Tab, lead: str) -> None:
    home = site.page(lead)
    await tab.goto(home)
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.url == home
    assert look.observation.settled != "deadline"
    [(kind, text)] = tab.notices
    assert kind == "navigation_failed"
    assert "only http and https addresses are" in text


AT_ONCE = {
    "before its body": "<script>location = 'app://x'</script><title>Home</title><p>here</p>",
    "from its body": "<title>Home</title><p>here</p><script>location = 'app://x'</script>",
    "by a refresh": "<meta http-equiv=refresh content='0;url=app://x'><title>Home</title><p>here</p>",
    "by a form": "<title>Home</title><p>here</p><form action='file:///x'></form>"
    "<script>document.forms[0].submit()</script>",
}


@pytest.mark.parametrize("page", AT_ONCE.values(), ids=AT_ONCE.keys())
async def test_a_page_that_leads_out_of_the_web_at_once(site: Site, tab: Tab, page: str) -> None:
    """Chromium reads no further what leads on before its body: the page is blank, but not lost."""
    home = site.page(page)
    look = await tab.goto(home)
    assert look.observation.url == home
    assert look.observation.settled != "deadline"
    assert look.observation.status == 200
    assert tab.text == [""] if "<script>" in page[:8] else ["here"]
    [(kind, text)] = tab.notices
    assert kind == "navigation_failed"
    assert "only http and https addresses are" in text


# --- back ---------------------------------------------------------------------------------------------


async def test_back_from_a_page_that_could_not_be_opened(site: Site, tab: Tab) -> None:
    home = site.page("<title>Home</title><a href='http://no-such-host.invalid/'>Go</a>")
    await tab.goto(home)
    await tab.step(LeftClick(tab.at("Go")))
    look = await tab.step(GoBack())
    assert (look.observation.url, look.observation.status) == (home, 200)
    assert tab.notices == []


@pytest.mark.parametrize("kept", ["max-age=60", "no-store"])
async def test_back_after_a_form_was_sent(site: Site, tab: Tab, kept: str) -> None:
    """What the browser has kept is shown; nothing is bought twice."""

    async def take(request: Request) -> Response:
        form = await request.form()
        page = f"<title>Took {form['q']}</title><a href=/next>Next</a>"
        return HTMLResponse(page, headers={"cache-control": kept})

    site.on("/take", take)
    site.page("<title>Next</title><p>here</p>", "/next")
    home = site.page(
        "<title>Form</title><form action=/take method=post><input name=q value=7><button>Go</button></form>"
    )
    await tab.goto(home)
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == "Took 7"
    await tab.step(LeftClick(tab.at("Next")))
    look = await tab.step(GoBack())
    assert look.observation.url == site.url("/take")
    if kept == "no-store":
        [(kind, text)] = tab.notices
        assert kind == "navigation_failed"
        assert "net::ERR_CACHE_MISS, this page was the answer to a form" in text
    else:
        assert look.observation.title == "Took 7"
    assert site.hits.count("/take") == 1, "it was not sent again"
    look = await tab.step(GoBack())
    assert look.observation.url == home


async def test_back_to_a_page_that_scripts_had_changed(site: Site, tab: Tab) -> None:
    site.page("<title>Item</title><p>here</p>", "/item")
    home = site.page(
        "<button onclick=\"r.textContent = '3 results'\">Search</button><a href=/item>Item</a><p id=r>none"
    )
    await tab.goto(home)
    for is_changed in (False, True):
        if is_changed:
            await tab.step(LeftClick(tab.at("Search")))
        await tab.step(LeftClick(tab.at("Item")))
        await tab.step(GoBack())
        assert [kind for kind, _ in tab.notices] == ["reloaded"] * is_changed


@pytest.mark.slow
@pytest.mark.skipif(not FULL, reason="no full Chromium is installed")
async def test_a_full_browser_goes_back_to_the_page_as_it_was(site: Site, egress: Egress) -> None:
    """It has a back-forward cache; our scripts stay in the page, and numbers with their elements."""
    site.page("<title>Item</title><p>here</p>", "/item")
    inner = site.page("<button onclick=\"this.textContent = 'Pressed'\">Press</button>")
    home = site.page(
        "<button onclick=\"r.innerHTML = '3 results <a href=/item>Shoe</a>'\">Search</button>"
        f"<label><input type=checkbox>Red</label><iframe src='{site.elsewhere(inner)}'></iframe><p id=r>none"
    )
    with tempfile.TemporaryDirectory() as folder:  # such a browser needs a short path
        slot = Slot(BrowserConfig(), Path(FULL or ""), ProfileRoot(Path(folder)), egress)
        options = PageOptions(text=True, elements=True, viewport=VIEWPORT)
        await slot.open(options)
        tab = Tab(slot, options)
        await tab.goto(home)
        for name, role in (("Search", "button"), ("Press", "button"), ("Red", "checkbox")):
            await tab.step(LeftClick(tab.at(name, role)))
        assert tab.last is not None
        elements = tab.last.observation.elements
        for _ in range(2):
            await tab.step(LeftClick(tab.at("Shoe")))
            look = await tab.step(GoBack())
            assert look.observation.elements == elements
            assert (look.observation.status, tab.notices) == (200, [])
        await slot.stop()
    assert site.hits.count(home.removeprefix(site.url(""))) == 1


async def test_back_out_of_a_page_that_writes_its_history(site: Site, tab: Tab) -> None:
    """Each popstate adds entries: that is reported, and going back once more leaves it."""
    home = site.page("<title>Home</title><a href=/writer>Go</a>")
    site.page(
        "<title>Writer</title><h1>here</h1><script>let k = 0; f(); f(); f(); onpopstate = f;"
        "function f() { history.pushState({}, '', '?' + ++k) }</script>",
        "/writer",
    )
    await tab.goto(home)
    await tab.step(LeftClick(tab.at("Go")))
    look = await tab.step(GoBack())
    assert look.observation.title == "Writer"
    assert "put itself in front" in tab.notices[0][1]
    look = await tab.step(GoBack())
    assert (look.observation.title, look.observation.url) == ("Home", home)
    assert tab.notices == []


TRAPS = {
    "an address": "<script>location.href = '/end'</script>",
    "in its place": "<script>location.replace('/end')</script>",
    "a little later": "<script>setTimeout(() => { location = '/end' }, 60)</script>",
    "a refresh": "<meta http-equiv=refresh content='0;url=/end'>",
    "a form": "<form action=/end></form><script>document.forms[0].submit()</script>",
    "two of them": "<script>location.href = '/trap2'</script>",
}


@pytest.mark.parametrize("trap", TRAPS.values(), ids=TRAPS.keys())
async def test_back_out_of_a_page_that_leads_on_at_once(site: Site, tab: Tab, trap: str) -> None:
    site.page("<title>End</title><p>here</p>", "/end")
    site.page("<script>location.href = '/end'</script>", "/trap2")
    home = site.page("<title>Home</title><a href=/trap>Go</a>")
    site.page(f"<title>Trap</title>{trap}", "/trap")
    await tab.goto(home)
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == "End"
    look = await tab.step(GoBack())
    assert look.observation.url == home
    assert tab.notices == []


async def test_back_to_a_first_page_that_leads_on(site: Site, new_tab: Tab) -> None:
    site.page("<title>End</title><p>here</p>", "/end")
    await new_tab.goto(site.page("<script>setTimeout(() => { location = '/end' }, 60)</script>"))
    look = await new_tab.step(GoBack())
    assert look.observation.title == "End"
    assert new_tab.notices == [("action_failed", "there is no earlier page to go back to")]


async def test_back_in_histories_that_scripts_write(site: Site, tab: Tab) -> None:
    home = site.page(
        "<h1 id=h></h1><button onclick=\"go('/one')\">One</button><button onclick=\"go('/two')\">Two</button>"
        "<button onclick=\"history.replaceState(0, '', '/three'); show()\">Three</button>"
        "<button onclick=\"location.hash = 'four'\">Four</button>"
        "<script>const show = () => { h.textContent = location.pathname + location.hash };"
        "const go = (to) => { history.pushState(0, '', to); show() };"
        "onpopstate = show; onhashchange = show; show()"
        "</script>"
    )
    before = site.page("<title>Before</title><p>here</p>")
    await tab.goto(before)
    await tab.goto(home)
    for name in ("One", "Two", "Three", "Four"):
        await tab.step(LeftClick(tab.at(name)))
    assert tab.last is not None
    assert tab.text[0] == "/three#four"
    seen = []
    for _ in range(4):
        look = await tab.step(GoBack())
        seen.append(look.observation.url.removeprefix(site.url("")))
        assert tab.notices == []
    assert seen == ["/three", "/one", home.removeprefix(site.url("")), before.removeprefix(site.url(""))]
