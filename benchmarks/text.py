"""The text of observations compared with the pixels of pages: pages of npm packages.

    .venv/bin/python benchmarks/text.py
    .venv/bin/python benchmarks/text.py --set half_b

A second browser paints the words of a page in a colour, by a highlight that does not change the layout, and
takes a screenshot: a word is visible if most of its box has that colour, also under a translucent overlay.
Equal words in the same place count once. The visible words are compared with the text of an observation,
without placeholders, options and captions of fields, which a highlight cannot paint. Exit code 1 if precision
or recall is below its goal.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import io
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
from npm_pages import CACHE, FILES, PAGES, serving
from PIL import Image

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate

GOAL = 0.97
LEAST_SHARE = 0.6
"""Least painted share of the box of a visible word."""

SECONDS = 30.0
LEAST_PINK = 100
"""Least excess of red and blue over green in a painted pixel, also under an overlay."""

SCRIPT = """
(() => {
  const words = [];
  const fields = [];
  const style = '::highlight(all) { color: rgb(255 0 254); background-color: rgb(255 0 254); }';
  const paint = new Highlight();
  const walk = (root) => {
    const sheet = new (root.defaultView || root.ownerDocument.defaultView).CSSStyleSheet();
    sheet.replaceSync(style);
    root.adoptedStyleSheets.push(sheet);
    const walker = document.createTreeWalker(root, NodeFilter.SHOW_ELEMENT | NodeFilter.SHOW_TEXT);
    for (let node = walker.nextNode(); node; node = walker.nextNode()) {
      if (node.shadowRoot) walk(node.shadowRoot);
      if (node.placeholder && !node.value) fields.push(node.placeholder);
      if (/^(button|submit|reset)$/.test(node.type) && node.localName === 'input') fields.push(node.value);
      if (node.type === 'file') fields.push('Choose File No file chosen');
      if (node.localName === 'select') fields.push(...[...node.selectedOptions].map(({ label }) => label));
      const parent = node.parentNode;
      if (node.nodeType !== 3 || parent.isContentEditable) continue;
      if (/^(script|style|noscript|textarea|title)$/.test(parent.localName)) continue;
      for (const match of node.data.matchAll(/\\S+/g)) {
        const range = document.createRange();
        range.setStart(node, match.index);
        range.setEnd(node, match.index + match[0].length);
        paint.add(range);
        const rects = [...range.getClientRects()];
        const boxes = rects.map(({ left, top, right, bottom }) => [left, top, right, bottom]);
        if (boxes.length) words.push([match[0], boxes]);
      }
    }
  };
  walk(document);
  CSS.highlights.set('all', paint);
  return [words, fields.join(' ')];
})()
"""


class Value(msgspec.Struct):
    value: Any = None


class Result(msgspec.Struct):
    result: Value


class Shot(msgspec.Struct):
    data: str


def share_painted(picture: Image.Image, box: tuple[float, ...]) -> float:
    """The painted share of a box, a part of which may lie outside the picture."""
    left, top, right, bottom = (round(at) for at in box)
    inner = (max(left, 0), max(top, 0), min(right, picture.width), min(bottom, picture.height))
    whole = (right - left) * (bottom - top)
    if inner[0] >= inner[2] or inner[1] >= inner[3] or not whole:
        return 0.0
    colours = picture.crop(inner).getcolors(1 << 20) or []
    return sum(count for count, (r, g, b) in colours if min(r, b) - g >= LEAST_PINK) / whole


async def painted_words(slot: Slot, url: str) -> tuple[Counter[str], Counter[str]]:
    """The words that are visible in the pixels of a page, and those that its fields may show."""
    await slot.open(PageOptions())
    await slot.act(Navigate(url))
    session = slot.page.session
    asked = {"expression": SCRIPT, "returnByValue": True}
    done = await session.call("Runtime.evaluate", asked, reply=Result, seconds=SECONDS)
    words, fields = done.result.value
    places = {(word, *(round(at) for box in boxes for at in box)): boxes for word, boxes in words}
    shot = await session.call("Page.captureScreenshot", {"format": "png"}, reply=Shot, seconds=SECONDS)
    picture = Image.open(io.BytesIO(base64.b64decode(shot.data))).convert("RGB")
    seen = Counter(
        str(place[0])
        for place, boxes in places.items()
        if min(share_painted(picture, box) for box in boxes) >= LEAST_SHARE
    )
    return seen, Counter(fields.split())


async def run(pages: list[str], cache: Path, details: bool) -> bool:
    print("page          words  precision  recall")
    sums = [0, 0, 0]

    def row(name: str, listed: int, seen: int, both: int) -> tuple[float, float]:
        precision, recall = both / listed if listed else 1.0, both / seen if seen else 1.0
        print(f"{name:12} {seen:6} {precision:10.3f} {recall:7.3f}", flush=True)
        return precision, recall

    with tempfile.TemporaryDirectory() as scratch, serving(cache) as address:
        async with Egress(EgressConfig(allow=("127.0.0.1",))) as egress:
            slot = Slot(BrowserConfig(freeze=False), find_browser().path, ProfileRoot(Path(scratch)), egress)
            try:
                for name in pages:
                    await slot.open(PageOptions(text=True))
                    text = (await slot.step(Navigate(f"{address}/{name}"))).observation.text or ""
                    listed = Counter(word for word in text.split() if word != "…")
                    seen, fields = await painted_words(slot, f"{address}/{name}")
                    listed -= (listed - seen) & fields
                    both = (listed & seen).total()
                    row(name, listed.total(), seen.total(), both)
                    if details:
                        print(f"  added {dict(listed - seen)}\n  missing {dict(seen - listed)}")
                    sums = [sums[0] + listed.total(), sums[1] + seen.total(), sums[2] + both]
            finally:
                await slot.stop()
    return min(row("all", *sums)) >= GOAL


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--set", choices=PAGES, default="first", help="set of pages; see npm_pages.py")
    parser.add_argument("--pages", nargs="+", choices=FILES, metavar="PAGE", help="only these pages")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of the npm packages")
    parser.add_argument("--details", action="store_true", help="print added and missing words")
    given = parser.parse_args()
    sys.exit(0 if asyncio.run(run(given.pages or PAGES[given.set], given.cache, given.details)) else 1)


if __name__ == "__main__":
    main()
