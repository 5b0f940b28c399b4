"""What is typed into a slider or a colour field becomes its value, or the agent is told what it is."""

from __future__ import annotations

from itertools import cycle

import pytest

from webgym.browser.actions import TYPED_KEYS
from webgym.core.action import Target, Type

from .conftest import MODES, Open, Site, Tab, batches
from .test_marks import evaluate

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

ARIA = """
<style>#s { display: block; width: 300px; height: 20px; background: #ccc }</style>
<div id=s role=slider tabindex=0 aria-label=Volume
  aria-valuemin=LOW aria-valuemax=HIGH aria-valuenow=NOW></div>
<script>
  let [value, keys] = [NOW, 0];
  const steps = STEPS;
  s.onkeydown = (event) => {
    keys += 1;
    if (!event.isTrusted || !(event.key in steps)) return;
    event.preventDefault();
    value = Math.min(HIGH, Math.max(LOW, Number((value + steps[event.key]).toFixed(2))));
    const tell = () => s.setAttribute('aria-valuenow', value);
    LATER;
  };
</script>
"""
"""A slider of ARIA: its least, greatest and present value, its steps by key, and how it tells the value."""


def aria(steps: str, *, low: float = 0, high: float = 100, now: float = 30, later: str = "tell()") -> str:
    page = ARIA.replace("LOW", str(low)).replace("HIGH", str(high)).replace("NOW", str(now))
    return page.replace("STEPS", steps).replace("LATER", later)


ARROWS = "{ ArrowRight: STEP, ArrowUp: STEP, ArrowLeft: -STEP, ArrowDown: -STEP }"
ONE, FIVE, TENTH = (ARROWS.replace("STEP", step) for step in ("1", "5", "0.1"))
PAGED = FIVE.replace("}", ", PageUp: 1000, PageDown: -1000 }")


async def held(tab: Tab) -> str:
    return str(await evaluate(tab, "String(value)"))


@MODES
async def test_a_slider_takes_the_value_that_is_typed(site: Site, open_tab: Open, mode: str) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(aria(ONE)))
    for text in ("70", "12", " 12 %", "0", "100", "$99.00"):
        await tab.step(Type(tab.at("Volume"), text))
        assert tab.notices == []
        assert await held(tab) == text.strip(" %$").removesuffix(".00")


KINDS = {
    "by tenths": (aria(TENTH, high=1, now=0.2), "0.7"),
    "below zero": (aria(ONE, low=-100), "-25"),
    "by keys that its handle takes": (
        aria(ONE).replace("tabindex=0", "").replace("></div>", "><i tabindex=0>o</i></div>"),
        "70",
    ),
    "with a minus sign": (aria(ONE, low=-100), "\u221225"),
    "by pages": (aria(PAGED, high=100_000), "54,305"),
    "from right to left": (aria("{ ArrowRight: -1, ArrowLeft: 1 }"), "35"),
    "from right to left, down": (aria("{ ArrowRight: -1, ArrowLeft: 1 }"), "5"),
    "upright": (aria("{ ArrowUp: 2, ArrowDown: -2 }"), "88"),
    "drawn later": (aria(FIVE, later="setTimeout(tell, 40)"), "85"),
    "told in its own frame": (aria(FIVE, later="requestAnimationFrame(tell)"), "85"),
}


@pytest.mark.parametrize("kinds", batches(2, KINDS))
async def test_sliders_of_many_kinds(site: Site, tab: Tab, kinds: list[str]) -> None:
    for kind in kinds:
        page, text = KINDS[kind]
        await tab.goto(site.page(page))
        await tab.step(Type(tab.at("Volume"), text))
        assert tab.notices == [], kind
        assert await held(tab) == text.replace(",", "").replace("\u2212", "-"), kind


OTHERWISE = [
    (aria(FIVE), "42", "40", "the slider is at 40, not at 42"),
    (aria(FIVE), "43", "45", "the slider is at 45, not at 43"),
    (aria(ONE), "150", "100", "the slider is at 100, not at 150"),
    (aria(ONE), "-1", "0", "the slider is at 0, not at -1"),
    (aria(ONE), "loud", "30", 'does not take "loud"'),
    (aria(ONE), "10 to 20", "30", "write a number"),
    (aria(ONE), "", "30", "write a number"),
    (aria("{}"), "40", "30", "the slider is at 30, not at 40, and does not react to keys"),
]


async def test_another_value_than_the_one_typed_is_told(site: Site, tab: Tab) -> None:
    for page, text, value, told in OTHERWISE:
        await tab.goto(site.page(page))
        await tab.step(Type(tab.at("Volume"), text))
        assert await held(tab) == value, text
        assert [kind for kind, _ in tab.notices] == ["action_failed"], text
        assert told in tab.notices[0][1]


@pytest.mark.parametrize(
    "later",
    ["", "s.setAttribute('aria-valuenow', keys % 2)", "s.setAttribute('aria-valuenow', Math.random() * 9)"],
)
async def test_a_slider_that_never_gets_there_ends(site: Site, tab: Tab, later: str) -> None:
    await tab.goto(site.page(aria(ONE, later=later)))
    await tab.step(Type(tab.at("Volume"), "70"))
    assert [kind for kind, _ in tab.notices] == ["action_failed"]
    assert await evaluate(tab, "keys") <= TYPED_KEYS


async def test_a_slider_that_is_off_is_left_alone(site: Site, tab: Tab) -> None:
    await tab.goto(site.page(aria(ONE).replace("tabindex", "aria-disabled=true tabindex")))
    await tab.step(Type(Target(coordinate=(100, 24)), "70"))
    assert "cannot be changed" in tab.notices[0][1]
    assert await held(tab) == "30"


async def test_a_slider_gets_the_keys_that_leaves_the_focus_in_a_field(site: Site, tab: Tab) -> None:
    stays = (
        "<input id=f autofocus value=kept><script>s.onmousedown = (event) => event.preventDefault()</script>"
    )
    await tab.goto(site.page(aria(ONE) + stays + "<script>f.focus()</script>"))
    await tab.step(Type(tab.at("Volume"), "70"))
    assert await held(tab) == "70"
    assert await evaluate(tab, "f.value") == "kept"


async def test_a_field_within_a_slider_takes_the_text(site: Site, tab: Tab) -> None:
    inner = "<input id=f style='width:300px' aria-label=Exact>"
    await tab.goto(site.page(aria(ONE).replace("></div>", f">{inner}</div>")))
    await tab.step(Type(Target(coordinate=(100, 24)), "70"))
    assert await evaluate(tab, "f.value") == "70"
    assert await held(tab) == "30"


async def test_a_slider_in_frames(site: Site, tab: Tab) -> None:
    tells = f"<p id=p></p>{aria(ONE, later='tell(); p.textContent = `held ${value}`')}"
    inner = site.page(tells)
    for url in (inner, site.elsewhere(inner)):
        await tab.goto(site.page(f"<iframe src='{url}' width=600 height=200></iframe>"))
        await tab.step(Type(tab.at("Volume"), "70"))
        assert tab.notices == []
        assert "held 70" in tab.text


# --- sliders without a value of ARIA ------------------------------------------------------------------

JQUERY = """
<style>
  .ui-slider { position: relative; width: 200px; height: 10px; margin: 40px; background: #ccc }
  .ui-slider.upright { width: 10px; height: 150px }
  .ui-slider-handle { position: absolute; width: 16px; height: 16px; margin: -3px -8px; background: #36c }
  .upright .ui-slider-handle { margin: -8px -3px }
</style>
<div class="ui-slider KIND"></div> <b>Deals of 24 hours</b> <p>OUTPUT</p>
<script>
  const slider = document.querySelector('.ui-slider');
  const value = [VALUES];
  const show = () => {
    value.forEach((one, n) => {
      const share = `${(one - LOW) / (HIGH - LOW) * 100}%`;
      slider.children[n].style[slider.matches('.upright') ? 'bottom' : 'left'] = share;
    });
    const text = value.map((one) => `$${one}`).join(' - ');
    const out = document.querySelector('#out');
    if (out) out.localName === 'input' ? (out.value = text) : (out.textContent = text);
  };
  const steps = { 39: 1, 38: 1, 37: -1, 40: -1, 33: (HIGH - LOW) / 5, 34: (LOW - HIGH) / 5 };
  value.forEach((_, n) => {
    const handle = document.createElement('span');
    handle.className = 'ui-slider-handle';
    handle.tabIndex = 0;
    handle.title = `Handle ${n}`;
    handle.onmousedown = (event) => { event.preventDefault(); handle.focus(); };
    handle.onkeydown = (event) => {
      if (!steps[event.keyCode]) return;
      event.preventDefault();
      const [least, most] = [value[n - 1] ?? LOW, value[n + 1] ?? HIGH];
      value[n] = Math.min(most, Math.max(least, value[n] + steps[event.keyCode]));
      show();
    };
    slider.append(handle);
  });
  show();
</script>
"""
"""A slider like that of jQuery UI: its handles are placed by a share of the track, and tell nothing."""


def jquery(
    values: str, *, low: int = 0, high: int = 100, output: str = "<i id=out></i>", kind: str = ""
) -> str:
    page = JQUERY.replace("VALUES", values).replace("OUTPUT", output).replace("KIND", kind)
    return page.replace("LOW", str(low)).replace("HIGH", str(high))


BY_TEXT = {
    "in the middle": (jquery("40"), 0, "63", "63"),
    "at its end": (jquery("100"), 0, "63", "63"),
    "at its start": (jquery("-100", low=-100), 0, "-7", "-7"),
    "upright": (jquery("40", kind="upright"), 0, "0", "0"),
    "in a field": (jquery("40", output="<input id=out readonly>"), 0, "63", "63"),
    "the first of two": (jquery("20,80", output="<input id=out readonly>"), 0, "70", "70,80"),
    "the second of two": (jquery("20,80"), 1, "70", "20,70"),
}


@pytest.mark.parametrize(("kind", "mode"), list(zip(BY_TEXT, cycle(["coordinates", "marks"]))))
async def test_a_slider_whose_value_stands_beside_it(
    site: Site, open_tab: Open, kind: str, mode: str
) -> None:
    page, handle, text, value = BY_TEXT[kind]
    tab = await open_tab(mode)
    await tab.goto(site.page(page))
    await tab.step(Type(tab.at(f"Handle {handle}"), text))
    assert tab.notices == []
    assert await held(tab) == value


@pytest.mark.parametrize("kind", ["", "upright"])
async def test_a_slider_that_shows_no_value_takes_a_share(site: Site, tab: Tab, kind: str) -> None:
    await tab.goto(site.page(jquery("5", high=20, output="", kind=kind)))
    await tab.step(Type(tab.at("Handle 0"), "7"))
    assert "such as 40%" in tab.notices[0][1]
    await tab.step(Type(tab.at("Handle 0"), "75%"))
    assert tab.notices == []
    assert await held(tab) == "15"
    await tab.step(Type(tab.at("Handle 0"), "33%"))
    assert tab.notices == [("action_failed", "the slider is at 35 % of its track, not at 33 % of its track")]


# --- fields of HTML -----------------------------------------------------------------------------------


FIELDS = [
    ("range value=30", "70", "70", ""),
    ("range value=30", "70 %", "70", ""),
    ("range value=30", "150", "100", "the slider is at 100 now, not at 150"),
    ("range value=30 step=5", "42", "40", "the slider is at 40 now, not at 42"),
    ("range", "loud", "50", 'a range field does not take "loud"'),
    ("range", "", "50", "a range field does not take"),
    ("color value=#123456", "red", "#ff0000", ""),
    ("color value=#123456", "F80", "#ff8800", ""),
    ("color value=#123456", "AB2567", "#ab2567", ""),
    ("color value=#123456", "rgb(0, 128, 255)", "#0080ff", ""),
    ("color value=#123456", "#12345", "#123456", 'a color field does not take "#12345"'),
    ("color value=#123456", "transparent", "#123456", "write #rrggbb"),
    ("color value=#123456", "inherit", "#123456", "write #rrggbb"),
    ("color value=#123456", "", "#123456", "write #rrggbb"),
]


async def test_a_range_and_a_colour(site: Site, tab: Tab) -> None:
    heard = "oninput='this.title = this.value' onchange='this.title += `, ${this.value}`'"
    fields = (
        f"<input id=f{n} type={field} aria-label=Field{n} title='{value}, {value}' {heard}>"
        for n, (field, _, value, _) in enumerate(FIELDS)
    )
    await tab.goto(site.page("".join(fields)))
    for n, (_, text, value, told) in enumerate(FIELDS):
        await tab.step(Type(tab.at(f"Field{n}"), text))
        assert await evaluate(tab, f"f{n}.value") == value
        assert [told in notice for _, notice in tab.notices] == [True] * bool(told), text
        assert await evaluate(tab, f"f{n}.title") == f"{value}, {value}"
