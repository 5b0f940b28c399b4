"""What the browser itself draws or says beside the page is seen, told and can be used."""

from __future__ import annotations

import base64
import io
import wave

import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from tests.browser.conftest import Open, Site, Tab

from webgym.core.action import Hover, LeftClick, Press, Type, Upload
from webgym.core.task import Attachment

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]


# --- bubbles --------------------------------------------------------------------------------------------

FORM = (
    "<form action=/sent><label>Town <input name=t required></label>"
    "<label>Mail <input name=m type=email></label><button>Send</button></form>"
)


async def test_a_form_that_the_browser_holds_back_says_which_field_and_why(site: Site, tab: Tab) -> None:
    site.page("<p>Sent", "/sent")
    await tab.goto(site.page(FORM))
    await tab.step(LeftClick(tab.at("Send")))
    assert tab.notices == [("browser", 'the field "Town": Please fill out this field.')]
    await tab.step(None)
    assert tab.notices == []
    await tab.step(Type(tab.at("Town"), "Ulm", enter=False))
    await tab.step(Type(tab.at("Mail"), "nobody"))
    [(kind, text)] = tab.notices
    assert kind == "browser"
    assert text.startswith("the field \"Mail\": Please include an '@'")
    await tab.step(Type(tab.at("Mail"), "a@b.test"))
    assert tab.text == ["Sent"]


async def test_the_bubble_of_a_form_in_a_shadow_root(site: Site, tab: Tab) -> None:
    script = "<my-form></my-form><script>document.querySelector('my-form').attachShadow({mode: 'open'})"
    await tab.goto(site.page(f"{script}.innerHTML = `{FORM}`</script>"))
    await tab.step(LeftClick(tab.at("Send")))
    assert tab.notices == [("browser", 'the field "Town": Please fill out this field.')]


async def test_the_bubble_of_a_form_in_a_frame_of_another_origin(site: Site, tab: Tab) -> None:
    frame = site.elsewhere(site.page(FORM))
    await tab.goto(site.page(f"<iframe src='{frame}' width=600 height=200></iframe>"))
    await tab.step(LeftClick(tab.at("Send")))
    assert tab.notices == [("browser", 'the field "Town": Please fill out this field.')]


SPEAKING = {
    "it says so itself": "addEventListener('invalid', (event) => event.preventDefault(), true)",
    "it asks at each key": "i.form.noValidate = true; i.oninput = () => i.checkValidity()",
    "it asks without showing": "i.form.noValidate = true; b.onclick = () => i.checkValidity()",
}


@pytest.mark.parametrize("way", SPEAKING)
async def test_a_page_that_speaks_of_its_fields_itself_has_no_bubble(site: Site, tab: Tab, way: str) -> None:
    field = "<input id=i aria-label=Mail type=email required>"
    form = f"<form onsubmit='return false'>{field}<button id=b>Go</button></form><p id=o>-</p>"
    script = f"{SPEAKING[way]}; b.addEventListener('click', () => o.textContent += '-')"
    await tab.goto(site.page(f"{form}<script>{script}</script>"))
    await tab.step(Type(tab.at("Mail"), "x", enter=False))
    await tab.step(LeftClick(tab.at("Go")))
    assert tab.notices == []


# --- suggestions ----------------------------------------------------------------------------------------

TOWNS = (
    "<label>Town <input id=i list=l oninput='o.textContent = i.value'></label><p id=o>-</p><datalist id=l>"
    "<option value=ULM>Ulm</option><option value=BONN>Bonn</option><option value=KOLN>Cologne</option>"
    "</datalist>"
)


def options_of(tab: Tab) -> list[str]:
    assert tab.last is not None
    return [one.name for one in tab.last.observation.elements or () if one.role == "option"]


@pytest.mark.parametrize("mode", ["marks", "coordinates"])
async def test_suggestions_are_listed_below_their_field_and_chosen(
    site: Site, open_tab: Open, mode: str
) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(TOWNS))
    await tab.step(LeftClick(tab.at("Town")))
    assert options_of(tab) == ["ULM Ulm", "BONN Bonn", "KOLN Cologne"]
    assert "BONN Bonn" in " ".join(tab.text)
    await tab.step(Type(tab.at("Town"), "o", enter=False))
    assert options_of(tab) == ["BONN Bonn", "KOLN Cologne"]
    await tab.step(LeftClick(tab.at("KOLN Cologne")))
    assert options_of(tab) == []
    assert "KOLN" in tab.text
    await tab.step(Type(tab.at("Town"), "", enter=False))
    await tab.step(Press(("Escape",)))
    assert options_of(tab) == []


# --- pickers --------------------------------------------------------------------------------------------


async def test_a_list_that_a_script_opens_is_drawn(site: Site, tab: Tab) -> None:
    picker = "<select id=s><option>one<option>two</select><button onclick='s.showPicker()'>Choose</button>"
    script = "<p id=o>-</p><script>s.onchange = () => o.textContent = s.value</script>"
    await tab.goto(site.page(picker + script))
    await tab.step(LeftClick(tab.at("Choose")))
    assert options_of(tab) == ["one", "two"]
    await tab.step(LeftClick(tab.at("two", "option")))
    assert "two" in tab.text


async def test_a_picker_behind_a_button_is_a_field_to_type_in(site: Site, tab: Tab) -> None:
    hidden = "style='opacity:0;width:1px;height:1px;pointer-events:none'"
    picker = f"<input id=d type=date aria-label=Departure {hidden}>"
    button = "<button onclick='d.showPicker()'>Pick a day</button>"
    script = "<p id=o>-</p><script>d.onchange = () => o.textContent = d.value</script>"
    await tab.goto(site.page(picker + button + script))
    await tab.step(LeftClick(tab.at("Pick a day")))
    await tab.step(Type(tab.at("Departure"), "March 5, 2027"))
    assert "2027-03-05" in tab.text
    assert tab.notices == []


# --- players --------------------------------------------------------------------------------------------


def silence(seconds: int) -> str:
    """A sound as a data address."""
    file = io.BytesIO()
    with wave.open(file, "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(16000 * seconds))
    return f"data:audio/wav;base64,{base64.b64encode(file.getvalue()).decode()}"


async def test_players_have_numbers_that_play(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    sound = silence(30)
    players = (
        f"<audio controls src='{sound}'></audio><video controls src='{sound}' width=200 height=100></video>"
    )
    script = "for (const one of [...document.querySelectorAll('audio, video')]) one.onplay = () => "
    script += "o.textContent += ' ' + one.localName"
    await tab.goto(site.page(f"{players}<p id=o>plays</p><script>{script}</script>"))
    assert [tab.find(name).value for name in ("audio", "video")] == ["paused", "paused"]
    await tab.step(LeftClick(tab.at("audio")))
    assert tab.text[-1] == "plays audio"
    assert tab.find("audio").value == "playing"


# --- what lies over the page ----------------------------------------------------------------------------


async def test_a_layer_that_takes_all_clicks_from_the_start_has_a_number(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    layer = "<div style='position:fixed;inset:0' onclick='this.remove()'></div>"
    await tab.goto(site.page(f"<button onclick='o.textContent = 1'>Order</button><p id=o>0</p>{layer}"))
    await tab.step(LeftClick(tab.at("over the whole page")))
    await tab.step(LeftClick(tab.at("Order")))
    assert "1" in tab.text


# --- what is said beside the page -----------------------------------------------------------------------


async def test_a_tooltip_is_told_where_the_mouse_rests(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<button title='Opens at nine'><b>Shop</b></button><button>Other</button>"))
    await tab.step(Hover(tab.at("Shop")))
    assert tab.notices == [("browser", 'a tooltip "Opens at nine"')]
    await tab.step(Hover(tab.at("Other")))
    assert tab.notices == []


async def test_a_box_with_more_below_is_told_once(site: Site, tab: Tab) -> None:
    lines = "".join(f"<p>Line {number}</p>" for number in range(9))
    box = f"<div style='height:100px;overflow:auto'>{lines}</div>"
    frame = f"<iframe width=300 height=100 srcdoc='{lines}'></iframe>"
    await tab.goto(site.page(f"{box}{frame}<button>Press</button>"))
    told = "a box has more below than it shows, and can be scrolled: "
    assert tab.notices == [("browser", told + ", ".join(2 * ['"Line 0 Line 1 Line 2 Line 3 Line 4 Line …"']))]
    await tab.step(LeftClick(tab.at("Press")))
    assert "browser" not in [kind for kind, _ in tab.notices]


async def test_a_pdf_in_the_place_of_a_plugin_is_told_with_its_address(site: Site, tab: Tab) -> None:
    url = site.url("/inside.pdf")
    await tab.goto(site.page("<p>Read</p><embed src=/inside.pdf type=application/pdf width=300 height=200>"))
    [(kind, text)] = tab.notices
    assert (kind, text.endswith(url)) == ("browser", True)


async def test_files_are_not_given_to_the_file_system_api(site: Site, open_tab: Open) -> None:
    tab = await open_tab(files=(Attachment("notes.txt", "words"),))
    await tab.goto(site.page("<button onclick='showOpenFilePicker().catch(() => 0)'>Open</button>"))
    await tab.step(LeftClick(tab.at("Open")))
    assert tab.notices == [("action_failed", "the page asked for a file; files cannot be uploaded")]
    await tab.step(Upload(tab.at("Open"), ("notes.txt",)))
    assert ("action_failed", "the page asks by the File System API, which takes no files here") in tab.notices


async def test_the_print_preview_is_told(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<button onclick='print(); document.title = \"after\"'>Print</button>"))
    look = await tab.step(LeftClick(tab.at("Print")))
    assert look.observation.title == "after"
    assert tab.notices == [("browser", "the page opened the print preview; it was closed")]


async def test_a_password_that_the_browser_asks_for(site: Site, new_tab: Tab) -> None:
    async def members(request: Request) -> Response:
        is_known = request.headers.get("authorization") == f"Basic {base64.b64encode(b'ann:pass').decode()}"
        asks = {"www-authenticate": 'Basic realm="members"'}
        return HTMLResponse("<p>Inside") if is_known else HTMLResponse("<p>Who?", 401, asks)

    url = site.on("/members", members)
    await new_tab.goto(url)
    [(kind, text)] = new_tab.notices
    assert kind == "browser"
    assert "NAME:PASSWORD" in text
    await new_tab.goto(url.replace("://", "://ann:pass@"))
    assert new_tab.text == ["Inside"]
    assert new_tab.notices == []


# --- fields that do not take what is typed --------------------------------------------------------------

REFUSING = {
    "no keys": ("<input aria-label=f onkeydown='event.preventDefault()'>", "abc", "nothing"),
    "its own text": ("<input aria-label=f value=old oninput=\"this.value = 'old'\">", "abc", '"old"'),
    "digits": ("<input aria-label=f oninput='this.value = this.value.replace(/\\D/, \"\")'>", "a", "nothing"),
    "five letters": ("<input aria-label=f maxlength=5>", "too long", '"too l"'),
    "a number": ("<input aria-label=f type=number>", "abc", "nothing"),
}
TAKING = {
    "a mask": (
        "<input aria-label=f oninput='this.value = this.value.replace(/^5{3}$/, \"(555) \")'>",
        "555123",
    ),
    "lines": ("<textarea aria-label=f></textarea>", "one\ntwo"),
    "capitals": ("<input aria-label=f oninput='this.value = this.value.toUpperCase()'>", "abc"),
    "digit by digit": ("<input aria-label=f maxlength=1 oninput='g.focus()'><input id=g>", "12"),
}


async def test_a_field_says_that_it_does_not_hold_what_was_typed(site: Site, tab: Tab) -> None:
    for name, (field, text, held) in REFUSING.items():
        await tab.goto(site.page(field))
        await tab.step(Type(tab.at("f"), text, enter=False))
        told = f"the field did not take all that was typed; it holds {held}"
        assert tab.notices == [("action_failed", told)], name
    for name, (field, text) in TAKING.items():
        await tab.goto(site.page(field))
        await tab.step(Type(tab.at("f"), text, enter=False))
        assert tab.notices == [], name


DAYS = {"March 5": None, "5/3": None, "03-05": None, "Mar 5, 2027": "2027-03-05", "5 May 2027": "2027-05-05"}


async def test_a_day_without_a_year_is_refused(site: Site, tab: Tab) -> None:
    await tab.goto(site.page("<input type=date aria-label=Day><input type=month aria-label=Month>"))
    for text, value in DAYS.items():
        await tab.step(Type(tab.at("Day"), text, enter=False))
        if value is None:
            [(kind, told)] = tab.notices
            assert (kind, "write YYYY-MM-DD" in told) == ("action_failed", True), text
        else:
            assert tab.find("Day").value == value
    await tab.step(Type(tab.at("Month"), "March", enter=False))
    assert tab.notices[0][0] == "action_failed"
