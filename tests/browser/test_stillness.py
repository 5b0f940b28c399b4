"""The last picture is used again where a step changes none of it, and nowhere else."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable

import pytest
from PIL import Image

from webgym.browser.observe import EarlyScreenshot
from webgym.browser.pictures import Stillness, may_move
from webgym.core.action import Hover, LeftClick, Mode, Press, Scroll, Target, Wait

from .conftest import MODES, Open, Site, Tab, batches

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

HERE = Target(coordinate=(50, 50))
AWAY = Target(coordinate=(900, 900))
STYLE = (
    "<style>#b { position: absolute; left: 0; top: 0; width: 200px; height: 80px; background: #eee }</style>"
)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Of each step, whether the last picture was used again."""
    found: list[bool] = []
    end = EarlyScreenshot.end

    async def noted(self: EarlyScreenshot, settled: str) -> None:
        await end(self, settled)
        found.append(self.result is not None and self._kept is not None)

    monkeypatch.setattr(EarlyScreenshot, "end", noted)
    return found


def pictures(format: str, frames: int) -> bytes:
    """A picture of so many frames, as a file of this format."""
    first, *more = [Image.new("RGB", (60, 60), colour) for colour in ("red", "blue", "lime")[:frames]]
    file = io.BytesIO()
    first.save(file, format, save_all=frames > 1, append_images=more, duration=400, loop=0)
    return file.getvalue()


def shown(format: str, frames: int) -> str:
    data = base64.b64encode(pictures(format, frames)).decode()
    url = f"data:image/{format.lower()};base64,{data}"
    return f"<img src={url}><div style='width:60px;height:60px;background:url({url})'></div>"


@pytest.mark.parametrize("frames", [1, 3])
@pytest.mark.parametrize("format", ["GIF", "PNG", "WEBP", "AVIF"])
async def test_the_bytes_of_a_picture_say_whether_it_moves(format: str, frames: int) -> None:
    assert may_move(pictures(format, frames)) == (frames > 1)


async def test_an_unknown_picture_may_move() -> None:
    assert not may_move(pictures("JPEG", 1))
    assert may_move(b"\xff\x0a and so on: JPEG XL")
    assert may_move(b"")


class Reported:
    """A session that reports what a page paints when it is told to."""

    sent = ""
    paint: Callable[[], None]

    def on(self, _: str, __: object, handler: Callable[[None], None]) -> None:
        self.paint = lambda: handler(None)

    def send(self, method: str) -> None:
        self.sent = method


@pytest.mark.parametrize(
    ("before", "after", "is_kept"), [(1, 0, True), (0, 1, False), (2, 0, False), (1, 1, False)]
)
async def test_a_picture_is_kept_for_which_one_frame_was_painted(
    before: int, after: int, is_kept: bool
) -> None:
    """One of a document that is not drawn yet has none, and its first frame is another picture."""
    session = Reported()
    stillness = Stillness(session)  # type: ignore[arg-type]
    stillness.begin_picture()
    for _ in range(before):
        session.paint()
    stillness.end_picture("one", b"picture")
    for _ in range(after):
        session.paint()
    assert stillness.picture_of("one") == (b"picture" if is_kept else None)
    assert stillness.picture_of("two") is None
    for _ in range(40):
        session.paint()
    assert session.sent == "LayerTree.disable"


STILL = {
    "text": "<p>Text <a href=#n>and a link</a></p>",
    "a field": "<input value=text><p>Text</p>",
    "pictures": shown("PNG", 1) + shown("GIF", 1) + shown("JPEG", 1) + shown("WEBP", 1),
    "what changes and does not show": "<p id=p>Text</p><script>"
    "addEventListener('click', () => { p.lastChild.stamp = performance.now() })</script>",
    "an animation that is over": "<style>@keyframes k { from { opacity: 0 } } p { animation: k .2s "
    "}</style><p>Text",
}


@MODES
@pytest.mark.parametrize("page", STILL)
async def test_what_is_still_keeps_its_picture(
    site: Site, open_tab: Open, kept: list[bool], mode: Mode, page: str
) -> None:
    tab = await open_tab(mode)
    await tab.goto(site.page(STYLE + STILL[page]))
    for action in (LeftClick(AWAY), Wait(0), Press(("Shift",)), Hover(AWAY), Scroll("up")):
        kept.clear()
        for _ in range(8):  # a machine that is starved may be late
            seen = await tab.step(action)
            if any(kept):
                break
        assert any(kept), action
        assert seen.image == (await tab.step()).image


RULE = "document.querySelector('style#s').sheet.cssRules[0].style"
LAYER = (
    "<style id=s>.w { will-change: transform, opacity; width: 60px; height: 60px; background: red }</style>"
    "<p class=w>"
)
SCRIPTS = {
    "a rule": f"<style id=s>p {{ color: red }}</style><p>Text</p>|{RULE}.color = 'blue'",
    "a layer's place": f"{LAYER}|{RULE}.transform = 'translateX(90px)'",
    "a layer's opacity": f"{LAYER}|{RULE}.opacity = .5",
    "another sheet of as many rules": "<p>Text</p>|const s = new CSSStyleSheet(); s.replaceSync('p { color: '"
    " + (document.adoptedStyleSheets.length ? 'blue' : 'red') + '}'); document.adoptedStyleSheets = [s]",
    "a sheet that is switched off": "<style id=s>p { color: red }</style><p>Text</p>"
    "|document.querySelector('style#s').sheet.disabled = true",
    "a highlight": "<style>::highlight(x) { background: yellow }</style><p id=p>Text</p>"
    "|const r = new Range(); r.selectNodeContents(p); CSS.highlights.set('x', new Highlight(r))",
    "a state of a box": "<input type=checkbox id=c>|c.indeterminate = true",
    "a selection in a field": "<input id=t value='some text'>|t.setSelectionRange(0, 4); t.focus()",
    "a state of a component": "<style>x-a:state(on) { background: red }</style><x-a>Text</x-a><script>"
    "customElements.define('x-a', class extends HTMLElement { i = this.attachInternals() })</script>"
    "|document.querySelector('x-a').i.states.add('on')",
    "a canvas": "<canvas id=c></canvas>|c.getContext('2d').fillRect(0, 0, 90, 90)",
    "a box that is scrolled": "<div id=d "
    "style='height:90px;overflow:auto'><p>a<p>b<p>c<p>d<p>e</div>|d.scrollTop = 50",
    "a closed shadow root": "<div id=d></div><script>window.r = d.attachShadow({ mode: 'closed' });"
    "r.innerHTML = '<p>Text'</script>|r.firstChild.firstChild.data = 'Other'",
    "a message to itself": "<style id=s>p { color: red "
    "}</style><p>Text</p><script>addEventListener('message', () => "
    f"{RULE}.color = 'blue')</script>|postMessage(1)",
}


@pytest.mark.parametrize("scripts", batches(2, SCRIPTS))
async def test_what_a_script_changes_without_a_change_of_the_document_is_pictured(
    site: Site, tab: Tab, scripts: list[str]
) -> None:
    for name in scripts:
        body, script = SCRIPTS[name].rsplit("|", 1)
        await tab.goto(
            site.page(
                f"{STYLE}<button id=b>Do</button><div style=height:90px></div>{body}<script>"
                f"let n = 0; b.addEventListener('mouseup', () => {{ if (n++ == 2) {{ {script} }} }})</script>"
            )
        )
        before = ""
        for number in range(4):
            seen = await tab.step(LeftClick(HERE))
            await tab.slot.page.rest(0.1)
            later = await tab.step()
            assert seen.image == later.image, (name, number)
            if number == 2:
                assert seen.observation.screenshot != before, name
            before = seen.observation.screenshot


STATES = {
    "the mouse over it": "<style>#b:hover { background: red }</style>|hover",
    "the mouse over a layer": "<style>#b { will-change: transform } #b:hover { transform: scale(.5) "
    "}</style>|hover",
    "the focus": "<style>#b:focus { background: red }</style>|click",
    "a key": "<style>#b:focus-visible { background: red }</style>|key",
}


@pytest.mark.parametrize("state", STATES)
async def test_a_state_that_only_a_style_shows_is_pictured(site: Site, tab: Tab, state: str) -> None:
    style, action = STATES[state].split("|")
    await tab.goto(site.page(f"{STYLE}{style}<button id=b>Do</button>"))
    for _ in range(3):
        before = await tab.step(LeftClick(AWAY))
    act = {"hover": Hover(HERE), "click": LeftClick(HERE), "key": Press(("Tab",))}[action]
    seen = await tab.step(act)
    assert seen.observation.screenshot != before.observation.screenshot
    assert seen.image == (await tab.step()).image


MOVING = {
    "a GIF": shown("GIF", 3),
    "a PNG": shown("PNG", 3),
    "a WebP": shown("WEBP", 3),
    "an AVIF": shown("AVIF", 3),
    "an SVG": "<img width=60 src=\"data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg' "
    "width='60' height='60'%3E"
    "%3Crect width='60' height='60'%3E%3Canimate attributeName='fill' values='red;blue' "
    "calcMode='discrete' dur='.2s'"
    " repeatCount='indefinite'/%3E%3C/rect%3E%3C/svg%3E\">",
    "an animation": "<style>@keyframes k { to { transform: translateX(90px) } } p { animation: k 1s "
    "infinite }</style><p>Text",
    "an animation in a shadow root": "<div id=d></div><script>d.attachShadow({ mode: 'closed' "
    "}).innerHTML = '<style>"
    "@keyframes k { to { transform: translateX(90px) } } p { animation: k 1s infinite "
    "}</style><p>Text'</script>",
    "a canvas": "<canvas></canvas>",
    "a canvas of a frame": "<iframe srcdoc='<canvas></canvas>'></iframe>",
    "a canvas of a shadow root": "<div id=d></div><script>d.attachShadow({ mode: 'open' }).innerHTML = "
    "'<canvas>'</script>",
    "a film": "<video></video>",
    "a moving text": "<marquee>Text</marquee>",
    "a bar": "<progress></progress>",
    "a frame of another origin": "<iframe sandbox srcdoc=Text></iframe>",
}


@pytest.mark.parametrize("pages", batches(1, MOVING, 8))
async def test_what_may_move_is_pictured_anew(
    site: Site, tab: Tab, kept: list[bool], pages: list[str]
) -> None:
    for page in pages:
        await tab.goto(site.page(f"{STYLE}<body>{MOVING[page]}"))
        kept.clear()
        for _ in range(4):
            await tab.step(LeftClick(AWAY))
        assert not any(kept), page
