"""Frames of other origins, and closed shadow roots: seen, numbered and used like the rest of the page."""

from __future__ import annotations

import asyncio

import pytest
from starlette.requests import Request
from starlette.responses import Response

from webgym.core.action import GoBack, LeftClick, Scroll, Type
from webgym.core.observation import Element

from .conftest import MODES, VIEWPORT, Open, Site, Tab, one_in

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

INNER = """
<p>inside</p>
<label>Name <input></label>
<label>Size <select><option>S<option>M<option>L</select></label>
<button onclick="this.textContent = 'Done'">Press</button>
<a href="#there">Link</a>
"""


def names(tab: Tab) -> list[str]:
    assert tab.last is not None
    return [element.name for element in tab.last.observation.elements or ()]


def elements(tab: Tab) -> tuple[Element, ...]:
    assert tab.last is not None
    return tab.last.observation.elements or ()


def framed(url: str, style: str = "width:600px;height:200px", more: str = "") -> str:
    return f"<iframe src='{url}' style='{style}' {more}></iframe>"


@MODES
async def test_a_frame_of_another_origin_is_part_of_the_page(site: Site, open_tab: Open, mode: str) -> None:
    inner = site.elsewhere(site.page(INNER))
    tab = await open_tab(mode)
    await tab.goto(
        site.page(f"<p>before</p><button>First</button>{framed(inner)}<p>after</p><button>Last</button>")
    )
    assert names(tab) == ["First", "Name", "Size", "Press", "Link", "Last"]
    assert tab.text[0] == "before"
    assert tab.text.index("inside") < tab.text.index("after")
    assert len({element.number for element in elements(tab)}) == 6
    assert tab.find("Link").href == f"{inner}#there"
    before = {element.name: element.number for element in elements(tab)}
    await tab.step(LeftClick(tab.at("Press")))
    assert tab.find("Done").number == before["Press"]
    await tab.step(Type(tab.at("Name"), "Ann"))
    assert tab.find("Name").value == "Ann"
    await tab.step(Type(tab.at("Size"), "M"))
    assert tab.find("Size").value == "M"
    await tab.step(LeftClick(tab.at("Size")))
    await tab.step(LeftClick(tab.at("L", "option")))
    assert tab.find("Size").value == "L"
    assert tab.find("Name").number == before["Name"]
    assert tab.notices == []


TURNED = {
    "scaled": "transform:scale(.6);transform-origin:0 0",
    "enlarged": "transform:scale(1.4,1.2);transform-origin:0 0",
    "turned": "transform:rotate(20deg)",
    "upside down": "rotate:180deg",
    "mirrored": "transform:scaleX(-1)",
    "bordered": "border:13px solid;padding:17px;box-sizing:border-box",
    "zoomed": "zoom:1.5",
    "askew": "margin-left:-120px;margin-top:30px;transform:skewX(10deg) scale(.9)",
}


@pytest.mark.parametrize("name", one_in(4, TURNED))
@pytest.mark.parametrize(("mode", "host"), [("coordinates", ""), ("marks", "a")], ids=["own", "foreign"])
async def test_transformed_frames_are_clicked_where_they_show(
    site: Site, open_tab: Open, mode: str, name: str, host: str
) -> None:
    inner = site.page(
        "<style>button { position: fixed; right: 90px; bottom: 40px }</style>"
        "<button onclick=\"this.textContent = 'Done'\">Press</button>"
    )
    inner = site.elsewhere(inner, host) if host else inner
    tab = await open_tab(mode)
    body = "<div style='zoom:.9;padding:60px 150px'>{}</div>"
    await tab.goto(site.page(body.format(framed(inner, f"width:500px;height:200px;{TURNED[name]}"))))
    await tab.step(LeftClick(tab.at("Press")))
    assert names(tab) == ["Done"]


@MODES
async def test_frames_in_frames(site: Site, open_tab: Open, mode: str) -> None:
    deepest = site.page("<input aria-label=Deep><select aria-label=Pick><option>One<option>Two</select>")
    middle = site.page(f"<p>middle</p>{framed(deepest)}<button>Beside</button>")
    other = site.elsewhere(site.page(f"<p>other</p>{framed(middle, 'width:640px;height:320px')}"), "b")
    tab = await open_tab(mode)
    await tab.goto(
        site.page(
            framed(site.elsewhere(other, "b"), "width:700px;height:420px;transform:scale(.8)") + "<p>end</p>"
        )
    )
    assert names(tab) == ["Deep", "Pick", "Beside"]
    assert tab.text == ["other", "middle", "One", "Beside", "end"]
    await tab.step(Type(tab.at("Deep"), "hello"))
    assert tab.find("Deep").value == "hello"
    await tab.step(LeftClick(tab.at("Pick")))
    await tab.step(LeftClick(tab.at("Two", "option")))
    assert tab.find("Pick").value == "Two"
    assert tab.notices == []


async def test_what_lies_over_a_frame_covers_it(site: Site, tab: Tab) -> None:
    inner = site.page(
        "<style>* { position: fixed; height: 30px; margin: 0 } button { width: 100px }</style>"
        "<button style='left:0;top:0'>Free</button><button style='left:0;top:100px'>Covered</button>"
        "<button style='left:300px;top:100px'>Beyond</button><p style='left:0;top:140px'>hidden words</p>"
    )
    await tab.goto(
        site.page(
            "<div style='width:350px;overflow:hidden'>"
            + framed(
                site.elsewhere(inner), "width:600px;height:200px;border:0;position:absolute;left:0;top:0"
            )
            + "</div><div style='position:fixed;left:0;top:80px;width:250px;height:120px'>Over</div>"
        )
    )
    assert names(tab) == ["Free", "Beyond"]
    assert "hidden words" not in tab.text
    assert "Over" in tab.text


async def test_a_frame_without_scripts_is_seen(site: Site, tab: Tab) -> None:
    inner = "<p>static</p><a href=/next>Next</a><input aria-label=Name>"
    await tab.goto(site.page(f'<iframe sandbox srcdoc="{inner}"></iframe>'))
    assert tab.text == ["static", "Next"]
    await tab.step(Type(tab.at("Name"), "Ann"))
    assert tab.find("Name").value == "Ann"


async def test_a_frame_that_moves_on(site: Site, tab: Tab) -> None:
    second = site.page("<p>second</p>")
    first = site.page(f"<a href='{site.elsewhere(second, 'b')}'>Go</a>")
    await tab.goto(
        site.page(
            framed(site.elsewhere(first)) + '<button onclick="f().remove()">Remove</button>'
            "<script>f = () => document.querySelector('iframe')</script>"
        )
    )
    await tab.step(LeftClick(tab.at("Go")))
    assert tab.text[0] == "second"
    await tab.step(LeftClick(tab.at("Remove")))
    assert "second" not in tab.text
    assert names(tab) == ["Remove"]


async def test_a_frame_that_comes_late_or_never(site: Site, tab: Tab) -> None:
    async def never(_: Request) -> Response:
        await asyncio.Event().wait()
        raise AssertionError

    hanging = site.on("/never", never)
    late = site.elsewhere(site.page("<button>Late</button>"))
    page = site.page(
        framed(site.elsewhere(hanging), "width:200px;height:100px")
        + "<button onclick=\"f.src = '"
        + late
        + "'; f.style.display = 'block'\">Show</button>"
        "<iframe id=f style='display:none'></iframe>"
    )
    await tab.goto(page)
    assert names(tab) == ["Show"]
    await tab.step(LeftClick(tab.at("Show")))
    assert names(tab) == ["Show", "Late"]


async def test_changes_in_a_frame_are_waited_for(site: Site, tab: Tab) -> None:
    inner = site.page(
        '<button onclick="let n = out.textContent = 1; const t = setInterval(() => { out.textContent = ++n;'
        ' if (n == 8) clearInterval(t) }, 50)">Count</button><p id=out></p>'
    )
    await tab.goto(site.page(framed(site.elsewhere(inner))))
    await tab.step(LeftClick(tab.at("Count")))
    assert "8" in tab.text


async def test_a_long_list_in_a_frame_is_scrolled_by_the_wheel(site: Site, tab: Tab) -> None:
    options = "".join(f"<option>City {number}" for number in range(40))
    inner = site.page(f"<label>City <select>{options}</select></label>")
    await tab.goto(site.page("<p>top</p>" + framed(site.elsewhere(inner), "width:300px;height:220px")))
    await tab.step(LeftClick(tab.at("City")))
    assert "City 39" not in tab.text
    for _ in range(8):
        await tab.step(Scroll("down"))
    await tab.step(LeftClick(tab.at("City 39", "option")))
    assert tab.find("City", "combobox").value == "City 39"


async def test_frames_come_into_view_by_scrolling(site: Site, open_tab: Open) -> None:
    inner = site.elsewhere(site.page("<button>Far</button>"))
    tab = await open_tab("marks")
    await tab.goto(site.page(f"<button>Near</button><div style='height:900px'></div>{framed(inner)}"))
    assert names(tab) == ["Near"]
    await tab.step(Scroll("down"))
    [far] = elements(tab)
    assert far.name == "Far"
    await tab.step(Scroll("up"))
    await tab.step(Scroll("down"))
    assert elements(tab)[0].number == far.number


async def test_a_page_without_such_frames_costs_no_round_trip(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    tab = await open_tab("marks")
    inner = site.page("<button>Inner</button>")
    await tab.goto(site.page(f"<h1>Plain</h1><a href=/next>Next</a><div></div>{framed(inner)}"))
    await tab.step()
    assert tab.slot.process is not None
    connection = tab.slot.process.connection
    sent: list[str] = []
    send = connection.send

    def count(method: str, *more: object, **named: object) -> int:
        sent.append(method)
        return send(method, *more, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(connection, "send", count)
    await tab.step()
    # The second is not awaited.
    assert sent == ["Runtime.evaluate", "LayerTree.enable", "Page.captureScreenshot"]


CLOSED = """
<style>#host, x-host { display: block }</style>
<HOST></HOST>
<script>
  const host = document.querySelector('HOST');
  const root = host.attachShadow({ mode: 'closed' });
  root.innerHTML = `<p>closed words</p><label>Name <input></label>
    <label>Size <select><option>S<option>M</select></label><button>Press</button>`;
  root.querySelector('button').onclick = (event) => { event.target.textContent = 'Done'; };
</script>
"""


@pytest.mark.parametrize(("mode", "host"), [("coordinates", "div"), ("marks", "x-host")])
async def test_closed_shadow_roots_are_part_of_the_page(
    site: Site, open_tab: Open, mode: str, host: str
) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(CLOSED.replace("HOST", host)))
    assert names(tab) == ["Name", "Size", "Press"]
    assert tab.text[0] == "closed words"
    await tab.step(Type(tab.at("Name"), "Ann"))
    assert tab.find("Name").value == "Ann"
    await tab.step(LeftClick(tab.at("Size")))
    await tab.step(LeftClick(tab.at("M", "option")))
    assert tab.find("Size").value == "M"
    await tab.step(LeftClick(tab.at("Press")))
    assert "Done" in names(tab)


async def test_typing_into_a_closed_root_that_was_never_looked_at(site: Site, open_tab: Open) -> None:
    tab = await open_tab()
    await tab.goto(site.page(CLOSED.replace("HOST", "x-host")))
    target = tab.at("Name")
    tab.options = tab.options.__class__(viewport=VIEWPORT)
    await tab.slot.open(tab.options)  # no text, no elements: nothing walks the page
    await tab.goto(
        site.page(
            CLOSED.replace("HOST", "x-host").replace(
                "<input>", "<input oninput='document.title = this.value'>"
            )
        )
    )
    look = await tab.step(Type(target, "Ann"))
    assert look.observation.title == "Ann"


async def test_a_frame_of_another_origin_within_a_closed_root(site: Site, tab: Tab) -> None:
    inner = site.elsewhere(site.page(INNER))
    await tab.goto(
        site.page(
            "<x-host></x-host><script>document.querySelector('x-host').attachShadow({ mode: 'closed' })"
            f".innerHTML = `{framed(inner)}`</script>"
        )
    )
    assert "Press" in names(tab)
    await tab.step(Type(tab.at("Name"), "Ann"))
    assert tab.find("Name").value == "Ann"


async def test_going_back_in_a_frame(site: Site, tab: Tab) -> None:
    second = site.page("<p>second</p>")
    inner, other = (site.page(f"<p>first</p><a href='{second}'>{name}</a>") for name in ("Next", "Beyond"))
    await tab.goto(site.page(framed(inner) + framed(site.elsewhere(other))))
    before = tab.text
    for link, lines in {"Next": ["second", *before[2:]], "Beyond": [*before[:2], "second"]}.items():
        await tab.step(LeftClick(tab.at(link)))
        assert tab.text == lines
        await tab.step(GoBack())
        assert (tab.text, tab.notices) == (before, [])
