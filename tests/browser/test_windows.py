"""Windows: a stack of live pages, the newest in front."""

from __future__ import annotations

import asyncio

import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response

from webgym.browser.cdp_messages import CdpMessage, TargetInfo
from webgym.browser.windows import MOST_WINDOWS
from webgym.core.action import GoBack, LeftClick, Type

from .conftest import Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

OPENED = ("popup", "the page opened a new window, which is in front now; go_back closes it")
CLOSED = ("popup", "the window was closed; the page behind it is in front again")


class _Targets(CdpMessage, frozen=True):
    target_infos: tuple[TargetInfo, ...]


async def windows(tab: Tab) -> int:
    """Pages that the browser holds for this tab's episode."""
    assert tab.slot.process is not None
    connection = tab.slot.process.connection
    targets = await connection.call("Target.getTargets", reply=_Targets, seconds=5)
    [own] = [one for one in targets.target_infos if one.target_id == tab.slot.page.target_id]
    same = [one for one in targets.target_infos if one.browser_context_id == own.browser_context_id]
    return len([one for one in same if one.type == "page"])


WAYS = {
    "a link": "<a href=/second target=_blank>Go</a>",
    "a named link": "<a href=/second target=other>Go</a>",
    "a script": "<button onclick=\"window.open('/second')\">Go</button>",
    "a script that fills it in": "<button onclick=\"w = window.open(); w.location = '/second'\">Go</button>",
    "a form": "<form action=/second target=_blank><button>Go</button></form>",
    "noopener": "<a href=/second target=_blank rel='noopener noreferrer'>Go</a>",
    "noopener by script": "<button onclick=\"window.open('/second', '_blank', 'noopener')\">Go</button>",
    "a window with a size": "<button onclick=\"window.open('/second', 'w', 'width=300')\">Go</button>",
    "later": "<button onclick=\"setTimeout(() => window.open('/second'), 30)\">Go</button>",
    "in a frame": "<iframe srcdoc='<a href=/second target=_blank>Go</a>'></iframe>",
    "a form that a script sends": "<form id=f action=/second target=_blank></form>"
    '<button onclick="f.submit()">Go</button>',
    "a form into a window": "<form id=f action=/second target=w></form>"
    "<button onclick=\"window.open('', 'w'); f.submit()\">Go</button>",
    "through a redirect": "<a href=/redirect target=_blank>Go</a>",
    "an area of a picture": "<img usemap=#m width=60 height=60 src=/dot>"
    "<map name=m><area shape=rect coords=0,0,60,60 href=/second target=_blank alt=Go></map>",
}


def told(tab: Tab) -> list[tuple[str, str]]:
    """The notices, but for one that a page still changes: on a busy machine it may."""
    return [notice for notice in tab.notices if notice[0] != "still_loading"]


@pytest.mark.parametrize("way", one_in(2, WAYS))
async def test_every_way_to_a_window_and_back(site: Site, tab: Tab, way: str) -> None:
    async def redirect(_: Request) -> Response:
        return RedirectResponse("/second")

    async def dot(_: Request) -> Response:
        return Response("<svg xmlns='http://www.w3.org/2000/svg'/>", media_type="image/svg+xml")

    site.page("<title>Second</title><p>here</p>", "/second")
    site.on("/redirect", redirect)
    site.on("/dot", dot)
    first = site.page(f"<title>First</title>{WAYS[way]}")
    await tab.goto(first)
    look = await tab.step(LeftClick(tab.at("Go")))
    assert (look.observation.title, look.observation.url.rstrip("?")) == ("Second", site.url("/second"))
    assert look.observation.status == 200
    assert told(tab) == [OPENED]
    assert "here" in tab.text
    look = await tab.step(GoBack())
    assert (look.observation.title, look.observation.url) == ("First", first)
    assert told(tab) == [CLOSED]
    assert site.hits.count("/second") == 1
    assert site.hits.count(first.removeprefix(site.url(""))) == 1, "the first page was not loaded again"
    assert await windows(tab) == 1


SHOWN = {
    "written": "w = window.open('', '_blank'); w.document.write('<h1>Receipt</h1>'); w.document.close()",
    "written and never closed": "w = window.open('about:blank'); w.document.write('<h1>Receipt</h1>')",
    "filled later": "w = window.open(''); setTimeout(() => { w.document.body.innerHTML = 'Receipt' }, 50)",
    "blob": "window.open(window.URL.createObjectURL(new Blob(['<h1>Receipt</h1>'], { type: 'text/html' })))",
}


async def test_what_scripts_write_into_windows_is_seen(site: Site, tab: Tab) -> None:
    buttons = "".join(f'<button onclick="{opens}">{name}</button>' for name, opens in SHOWN.items())
    await tab.goto(site.page(f"<title>Home</title>{buttons}"))
    for name in SHOWN:
        await tab.step(LeftClick(tab.at(name)))
        assert tab.text == ["Receipt"], name
        assert told(tab) == [OPENED], name
        look = await tab.step(GoBack())
        assert look.observation.title == "Home"


async def test_signing_in_by_a_window(site: Site, tab: Tab) -> None:
    """Its page talks to the opener and closes itself; what was typed and drawn there is still there."""
    site.page(
        "<title>Login</title><button onclick=\"opener.postMessage('ada', '*'); window.close()\">"
        "Allow</button>",
        "/login",
    )
    home = site.page(
        "<title>App</title><input aria-label=Draft><button>Sign in</button><p id=s>signed out</p><script>"
        "document.querySelector('button').onclick = () => open('/login', 'login', 'width=400,height=300');"
        "onmessage = (e) => { s.textContent = 'signed in as ' + e.data }</script>"
    )
    await tab.goto(home)
    await tab.step(Type(tab.at("Draft"), "my draft", enter=False))
    look = await tab.step(LeftClick(tab.at("Sign in")))
    assert look.observation.title == "Login"
    look = await tab.step(LeftClick(tab.at("Allow")))
    assert (look.observation.title, look.observation.url) == ("App", home)
    assert "signed in as ada" in tab.text
    assert tab.find("Draft").value == "my draft"
    assert told(tab) == [CLOSED]


async def test_a_window_of_a_window(site: Site, new_tab: Tab) -> None:
    tab = new_tab
    site.page("<title>Third</title><p>here</p>", "/third")
    site.page("<title>Second</title><a href=/third target=_blank>On</a><a href=/next>Next</a>", "/second")
    site.page("<title>Next</title><p>here</p>", "/next")
    await tab.goto(site.page("<title>First</title><a href=/second target=_blank>Go</a>"))
    await tab.step(LeftClick(tab.at("Go")))
    await tab.step(LeftClick(tab.at("Next")))
    titles = []
    await tab.step(GoBack())
    assert told(tab) == [], "an earlier page of the window itself"
    await tab.step(LeftClick(tab.at("On")))
    for _ in range(3):
        assert tab.last is not None
        titles.append(tab.last.observation.title)
        await tab.step(GoBack())
    assert titles == ["Third", "Second", "First"]
    assert told(tab) == [("action_failed", "there is no earlier page to go back to")]


async def test_windows_that_close_by_themselves(site: Site, tab: Tab) -> None:
    site.page("<title>Brief</title><script>setTimeout(() => close(), 400)</script><p>here", "/brief")
    opens = "window.open('/brief')"
    at_once = "window.open('/brief').close()"
    await tab.goto(
        site.page(
            f'<title>Home</title><button onclick="{opens}">Brief</button>'
            f'<button onclick="{at_once}">At once</button>'
        )
    )
    look = await tab.step(LeftClick(tab.at("At once")))
    assert look.observation.title == "Home"
    assert told(tab) in ([], [("popup", "the page opened a new window, and closed it again")])
    await tab.step(LeftClick(tab.at("Brief")))
    if told(tab) == [OPENED]:
        await asyncio.sleep(0.5)
        await tab.step()
        assert told(tab) == [CLOSED]
    assert tab.last is not None
    assert tab.last.observation.title == "Home"


async def test_no_more_windows_than_allowed(site: Site, tab: Tab) -> None:
    site.page("<title>Second</title><p>here</p>", "/second")
    opens = f"for (let i = 0; i < {MOST_WINDOWS + 3}; i++) window.open('/second')"
    await tab.goto(site.page(f'<title>Home</title><button onclick="{opens}">Go</button>'))
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == "Second"
    assert ("popup", "a further window was not opened") in tab.notices
    assert await windows(tab) == MOST_WINDOWS
    for _ in range(MOST_WINDOWS - 1):
        look = await tab.step(GoBack())
    assert look.observation.title == "Home"


async def test_the_next_episode_has_no_windows(site: Site, open_tab: Open) -> None:
    tab = await open_tab()
    site.page("<title>Second</title><p>here</p>", "/second")
    home = site.page("<title>Home</title><a href=/second target=_blank>Go</a>")
    await tab.goto(home)
    await tab.step(LeftClick(tab.at("Go")))
    again = await open_tab()
    look = await again.goto(home)
    assert look.observation.title == "Home"
    assert again.notices == []
    assert await windows(again) == 1


@pytest.mark.parametrize("kind", ["", "enctype=multipart/form-data"])
async def test_what_a_script_posts_to_a_window_arrives(site: Site, tab: Tab, kind: str) -> None:
    async def take(request: Request) -> Response:
        said = ", ".join(f"{name}={value}" for name, value in (await request.form()).items())
        return HTMLResponse(f"<title>{request.method} {said}</title>")

    site.on("/take", take)
    first = site.page(
        f"<form id=f action=/take method=post target=w {kind}><input name=q value='Zoë &amp; 7'></form>"
        "<button onclick=\"window.open('', 'w'); f.submit()\">Go</button>"
    )
    await tab.goto(first)
    look = await tab.step(LeftClick(tab.at("Go")))
    assert look.observation.title == "POST q=Zoë & 7"
    assert site.hits.count("/take") == 1


async def test_a_crashed_window_and_its_opener(site: Site, new_tab: Tab) -> None:
    """They share a process. What can be loaded again is; a window that a script wrote is closed."""
    tab = new_tab
    opens = "w = window.open('', '_blank'); w.document.write('<h1>Receipt</h1>')"
    await tab.goto(site.page(f'<title>Home</title><button onclick="{opens}">Go</button>'))
    await tab.step(LeftClick(tab.at("Go")))
    tab.slot.page.session.send("Page.crash")
    look = await tab.step()
    assert look.observation.title == "Home"
    assert {"crashed", "popup"} == {kind for kind, _ in tab.notices}
    assert [fault.kind for fault in look.observation.faults] == ["renderer", "renderer"]
