"""The text of observations compared with the pixels of pages.

    PYTHONPATH=. .venv/bin/python benchmarks/text.py
    PYTHONPATH=. .venv/bin/python benchmarks/text.py --of npm --set half_b --details

After an observation three more pictures of the page are taken: as it is, with all text transparent, and with
a coloured box behind every word, in two colours by turns. A word is visible if its transparency changes the
picture where it stands, with edges that are no blur, and its box is painted. Words of which a part is cut off
or covered count neither way, nor do letters that are too small to be read, and markers of lists. What style
sheets write is measured line by line, where Chromium's snapshot of the page has it, and what stands in fields
by their boxes. The visible words are compared with the text and the fields of the observation. Exit code 1 if
precision or recall is below its goal.

Pages are those of the offline web (``offline``), the shared cases (``cases``, if they lie beside the project)
and the tests of sight (``sight``), and of npm packages (``npm``: they are installed at the first run, and not
measured by default).
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import io
import sys
import tempfile
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from npm_pages import CACHE, PAGES
from npm_pages import serving as serving_npm
from numpy.typing import NDArray
from PIL import Image
from tests.browser.conftest import Site
from tests.browser.conftest import serving as serving_site
from tests.browser.test_shared_cases import CASES, FOLDER, serve
from tests.browser.test_sight import CLEAR, LAYERS, SEEN, UNSEEN, layered

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.errors import WebGymError
from webgym.offline.app import serving as serving_offline
from webgym.offline.config import SitesConfig

GROUPS: Final = ("offline", "cases", "sight", "npm")
GOAL: Final = 0.98
"""Least precision and recall."""

SECONDS: Final = 30.0
LEVELS: Final = 20
"""Least step of a colour channel, of 255, at the edge of a letter that can be read; #eee on white has 17."""

SHARE: Final = 0.85
"""Least painted share of the box of a word that counts as seen; and of a line's width that changes."""

LEAST_HEIGHT: Final = 6
"""Of the box of a word that can be read, pixels."""

LEFT_OUT: Final = ("03-pdf", "38-websocket", "49-sandbox-frame", "90-lease-timer", "91-shadow-form")
"""Cases whose words change all the time, or stand in documents that no script of the page can read."""

LINKS: Final = 4
"""Pages of a website beside its first."""

Box = tuple[float, float, float, float]
Mask = NDArray[np.bool_]
Picture = NDArray[np.int16]


class Found(NamedTuple):
    """The words of a page by what its pixels say.

    Attributes:
        seen: visible words.
        open: words that count neither way.
    """

    seen: Counter[str]
    open: Counter[str]


class _Value(msgspec.Struct):
    value: Any = None


class _Result(msgspec.Struct):
    result: _Value


class _Shot(msgspec.Struct):
    data: str


# --- pictures -----------------------------------------------------------------------------------------------


class Pixels:
    """Pictures of the page in a slot, and what its pixels say of boxes."""

    def __init__(self, slot: Slot) -> None:
        self._session = slot.page.session

    async def take(self) -> tuple[list[Any], list[Any]]:
        """Take the pictures.

        Returns:
            The page's words, and what stands in its fields, with their boxes.
        """
        words, fields = await self._evaluate(Path(__file__).with_suffix(".js").read_text("utf-8"))
        plain = await self._picture()
        await self._evaluate("textTruth.transparent(true)")
        transparent = await self._picture()
        await self._evaluate("textTruth.transparent(false)")
        again = await self._picture()
        await self._evaluate("textTruth.painted()")
        painted = await self._picture()
        ink = np.minimum(_difference(plain, transparent), _difference(again, transparent))
        ink[_difference(plain, again) >= LEVELS // 2] = 0  # what changes by itself
        across, down = (np.abs(np.diff(ink, axis=axis, append=0)) for axis in (0, 1))
        self.edges = np.maximum(across, down) >= LEVELS
        pink = [picture[..., 0] + picture[..., 2] - 2 * picture[..., 1] for picture in (again, painted)]
        self.painted = (pink[1] - pink[0] >= LEVELS, pink[0] - pink[1] >= LEVELS)
        return words, fields

    def is_seen(self, number: int, boxes: list[Box], is_painted: bool) -> bool | None:
        """Whether a word is visible; ``None`` if one cannot tell."""
        shares = [self._share(self.painted[number % 2], box) for box in boxes] if is_painted else [1.0]
        if not all(self._of(self.edges, box).any() for box in boxes) or max(shares) < 1 - SHARE:
            return False
        is_small = min(bottom - top for _, top, _, bottom in boxes) < LEAST_HEIGHT
        return None if is_small or min(shares) < SHARE else True

    def is_line_seen(self, box: Box) -> bool | None:
        """Whether a line is visible; ``None`` for a part of it."""
        columns = np.flatnonzero(self._of(self.edges, box).any(axis=0))
        if not columns.size:
            return False
        return True if (columns[-1] - columns[0] + 3) / (box[2] - box[0]) > SHARE else None

    def _of(self, mask: Mask, box: Box) -> Mask:
        left, top, right, bottom = (max(0, round(at)) for at in box)
        return mask[top:bottom, left:right]

    def _share(self, mask: Mask, box: Box) -> float:
        left, top, right, bottom = (round(at) for at in box)
        return float(self._of(mask, box).sum()) / max(1, (right - left) * (bottom - top))

    async def _picture(self) -> Picture:
        shot = await self._session.call(
            "Page.captureScreenshot", {"format": "png"}, reply=_Shot, seconds=SECONDS
        )
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(shot.data))).convert("RGB"), np.int16)

    async def _evaluate(self, expression: str) -> Any:
        asked = {"expression": expression, "returnByValue": True}
        done = await self._session.call("Runtime.evaluate", asked, reply=_Result, seconds=SECONDS)
        return done.result.value


def _difference(one: Picture, other: Picture) -> Picture:
    result: Picture = np.abs(one - other).max(axis=2)
    return result


# --- words --------------------------------------------------------------------------------------------------


async def visible_words(slot: Slot) -> Found:
    """The words that are visible in the pixels of the slot's page."""
    pixels = Pixels(slot)
    words, fields = await pixels.take()
    found = Found(Counter(), Counter())
    tokens: list[list[Any]] = []  # [text, state, last box]
    places = set()
    for number, (text, boxes, goes_on, is_painted) in enumerate(words):
        place = (text, *(round(at) for box in boxes for at in box))
        if place in places:
            continue  # the same words lie upon each other
        state = pixels.is_seen(number, boxes, is_painted)
        if state:
            places.add(place)
        if goes_on and tokens and state == tokens[-1][1] and _touch(tokens[-1][2], boxes[0]):
            tokens[-1][0] += text
            tokens[-1][2] = boxes[-1]
        else:
            tokens.append([text, state, boxes[-1]])
    starts = {place[:3] for place in places}
    for line, box in await _lines(slot):
        if (line.split()[0], round(box[0]), round(box[1])) in starts:
            continue  # slotted into a closed component
        state = pixels.is_line_seen(box)
        tokens += [[word, state, box] for word in line.split()]
    for text, box, has_room in fields:
        state = pixels.is_line_seen(box) is not False and (has_room or None)
        tokens += [[word, state, box] for word in text.split()]
    for text, state, _ in tokens:
        if state is not False:
            (found.seen if state else found.open)[text] += 1
    return found


def _touch(before: Box, after: Box) -> bool:
    return abs(after[0] - before[2]) <= 1 and after[1] < before[3]


async def _lines(slot: Slot) -> list[tuple[str, Box]]:
    """What style sheets write, and the text of closed components: lines and their boxes."""
    shot = await slot.page.session.call(
        "DOMSnapshot.captureSnapshot", {"computedStyles": []}, reply=dict[str, Any], seconds=SECONDS
    )
    strings, document = shot["strings"], shot["documents"][0]
    nodes, layout, boxes = document["nodes"], document["layout"], document["textBoxes"]
    pseudo = dict(zip(nodes["pseudoType"]["index"], nodes["pseudoType"]["value"], strict=True))
    roots = dict(zip(nodes["shadowRootType"]["index"], nodes["shadowRootType"]["value"], strict=True))

    def is_inner(node: int) -> bool:
        while node >= 0:
            if node in pseudo:
                return strings[pseudo[node]] in ("before", "after")
            if node in roots and strings[roots[node]] != "open":
                return True
            node = nodes["parentIndex"][node]
        return False

    lines = []
    dx, dy = document.get("scrollOffsetX", 0), document.get("scrollOffsetY", 0)
    for index, (x, y, width, height), start, length in zip(
        boxes["layoutIndex"], boxes["bounds"], boxes["start"], boxes["length"], strict=True
    ):
        if is_inner(layout["nodeIndex"][index]):
            text = strings[layout["text"][index]].encode("utf-16-le")[2 * start : 2 * (start + length)]
            line = "".join(one for one in text.decode("utf-16-le") if not "\ue000" <= one <= "\uf8ff")
            box = (x - dx, y - dy, x - dx + width, y - dy + height)
            if lines and lines[-1][0][-1:].strip() and line[:1].strip() and _touch(lines[-1][1], box):
                before, (left, top, _, _) = lines.pop()
                line, box = before + line, (left, top, *box[2:])
            lines.append((line, box))
    return [(line, box) for line, box in lines if line.strip("•\u200b \xa0\n").split() and box[2] > box[0]]


# --- pages --------------------------------------------------------------------------------------------------


@asynccontextmanager
async def pages_of(groups: list[str], sets: list[str], cache: Path) -> AsyncIterator[Any]:
    """Serve the pages of groups until the block ends.

    Yields:
        Rules for the way out, and the pages: group, name, URL and whether links of it are followed.
    """
    pages: list[tuple[str, str, str, bool]] = []
    async with AsyncExitStack() as stack:
        rules = ["127.0.0.1"]
        site: Site = await stack.enter_async_context(serving_site())
        if "offline" in groups:
            offline = await stack.enter_async_context(
                serving_offline(SitesConfig(port=0, latency=0, slow_seconds=0, per_family=1))
            )
            rules += offline.allowed_hosts
            hosts = {
                spec.family: host for host, spec in offline.web.specs.items() if spec.behaviour == "good"
            }
            pages += [("offline", host.split(".")[0], f"http://{host}/", True) for host in hosts.values()]
        if "cases" in groups and FOLDER.is_dir():
            serve(site)
            pages += [
                ("cases", name, site.url(f"/{name}/{case.page}"), False)
                for name, case in CASES.items()
                if name not in LEFT_OUT
            ]
        if "sight" in groups:
            bodies = UNSEEN | SEEN | {"layers": layered(LAYERS), "clear layers": layered(CLEAR)}
            pages += [("sight", name, site.page(body), False) for name, body in bodies.items()]
        if "npm" in groups:
            address = stack.enter_context(serving_npm(cache))
            names = [name for one in sets for name in PAGES[one]]
            pages += [("npm", name, f"{address}/{name}", False) for name in names]
        yield rules, pages


class Sums:
    """Words of a group's pages: listed, seen, and both."""

    def __init__(self) -> None:
        self.listed = self.seen = self.both = self.pages = 0

    def add(self, listed: Counter[str], seen: Counter[str]) -> None:
        """Count the words of a page."""
        self.pages += 1
        self.listed += listed.total()
        self.seen += seen.total()
        self.both += (listed & seen).total()

    def row(self, name: str) -> str:
        """A row of the table."""
        precision, recall = self.rates()
        return f"{name:10} {self.pages:6} {self.seen:7} {precision:10.4f} {recall:7.4f}"

    def rates(self) -> tuple[float, float]:
        """Precision and recall."""
        return self.both / (self.listed or 1), self.both / (self.seen or 1)


async def measure(slot: Slot, url: str) -> tuple[Counter[str], Counter[str], list[str]]:
    """The words listed in an observation of a page, those seen in its pixels, and its links."""
    if not slot.is_open:
        await slot.open(PageOptions(text=True, elements=True))
    shown = (await slot.step(Navigate(url))).observation
    text = " ".join([shown.text or "", *shown.fields]).replace("\xad", "")
    listed = Counter(word for word in text.split() if word != "…")
    found = await visible_words(slot)
    listed -= (listed - found.seen) & found.open
    return listed, found.seen, [one.href for one in shown.elements or () if one.href]


async def run(given: argparse.Namespace) -> bool:
    """Measure the pages and print the table."""
    sums = {name: Sums() for name in (*given.of, "all")}
    async with (
        pages_of(given.of, given.set, given.cache) as (rules, pages),
        Egress(EgressConfig(allow=tuple(rules))) as egress,
    ):
        with tempfile.TemporaryDirectory() as scratch:
            slot = Slot(BrowserConfig(freeze=False), find_browser().path, ProfileRoot(Path(scratch)), egress)
            try:
                for page in pages:
                    if not given.pages or page[1] in given.pages:
                        await measure_page(slot, page, sums, given.details)
            finally:
                await slot.stop()
                print("group       pages   words  precision  recall")
                for name, one in sums.items():
                    print(one.row(name))
    return min(sums["all"].rates()) >= GOAL


async def measure_page(
    slot: Slot, page: tuple[str, str, str, bool], sums: dict[str, Sums], has_details: bool
) -> None:
    """Count the words of a page, and of some that it links to, if that is wanted."""
    group, name, url, has_links = page
    urls = [url]
    for one in urls:
        try:
            listed, seen, links = await measure(slot, one)
        except (WebGymError, TimeoutError) as error:
            print(f"{name}: {error}", flush=True)
            await slot.close()
            continue
        if has_links and len(urls) == 1:
            fresh = dict.fromkeys(link for link in links if link.startswith(url) and link != url)
            urls += [*fresh][:LINKS]
        for each in (group, "all"):
            sums[each].add(listed, seen)
        if has_details and listed != seen:
            added, missing = dict(listed - seen), dict(seen - listed)
            print(f"{group} {name}: added {added} missing {missing}", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--of", nargs="+", choices=GROUPS, default=list(GROUPS[:-1]), help="groups of pages")
    parser.add_argument("--set", nargs="+", choices=PAGES, default=list(PAGES), help="sets of npm pages")
    parser.add_argument("--pages", nargs="+", metavar="PAGE", help="only pages of these names")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of the npm packages")
    parser.add_argument("--details", action="store_true", help="print added and missing words")
    given = parser.parse_args()
    sys.exit(0 if asyncio.run(run(given)) else 1)


if __name__ == "__main__":
    main()
