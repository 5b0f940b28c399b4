"""Pages are told of a desktop, with a mouse, as by a headed browser."""

from __future__ import annotations

import shutil

import pytest
from benchmarks import desktop

from webgym.browser.config import PageOptions
from webgym.browser.questions import QUESTIONS, WANTED, ask, differences, headed_answers
from webgym.core.action import LeftClick, Wait

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


async def test_answers_are_those_of_a_headed_browser(open_tab: Open) -> None:
    tab = await open_tab(viewport=PageOptions().viewport)
    assert len(QUESTIONS) >= 40
    found = differences(await ask(tab.goto), headed_answers())
    assert [str(one) for one in found if not one.reason] == []
    assert {one.question for one in found} == set(WANTED), "a reason that nothing needs any more"


@pytest.mark.slow
async def test_the_stored_answers_are_those_of_a_headed_browser() -> None:
    if missing := [name for name in desktop.PROGRAMS if shutil.which(name) is None]:
        pytest.skip(f"not installed: {', '.join(missing)}")
    assert await desktop.ask_headed() == headed_answers()


async def test_a_screen_holds_any_viewport(site: Site, open_tab: Open) -> None:
    tab = await open_tab(viewport=(2400, 1300))
    look = await tab.goto(
        site.page("<script>document.title = [screen.width, screen.height, outerWidth >= innerWidth]</script>")
    )
    assert look.observation.title == "2400,1300,true"


async def test_what_a_page_copies_can_be_pasted(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<button onclick=\"navigator.clipboard.writeText('CODE-77').then(() => document.title = 'copied',"
            "() => document.title = 'failed')\">Copy</button><button onclick=\"navigator.clipboard.readText()"
            '.then((text) => document.title = text)">Paste</button>'
        )
    )
    assert (await tab.step(LeftClick(tab.at("Copy")))).observation.title == "copied"
    assert (await tab.step(LeftClick(tab.at("Paste")))).observation.title == "CODE-77"


async def test_a_session_can_have_a_place(site: Site, open_tab: Open) -> None:
    tab = await open_tab(identity={"place": (52.5, 13.4)})
    look = await tab.goto(
        site.page(
            "<script>navigator.geolocation.getCurrentPosition(({ coords: { latitude, longitude } }) =>"
            "document.title = [latitude, longitude], ({ message }) => document.title = message)</script>"
        )
    )
    assert look.observation.title == "52.5,13.4"


async def test_requests_that_nobody_can_answer_are_refused_at_once(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<button>Ask</button><script>const told = [];"
            "const tell = (what) => { told.push(what); document.title = told.sort() };"
            "document.querySelector('button').onclick = () => {"
            "navigator.mediaDevices.getUserMedia({ video: true }).catch(({ name }) => tell(name));"
            "Notification.requestPermission().then(tell);"
            "navigator.geolocation.getCurrentPosition(() => {}, ({ code }) => tell(`place ${code}`)) }"
            "</script>"
        )
    )
    look = await tab.step(LeftClick(tab.at("Ask")))
    assert "denied,place 1" in look.observation.title
    for _ in range(10):  # Chromium looks for a camera first
        if "NotFoundError" in look.observation.title:
            break
        look = await tab.step(Wait(0.5))
    assert look.observation.title == "NotFoundError,denied,place 1"
