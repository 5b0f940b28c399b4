from __future__ import annotations

import json

import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from webgym.core.action import GoBack, LeftClick, Navigate, Scroll, Target, Type, Wait

from .conftest import MODES, VIEWPORT, Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

FORM = """
<title>Form</title>
<form action=/sent>
  <label>Name <input name=name value="old value"></label>
  <label>Colour <select name=colour><option>Red<option>Green<option value=b>Light blue</select></label>
  <label>Day <input type=date name=day></label>
  <label>At <input type=time name=at></label>
  <label>Note <textarea name=note></textarea></label>
  <button>Send</button>
</form>
<script>
  document.querySelector('select').addEventListener('change', (e) => {
    document.title = 'changed to ' + e.target.value;
  });
</script>
"""


async def echo(request: Request) -> Response:
    return HTMLResponse(
        f"<title>Sent</title><pre style='white-space:pre-wrap'>{json.dumps(dict(request.query_params))}</pre>"
    )


async def form(site: Site, tab: Tab) -> None:
    site.on("/sent", echo)
    await tab.goto(site.page(FORM))


def sent(tab: Tab) -> dict[str, str]:
    assert tab.last is not None
    assert tab.last.observation.title == "Sent"
    result: dict[str, str] = json.loads(tab.text[0])
    return result


@pytest.mark.parametrize("mode", ["coordinates", "marks"])
async def test_typing_replaces_what_was_there_and_enter_submits(
    site: Site, open_tab: Open, mode: str
) -> None:
    tab = await open_tab(mode)
    await form(site, tab)
    await tab.step(Type(tab.at("Name"), "Zoë 😀 日本語"))
    assert sent(tab)["name"] == "Zoë 😀 日本語"


async def test_typing_nothing_clears_the_field(site: Site, tab: Tab) -> None:
    await form(site, tab)
    await tab.step(Type(tab.at("Name"), ""))
    assert sent(tab)["name"] == ""


@MODES
async def test_a_dropdown_opens_in_the_page_and_takes_a_click(site: Site, open_tab: Open, mode: str) -> None:
    tab = await open_tab(mode)
    await form(site, tab)
    before = tab.last
    await tab.step(LeftClick(tab.at("Colour")))
    assert before is not None
    assert tab.last is not None
    assert tab.last.observation.screenshot != before.observation.screenshot, "the list is in the picture"
    assert {"Red", "Green", "Light blue"} <= set(tab.text)
    await tab.step(LeftClick(tab.at("Light blue", "option")))
    assert tab.find("Colour").value == "Light blue"
    assert tab.last.observation.title == "changed to b", "the page heard of it"
    assert "Green" not in tab.text, "the list is closed"


async def test_a_dropdown_that_the_page_draws_itself(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")

    def names() -> list[str]:
        assert tab.last is not None
        return [element.name for element in tab.last.observation.elements or ()]

    options = "".join(f"<option>City {number}" for number in range(40))
    await tab.goto(
        site.page(
            "<style>select, ::picker(select) { appearance: base-select }</style>"
            "<div style='overflow: hidden; height: 40px'><label>Town <select><button>Open</button>"
            f"<option>Rome<option disabled>Oslo{options}</select></label></div>"
        )
    )
    assert names() == ["Town"]
    await tab.step(LeftClick(tab.at("Town")))
    assert names()[:3] == ["Town", "Rome", "City 0"]
    assert {"Rome", "Oslo", "City 1"} <= set(tab.text)
    await tab.step(Scroll("down", tab.at("City 1")))
    assert not tab.notices, "it scrolled"
    last = names()[-1]
    await tab.step(LeftClick(tab.at(last)))
    assert names() == ["Town"]
    assert tab.find("Town").value == last


async def test_a_click_elsewhere_closes_an_open_list(site: Site, tab: Tab) -> None:
    await form(site, tab)
    await tab.step(LeftClick(tab.at("Colour")))
    await tab.step(LeftClick(Target(coordinate=(900, 900))))
    assert "Green" not in tab.text
    assert tab.find("Colour").value == "Red"


async def test_typing_into_a_dropdown_picks_the_option(site: Site, tab: Tab) -> None:
    await form(site, tab)
    for text, value in (
        ("Green", "Green"),
        ("  light BLUE ", "Light blue"),
        ("gre", "Green"),
        ("blue", "Light blue"),
    ):
        await tab.step(Type(tab.at("Colour"), text))
        assert tab.find("Colour").value == value
        assert tab.notices == []


async def test_an_option_that_is_not_there_is_said(site: Site, tab: Tab) -> None:
    await form(site, tab)
    await tab.step(Type(tab.at("Colour"), "Purple"))
    [(kind, text)] = tab.notices
    assert kind == "action_failed"
    assert "Purple" in text
    assert "Green" in text
    assert tab.find("Colour").value == "Red"


@pytest.mark.parametrize(
    ("field", "text", "key", "value"),
    [
        ("Day", "2026-03-14", "day", "2026-03-14"),
        ("Day", "March 14, 2026", "day", "2026-03-14"),
        ("Day", "3/14/2026", "day", "2026-03-14"),
        ("At", "18:30", "at", "18:30"),
        ("At", "6:30 pm", "at", "18:30"),
    ],
)
async def test_dates_and_times_are_typed(
    site: Site, tab: Tab, field: str, text: str, key: str, value: str
) -> None:
    await form(site, tab)
    await tab.step(Type(tab.at(field), text))
    assert sent(tab)[key] == value


async def test_a_click_may_open_the_field_that_is_typed_into(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            '<button onclick="setTimeout(() => { d.showModal(); i.focus(); }, 20)">Search</button>'
            "<dialog id=d><input id=i aria-label=Query "
            "onkeydown=\"if (event.key === 'Enter') document.title = this.value\"></dialog>"
        )
    )
    look = await tab.step(Type(tab.at("Search"), "boots"))
    assert look.observation.title == "boots"


async def test_editable_content_and_its_key_handlers(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<div contenteditable role=textbox aria-label=Post>draft</div><p id=keys></p>"
            "<script>addEventListener('keyup', (e) => keys.append(e.key + ' '))</script>"
        )
    )
    await tab.step(Type(tab.at("Post"), "hello"))
    assert tab.last is not None
    assert tab.last.observation.fields == ("hello",)
    assert "o Enter" in tab.text[-1]


async def test_scrolling_moves_by_a_share_of_the_viewport(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<div style='height:3000px'>top</div>"))
    look = await tab.step(Scroll("down"))
    assert look.observation.scroll[0] == pytest.approx(VIEWPORT[1] * 0.75)
    look = await tab.step(Scroll("up"))
    assert look.observation.scroll[0] == 0


@pytest.mark.parametrize(
    "style",
    ["width:600px;height:300px;position:fixed;left:340px;top:234px", "width:110px;height:60px"],
    ids=["in the middle", "small and aside"],
)
async def test_every_row_of_a_box_comes_into_view(site: Site, tab: Tab, style: str) -> None:
    rows = "".join(f"<div style='height:20px'>Row {number}</div>" for number in range(40))
    await tab.goto(site.page(f"<div style='overflow:auto;{style}'>{rows}</div>"))
    seen = set(tab.text)
    for _ in range(40):
        if "Row 39" not in seen:
            await tab.step(Scroll("down"))
            seen |= set(tab.text)
    assert {f"Row {number}" for number in range(40)} <= seen


async def test_going_back_and_its_beginning(site: Site, new_tab: Tab) -> None:
    first = site.page("<title>First</title><a href='#part'>Part</a>")
    second = site.page("<title>Second</title>")
    await new_tab.step(GoBack())
    assert [kind for kind, _ in new_tab.notices] == ["action_failed"]
    await new_tab.goto(first)
    await new_tab.step(LeftClick(new_tab.at("Part")))
    assert new_tab.last is not None
    assert new_tab.last.observation.url == f"{first}#part"
    await new_tab.goto(second)
    await new_tab.step(GoBack())
    assert new_tab.last.observation.url == f"{first}#part"
    await new_tab.step(GoBack())
    assert new_tab.last.observation.url == first
    await new_tab.step(GoBack())
    assert [kind for kind, _ in new_tab.notices] == ["action_failed"]
    assert new_tab.last.observation.url == first


async def test_going_back_in_a_script_made_history(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<h1>List</h1><button onclick=\"history.pushState(0,'','/detail');h.textContent='Detail'\">"
            "Open</button><p id=h></p><script>onpopstate = () => { h.textContent = 'Back'; }</script>"
        )
    )
    await tab.step(LeftClick(tab.at("Open")))
    assert "Detail" in tab.text
    await tab.step(GoBack())
    assert "Back" in tab.text
    assert tab.notices == []


async def test_a_very_long_address_is_refused(site: Site, tab: Tab) -> None:
    await tab.step(Navigate(site.url("/" + "x" * 100_000)))
    [(kind, text)] = tab.notices
    assert kind == "navigation_failed"
    assert len(text) < 1000


async def test_an_address_without_a_scheme_is_opened(site: Site, tab: Tab) -> None:
    site.page("<title>Here</title>", "/here")
    look = await tab.step(Navigate(f"127.0.0.1:{site.port}/here"))
    assert look.observation.title == "Here"


async def test_a_number_of_an_earlier_picture_clicks_nothing(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(site.page("<a href=/next>Next</a>"))
    old = tab.at("Next")
    await tab.goto(site.page("<p>no links</p>"))
    await tab.step(LeftClick(old))
    assert [kind for kind, _ in tab.notices] == ["action_failed"]


async def test_a_click_lands_on_an_element_that_is_half_covered(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<style>* { position: fixed; top: 0; height: 100px; width: 200px; left: 0 }"
            "div { left: 60px; width: 400px; background: #ccc }</style>"
            "<button onclick=\"document.title = 'hit'\">Wide</button><div></div>"
        )
    )
    look = await tab.step(LeftClick(tab.at("Wide")))
    assert look.observation.title == "hit"


async def test_waiting_lets_the_page_go_on(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<script>setTimeout(() => { document.title = 'later' }, 700)</script>"))
    look = await tab.step(Wait(0.8))
    assert look.observation.title == "later"
