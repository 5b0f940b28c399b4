"""Names that a page gives its elements hide properties of its forms and documents: we see it as it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from importlib import resources

import msgspec
import pytest

from webgym.browser.document import ReadRequest
from webgym.browser.gestures import ScrollElement
from webgym.browser.observe import Look
from webgym.core.action import LeftClick, Scroll, Type

from .conftest import Open, Site, Tab

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

FOLDER = resources.files("webgym.browser") / "scripts"
SCRIPTS = [file.read_text("utf-8") for file in FOLDER.iterdir() if file.name.endswith(".js")]
DESTRUCTURED = re.compile(r"\{([\w\s,:'-]*)\}(?= = |\) =>)")
LISTED = re.compile(r"'([a-zA-Z ]+)'")
NAMES = sorted(
    {name for script in SCRIPTS for name in re.findall(r"\.([a-zA-Z]\w*)", script)}
    | {
        name
        for script in SCRIPTS
        for part in DESTRUCTURED.findall(script) + LISTED.findall(script)
        for name in re.findall(r"[a-zA-Z]\w*", part)
    }
)
"""What the scripts read from anything at all: as `.name`, in patterns, and from lists of names."""

SHOWN = """
<label>Agree <input type=checkbox></label> <label>Name <input></label>
<label>Size <select><option>Small<option>Middle<option>Large</select></label>
<button type=button onclick="this.textContent = 'Done'">Press</button>
<a href=/next>Next</a> <span style="cursor:pointer">Only a script</span>
<p style="width:90px;overflow:hidden;white-space:nowrap;text-overflow:ellipsis">A text that is cut off</p>
<p style="position:relative"><b style="position:absolute;left:0;top:0;background:#fff">Above</b>Below it</p>
<svg width=40 height=20><text y=15>Drawn</text></svg>
"""
REST = "<p>after the form</p><div style='height:700px'></div><p>far below</p>"
FORM = "style='height:230px;overflow:auto' tabindex=0 aria-label='All of it' onsubmit='return false'"


def form(names: Iterable[str], attribute: str = "name") -> str:
    fields = "".join(f"<input type=hidden {attribute}={name}>" for name in names)
    inner = f"{SHOWN}<div style='height:400px'></div>{fields}"
    shadow = f"<div><template shadowrootmode=open><form><p>In the shadow</p>{fields}</form></template></div>"
    return f"<title>A form</title><form {FORM}>{inner}</form>{shadow}{REST}"


def document(pattern: str) -> Callable[[Iterable[str]], str]:
    def build(names: Iterable[str]) -> str:
        return f"<title>A document</title>{SHOWN}{REST}{''.join(pattern.format(name) for name in names)}"

    return build


def harmless(names: Iterable[str]) -> list[str]:
    return ["z" * len(name) for name in names]


def shown(look: Look) -> object:
    """All of an observation but where it was made, how long it took, and where the mouse pointer was."""
    return msgspec.structs.replace(
        look.observation, url="", milliseconds={}, bytes={}, settled="", screenshot=""
    )


async def seen(site: Site, tab: Tab, page: str) -> list[object]:
    """What is to be seen of a page, and what is in it."""
    found = [shown(await tab.goto(site.page(page)))]
    read = await tab.slot.read(ReadRequest(lines=50, elements=True, meta=True))
    return [*found, msgspec.structs.replace(read, url="")]


async def used(site: Site, tab: Tab, page: str) -> list[object]:
    """The same, and what comes of using it."""
    found = await seen(site, tab, page)

    async def step(action: object) -> None:
        found.append(shown(await tab.step(action)))

    await step(LeftClick(tab.at("Press")))
    await step(Type(tab.at("Name"), "Ann"))
    await step(Type(tab.at("Size"), "Middle"))
    assert (tab.find("Name").value, tab.find("Size").value) == ("Ann", "Middle")
    await step(LeftClick(tab.at("Size")))
    await step(LeftClick(tab.at("Large", "option")))
    assert tab.find("Size").value == "Large"
    await step(ScrollElement(tab.find("Done").number, "down"))
    await step(Scroll("down"))
    assert tab.text == ["far below"]
    return found


@pytest.mark.parametrize("attribute", ["name", "id"])
async def test_a_form_is_used_as_if_its_fields_had_other_names(
    site: Site, open_tab: Open, attribute: str
) -> None:
    tab, use = await open_tab("marks"), used if attribute == "name" else seen
    plain = await use(site, tab, form(harmless(NAMES), attribute))
    assert await use(site, tab, form(NAMES, attribute)) == plain


DOCUMENTS = {
    "img": "<img name={0} alt=''>",
    "form": "<form name={0}></form>",
    "object": "<object name={0} id={0}></object>",
    "embed": "<embed name={0} hidden>",
}


@pytest.mark.parametrize("element", DOCUMENTS)
async def test_a_document_is_used_as_if_its_elements_had_other_names(
    site: Site, open_tab: Open, element: str
) -> None:
    tab = await open_tab("marks")
    build, use = document(DOCUMENTS[element]), used if element == "form" else seen
    assert await use(site, tab, build(NAMES)) == await use(site, tab, build(harmless(NAMES)))


async def test_a_document_is_seen_as_if_its_frames_had_other_names(site: Site, tab: Tab) -> None:
    dom = (FOLDER / "dom.js").read_text("utf-8")
    taken = "".join(re.findall(r"\(\s*\[?[^()]*Document[^()]*\);", dom))
    names = ["document", *re.findall(r"[a-z]\w+", " ".join(re.findall(r"'(.*?)'", taken)))]
    assert "scrollingElement" in names
    build = document("<iframe name={0} hidden></iframe>")
    plain = await seen(site, tab, build(harmless(names)))
    assert await seen(site, tab, build(names)) == plain
    inner = site.elsewhere(site.page("<p>inside</p><iframe name=document hidden></iframe>"))
    await tab.goto(site.page(f"<iframe src='{inner}'></iframe>"))
    assert tab.text == ["inside"]


@pytest.mark.parametrize(
    "name", ["<p id={0}></p>", "<form name={0}></form>", "<iframe name={0} hidden></iframe>"]
)
async def test_an_element_may_have_any_id(site: Site, tab: Tab, name: str) -> None:
    build = document(name)
    assert await seen(site, tab, build(["webgym"])) == await seen(site, tab, build(["zzzzzz"]))
