"""Marks compared with the elements that react to clicks in a second browser: pages of npm packages.

    .venv/bin/python benchmarks/marks.py
    .venv/bin/python benchmarks/marks.py --set half_b
    .venv/bin/python benchmarks/marks.py --pages shoelace leaflet --details

In a second browser, without our scripts, a point of every element is hovered over and clicked. The page is
reloaded whenever it reacts: an element, attribute, value or image changes, an element moves to another
place in the document, a control gets the focus, or the address changes. The set of changes is the signature
of the point.

A mark is correct if the page reacts to a click on its middle: at once, after a click on another element of
its kind (the open tab), to the right button, to a double click, or after the mouse has left (a star); and if
no other mark at this place has the same signature. A point that reacts is covered if a mark has its
signature, or a mark that it lies in has most of it, or a mark has the same changes apart from looks. Ignored
are containers and their changes, rims of marks where only looks change, disabled controls, reactions to the
mouse without a click, to a click where there is nothing, and labels of visible controls.

Names are compared with the browser's accessibility tree. Exit code 1 if a result is below its goal.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from npm_pages import CACHE, FILES, PAGES, serving

from webgym.browser.cdp import CommandFailed, Session
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.page import Page as Tab
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.observation import Element
from webgym.core.text import fold

GOAL = 0.97
GRID = 14
"""Distance of grid points in CSS pixels; one point is chosen for every element."""

MOST_POINTS = 140
"""Maximum number of points to click on a page; of more points, every n-th is clicked."""

LARGE = 0.25
"""Share of the viewport from which a mark counts as a container, unless it is a text field."""

LOOKS = frozenset({"class", "part", "style", "focus"})
"""Kinds of changes that may affect looks only."""

KIN = 3
"""Number of similar elements that are clicked before a mark without reaction is clicked again."""

FIELD_ENDS = " |"
"""Ends the name of a field that has the focus; what else has changed follows it."""

SLACK = 8
"""Margin in CSS pixels around a mark that belongs to it."""

NOWHERE = (1278.0, 766.0)
"""A point in the corner of the viewport, where most pages have nothing."""

DRAGGED = (10, 20, 30)
"""Distances from the middle of a slider's handle, CSS pixels."""

CALL_SECONDS = 30.0
REACTION_SECONDS = 0.09
LATE_SECONDS = 0.6
LOAD_SECONDS = 0.1
MOST_POLLS = 8
POLL_SECONDS = 0.02
QUIET_SECONDS = 0.7

TRIAL = Path(__file__).with_name("marks_trial.js").read_text("utf-8")


class Value(msgspec.Struct):
    value: Any = None
    objectId: str = ""  # noqa: N815 - as the protocol writes it


class Result(msgspec.Struct):
    result: Value


class Anything(msgspec.Struct):
    node: dict[str, Any] = {}
    nodes: list[dict[str, Any]] = []


class Trier:
    """The second browser: clicks points of a page and stores the reactions."""

    def __init__(self, slot: Slot, url: str) -> None:
        self.slot = slot
        self.url = url
        self.known: dict[tuple[float, ...], str] = {}
        self.noise: list[str] | None = None
        self._loads = 0
        self._is_fresh = False

    @property
    def tab(self) -> Tab:
        return self.slot.page

    @property
    def session(self) -> Session:
        return self.tab.session

    async def evaluate(self, expression: str) -> Any:
        params = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        done = await self.session.call("Runtime.evaluate", params, reply=Result, seconds=CALL_SECONDS)
        return done.result.value

    async def load(self) -> None:
        """Load the page, and ignore changes that it makes by itself."""
        self.tab.begin_action()  # otherwise the tab is stopped because of too many navigations
        self._loads += 1
        url = f"{self.url}?{self._loads}"
        chosen = {"origin": self.url.rpartition("/")[0], "storageTypes": "local_storage"}
        await self.session.do("Storage.clearDataForOrigin", chosen, seconds=CALL_SECONDS)
        await self.session.do("Page.navigate", {"url": url}, seconds=CALL_SECONDS)
        is_there = f"location.href === {json.dumps(url)} && document.readyState === 'complete'"
        async with asyncio.timeout(CALL_SECONDS):
            while not await self.evaluate(is_there):  # noqa: ASYNC110 - the browser is another process
                await asyncio.sleep(POLL_SECONDS)
        await asyncio.sleep(LOAD_SECONDS)
        noise = json.dumps(self.noise or [])
        await self.evaluate(TRIAL.replace("NOISE", noise).replace("LARGE", str(LARGE)))
        if self.noise is None:
            await asyncio.sleep(QUIET_SECONDS)
            await self.evaluate("__trial.take()")
            await asyncio.sleep(QUIET_SECONDS)
            self.noise = [change.split("=")[0] for change in await self.evaluate("__trial.changes()")]
            await self.load()
        for _ in range(MOST_POLLS):  # on a busy machine components are drawn late
            await self.evaluate("__trial.take()")
            await asyncio.sleep(LOAD_SECONDS)
            if not await self.evaluate("__trial.changes()"):
                break
        self._is_fresh = True

    async def mouse(self, kind: str, x: float, y: float, **more: object) -> None:
        params = {"type": kind, "x": x, "y": y, **more}
        await self.session.do("Input.dispatchMouseEvent", params, seconds=CALL_SECONDS)

    async def try_at(self, x: float, y: float) -> str:
        """The signature of a point: the changes after a click; empty if there are none."""
        point = (round(x, 1), round(y, 1))
        if point not in self.known:
            if not self._is_fresh:
                await self.load()
            self.known[point] = await self._click(x, y)
            self._is_fresh = not self.known[point]
            if self._is_fresh:
                await self.mouse("mouseMoved", 1279, 767)
        return self.known[point]

    async def elsewhere(self) -> set[str]:
        """What changes on a click where there is nothing: any click does that, such as close what is open."""
        if not self._is_fresh:
            await self.load()
        x, y = NOWHERE
        hit = f"__trial.at({x}, {y})"
        is_free = await self.evaluate(f"[document.body, document.documentElement].includes({hit})")
        signature = await self.try_at(x, y) if is_free else ""
        return changes_of(signature)

    async def _click(self, x: float, y: float) -> str:
        try:
            await self.mouse("mouseMoved", x, y)
            await self._reaction()
            await self.evaluate("__trial.take()")
            before = await self.evaluate("__trial.focused()")
            await self._press(x, y)
            changes, focused = await self._came()
            if not changes and focused == before:
                await asyncio.sleep(LATE_SECONDS)  # the page may wait for a second click
                changes, focused = await self._came()
            field = await self.evaluate("__trial.field()")
            is_in_field = await self.evaluate(f"__trial.isInFocus({x}, {y})")
        except CommandFailed:
            changes = None
        address = await self.evaluate("location.href.split('?')[0]")
        if changes is None or address != self.url:
            return f"left {address}"
        if field and (changes or focused != before or is_in_field):
            return "; ".join([str(field) + FIELD_ENDS, *changes])
        return "; ".join([*changes, *([focused] if focused != before else [])])

    async def _arrive(self, x: float, y: float) -> None:
        """Load the page and move the mouse there; changes from then on count."""
        await self.load()
        self._is_fresh = False
        await self.mouse("mouseMoved", x, y)
        await self._reaction()
        await self.evaluate("__trial.take()")

    async def _press(self, x: float, y: float, button: str = "left") -> None:
        """Click like a person: the page draws while the button is down."""
        for kind in ("mousePressed", "mouseReleased"):
            await self.mouse(kind, x, y, button=button, clickCount=1)
            await self._reaction()

    async def is_right_clicked(self, x: float, y: float) -> bool:
        """Whether the page reacts to a click with the right button."""
        await self._arrive(x, y)
        await self._press(x, y, "right")
        return bool((await self._came())[0])

    async def is_double_clicked(self, x: float, y: float) -> bool:
        """Whether the page reacts to a double click; asked of what does not react to a click."""
        await self._arrive(x, y)
        for count in (1, 2):
            for kind in ("mousePressed", "mouseReleased"):
                await self.mouse(kind, x, y, button="left", clickCount=count)
        await self._reaction()
        return bool((await self._came())[0])

    async def is_current(self, x: float, y: float, marks: Sequence[Element]) -> bool:
        """Whether the page reacts to a second click after one on a similar element (such as another tab)."""
        if not self._is_fresh:
            await self.load()
        await self.evaluate("__trial.take()")
        kin = await self.evaluate(f"__trial.kin({x}, {y}, {json.dumps([middle(mark) for mark in marks])})")
        for other, _, depth in kin[:KIN]:
            await self.load()
            path = ""
            for point in (middle(marks[other]), (x, y)):
                await self.mouse("mouseMoved", *point)
                await self._reaction()
                await self.evaluate("__trial.take()")
                path = await self.evaluate(f"__trial.pathAbove({x}, {y}, {depth})")  # clicks may move it
                await self._press(*point)
            self._is_fresh = False
            changes = (await self._came())[0] or []  # none if the first click led elsewhere
            if path and any(f"{change} /".startswith((f"{path} ", f"{path}/")) for change in changes):
                return True
        return False

    async def is_lasting(self, x: float, y: float) -> bool:
        """Whether a change shows only after the mouse has left, such as that of the star of a rating."""
        await self.load()
        self._is_fresh = False
        for press in (False, True):
            await self.mouse("mouseMoved", x, y)
            await self._reaction()
            if press:
                await self._press(x, y)
            await self.mouse("mouseMoved", 1279, 767)
            await self._reaction()
            await asyncio.sleep(LATE_SECONDS)
            if not press:
                await self.evaluate("__trial.take()")
        return bool((await self._came())[0])

    async def is_dragged(self, x: float, y: float) -> bool:
        """Whether the page reacts to a drag, such as that of a slider's handle, whose middle is its value."""
        await self._arrive(x, y)
        await self.mouse("mousePressed", x, y, button="left", clickCount=1)
        for distance in DRAGGED:
            await self.mouse("mouseMoved", x + distance, y + distance, button="left", buttons=1)
            await self._reaction()
        await self.mouse("mouseReleased", x + distance, y + distance, button="left", clickCount=1)
        await self._reaction()
        return bool((await self._came())[0])

    async def _came(self) -> tuple[list[str], str]:
        """The changes so far, and the element with the focus."""
        return await self.evaluate("__trial.changes()"), await self.evaluate("__trial.focused()")

    async def is_hover(self, x: float, y: float, signature: str) -> bool:
        """Whether the page reacts in the same way to the mouse without a click, such as with a tooltip."""
        key = (round(x, 1), round(y, 1), 0.0)
        if key not in self.known:
            await self._arrive(x, y)
            await asyncio.sleep(LATE_SECONDS)
            self.known[key] = "; ".join((await self._came())[0])
        return nodes_of(signature) <= nodes_of(self.known[key])

    async def _reaction(self) -> None:
        """Wait for the page to react and to draw, which takes longer on a busy machine."""
        await asyncio.sleep(REACTION_SECONDS)
        await self.evaluate("__trial.drawn()")

    async def points(self) -> list[tuple[float, float]]:
        """One point for every element that the grid hits."""
        await self.load()
        await asyncio.sleep(QUIET_SECONDS)  # on a busy machine components are drawn late
        found = [(x, y) for x, y in await self.evaluate(f"__trial.points({GRID})")]
        return found[:: -(-len(found) // MOST_POINTS)]

    async def is_rim(self, x: float, y: float, signature: str, marks: Sequence[Element]) -> bool:
        """Whether the point is on a rim around a mark, where only looks change."""
        if deeds_of(signature):
            return False
        if not self._is_fresh:
            await self.load()
        points = json.dumps([middle(mark) for mark in marks])
        return bool(await self.evaluate(f"__trial.isRim({x}, {y}, {points})"))

    async def name_at(self, x: float, y: float, role: str) -> str | None:
        """The accessible name of the element at a point; ``None`` if it has none."""
        if not self._is_fresh:
            await self.load()
        params = {"expression": f"__trial.at({x}, {y})"}
        hit = await self.session.call("Runtime.evaluate", params, reply=Result, seconds=CALL_SECONDS)
        if not hit.result.objectId:
            return None
        asked = {"objectId": hit.result.objectId, "fetchRelatives": True}
        tree = await self.session.call(
            "Accessibility.getPartialAXTree", asked, reply=Anything, seconds=CALL_SECONDS
        )
        by_id = {node["nodeId"]: node for node in tree.nodes}
        node = tree.nodes[0] if tree.nodes else None
        while node:
            if not node.get("ignored") and node.get("role", {}).get("value") in NAMED[role]:
                return fold(node.get("name", {}).get("value", ""))
            node = by_id.get(node.get("parentId", ""))
        return None


BOXES = frozenset({"checkbox", "switch", "radio", "menuitemcheckbox", "menuitemradio", "ToggleButton"})
FIELDS = frozenset(
    (
        "textbox searchbox combobox spinbutton ComboBoxMenuButton popUpButton ComboBoxSelect "
        "TextFieldWithComboBox Date InputTime"
    ).split()
)
NAMED: dict[str, frozenset[str]] = {
    "button": frozenset({"button", "popUpButton", "ToggleButton", "DisclosureTriangle", "tab"}),
    "link": frozenset({"link"}),
    **dict.fromkeys(("checkbox", "radio", "switch"), BOXES),
    **dict.fromkeys(("textbox", "searchbox", "combobox", "spinbutton"), FIELDS),
    **{role: frozenset({role}) for role in ("tab", "slider", "menuitem", "treeitem", "gridcell")},
    "option": frozenset({"option", "MenuListOption", "ListBoxOption"}),
}
"""By role of our marks: the equivalent roles of the accessibility tree."""


def inside(x: float, y: float, element: Element, slack: float = 0) -> bool:
    left, top, width, height = element.box
    return left - slack <= x <= left + width + slack and top - slack <= y <= top + height + slack


def middle(element: Element) -> tuple[float, float]:
    x, y, width, height = element.box
    return x + width / 2, y + height / 2


def place_of(signature: str) -> str:
    """The signature without what depends on where in a field one clicks."""
    return signature.split(FIELD_ENDS)[0]


def nodes_of(signature: str) -> set[str]:
    return changes_of(place_of(signature))


def changes_of(signature: str) -> set[str]:
    return {change.split("=")[0] for change in signature.split("; ")}


def is_twin(one: str, other: str, elsewhere: set[str]) -> bool:
    """Whether two marks do the same; buttons in a field, such as one that clears it, do something else."""
    if place_of(one) != place_of(other) or not one:
        return False
    changes = [changes_of(signature.partition("; ")[2]) - elsewhere for signature in (one, other)]
    return one == other or 2 * len(changes[0] & changes[1]) >= len(changes[0] | changes[1])


def deeds_of(signature: str) -> set[str]:
    """The changes of a signature that affect more than looks."""
    return {node for node in nodes_of(signature) if node and node.split()[-1] not in LOOKS}


def is_done_by(signature: str, mark: str) -> bool:
    """Whether a click on a mark has the same changes apart from looks, such as around a checkbox.

    What a click in a field has beside the focus of the field counts: the icon beside it opens the same list.
    """
    if FIELD_ENDS in mark and FIELD_ENDS not in signature:
        mark = mark.partition(f"{FIELD_ENDS}; ")[2]
    return bool(deeds_of(mark)) and deeds_of(mark) == deeds_of(signature)


def is_alike(one: str, other: str) -> bool:
    """Whether two signatures contain mostly the same nodes, such as two positions on a slider."""
    nodes = [nodes_of(signature) for signature in (one, other)]
    return 2 * len(nodes[0] & nodes[1]) >= len(nodes[0] | nodes[1])


async def measure(ours: Slot, trier: Trier, say: Any) -> Counter[str]:
    """Counts of correct marks, covered points and correct names on a page."""
    await ours.open(PageOptions(elements=True, mode="marks"))
    await ours.act(Navigate(trier.url))
    await asyncio.sleep(QUIET_SECONDS)
    marks = (await ours.observe()).observation.elements or ()
    counts: Counter[str] = Counter()
    signatures: list[str] = []
    points = [(*point,) for point in await trier.points()]
    tried = {point: await trier.try_at(*point) for point in [*map(middle, marks), *points]}
    reacting = [mark for mark in marks if tried[middle(mark)]]
    elsewhere = await trier.elsewhere()
    for mark in marks:
        signature = tried[middle(mark)]
        is_large = mark.box[2] * mark.box[3] > LARGE * 1280 * 768
        twin = next(
            (
                other
                for other, same in zip(marks, signatures, strict=False)
                if is_twin(signature, same, elsewhere)
                and (inside(*middle(mark), other) or inside(*middle(other), mark))
            ),
            None,
        )
        signatures.append(signature)
        reacts = (
            bool(signature)
            or await trier.is_current(*middle(mark), reacting)
            or await trier.is_right_clicked(*middle(mark))
            or await trier.is_double_clicked(*middle(mark))
            or await trier.is_lasting(*middle(mark))
            or (mark.role == "slider" and await trier.is_dragged(*middle(mark)))
        )
        is_right = reacts and twin is None and not (is_large and mark.role != "textbox")
        counts["marks"] += 1
        counts["right"] += is_right
        if not is_right:
            why = f"the same as {twin.number}" if twin else "large" if reacts else "nothing"
            say(f"  wrong   {mark.number:3} {mark.role} {mark.name[:30]!r} {mark.box}: {why}")
    for x, y in points:
        signature = tried[x, y]
        if changes_of(signature) == elsewhere:
            continue
        is_found = place_of(signature) in map(place_of, signatures) or any(
            (inside(x, y, mark, SLACK) and (mark.role == "slider" or is_alike(signature, other)))
            or is_done_by(signature, other)
            for mark, other in zip(marks, signatures, strict=True)
        )
        if not signature or (not is_found and await trier.is_rim(x, y, signature, marks)):
            continue
        if not is_found and await trier.is_hover(x, y, signature):
            continue
        counts["targets"] += 1
        counts["found"] += is_found
        if not is_found:
            what = await trier.evaluate(f"__trial.at({x}, {y})?.outerHTML.slice(0, 90)")
            say(f"  missing {x:.0f},{y:.0f} {what} {signature[:70]}")
    for mark in marks:
        name = await trier.name_at(*middle(mark), mark.role) if mark.role in NAMED else None
        if name:
            counts["named"] += 1
            counts["same name"] += fold(mark.name) == name
            if fold(mark.name) != name:
                say(f"  name    {mark.role} {mark.name[:40]!r} is {name[:40]!r}")
    return counts


def row(name: str, counts: Counter[str]) -> tuple[str, float, float]:
    shares = [
        counts[a] / counts[b] if counts[b] else 1.0
        for a, b in (("right", "marks"), ("found", "targets"), ("same name", "named"))
    ]
    text = (
        f"{name:12} {counts['marks']:6} {counts['targets']:8} {shares[0]:10.3f} {shares[1]:7.3f} "
        f"{counts['named']:6} {shares[2]:11.3f}"
    )
    return text, shares[0], shares[1]


async def run(pages: list[str], cache: Path, details: bool) -> bool:
    print("page          marks  targets  precision  recall  named  names right")
    total: Counter[str] = Counter()
    trials = cache / "trials.json"
    kept: dict[str, dict[str, str]] = json.loads(trials.read_text()) if trials.exists() else {}
    with tempfile.TemporaryDirectory() as scratch, serving(cache) as address:
        async with Egress(EgressConfig(allow=("127.0.0.1",))) as egress:
            profiles = ProfileRoot(Path(scratch))
            executable = find_browser().path
            slots = [Slot(BrowserConfig(freeze=False), executable, profiles, egress) for _ in range(2)]
            try:
                for name in pages:
                    said: list[str] = []
                    await slots[1].open(PageOptions())
                    trier = Trier(slots[1], f"{address}/{name}")
                    trier.known = {tuple(json.loads(at)): one for at, one in kept.get(name, {}).items()}
                    began = time.monotonic()
                    counts = await measure(slots[0], trier, said.append)
                    kept[name] = {json.dumps(at): one for at, one in trier.known.items()}
                    trials.write_text(json.dumps(kept))
                    total += counts
                    print(
                        f"{row(name, counts)[0]} {time.monotonic() - began:5.0f}s",
                        *(said if details else ()),
                        sep="\n",
                        flush=True,
                    )
            finally:
                for slot in slots:
                    await slot.stop()
    text, precision, recall = row("all", total)
    print(text)
    return precision >= GOAL and recall >= GOAL


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--set", choices=PAGES, default="first", help="set of pages; see npm_pages.py")
    parser.add_argument("--pages", nargs="+", choices=FILES, metavar="PAGE", help="only these pages")
    parser.add_argument(
        "--cache",
        type=Path,
        default=CACHE,
        help="folder of the npm packages and of trials.json, which must be deleted when a page changes",
    )
    parser.add_argument(
        "--details", action="store_true", help="print wrong and missing marks, and names that differ"
    )
    given = parser.parse_args()
    sys.exit(0 if asyncio.run(run(given.pages or PAGES[given.set], given.cache, given.details)) else 1)


if __name__ == "__main__":
    main()
