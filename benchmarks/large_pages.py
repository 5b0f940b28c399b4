"""What an observation of a page of about 6 MB costs: a picture alone, with marks, and with marks and text.

    .venv/bin/python benchmarks/large_pages.py
    .venv/bin/python benchmarks/large_pages.py --against OTHER_CHECKOUT

Prints medians of rounds, milliseconds: CPU time of Chromium, and wall time. With --against, the scripts of
another checkout observe the same pages in turn, in a second browser: "ratio" is their CPU time over ours, of
all rounds, and "same" says whether both read the same elements and text.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import NamedTuple

import msgspec

from webgym.bench.stepping import CpuTimes
from webgym.browser import isolated_worlds
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.observe import Look
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate

WORDS = "The ferry leaves at eight, and whoever is late takes the bridge. "


def table(columns: str) -> str:
    rows = (f"<tr><td>{n}</td>{columns.replace('NUMBER', str(n))}</tr>" for n in range(27_000))
    return f"<table border=1>{''.join(rows)}</table>"


def article(depth: int) -> str:
    """Sections within sections, each with paragraphs."""
    section = "".join(f"<p>{WORDS * 6}<a href='#{n}'>Part {n}</a> <em>and more</em></p>" for n in range(120))
    return "<section><div><h2>A title</h2>" * depth + f"{section}</div></section>" * depth


PAGES = {
    "links": table(
        f"<td>{WORDS}<td><a href='/item/NUMBER'>Item NUMBER</a><td><b>in stock</b><td>Town NUMBER"
    ),
    "boxes": table(
        "<td><label><input type=checkbox> Take NUMBER</label><td><label for=f-NUMBER>Name</label>"
        "<td><input type=radio name=NUMBER id=f-NUMBER><td><i>left</i>"
    ),
    "article": article(100),
    "buttons": "".join(
        f"<button type=button class='action action-{n}' data-number={n} onclick='this.textContent += 1'>"
        f"<span class=icon aria-hidden=true>*</span> <span class=label>Do {n}, at once and with all that it "
        f"brings about for number {n}, be it what it may</span></button> "
        for n in range(20_000)
    ),
    "lines": f"<pre>{(WORDS + chr(10)) * 90_000}</pre>",
}
"""The body of the document by name."""

CONFIG = BrowserConfig(freeze=False, execute_seconds=300, screenshot_seconds=300, screenshot_try_seconds=100)
"""Deadlines that even slow scripts keep."""

KINDS = {
    "picture": PageOptions(),
    "marks": PageOptions(mode="marks"),
    "marks, text": PageOptions(mode="marks", text=True),
}


@contextmanager
def serving() -> Iterator[str]:
    """Serve the pages by name. Yields the base URL."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            name = self.path.strip("/")
            body = f"<!doctype html><meta charset=utf-8><title>{name}</title>{PAGES.get(name, '')}".encode()
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def scripts_of(checkout: Path) -> str:
    command = "from webgym.browser.isolated_worlds import _SCRIPT; print(_SCRIPT)"
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src")}
    done = subprocess.run(
        [sys.executable, "-c", command], env=environment, text=True, capture_output=True, check=True
    )
    return done.stdout


class Timed(NamedTuple):
    """An observation, with the CPU time of Chromium and the wall time that it took, milliseconds."""

    cpu: float
    wall: float
    look: Look


async def timed(slot: Slot) -> Timed:
    process = slot._process
    assert process is not None
    cpu, start = CpuTimes(process.pid), time.perf_counter()
    look = await slot.observe()
    wall = time.perf_counter() - start
    return Timed(sum(cpu.since_last().values()) * 1000, wall * 1000, look)


def content(look: Look) -> object:
    """What was read, without the numbers, which depend on earlier observations."""
    elements = [msgspec.structs.replace(one, number=0) for one in look.observation.elements or ()]
    return elements, look.observation.text, look.observation.fields


async def measure(names: list[str], rounds: int, other: Path | None) -> None:
    """Measure, and print a row for each page and kind of observation."""
    scripts = [isolated_worlds._SCRIPT, *([scripts_of(other)] if other else [])]
    print(f"{'page':10} {'observation':12} {'CPU':>6} {'wall':>6} {'elements':>8}  ratio  same")
    async with AsyncExitStack() as stack:
        address = stack.enter_context(serving())
        egress = await stack.enter_async_context(Egress(EgressConfig(allow=("127.0.0.1",))))
        slots = [Slot(CONFIG, find_browser().path, ProfileRoot(), egress) for _ in scripts]
        for slot in slots:
            stack.push_async_callback(slot.stop)
        for name in names:
            for slot, script in zip(slots, scripts, strict=True):
                isolated_worlds._SCRIPT = script
                await slot.open(PageOptions())
                await slot.act(Navigate(f"{address}/{name}"))
            for kind, options in KINDS.items():
                for slot in slots:
                    slot.page.options = options
                    await slot.observe()
                pairs = [[await timed(slot) for slot in slots] for _ in range(rounds)]
                ours, *others = zip(*pairs, strict=True)
                cpu = statistics.median(one.cpu for one in ours)
                wall = statistics.median(one.wall for one in ours)
                found = len(ours[0].look.observation.elements or ())
                row = f"{name:10} {kind:12} {cpu:6.0f} {wall:6.0f} {found:8}"
                for theirs in others:
                    ratio = sum(one.cpu for one in theirs) / sum(one.cpu for one in ours)
                    is_same = all(content(a.look) == content(b.look) for a, b in pairs)
                    row += f"  {ratio:5.2f}  {is_same}"
                print(row, flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--pages", nargs="+", choices=PAGES, default=list(PAGES), metavar="PAGE")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--against", type=Path, metavar="CHECKOUT")
    given = parser.parse_args()
    asyncio.run(measure(given.pages, given.rounds, given.against))


if __name__ == "__main__":
    main()
