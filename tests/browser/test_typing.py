"""What a page hears while text is typed, and what becomes of it."""

from __future__ import annotations

import itertools
import json

import pytest

from webgym.browser.keyboard import ENTER, runs, split_input
from webgym.core.action import LeftClick, Target, Type

from .conftest import MODES, Open, Site, Tab

browser = pytest.mark.browser
pytestmark = [pytest.mark.asyncio(loop_scope="package")]

HEARD = """
<script>
  const heard = [];
  for (const name of ['keydown', 'keypress', 'keyup', 'beforeinput', 'input', 'change',
                      'compositionstart', 'compositionend'])
    addEventListener(name, (e) => heard.push([name, e.key || e.data || e.inputType || '']), true);
  const tell = () => { out.textContent = JSON.stringify(heard); };
  setInterval(tell, 20);
</script>
<style>#out { font: 6px/6px monospace }</style>
"""


def heard(tab: Tab) -> list[list[str]]:
    said = next(line for line in tab.text if line.startswith("[["))
    events: list[list[str]] = json.loads(said)
    return events


def value(tab: Tab, name: str = "Field") -> str:
    found = tab.find(name).value
    assert found is not None
    return found


TEXTS = {
    "plain": "hello",
    "long": "the quick brown fox jumps over the lazy dog",
    "signs": 'a+b=<c>&"d" {e} ~50% #1 x@y.z',
    "accents": "Zoë Ñandú Straße",
    "combining": "e\u0301te\u0301 a\u0323\u0302",
    "russian": "Привет, мир",
    "hebrew": "שלום עולם",
    "arabic": "مرحبا بالعالم 123",
    "devanagari": "नमस्ते",
    "thai": "สวัสดีครับ",
    "chinese": "你好,世界",
    "japanese": "日本語カナ",
    "korean": "안녕하세요",
    "emoji": "ok 👍🏽 👩‍👩‍👧 🇩🇪 ❤️",
    "mixed": "abc日本😀é",
    "astral": "𝒳𠮷",
}


@browser
@pytest.mark.parametrize(
    "field",
    [
        "<input aria-label={} value=old>",
        pytest.param("<textarea aria-label={}>old</textarea>", marks=pytest.mark.slow),
    ],
)
async def test_every_script_arrives_as_it_is(site: Site, tab: Tab, field: str) -> None:
    await tab.goto(site.page("".join(map(field.format, TEXTS))))
    for name, text in TEXTS.items():
        await tab.step(Type(tab.at(name), text))
        assert value(tab, name) == text


@browser
async def test_every_script_arrives_in_editable_content(site: Site, tab: Tab) -> None:
    div = "<div contenteditable aria-label={} dir=auto style='float:left;width:48%'>old <b>text</b></div>"
    await tab.goto(site.page("".join(map(div.format, TEXTS))))
    for name, text in TEXTS.items():
        await tab.step(Type(tab.at(name), text))
        assert tab.last is not None
        assert " ".join(text.split()) in tab.last.observation.fields
    assert tab.last is not None
    assert tab.last.observation.fields == tuple(" ".join(text.split()) for text in TEXTS.values())


@browser
async def test_a_short_text_is_heard_key_by_key(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(f"<input aria-label=Field>{HEARD}<p id=out></p>"))
    await tab.step(Type(tab.at("Field"), "aB"))
    await tab.step()
    expected = []
    for key in "aB":
        expected += [
            ["keydown", key],
            ["keypress", key],
            ["beforeinput", key],
            ["input", key],
            ["keyup", key],
        ]
    enter = [["keydown", "Enter"], ["keypress", "Enter"]]
    events = [event for event in heard(tab) if event[0] != "change" and event[1] != "insertLineBreak"]
    assert events == [*expected, *enter, ["keyup", "Enter"]]


@browser
async def test_codes_and_numbers_of_keys(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<input aria-label=Field><p id=out></p><script>addEventListener('keydown', (event) => "
            "out.append(`${event.key}/${event.code}/${event.keyCode}/${event.shiftKey ? 1 : 0} `))</script>"
        )
    )
    await tab.step(Type(tab.at("Field"), "aZ1!?"))
    assert (
        tab.text[-1] == "a/KeyA/65/0 Z/KeyZ/90/1 1/Digit1/49/0 !/Digit1/49/1 ?/Slash/191/1 Enter/Enter/13/0"
    )


@browser
async def test_a_field_that_lives_on_keys_gets_every_one(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<input aria-label=Field><p id=out></p><script>const f = document.querySelector('input');"
            "f.addEventListener('keydown', (event) => { if (event.key.length > 1) return;"
            "event.preventDefault(); f.value += event.key; })</script>"
        )
    )
    await tab.step(Type(tab.at("Field"), "a longer search for boots"))
    assert value(tab, "Field") == "a longer search for boots"


@browser
async def test_a_very_long_text_is_inserted_and_ends_in_a_key(
    site: Site, open_tab: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.browser.actions.TYPED_KEYS", 8)
    tab = await open_tab()
    await tab.goto(
        site.page(
            "<input aria-label=Field><p id=out></p><script>let keys = 0;"
            "addEventListener('keydown', () => (keys += 1)); addEventListener('keyup', (event) => {"
            "if (event.key !== 'Enter') out.textContent = `${keys} found ${event.target.value}`; })</script>"
        )
    )
    await tab.step(Type(tab.at("Field"), "a longer search for boots"))
    assert tab.text[-1] == "1 found a longer search for boots"


@browser
async def test_an_input_method_composes(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(f"<input aria-label=Field value=old>{HEARD}<p id=out></p>"))
    await tab.step(Type(tab.at("Field"), "東京"))
    await tab.step()
    kinds = [name for name, _ in heard(tab)]
    assert ["keydown", "Process"] in heard(tab)
    assert kinds.index("compositionstart") < kinds.index("input") < kinds.index("compositionend")
    assert ["compositionend", "東京"] in heard(tab)
    assert value(tab) == "東京"


@browser
@pytest.mark.parametrize(
    "field",
    [
        "<textarea aria-label=Field>old</textarea>",
        "<div contenteditable role=textbox aria-label=Field>old</div>",
    ],
)
async def test_enter_does_not_spoil_a_text_of_several_lines(site: Site, tab: Tab, field: str) -> None:
    await tab.goto(
        site.page(
            f"{field}<p id=out></p><script>const f = document.querySelector('[aria-label]');"
            "f.onkeydown = (e) => { if (e.key === 'Enter') out.textContent = "
            "'sent ' + JSON.stringify(f.value ?? f.innerText) };"
            "f.onkeyup = () => { document.title = JSON.stringify(f.value ?? f.innerText) }</script>"
        )
    )
    look = await tab.step(Type(tab.at("Field"), "hello"))
    assert look.observation.title == '"hello"', "no line break was added"
    assert 'sent "hello"' in tab.text, "the page heard of Enter"
    look = await tab.step(Type(tab.at("Field"), "one\ntwo"))
    assert json.loads(look.observation.title).split() == ["one", "two"]
    assert look.observation.title in ('"one\\ntwo"', '"one\\n\\ntwo"')


@browser
async def test_lines_break_again_when_the_page_types_on(site: Site, tab: Tab) -> None:
    """Only the Enter that ends our typing is held back."""
    await tab.goto(site.page("<textarea aria-label=Field></textarea>"))
    await tab.step(Type(tab.at("Field"), "one"))
    page = tab.slot.page  # a second Enter, which no action presses
    for kind in ("down", "up"):
        await page.session.do("Input.dispatchKeyEvent", ENTER.event(kind), seconds=5)
    await tab.step()
    assert value(tab) == "one\n"


@browser
async def test_a_form_in_which_enter_sends_from_a_text_area(site: Site, tab: Tab) -> None:
    site.page("<title>Results</title>", "/results")
    await tab.goto(
        site.page(
            '<form action=/results><textarea name=q aria-label=Search rows=1 onkeydown="if (event.key === '
            "'Enter') { event.preventDefault(); this.form.submit(); }\"></textarea></form>"
        )
    )
    look = await tab.step(Type(tab.at("Search"), "boots for rain"))
    assert look.observation.title == "Results"
    assert look.observation.url.endswith("?q=boots+for+rain")


@browser
@pytest.mark.parametrize(
    ("mode", "widget"),
    [
        ("coordinates", "<div id=w tabindex=0 aria-label=Board>click</div>"),
        ("marks", "<canvas id=w tabindex=0 aria-label=Board width=200 height=100></canvas>"),
    ],
)
async def test_something_that_only_listens_to_keys(
    site: Site, open_tab: Open, mode: str, widget: str
) -> None:
    tab = await open_tab(mode)
    await tab.goto(
        site.page(
            f"{widget}<p id=out></p><script>w.onkeydown = (e) => out.append(e.key === 'Enter' ? '!' : e.key)"
            "</script>"
        )
    )
    await tab.step(Type(tab.at("Board"), "crane 7"))
    assert tab.text[-1] == "crane 7!"
    await tab.step(Type(tab.at("Board"), "x" * 300))
    assert [kind for kind, _ in tab.notices] == ["action_failed"]


@browser
async def test_a_code_in_boxes_of_one_character(site: Site, tab: Tab) -> None:
    boxes = "".join(f"<input maxlength=1 inputmode=numeric aria-label=Digit{n}>" for n in range(4))
    await tab.goto(
        site.page(
            f"{boxes}<script>document.querySelectorAll('input').forEach((box) => box.oninput = () => "
            "box.value && box.nextElementSibling.focus?.())</script>"
        )
    )
    await tab.step(Type(tab.at("Digit0"), "4711"))
    assert [value(tab, f"Digit{n}") for n in range(4)] == ["4", "7", "1", "1"]


@browser
async def test_a_mask_that_formats_what_is_typed(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<input type=tel aria-label=Phone><script>const f = document.querySelector('input');"
            "f.onkeydown = (e) => { if (e.key.length > 1) return; e.preventDefault();"
            "const d = (f.selectionEnd > f.selectionStart ? '' : f.value.replace(/\\D/g, '')) + e.key;"
            "f.value = d.replace(/^(\\d{3})(\\d)/, '($1) $2'); f.setSelectionRange(99, 99); }</script>"
        )
    )
    await tab.step(Type(tab.at("Phone"), "5551234567"))
    assert value(tab, "Phone") == "(555) 1234567"


TYPES = [
    ("month", "March 2026", "2026-03"),
    ("month", "2026-03", "2026-03"),
    ("week", "2026-W12", "2026-W12"),
    ("datetime-local", "2026-03-14 18:30", "2026-03-14T18:30"),
    ("datetime-local", "March 14, 2026 6:30 pm", "2026-03-14T18:30"),
    ("date", "14.3.2026", "2026-03-14"),
    ("date", "14 March 2026", "2026-03-14"),
    ("date", "2026/3/4", "2026-03-04"),
    ("date", "", ""),
    ("time", "6 pm", "18:00"),
    ("time", "12:05 AM", "00:05"),
    ("time", "9:30:15", "09:30:15"),
    ("color", "#FF8800", "#ff8800"),
    ("range", "70", "70"),
    ("number", "-3.5", "-3.5"),
    ("number", "12", "12"),
    ("email", "a@b.example", "a@b.example"),
    ("password", "secret!", "•••••••"),
    ("url", "https://x.example/?a=b", "https://x.example/?a=b"),
]


@browser
async def test_fields_of_every_type(site: Site, tab: Tab) -> None:
    fields = (f"<input type={kind} step=any aria-label=Field{n}>" for n, (kind, _, _) in enumerate(TYPES))
    await tab.goto(site.page("".join(fields)))
    for n, (kind, text, result) in enumerate(TYPES):
        await tab.step(Type(tab.at(f"Field{n}"), text))
        assert tab.notices == [], kind
        assert value(tab, f"Field{n}") == result


@browser
async def test_a_document_in_design_mode(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<iframe srcdoc='<body>old text' width=400 height=100></iframe><script>onload = () => {"
            "document.querySelector('iframe').contentDocument.designMode = 'on' }</script>"
        )
    )
    await tab.step(Type(Target(coordinate=(100, 60)), "new text"))
    assert tab.notices == []
    assert tab.last is not None
    assert tab.last.observation.fields == ("new text",)


@browser
async def test_a_read_only_field_whose_click_opens_another_later(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<input readonly aria-label=Search onclick='setTimeout(open_, 200)'>"
            "<input id=i hidden onchange='document.title = this.value'>"
            "<script>const open_ = () => { i.hidden = false; i.focus() }</script>"
        )
    )
    look = await tab.step(Type(tab.at("Search"), "boots"))
    assert look.observation.title == "boots"


NO_TEXT = {
    "<input type=file {}>": "files cannot be uploaded",
    "<input readonly {}>": "cannot be changed",
    "<input type=date {}>": "YYYY-MM-DD",
    "<button {}>x</button>": "no text field",
    "<a href='#x' {}>x</a>": "no text field",
    "<input type=checkbox {}>": "no text field",
}


@browser
async def test_what_takes_no_text_is_told(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(" ".join(field.format(f"aria-label=Field{n}") for n, field in enumerate(NO_TEXT)))
    )
    for n, why in enumerate(NO_TEXT.values()):
        await tab.step(Type(tab.at(f"Field{n}"), "soon"))
        told = [text for kind, text in tab.notices if kind == "action_failed"]
        assert any(why in text for text in told), n


LIST = """
<label>Fruit <select id=s SIZE>
  <option>Apple<optgroup label=Citrus><option>Orange<option disabled>Lemon</optgroup>
  <optgroup label=Gone disabled><option>Plum</optgroup><option>Pear
</select></label>
<script>
  let n = 0;
  s.onchange = () => { document.title = `${++n}: ` + [...s.selectedOptions].map((o) => o.value); };
</script>
"""


@browser
@MODES
async def test_lists_of_several_lines(site: Site, open_tab: Open, mode: str) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(LIST.replace("SIZE", "size=8")))
    look = await tab.step(LeftClick(tab.at("Orange", "option")))
    assert look.observation.title == "1: Orange"
    look = await tab.step(Type(tab.at("Fruit"), "pear"))
    assert look.observation.title == "2: Pear"
    await tab.goto(site.page(LIST.replace("SIZE", "size=8 multiple")))
    look = await tab.step(Type(tab.at("Fruit"), "Orange, pear"))
    assert look.observation.title == "1: Orange,Pear"
    look = await tab.step(Type(tab.at("Fruit"), "Apple, Kiwi"))
    assert "Kiwi" in tab.notices[0][1]
    assert look.observation.title == "1: Orange,Pear"


@browser
@MODES
async def test_groups_and_what_is_not_offered(site: Site, open_tab: Open, mode: str) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(LIST.replace("SIZE", "")))
    await tab.step(LeftClick(tab.at("Fruit")))
    assert "Citrus" in tab.text
    options = (
        [one.name for one in tab.last.observation.elements or () if one.role == "option"] if tab.last else []
    )
    assert options == ["Apple", "Orange", "Pear"]
    look = await tab.step(LeftClick(tab.at("Orange", "option")))
    assert look.observation.title == "1: Orange"
    await tab.step(Type(tab.at("Fruit"), "Lemon"))
    assert "Lemon" in tab.notices[0][1]
    await tab.step(LeftClick(tab.at("Fruit")))
    await tab.step(LeftClick(tab.at("Fruit")))
    assert "Citrus" not in tab.text, "a second click closes the list"


@browser
async def test_a_list_in_a_menu_that_closes_when_one_clicks_beside_it(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<div id=m style='width:300px;height:60px;background:#eee'><label>Size <select><option>S<option>M"
            "</select></label></div><script>document.addEventListener('mousedown', (e) => {"
            "if (!m.contains(e.target)) m.remove() })</script>"
        )
    )
    await tab.step(LeftClick(tab.at("Size")))
    await tab.step(LeftClick(tab.at("M", "option")))
    assert value(tab, "Size") == "M"


@browser
async def test_a_list_in_a_modal_dialog_and_in_an_open_shadow_root(site: Site, tab: Tab) -> None:
    await tab.goto(
        site.page(
            "<dialog id=d><x-form></x-form></dialog><script>document.querySelector('x-form')"
            ".attachShadow({ mode: 'open' }).innerHTML = "
            "'<label>Size <select><option>S<option>M</select></label>'; d.showModal()</script>"
        )
    )
    await tab.step(LeftClick(tab.at("Size")))
    await tab.step(LeftClick(tab.at("M", "option")))
    assert value(tab, "Size") == "M"


@browser
async def test_a_list_of_a_small_frame_has_the_room_of_the_page(site: Site, tab: Tab) -> None:
    inner = site.page("<select aria-label=Size><option>S<option>M<option>L<option>XL</select>")
    await tab.goto(
        site.page(
            f"<iframe src={inner} style='width:150px;height:50px;margin:200px;transform:scale(1.5)'></iframe>"
        )
    )
    await tab.step(LeftClick(tab.at("Size")))
    await tab.step(LeftClick(tab.at("XL", "option")))
    assert value(tab, "Size") == "XL"


# --- without a browser --------------------------------------------------------------------------------


async def test_texts_are_cut_by_the_way_they_are_typed() -> None:
    assert [*runs("ab日本😀é")] == [("keys", "ab"), ("compose", "日本"), ("insert", "😀"), ("keys", "é")]
    assert [*runs("e\u0301a")] == [("insert", "e\u0301"), ("keys", "a")]
    assert [*runs("a\nb")] == [("keys", "a"), ("insert", "\n"), ("keys", "b")]
    assert [*runs("")] == []


async def test_no_character_is_lost() -> None:
    for text, most in itertools.product(TEXTS.values(), (1, 4, 100)):
        assert "".join(run for _, run in split_input(text, most)) == text
        keys = sum(len(run) for way, run in split_input(text, most) if way == "keys")
        assert keys <= max(1, most)


EDITOR = """<div id=box style="width:400px;height:120px;border:1px solid">old text</div>
<textarea id=keys style="position:absolute;left:600px;width:9px;height:9px;opacity:0"></textarea><script>
let whole = false;
box.onmousedown = (e) => { e.preventDefault(); keys.focus(); };
keys.onkeydown = (e) => {
  if (e.ctrlKey && e.key === 'a') { whole = true; e.preventDefault(); }
  if (e.key === 'Backspace' && whole) { box.textContent = ''; whole = false; }
};
keys.oninput = (e) => {
  box.textContent = (whole ? '' : box.textContent) + keys.value;
  whole = false; keys.value = '';
};
</script>"""


@pytest.mark.parametrize("text", ["new", ""])
async def test_an_editor_that_keeps_its_content_itself_is_cleared(site: Site, tab: Tab, text: str) -> None:
    await tab.goto(site.page(EDITOR))
    await tab.step(Type(Target(coordinate=(100, 80)), text))
    assert "".join(tab.text) == text
