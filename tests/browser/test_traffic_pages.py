"""What an action asks for is waited for, whatever else the page asks for by itself."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio
from benchmarks.settle.hardweb import HardSite
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response, StreamingResponse

from webgym.browser.config import BrowserConfig
from webgym.core.action import LeftClick, Target, Type, Wait

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

NOWHERE = LeftClick(Target(coordinate=(990, 990)))


@pytest.fixture
def tab(new_tab: Tab) -> Tab:
    """A new one: how long a page is waited for is told from a tab's beginning."""
    return new_tab


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def hard() -> AsyncIterator[HardSite]:
    async with HardSite() as site:
        yield site


def reason(tab: Tab) -> str:
    assert tab.last is not None
    return tab.last.observation.settled


def settle_ms(tab: Tab) -> float:
    assert tab.last is not None
    return tab.last.observation.milliseconds["settle"]


_SEARCH = """<input id=q aria-label=Search><p id=out>nothing</p><script>q.onchange = async () => {
  out.textContent = await (await fetch('/search?q=' + q.value)).text() }</script>"""


async def test_an_answer_that_is_late_is_named_each_time(site: Site, open_tab: Open) -> None:
    async def answer(request: Request) -> Response:
        await asyncio.sleep(1)
        return Response(f"about {request.query_params['q']}")

    site.on("/search", answer)
    tab = await open_tab(config=BrowserConfig(long_poll_seconds=0.5))
    await tab.goto(site.page(_SEARCH))
    for word in ("ships", "shores", "ferries"):
        await tab.step(Type(tab.at("Search"), word))
        assert settle_ms(tab) >= 450
        assert "a request to /search" in dict(tab.notices)["still_loading"]
        await tab.step(Wait(0.8))
        assert f"about {word}" in tab.text
        assert tab.notices == []


_ONE_ADDRESS = """<p id=out>nothing</p><button onclick=ask()>Ask</button><script>
const at = (body) => fetch('/graphql', { method: 'POST', body });
const hear = async () => { for (let n = 0; ; n++) await at('news ' + n) };
const ask = async () => { out.textContent = await (await at('question')).text() };
hear();
</script>"""


async def test_what_is_asked_for_ever_hides_no_answer_from_its_address(site: Site, open_tab: Open) -> None:
    news = asyncio.Event()
    questions = 0

    async def answer(request: Request) -> Response:
        nonlocal questions, news
        if (await request.body()).startswith(b"news"):
            await news.wait()
            return Response("news")
        questions += 1
        await asyncio.sleep(0.4)
        return Response(f"answer {questions}")

    site.on("/graphql", answer)
    tab = await open_tab(config=BrowserConfig(long_poll_seconds=2.0))
    await tab.goto(site.page(_ONE_ADDRESS))
    assert reason(tab) == "long_poll"
    for number in range(1, 4):
        await tab.step(LeftClick(tab.at("Ask")))
        assert f"answer {number}" in tab.text
        await tab.step(NOWHERE)
        assert reason(tab) == "unchanged"
    waits = []
    for _ in range(2):  # news comes after the action, and is asked for again
        await asyncio.sleep(BrowserConfig().minor_seconds + 0.1)
        asyncio.get_running_loop().call_later(0.03, news.set)
        asyncio.get_running_loop().call_later(0.06, news.clear)
        await tab.step(NOWHERE)
        waits.append(settle_ms(tab))
    assert waits[1] < 1000, waits


async def test_an_answer_in_pieces_is_read_to_its_end(site: Site, tab: Tab) -> None:
    async def answer(_: Request) -> Response:
        async def pieces() -> AsyncIterator[str]:
            for number in range(4):
                await asyncio.sleep(1.3)
                yield f"part {number} "

        return StreamingResponse(pieces(), media_type="text/plain")

    site.on("/answer", answer)
    page = """<p id=out></p><button onclick=ask()>Ask</button><script>const ask = async () => {
      const reader = (await fetch('/answer')).body.getReader();
      for (let one; !(one = await reader.read()).done; ) out.append(new TextDecoder().decode(one.value));
    }</script>"""
    await tab.goto(site.page(page))
    for _ in range(2):
        await tab.step(LeftClick(tab.at("Ask")))
        assert tab.text[0].endswith("part 3")


@pytest.mark.parametrize(
    ("how", "replies"), [("ms=1500", 1), ("ms=300&count=3", 3)], ids=["a late one", "several"]
)
async def test_answers_on_a_socket_are_waited_for(
    how: str, replies: int, site: Site, hard: HardSite, tab: Tab
) -> None:
    page = f"""<p id=out></p><button onclick="socket.send('')">Ask</button><script>
      const socket = new WebSocket('ws://127.0.0.1:{hard.port}/ws?{how}');
      socket.onmessage = (e) => out.append(e.data + ' ');
    </script>"""
    await tab.goto(site.page(page))
    for count in range(1, 4):
        await tab.step(LeftClick(tab.at("Ask")))
        assert tab.text[0] == " ".join(["reply"] * replies * count)


async def test_a_socket_that_does_not_answer_is_known_again(site: Site, hard: HardSite, tab: Tab) -> None:
    page = f"""<p>text</p><script>
      const socket = new WebSocket('ws://127.0.0.1:{hard.port}/ws?ms=60000');
      onclick = () => socket.send('');
    </script>"""
    await tab.goto(site.page(page))
    for _ in range(2):
        await tab.step(NOWHERE)
    assert settle_ms(tab) < 1000


_SHARED = """onconnect = (e) => { const [port] = e.ports; port.onmessage = async () => {
  port.postMessage(await (await fetch('/answer')).text()) } }"""


async def test_a_shared_worker_is_waited_for_like_others(site: Site, tab: Tab) -> None:
    count = 0

    async def script(_: Request) -> Response:
        return Response(_SHARED, media_type="text/javascript")

    async def answer(_: Request) -> Response:
        nonlocal count
        count += 1
        await asyncio.sleep(0.5)
        return Response(f"answer {count}")

    site.on("/shared.js", script)
    site.on("/answer", answer)
    page = """<p id=out>nothing</p><button onclick="worker.port.postMessage('')">Ask</button><script>
      const worker = new SharedWorker('%s');
      worker.port.onmessage = (e) => { out.textContent = e.data };
    </script>"""
    await tab.goto(site.page(page % "/shared.js"))
    assert reason(tab) == "quiet"
    for number in range(1, 3):
        await tab.step(LeftClick(tab.at("Ask")))
        assert f"answer {number}" in tab.text
    await tab.goto(site.page(page % "/nowhere.js"))
    assert reason(tab) == "quiet"


async def test_frames_that_come_and_go_for_ever_are_not_waited_for(site: Site, open_tab: Open) -> None:
    async def late(_: Request) -> Response:
        await asyncio.sleep(0.5)
        return HTMLResponse("<p>text</p>")

    frame, wanted = (site.elsewhere(site.on(path, late)) for path in ("/advertisement", "/wanted"))
    tab = await open_tab(config=BrowserConfig(settle_seconds=6.0))
    page = f"""<button onclick="add('{wanted}')">Open</button><p id=out></p><script>
      const add = (src) => {{
        const frame = document.body.appendChild(Object.assign(document.createElement('iframe'), {{ src }}));
        frame.onload = () => {{ if (src === '{wanted}') out.textContent = 'arrived' }};
        return frame;
      }};
      const shown = [];
      const show = () => shown.push(add('{frame}')) > 2 && shown.shift().remove();
      show();
      setInterval(show, 300);
    </script>"""
    await tab.goto(site.page(page))
    assert reason(tab) == "deadline"
    await tab.step(NOWHERE)
    assert reason(tab) != "deadline"
    await tab.step(LeftClick(tab.at("Open")))
    assert reason(tab) != "deadline"
    assert "arrived" in tab.text
