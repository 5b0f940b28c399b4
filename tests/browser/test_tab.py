"""What happens to a page: dialogs, downloads, failures, crashes."""

from __future__ import annotations

import asyncio
import contextlib
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from starlette.requests import Request
from starlette.responses import Response

from webgym.browser.config import BrowserConfig
from webgym.browser.notices import NOTICES_PER_OBSERVATION
from webgym.browser.page import MOST_DOCUMENTS
from webgym.browser.process import BrowserProcess
from webgym.core.action import GoBack, LeftClick

from .conftest import Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


@pytest.mark.parametrize(
    ("call", "notice", "title"),
    [
        ("alert('careful')", 'alert "careful": accepted', "undefined"),
        ("confirm('sure?')", 'confirm "sure?": accepted', "true"),
        ("prompt('name?', 'Ann')", 'prompt "name?": answered "Ann"', "Ann"),
    ],
)
async def test_dialogs_are_answered_and_told(
    site: Site, tab: Tab, call: str, notice: str, title: str
) -> None:
    await tab.goto(site.page(f'<button onclick="document.title = {call}">Ask</button>'))
    look = await tab.step(LeftClick(tab.at("Ask")))
    assert tab.notices == [("dialog", notice)]
    assert look.observation.title == title


async def test_a_page_that_does_not_want_to_be_left_is_left(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<button>Touch</button><script>onbeforeunload = () => 'stay'</script>"))
    await tab.step(LeftClick(tab.at("Touch")))
    target = site.page("<title>Away</title><p>here</p>")
    look = await tab.goto(target)
    assert look.observation.url == target
    assert [kind for kind, _ in tab.notices] == ["dialog"]


async def test_endless_alerts_end(site: Site, new_tab: Tab) -> None:
    await new_tab.goto(
        site.page("<button onclick=\"while (true) alert('again')\">Trap</button><p>still here</p>")
    )
    async with asyncio.timeout(8):
        await new_tab.step(LeftClick(new_tab.at("Trap")))
    assert "still here" in new_tab.text
    kinds = {kind for kind, _ in new_tab.notices}
    assert kinds == {"dialog"}
    assert len(new_tab.notices) <= NOTICES_PER_OBSERVATION


async def test_a_page_in_an_endless_loop_is_freed(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(execute_seconds=1))
    await tab.goto(site.page("<button onclick='while (true);'>Loop</button><p>still here</p>"))
    await tab.step(LeftClick(tab.at("Loop")))
    assert "still here" in tab.text
    assert [kind for kind, _ in tab.notices] == ["still_loading"]


async def test_a_loop_that_starts_between_two_looks_is_ended(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(execute_seconds=1))
    await tab.goto(site.page("<p>here</p><script>setTimeout(() => { while (true); }, 1800)</script>"))
    await asyncio.sleep(2)  # the model thinks
    await tab.step()
    assert tab.text == ["here"]
    assert [kind for kind, _ in tab.notices] == ["still_loading"]


async def test_a_script_that_lacks_a_processor_is_not_ended(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    tab = await open_tab(config=BrowserConfig(execute_seconds=2))

    async def wholly() -> float:
        return 1.0

    monkeypatch.setattr(tab.slot.page.session.connection, "starved", wholly)
    script = "const end = Date.now() + 3200; while (Date.now() < end); out.textContent = 'computed'"
    await tab.goto(site.page(f"<p id=out>here</p><script>setTimeout(() => {{ {script} }}, 1800)</script>"))
    await asyncio.sleep(2)  # the model thinks
    await tab.step()
    assert tab.text == ["computed"]
    assert tab.notices == []


async def test_that_a_page_lacks_a_processor_is_measured(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<p>here"))
    session = tab.slot.page.session
    starved = session.connection.starved
    assert starved is not None
    assert await starved() < 0.5, "it does nothing"
    assert isinstance(tab.slot._process, BrowserProcess)
    [cpu, *_] = os.sched_getaffinity(0)
    for pid in tab.slot._process.processes():
        os.sched_setaffinity(pid, {cpu})
    session.send("Runtime.evaluate", {"expression": "for (;;);"})
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(8)]  # noqa: ASYNC220 - they end below
    try:
        for burner in burners:
            os.sched_setaffinity(burner.pid, {cpu})
        assert await starved() > 0.5
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()
    await tab.slot.close()


OBSERVER = """
new MutationObserver(() => document.body.setAttribute('data-n', Math.random()))
  .observe(document.body, { attributes: true });
document.body.setAttribute('data-n', 0);
"""


async def test_an_observer_that_calls_itself_for_ever_is_ended(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.page.TERMINATE_SECONDS", 0.5)
    tab = await open_tab(config=BrowserConfig(execute_seconds=1))
    script = f"loop.onclick = () => {{ {OBSERVER} }}; more.onclick = () => {{ more.textContent += '!'; }}"
    body = "<button id=loop>Loop</button><br><button id=more>More</button>"
    await tab.goto(site.page(f"{body}<script>{script}</script>"))
    await tab.step(LeftClick(tab.at("Loop")))
    assert tab.text == ["Loop", "More"]
    assert [kind for kind, _ in tab.notices] == ["still_loading"]
    await tab.step(LeftClick(tab.at("More")))
    assert tab.text == ["Loop", "More!"], "its scripts go on"
    assert tab.notices == []
    await tab.step(LeftClick(tab.at("Loop")))
    await tab.goto(site.page("<p>calm"))
    assert tab.text == ["calm"]
    assert tab.notices == []


async def test_a_page_that_is_blocked_again_and_again_loses_its_scripts(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.page.TERMINATE_SECONDS", 0.5)
    tab = await open_tab(config=BrowserConfig(execute_seconds=1, settle_seconds=2))
    link = site.page("<p>before</p><script>document.querySelector('p').textContent = 'runs'</script>")
    loop = "<script>for (let n = 9; n--; ) setInterval(() => { while (true); }, 100)</script>"
    blocked = site.page(f"<p>here</p><a href='{link}'>Next</a>{loop}")
    await tab.goto(blocked)
    assert tab.text == ["here", "Next"]
    assert tab.notices[-1] == ("still_loading", "it was blocked again at once; its scripts are switched off")
    await tab.step(LeftClick(tab.at("Next")))
    assert tab.text == ["runs"]
    await tab.step(GoBack())
    await tab.goto(link)
    assert tab.text == ["runs"]


async def test_downloads_are_refused(site: Site, tab: Tab) -> None:
    async def file(_: Request) -> Response:
        return Response(b"x" * 1000, headers={"content-disposition": "attachment; filename=report.zip"})

    link = site.on("/file", file)
    home = site.page("<a href=/file>Get it</a>")
    await tab.goto(home)
    for action in (LeftClick(tab.at("Get it")), None):
        look = await (tab.step(action) if action else tab.goto(link))
        assert [kind for kind, _ in tab.notices] == ["download_refused"]
        assert "report.zip" in tab.notices[0][1]
        assert look.observation.url == home


def free_port() -> int:
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        port: int = listener.getsockname()[1]
        return port


async def test_a_server_that_never_answers(site: Site, open_tab: Open) -> None:
    async def never(_: Request) -> Response:
        await asyncio.Event().wait()
        raise AssertionError

    url = site.on("/never", never)
    tab = await open_tab(config=BrowserConfig(navigate_seconds=0.7))
    home = site.page("<title>Home</title><p>here</p>")
    await tab.goto(home)
    look = await tab.goto(url)
    [(kind, text)] = tab.notices
    assert kind == "navigation_failed"
    assert "0.7 s" in text
    assert look.observation.url == home


LOOPS = {
    "refresh": "<meta http-equiv=refresh content=0>",
    "timer": "<script>setTimeout(() => location.reload(), 20)</script>",
    "reload": "<script>location.reload()</script>",
    "itself": "<script>location.href = location.href</script>",
    "another of itself": "<script>location.href = '?' + Math.random()</script>",
}


@pytest.mark.parametrize("loop", one_in(2, LOOPS))
async def test_a_page_that_leads_on_and_on_is_held_and_can_be_left(site: Site, tab: Tab, loop: str) -> None:
    home = site.page("<p>Home</p>", "/home")
    await tab.goto(site.page(f"<p>Still here</p><a href='{home}'>Out</a>{LOOPS[loop]}"))
    assert tab.notices == [
        ("still_loading", f"the page led on {MOST_DOCUMENTS} times; it is held here for now")
    ]
    assert "Still here" in tab.text
    await tab.step(LeftClick(tab.at("Out")))
    assert tab.text == ["Home"]
    assert tab.notices == []


async def test_a_page_that_closes_itself(site: Site, new_tab: Tab) -> None:
    await new_tab.goto(site.page("<button onclick='window.close()'>Close</button><p>here</p>"))
    await new_tab.step(LeftClick(new_tab.at("Close")))
    assert "here" in new_tab.text


# --- dialogs and downloads in all their ways --------------------------------------------------


async def test_dialogs_while_a_page_loads_and_within_frames(site: Site, tab: Tab) -> None:
    inner = site.page("<script>alert('from a frame')</script>")
    look = await tab.goto(
        site.page(
            f"<script>document.title = confirm('cookies?') + prompt('who?')</script><iframe src={inner}>"
        )
    )
    assert look.observation.title == "true"
    assert [text for kind, text in tab.notices if kind == "dialog"] == [
        'confirm "cookies?": accepted',
        'prompt "who?": answered ""',
        'alert "from a frame": accepted',
    ]


async def test_a_page_that_asks_before_it_is_left_by_going_back(site: Site, tab: Tab) -> None:
    home = site.page("<title>Home</title><p>here</p>")
    await tab.goto(home)
    await tab.goto(
        site.page("<button>Touch</button><script>onbeforeunload = (e) => e.preventDefault()</script>")
    )
    await tab.step(LeftClick(tab.at("Touch")))
    look = await tab.step(GoBack())
    assert look.observation.url == home
    assert [kind for kind, _ in tab.notices] == ["dialog"]


DOWNLOADS = {
    "an attribute": "<a href=/plain download=notes.txt>Get</a>",
    "a header": "<a href=/file>Get</a>",
    "a header in a new window": "<a href=/file target=_blank>Get</a>",
    "a type that is not shown": "<a href=/binary>Get</a>",
    "a blob": "<a href=# onclick=\"event.preventDefault(); a = document.createElement('a');"
    "a.href = window.URL.createObjectURL(new Blob(['x'])); a.download = 'made.txt'; a.click()\">Get</a>",
    "a data address": "<a href='data:text/plain,hello' download=hello.txt>Get</a>",
    "a frame": "<button onclick=\"f.src = '/file'\">Get</button><iframe id=f></iframe>",
    "a form": "<form action=/file method=post><button>Get</button></form>",
}


def kept_files(tab: Tab) -> set[Path]:
    assert tab.slot.process is not None
    profile = tab.slot.process.profile
    return {path for path in profile.rglob("*") if path.suffix in (".zip", ".txt", ".crdownload")}


@pytest.mark.parametrize("way", one_in(2, DOWNLOADS))
async def test_every_download_is_refused_and_told(site: Site, tab: Tab, way: str) -> None:
    async def file(_: Request) -> Response:
        return Response(b"x" * 1000, headers={"content-disposition": "attachment; filename=report.zip"})

    async def plain(_: Request) -> Response:
        return Response("words", media_type="text/plain")

    async def binary(_: Request) -> Response:
        return Response(b"\\0" * 500, media_type="application/octet-stream")

    site.on("/file", file)
    site.on("/plain", plain)
    site.on("/binary", binary)
    home = site.page(DOWNLOADS[way])
    await tab.goto(home)
    before = kept_files(tab)  # of other tests, for which the browser had files to choose
    await tab.step(LeftClick(tab.at("Get")))
    told = list(tab.notices)
    look = await tab.step()
    told += tab.notices
    assert "download_refused" in [kind for kind, _ in told]
    assert "navigation_failed" not in [kind for kind, _ in told]
    assert look.observation.url.split("#")[0] == home
    assert kept_files(tab) == before
