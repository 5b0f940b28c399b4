"""What happens to the one tab: dialogs, second windows, downloads, failures, crashes."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
from pathlib import Path

import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from webgym.browser import BrowserConfig
from webgym.core.action import GoBack, LeftClick
from webgym.core.errors import BrowserCrashed

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="module")]


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
    target = site.page("<title>Away</title>")
    look = await tab.goto(target)
    assert look.observation.url == target
    assert [kind for kind, _ in tab.notices] == ["dialog"]


async def test_endless_alerts_end(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page("<button onclick=\"while (true) alert('again')\">Trap</button><p>still here</p>")
    )
    async with asyncio.timeout(8):
        await tab.step(LeftClick(tab.at("Trap")))
    assert "still here" in tab.text
    kinds = {kind for kind, _ in tab.notices}
    assert kinds == {"dialog"}
    assert len(tab.notices) <= BrowserConfig().notices_per_observation


async def test_a_page_in_an_endless_loop_is_freed(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(execute_seconds=1))
    await tab.goto(site.page("<button onclick='while (true);'>Loop</button><p>still here</p>"))
    await tab.step(LeftClick(tab.at("Loop")))
    assert "still here" in tab.text
    assert [kind for kind, _ in tab.notices] == ["still_loading"]


async def test_a_loop_that_starts_between_two_looks_is_ended(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(execute_seconds=1))
    await tab.goto(site.page("<p>here</p><script>setTimeout(() => { while (true); }, 600)</script>"))
    await asyncio.sleep(0.8)  # the model thinks
    await tab.step()
    assert tab.text == ["here"]
    assert [kind for kind, _ in tab.notices] == ["still_loading"]


POPUPS = {
    "a link": "<a href=/second target=_blank>Go</a>",
    "a named link": "<a href=/second target=other>Go</a>",
    "a script": "<button onclick=\"window.open('/second')\">Go</button>",
    "a script that fills it in": "<button onclick=\"w = window.open(); w.location = '/second'\">Go</button>",
    "a form": "<form action=/second target=_blank><button>Go</button></form>",
}


@pytest.mark.parametrize("body", POPUPS.values(), ids=POPUPS.keys())
async def test_a_second_window_opens_in_the_same_tab(site: Site, tab: Tab, body: str) -> None:
    site.page("<title>Second</title>", "/second")
    first = site.page(body)
    await tab.goto(first)
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == "Second"
    assert site.hits.count("/second") == 1, "asked for once, not by the window as well"
    look = await tab.step(GoBack())
    assert look.observation.url == first


async def test_a_form_for_a_new_window_keeps_its_body(site: Site, tab: Tab) -> None:
    async def take(request: Request) -> Response:
        form = await request.form()
        return HTMLResponse(f"<title>{request.method} {form.get('q')}</title>")

    site.on("/take", take)
    await tab.goto(
        site.page(
            "<form action=/take method=post target=_blank><input name=q value=7><button>Go</button></form>"
        )
    )
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == "POST 7"


async def test_many_windows_and_an_empty_one_do_no_harm(site: Site, tab: Tab) -> None:
    site.page("<title>Second</title><p>here</p>", "/second")
    opens = "for (let i = 0; i < 5; i++) window.open('/second'); window.open('about:blank')"
    await tab.goto(site.page(f'<button onclick="{opens}">Go</button>'))
    await tab.step(LeftClick(tab.at("Go")))
    look = await tab.step()
    assert look.observation.title == "Second"
    assert site.hits.count("/second") == 1


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


async def test_failed_navigations_carry_the_browsers_word(site: Site, tab: Tab) -> None:
    refused = f"http://127.0.0.1:{free_port()}/"
    await tab.goto(refused)
    assert tab.notices == [("navigation_failed", f"{refused}: net::ERR_CONNECTION_REFUSED")]
    await tab.goto("http://no-such-host.invalid/")
    assert "net::ERR_NAME_NOT_RESOLVED" in tab.notices[0][1]
    await tab.goto(f"https://127.0.0.1:{site.port}/")
    assert "net::ERR_SSL" in tab.notices[0][1]
    assert len(tab.notices) == 1


async def test_a_link_that_leads_nowhere_is_told_once(site: Site, tab: Tab) -> None:
    refused = f"http://127.0.0.1:{free_port()}/"
    await tab.goto(site.page(f"<a href='{refused}'>Broken</a>"))
    look = await tab.step(LeftClick(tab.at("Broken")))
    assert tab.notices == [("navigation_failed", f"{refused}: net::ERR_CONNECTION_REFUSED")]
    assert look.observation.url == refused
    assert look.observation.status is None


async def test_a_server_that_never_answers(site: Site, open_tab: Open) -> None:
    async def never(_: Request) -> Response:
        await asyncio.Event().wait()
        raise AssertionError

    url = site.on("/never", never)
    tab = await open_tab(config=BrowserConfig(navigate_seconds=0.7))
    home = site.page("<title>Home</title>")
    await tab.goto(home)
    look = await tab.goto(url)
    [(kind, text)] = tab.notices
    assert kind == "navigation_failed"
    assert "0.7 s" in text
    assert look.observation.url == home


async def test_http_status_and_redirects(site: Site, tab: Tab) -> None:
    async def redirect(_: Request) -> Response:
        return RedirectResponse("/end")

    look = await tab.goto(site.page("<h1>Gone</h1>", status=404))
    assert look.observation.status == 404
    assert tab.text == ["Gone"]
    site.page("<title>End</title>", "/end")
    look = await tab.goto(site.on("/start", redirect))
    assert (look.observation.url, look.observation.status) == (site.url("/end"), 200)


async def test_a_crashed_renderer_is_brought_back(site: Site, tab: Tab) -> None:
    home = site.page("<title>Home</title><p>alive</p>")
    await tab.goto(home)
    assert tab.slot.process is not None
    renderers = [
        pid
        for pid in tab.slot.process.processes()
        if "--type=renderer" in Path(f"/proc/{pid}/cmdline").read_text()
    ]
    assert renderers
    for pid in renderers:
        os.kill(pid, signal.SIGKILL)
    look = await tab.step()
    assert [kind for kind, _ in tab.notices] == ["crashed"]
    assert tab.text == ["alive"]
    assert look.observation.url == home


async def test_a_killed_browser_is_a_typed_error(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<p>alive</p>"))
    assert tab.slot.process is not None
    os.killpg(tab.slot.process.pid, signal.SIGKILL)
    with pytest.raises(BrowserCrashed):
        await tab.step()
    await tab.slot.open(tab.options)
    look = await tab.step()
    assert look.image.startswith(b"\x89PNG")


async def test_a_page_that_closes_itself(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<button onclick='window.close()'>Close</button><p>here</p>"))
    await tab.step(LeftClick(tab.at("Close")))
    assert "here" in tab.text
