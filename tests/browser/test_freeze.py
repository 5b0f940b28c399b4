"""Slots are stopped between calls: no CPU, and nothing that a page does is broken by it."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import os
import re
import signal
import struct
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import psutil
import pytest
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse

from webgym.browser.config import BrowserConfig
from webgym.browser.slot import Slot
from webgym.core.action import LeftClick, Wait

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

NAP_SECONDS = 1.0
LONG_SECONDS = 150.0

BUSY = """<title>Busy</title><style>@keyframes t{to{transform:rotate(1turn)}}#s{width:90px;height:90px;
background:red;animation:t 1s linear infinite}</style><div id=s></div><canvas width=600 height=400></canvas>
<script>const pen = document.querySelector('canvas').getContext('2d'); let n = 0;
(function f(){ pen.fillRect(n++ % 600, n % 400, 9, 9); requestAnimationFrame(f) })();
setInterval(() => { for (let i = 0, s = 0; i < 2e5; i++) s += i }, 20)</script>"""


async def asleep(tab: Tab, seconds: float = NAP_SECONDS) -> None:
    """Let it be stopped for so long."""
    await until(lambda: tab.slot.is_frozen and states(tab.slot) == {psutil.STATUS_STOPPED})
    await asyncio.sleep(seconds)


async def step(tab: Tab, action: object = None) -> str:
    with tab.slot.awake():
        await tab.step(action)
    return "\n".join(tab.text)


async def click(tab: Tab, name: str) -> str:
    return await step(tab, LeftClick(tab.at(name)))


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(60):
        while not condition():
            await asyncio.sleep(0.01)


async def shown(tab: Tab, text: str) -> str:
    """What a page shows once it shows this."""
    async with asyncio.timeout(60):
        while text not in (found := await step(tab, Wait(0.3))):
            pass
    return found


def states(slot: Slot) -> set[str]:
    assert slot.process is not None
    return {psutil.Process(pid).status() for pid in slot.process.processes()}


def cpu_seconds(slot: Slot) -> float:
    assert slot.process is not None
    times = [psutil.Process(pid).cpu_times() for pid in slot.process.processes()]
    return sum(time.user + time.system for time in times)


async def opened(open_tab: Open, url: str, config: BrowserConfig | None = None) -> Tab:
    tab = await open_tab(config=config)
    with tab.slot.awake():
        await tab.goto(url)
    return tab


@pytest.fixture
def numbers() -> Callable[[str], list[int]]:
    return lambda text: [int(number) for number in re.findall(r"-?\d+", text)]


async def test_a_stopped_slot_uses_no_processor(open_tab: Open, site: Site) -> None:
    tab = await opened(open_tab, site.page(BUSY))
    await asleep(tab, 0)
    before = cpu_seconds(tab.slot)
    await asyncio.sleep(NAP_SECONDS)
    assert cpu_seconds(tab.slot) == before
    with tab.slot.awake():
        assert psutil.STATUS_STOPPED not in states(tab.slot)
        await tab.step(Wait(0.3))
    assert cpu_seconds(tab.slot) > before


async def test_a_process_that_stops_after_the_others_went_on_goes_on_too(open_tab: Open, site: Site) -> None:
    """As one that is forked meanwhile: Linux gives it the first of the two signals alone."""
    tab = await opened(open_tab, site.page("<p>text"))
    with tab.slot.awake():
        with tab.slot.asleep():
            pass
        assert tab.slot.process is not None
        os.killpg(tab.slot.process.pid, signal.SIGSTOP)
        await until(lambda: psutil.STATUS_STOPPED not in states(tab.slot))


async def test_each_stop_ends_what_the_last_one_left_to_do(
    open_tab: Open, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The continue signals of earlier stops were sent on and on, up to seconds later."""
    tab = await opened(open_tab, site.page("<p>text"))
    process = tab.slot.process
    assert process is not None
    sent: list[signal.Signals] = []
    monkeypatch.setattr(process, "_signal", sent.append)
    stops = 20
    for _ in range(stops):
        process.freeze()
        process.thaw()
    await asyncio.sleep(1.5)
    assert sent.count(signal.SIGSTOP) == stops
    assert sent.count(signal.SIGCONT) < stops + 10, "those of the last stop: at 0.01 s, 0.03 s, 0.07 s ..."


async def test_not_stopped_where_that_is_off(open_tab: Open, site: Site) -> None:
    tab = await opened(open_tab, site.page(BUSY), BrowserConfig(freeze=False))
    assert not tab.slot.is_frozen
    assert psutil.STATUS_STOPPED not in states(tab.slot)


async def test_timers_rest_and_go_on(open_tab: Open, site: Site, numbers: Callable[[str], list[int]]) -> None:
    page = "<p id=t>0</p><script>setInterval(() => t.textContent = ++t.n || (t.n = 1), 50)</script>"
    tab = await opened(open_tab, site.page(page))
    before = time.monotonic()
    [first] = numbers(await step(tab))
    await asleep(tab)
    [second] = numbers(await step(tab))
    awake = time.monotonic() - before - NAP_SECONDS
    assert second - first < awake / 0.05 + 2, "it ran while it was stopped"
    async with asyncio.timeout(60):
        while numbers(await step(tab, Wait(0.5)))[0] < second + 5:  # it goes on
            pass


async def test_a_page_sees_a_clock_that_jumped_as_after_a_sleep(open_tab: Open, site: Site) -> None:
    page = """<p id=gap>0</p><p id=back>0</p><p id=wall>0</p><script>
      let wall = Date.now(), mono = performance.now(), gap = 0, back = 0;
      setInterval(() => {
        const w = Date.now(), m = performance.now();
        gap = Math.max(gap, w - wall); if (w < wall || m < mono) back++;
        [wall, mono] = [w, m];
        document.getElementById('gap').textContent = `gap ${Math.round(gap)}`;
        document.getElementById('back').textContent = `back ${back}`;
        document.getElementById('wall').textContent = `wall ${w}`;
      }, 20)</script>"""
    tab = await opened(open_tab, site.page(page))
    await step(tab)
    await asleep(tab)
    text = await step(tab, Wait(0.2))
    gap, back, wall = (int(re.search(rf"{name} (\d+)", text)[1]) for name in ("gap", "back", "wall"))  # type: ignore[index]
    assert gap >= NAP_SECONDS * 900
    assert back == 0, "time never runs backwards"
    assert abs(wall / 1000 - time.time()) < 5, "its clock is right again"


async def test_a_fetch_in_flight_arrives_after_the_sleep(open_tab: Open, site: Site) -> None:
    release = asyncio.Event()

    async def held(_: Request) -> Response:
        await release.wait()
        return Response("the answer")

    url = site.on("/held-by-freeze", held)
    script = f"fetch('{url}').then(r => r.text()).then(t => o.textContent = t)"
    page = f'<button onclick="{script}">Ask</button><p id=o>'
    tab = await opened(open_tab, site.page(page))
    await click(tab, "Ask")
    assert tab.last is not None
    await asleep(tab, 0)
    release.set()
    await asyncio.sleep(NAP_SECONDS)
    await shown(tab, "the answer")


async def test_a_download_of_megabytes_waits_for_the_reader(open_tab: Open, site: Site) -> None:
    size, piece = 24, b"x" * (1 << 20)

    async def stream(_: Request) -> Response:
        async def pieces() -> AsyncIterator[bytes]:
            for _ in range(size):
                yield piece
                await asyncio.sleep(0.02)

        return StreamingResponse(pieces())

    url = site.on("/megabytes", stream)
    script = f"fetch('{url}').then(r => r.arrayBuffer()).then(b => o.textContent = b.byteLength)"
    tab = await opened(open_tab, site.page(f'<button onclick="{script}">Get</button><p id=o>'))
    tab.slot.config = BrowserConfig(long_poll_seconds=0.05)
    with tab.slot.awake():
        await tab.slot.act(LeftClick(tab.at("Get")))
    await asleep(tab)
    await shown(tab, str(size << 20))


async def test_a_websocket_stays_open_and_brings_what_came_meanwhile(open_tab: Open, site: Site) -> None:
    async with push_server() as (port, push):
        page = f"""<p id=o></p><button onclick="s.send('hello')">Send</button><script>
          const s = new WebSocket('ws://127.0.0.1:{port}/');
          s.onopen = () => o.append('open ');
          s.onmessage = (m) => o.append(m.data + ' ');
          s.onclose = () => o.append('CLOSED');</script>"""
        tab = await opened(open_tab, site.page(page))
        await shown(tab, "open")
        await asleep(tab, 0)
        push("news")
        await asyncio.sleep(NAP_SECONDS)
        await shown(tab, "news")
        await click(tab, "Send")
        assert "CLOSED" not in await shown(tab, "echo-hello")


VIDEO = """<canvas id=c width=64 height=64></canvas><video id=v muted loop width=64></video><p id=o>wait</p>
<script>
const pen = c.getContext('2d'); let n = 0;
const timer = setInterval(() => {
  pen.fillStyle = `hsl(${n++ * 9} 90% 50%)`;
  pen.fillRect(0, 0, 64, 64);
}, 30);
const parts = [], recorder = new MediaRecorder(c.captureStream(30), { mimeType: 'video/webm' });
recorder.ondataavailable = (e) => parts.push(e.data);
recorder.onstop = () => {
  clearInterval(timer);
  v.src = URL.createObjectURL(new Blob(parts)); v.play();
  v.onerror = () => o.textContent = 'ERROR ' + v.error.message;
  let turns = 0, last = 0;
  setInterval(() => {
    if (v.currentTime === last) return;
    last = v.currentTime;
    o.textContent = `moved ${++turns}`;
  }, 50);
};
recorder.start(); setTimeout(() => recorder.stop(), 1200);
</script>"""


async def test_a_video_goes_on(open_tab: Open, site: Site, numbers: Callable[[str], list[int]]) -> None:
    tab = await opened(open_tab, site.page(VIDEO))
    await shown(tab, "moved")
    await asleep(tab)
    [before] = numbers(await step(tab))
    async with asyncio.timeout(60):
        while numbers(await step(tab, Wait(0.3)))[0] <= before:  # it does not stand still
            pass


async def test_a_crash_while_it_is_stopped_is_noticed(open_tab: Open, site: Site) -> None:
    tab = await opened(open_tab, site.page("<h1>Here</h1>"))
    await asleep(tab, 0)
    assert tab.slot.process is not None
    os.kill(tab.slot.process.pid, 9)
    await until(lambda: not tab.slot.is_up)
    await tab.slot.stop()
    assert tab.slot.process is None


@pytest.mark.slow
@pytest.mark.timeout(600)
async def test_stopped_for_minutes(open_tab: Open, site: Site) -> None:
    async with push_server() as (port, _):
        page = f"""<p id=o></p><button onclick="s.send('hello');
            fetch('/quick').then(r => r.text()).then(t => o.append(t))">Send</button><script>
          const s = new WebSocket('ws://127.0.0.1:{port}/');
          s.onmessage = (m) => o.append(m.data + ' ');
          s.onclose = () => o.append('CLOSED');</script>{BUSY}"""

        async def quick(_: Request) -> Response:
            return Response("fetched")

        site.on("/quick", quick)
        tab = await opened(open_tab, site.page(page))
        await asleep(tab, LONG_SECONDS)
        await click(tab, "Send")
        text = await step(tab, Wait(0.5))
        assert "echo-hello" in text
        assert "fetched" in text
        assert "CLOSED" not in text
        with tab.slot.awake():
            await tab.goto(site.page("<h1>Next</h1>"))
        assert tab.text == ["Next"]


@asynccontextmanager
async def push_server() -> AsyncIterator[tuple[int, Callable[[str], None]]]:
    """A WebSocket server (RFC 6455) that echoes short texts, and can say something unasked."""
    writers: list[asyncio.StreamWriter] = []

    def frame(text: str) -> bytes:
        data = text.encode()
        return struct.pack("!BB", 0x81, len(data)) + data

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = (await reader.readuntil(b"\r\n\r\n")).decode()
            key = re.search(r"Sec-WebSocket-Key: (\S+)", head, re.IGNORECASE)
            assert key is not None
            magic = key[1] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
            accept = base64.b64encode(hashlib.sha1(magic.encode()).digest()).decode()
            writer.write(
                "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                f"Sec-WebSocket-Accept: {accept}\r\n\r\n".encode()
            )
            writers.append(writer)
            while True:
                first, length = await reader.readexactly(2)
                mask, data = await reader.readexactly(4), await reader.readexactly(length & 127)
                if first & 15 == 8:
                    return
                text = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data)).decode()
                writer.write(frame(f"echo-{text}"))
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:
            writer.close()

    def push(text: str) -> None:
        for writer in writers:
            writer.write(frame(text))

    async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
        yield server.sockets[0].getsockname()[1], push
        for writer in writers:
            writer.close()
