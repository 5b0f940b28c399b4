"""No page can see, touch or hide what observing it does."""

from __future__ import annotations

import io
from typing import Any

import pytest
from PIL import Image

from webgym.browser.marks import COLOURS, place
from webgym.core.action import LeftClick, Scroll, Target, Wait

from .conftest import Open, Site, Tab
from .test_marks import evaluate

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

EMPTY = Target(coordinate=(900, 500))

WATCHING = """<script>
const found = new Set();
const toText = Function.prototype.toString;
new MutationObserver((records) => records.forEach(({ type, target, attributeName }) =>
  found.add(`mutation: ${type} ${attributeName} of ${target.nodeName}`)))
  .observe(document, { subtree: true, childList: true, attributes: true, characterData: true });
const EVENTS = ['beforetoggle', 'toggle', 'slotchange', 'animationstart', 'transitionrun',
  'visibilitychange', 'resize', 'error', 'securitypolicyviolation'];
for (const name of EVENTS)
  addEventListener(name, (event) => found.add(`event: ${event.type}`), true);
// What is called of the page's own world.
for (const [owner, names] of [
  [Element.prototype, ['attachShadow', 'append', 'setAttribute', 'animate', 'querySelectorAll']],
  [HTMLElement.prototype, ['showPopover', 'focus']],
  [Document.prototype, ['createElement', 'createElementNS', 'querySelectorAll', 'elementFromPoint']],
  [EventTarget.prototype, ['addEventListener', 'dispatchEvent']],
  [CSSStyleSheet.prototype, ['replaceSync', 'insertRule']],
]) for (const name of names) {
  const own = owner[name];
  owner[name] = function (...given) { found.add(`call: ${name}`); return own.apply(this, given) };
}
for (const name of ['adoptedStyleSheets', 'activeElement', 'title', 'body']) {
  const own = Object.getOwnPropertyDescriptor(Document.prototype, name);
  const get = function () { if (!looking) found.add(`read: ${name}`); return own.get.call(this) };
  Object.defineProperty(Document.prototype, name, { ...own, get });
}
let looking = false;
const look = () => {
  looking = true;
  const seen = {
    nodes: document.getElementsByTagName('*').length,
    children: document.documentElement.childNodes.length,
    sheets: document.styleSheets.length,
    adopted: document.adoptedStyleSheets.length,
    shadowAdopted: root.adoptedStyleSheets.length,
    animations: document.getAnimations().length,
    globals: Object.getOwnPropertyNames(window).length,
    own: Object.getOwnPropertyNames(document).length,
    ownOfRoot: Object.getOwnPropertyNames(document.documentElement).length,
    top: Boolean(document.querySelector(':popover-open, :modal')),
    style: document.documentElement.getAttributeNames().join(),
    native: toText.call(document.getElementsByTagName),
  };
  looking = false;
  return seen;
};
</script><main><input id=f value=text autofocus><button>One</button>
<a href=#x>Two</a><p contenteditable>Three</p><div id=host></div></main><p style=height:2000px>long
<script>
const root = host.attachShadow({ mode: 'open' });
root.innerHTML = '<input value=inner>';
const first = look();
found.clear();
const compare = () => {
  const now = look();
  for (const [name, value] of Object.entries(now))
    if (value !== first[name]) found.add(`${name}: ${value}, not ${first[name]}`);
};
const { port1, port2 } = new MessageChannel();  // as often as a page can
port2.onmessage = () => { compare(); if (busy) setTimeout(() => port1.postMessage(0), 2) };
let busy = true;
port1.postMessage(0);
const frame = () => { compare(); if (busy) requestAnimationFrame(frame) };
requestAnimationFrame(frame);
</script>"""


async def test_a_page_that_watches_finds_nothing(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    await tab.goto(site.page(WATCHING))
    assert len(tab.last.observation.elements or ()) == 5  # type: ignore[union-attr]
    for action in (Wait(0.1), LeftClick(EMPTY), Scroll("down"), None):
        await tab.step(action)
    looks = await evaluate(tab, "compare(), busy = false, [...found]")
    assert looks == []


HIDING = """
div:empty { display: none !important } svg { display: none !important } svg path { display: none }
[popover] { display: none !important } :popover-open { opacity: 0 !important }
html > div { display: none !important }
html > :not(head, body) { visibility: hidden !important } body ~ * { display: none !important }
div { transform: translateX(9999px) !important } :root > * { opacity: .999 }
[style] { clip-path: inset(50%) !important }
::backdrop { background: red } * { filter: grayscale(1) !important }
"""
"""What common style sheets say, for reasons of their own, of nodes that others put into a page."""


def labels_of(tab: Tab) -> dict[int, tuple[int, int, int]]:
    """The colour at the upper left corner of each label of the last picture."""
    assert tab.last is not None
    picture = Image.open(io.BytesIO(tab.last.image)).convert("RGB")
    elements = tab.last.observation.elements or ()
    boxes = [(round(x), round(y), round(x + w), round(y + h)) for x, y, w, h in (one.box for one in elements)]
    labels = place([one.number for one in elements], boxes, picture.size)
    pixels: Any = picture.load()
    return {label.number: pixels[label.box[0], label.box[1]] for label in labels}


async def test_no_style_of_a_page_hides_marks(site: Site, open_tab: Open) -> None:
    tab = await open_tab("marks")
    buttons = "".join(f"<button>{number}</button><br><br>" for number in range(12))
    await tab.goto(site.page(f"<style>{HIDING}</style>{buttons}"))
    colours = labels_of(tab)
    assert len(colours) == 12
    assert colours == {number: COLOURS[number % len(COLOURS)] for number in colours}
