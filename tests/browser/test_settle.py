"""When a look is taken: after what an action set off has ended, and not much later."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator

import pytest
from starlette.requests import Request
from starlette.responses import RedirectResponse, Response, StreamingResponse

from webgym.browser.config import BrowserConfig
from webgym.core.action import LeftClick, Target

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


@pytest.fixture
def tab(new_tab: Tab) -> Tab:
    """A new one: how long a page is waited for is told from a tab's beginning."""
    return new_tab


NOWHERE = LeftClick(Target(coordinate=(990, 990)))


async def slow(request: Request) -> Response:
    await asyncio.sleep(float(request.query_params["seconds"]))
    return Response("arrived")


def settle_ms(tab: Tab) -> float:
    assert tab.last is not None
    return tab.last.observation.milliseconds["settle"]


def reason(tab: Tab) -> str:
    assert tab.last is not None
    return tab.last.observation.settled


LATE = """<p id=out>loading</p><script>
  const load = async () => { out.textContent = await (await fetch('/slow?seconds=0.6')).text(); };
</script>"""


async def test_nothing_happened(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<p>still</p>"))
    await tab.step(NOWHERE)
    assert reason(tab) == "unchanged"


async def test_late_data_is_waited_for(site: Site, tab: Tab) -> None:
    site.on("/slow", slow)
    await tab.goto(site.page(LATE + "<script>load()</script><button onclick=load()>Again</button>"))
    assert "arrived" in tab.text
    assert reason(tab) == "quiet"
    await tab.step(LeftClick(tab.at("Again")))
    assert settle_ms(tab) >= 600


async def test_an_endless_spinner_is_waited_for_once(site: Site, tab: Tab) -> None:
    spin = "@keyframes spin { to { transform: rotate(360deg) } } i { animation: spin 1s infinite linear }"
    await tab.goto(site.page(f"<style>{spin}</style><i style='display:block'>*</i><p>text</p>"))
    assert reason(tab) == "loading"
    assert tab.notices == [("still_loading", "the page shows that it is loading")]
    await tab.step(NOWHERE)
    assert reason(tab) == "unchanged"
    assert "still_loading" not in dict(tab.notices), "told once"


_TURNING = "<style>@keyframes turn { to { rotate: 1turn } } i { animation: turn 1s infinite linear }</style>"
_NEVER_AT_REST = (
    _TURNING
    + """<i style='display: block; width: 30px'>*</i><p id=out>text</p><script>
setInterval(() => { out.textContent = Date.now() }, 400);
const poll = async () => { for (;;) await fetch('/slow?seconds=0.2&at=' + Date.now()) };
poll();
</script>"""
)


async def test_a_crowd_that_turns_is_decoration(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(f"{_TURNING}<p>text</p>{'<i style=display:inline-block>*</i>' * 400}"))
    assert reason(tab) == "quiet"
    assert tab.notices == []


async def test_what_turns_on_a_page_that_never_rests_costs_one_wait(site: Site, open_tab: Open) -> None:
    site.on("/slow", slow)
    tab = await open_tab(config=BrowserConfig(settle_seconds=3.0))
    await tab.goto(site.page(_NEVER_AT_REST))
    assert reason(tab) == "deadline"
    await tab.step(NOWHERE)
    await tab.step(NOWHERE)
    assert reason(tab) not in {"deadline", "loading", "busy"}


async def test_a_sign_that_came_back_is_a_sign_again(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(linger_seconds=0.2))
    await tab.goto(
        site.page(
            "<p id=out>text</p><button onclick=start()>Start</button><button onclick=end()>End</button>"
            "<script>"
            "let loads = 0;"
            "const end = () => { out.ariaBusy = null; out.textContent = 'done ' + loads };"
            "const start = () => { out.ariaBusy = 'true';"
            " if (++loads > 1) setTimeout(() => setTimeout(end, 900), 900) }</script>"
        )
    )
    start, end = LeftClick(tab.at("Start")), LeftClick(tab.at("End"))
    await tab.step(start)
    assert reason(tab) == "loading"
    await tab.step(end)
    await tab.step(start)
    assert "done 2" in tab.text


IDLE_HEADINGS = ("Processing time", "Searching tips", "Checking", "Saving for later")
BUSY_HEADINGS = (
    "Processing", "Searching for flights", "Fetching 3 pages…", "Saving…", "Signing in...",
    "Sending your message …",
)  # fmt: skip


async def test_a_heading_is_no_sign_of_loading(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(linger_seconds=0.2))
    found = {}
    for text in (*IDLE_HEADINGS, *BUSY_HEADINGS):
        await tab.goto(site.page(f"<table><tr><th>{text}</th></tr></table>"))
        found[text] = reason(tab)
    assert found == dict.fromkeys(IDLE_HEADINGS, "quiet") | dict.fromkeys(BUSY_HEADINGS, "loading")


async def test_news_in_one_line_are_no_sign_of_loading(site: Site, tab: Tab) -> None:
    moved = "@keyframes move { from { transform: translateX(100%) } to { transform: translateX(-100%) } }"
    for text, expected in {"Trains are late": "quiet", "": "loading"}.items():
        style = "display:inline-block;width:200px;height:4px;animation:move 3s infinite linear"
        await tab.goto(site.page(f"<style>{moved}</style><p>News</p><p style='{style}'>{text}</p>"))
        assert reason(tab) == expected


_SHADOW = """<x-s></x-s><script>customElements.define('x-s', class extends HTMLElement {{
  constructor() {{ super(); this.attachShadow({{ mode: 'open' }}).innerHTML = `{content}` }}
}})</script>"""


async def test_signs_of_loading_in_shadow_roots(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(linger_seconds=0.2))
    for sign in ("<b role=progressbar>60 %</b>", "Loading…"):
        await tab.goto(site.page(f"<h1>App</h1>{_SHADOW.format(content=f'<p>text</p>{sign}')}"))
        assert reason(tab) == "loading", sign


async def test_a_page_in_a_shadow_root_or_frames_is_not_blank(site: Site, tab: Tab) -> None:
    site.page("<p>All of it</p>", "/frame")
    shadows = (
        _SHADOW.format(content=content) for content in ("<h1>All of it</h1>", "<slot>All of it</slot>")
    )
    for page in (*shadows, "<frameset><frame src=/frame></frameset>"):
        await tab.goto(site.page(page))
        assert reason(tab) == "quiet", page


async def test_a_page_that_never_stops_changing(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page("<p id=p></p><script>setInterval(() => { p.textContent = performance.now() }, 20)</script>")
    )
    assert reason(tab) == "busy"


async def test_figures_that_count_up_are_final(site: Site, tab: Tab) -> None:
    count = "const turn = (t) => { start ??= t; const part = Math.min(1, (t - start) / 2000);"
    count += "out.textContent = Math.round(1284 * part); if (part < 1) requestAnimationFrame(turn) }"
    await tab.goto(
        site.page(f"<h1 id=out>0</h1><script>let start; {count}; requestAnimationFrame(turn)</script>")
    )
    assert tab.text == ["1284"]
    assert tab.notices == []


async def test_figures_that_counted_up_count_again(site: Site, tab: Tab) -> None:
    count = "let n = 0; const turn = () => { out.textContent = n += 7; if (n % 210) setTimeout(turn, 40) }"
    await tab.goto(site.page(f"<h1 id=out>0</h1><script>{count}; turn(); onclick = turn</script>"))
    assert tab.text == ["210"]
    await tab.step(NOWHERE)
    assert tab.text == ["420"]


async def test_what_still_changes_is_named_until_it_ends(site: Site, open_tab: Open) -> None:
    """A clock only once: it goes on for ever. A text that grows is worth another look."""
    tab = await open_tab(config=BrowserConfig(busy_seconds=0.6))
    clock = "setInterval(() => { out.textContent = 1000 + turn++ % 1000 }, 20)"
    grow = "let n = 0; const grow = () => { more.append(++n, ' '); if (n < 999) setTimeout(grow, 20) }"
    page = f"<p id=out></p><p id=more></p><script>let turn = 0; {clock}; {grow}; onclick = grow</script>"
    await tab.goto(site.page(page))
    assert reason(tab) == "busy"
    [(kind, text)] = tab.notices
    assert kind == "still_loading"
    assert re.fullmatch(r'"1\d\d\d" still changes', text)
    await tab.step(NOWHERE)
    for _ in range(2):
        assert reason(tab) == "busy"
        assert tab.notices == [("still_loading", "the page still changes")] or "still changes" in str(
            tab.notices
        )
        await tab.step(LeftClick(Target(coordinate=(990, 980))))


async def test_what_grows_by_a_script_is_waited_for(site: Site, open_tab: Open) -> None:
    tab = await open_tab(config=BrowserConfig(busy_seconds=30, settle_seconds=20))
    page = """<button onclick=go()>Go</button><i style="display:block;height:9px;background:red"></i><script>
      const bar = document.querySelector('i');
      const go = (turn = 0) => {
        bar.style.width = 9 * turn + 'px';
        if (turn < 60) setTimeout(go, 40, turn + 1);
        else document.body.append('Done');
      };
    </script>"""
    await tab.goto(site.page(page))
    await tab.step(LeftClick(tab.at("Go")))
    assert "Done" in " ".join(tab.text)


async def test_long_polls_and_streams_are_not_waited_for(site: Site, open_tab: Open) -> None:
    async def stream(_: Request) -> Response:
        async def events() -> AsyncIterator[str]:
            yield "data: hello\n\n"
            await asyncio.Event().wait()

        return StreamingResponse(events(), media_type="text/event-stream")

    tab = await open_tab(config=BrowserConfig(long_poll_seconds=0.5))
    site.on("/slow", slow)
    site.on("/stream", stream)
    await tab.goto(site.page("<p>text</p><script>fetch('/slow?seconds=30')</script>"))
    assert reason(tab) == "long_poll"
    assert 400 < settle_ms(tab) < 3000
    for is_told in (True, True, True, False):  # it may only be slow
        assert ("still_loading" in dict(tab.notices)) is is_told
        await tab.step(NOWHERE)
        assert settle_ms(tab) < 400, "known by now"
    await tab.goto(
        site.page(
            "<p id=p></p><script>new EventSource('/stream').onmessage = (e) => p.append(e.data)</script>"
        )
    )
    assert reason(tab) == "quiet"


async def test_redirects_by_header_and_by_script(site: Site, tab: Tab) -> None:
    async def hop(request: Request) -> Response:
        left = int(request.query_params["left"])
        return RedirectResponse(f"/hop?left={left - 1}" if left else "/scripted")

    site.on("/hop", hop)
    site.page("<script>location.replace('/meta')</script>", "/scripted")
    site.page("<meta http-equiv=refresh content='0;url=/end'>", "/meta")
    site.page("<title>End</title>", "/end")
    look = await tab.goto(site.url("/hop?left=3"))
    assert look.observation.title == "End"


async def test_images_are_there_before_the_look(site: Site, tab: Tab) -> None:
    async def image(_: Request) -> Response:
        await asyncio.sleep(0.4)
        svg = "<svg xmlns='http://www.w3.org/2000/svg' width='80' height='80'></svg>"
        return Response(svg, media_type="image/svg+xml")

    site.on("/image", image)
    await tab.goto(site.page("<img src=/image onload=\"document.title = 'shown'\"><p>text</p>", "/pictures"))
    assert tab.last is not None
    assert tab.last.observation.title == "shown"


async def test_a_long_transition_that_an_action_began(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<div id=d style='position:fixed;left:0;top:100px;transition:left 2.5s'>Moving</div>"
            "<button onclick=\"d.style.left = '700px'\">Move</button>"
            "<script>d.ontransitionend = () => { document.title = 'ended' }</script>"
        )
    )
    look = await tab.step(LeftClick(tab.at("Move")))
    assert look.observation.title == "ended"


async def test_the_deadline_is_hard_and_said(site: Site, open_tab: Open) -> None:
    async def endless(_: Request) -> Response:
        async def parts() -> AsyncIterator[str]:
            yield "<!doctype html><p>first part</p>"
            await asyncio.Event().wait()

        return StreamingResponse(parts(), media_type="text/html")

    tab = await open_tab(config=BrowserConfig(settle_seconds=0.8))
    look = await tab.goto(site.on("/endless", endless))
    assert reason(tab) == "deadline"
    assert [notice.kind for notice in look.observation.notices] == ["still_loading"]
    assert tab.text == ["first part"]
    assert settle_ms(tab) < 3000
