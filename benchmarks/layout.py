"""Find evidence that pages of the offline web cut off at the usual viewport, without an agent.

    .venv/bin/python benchmarks/layout.py --per-kind 1
    .venv/bin/python benchmarks/layout.py --family timetable --per-kind 1000

Opens pages with evidence of a task that can be reached by their address alone: at most --per-kind of every
kind and website, and at least one for every form of evidence ("00:00"). Evidence in the source of a page that
cannot be made visible by scrolling is printed; exit code 1 if there is any. Other lines that are cut off are
counted. Pages that need an account, a cart or a submitted form are left to ``webgym sites check``, which
carries out solutions.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qsl, unquote, urlsplit

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.text import fold, says
from webgym.offline.app import serving
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Visit, Website

EPISODE = 40
"""Number of pages per episode of a browser."""


class Evidence(NamedTuple):
    """Texts that must be visible at the same time on pages whose path matches."""

    path: str
    texts: tuple[str, ...]


def address_of(pattern: str) -> str | None:
    """An address that matches a pattern of evidence, if its first alternative determines one."""
    first = pattern
    while first.startswith("(?:") and not first.startswith("(?:("):
        first = first.removeprefix("(?:")
    cut = re.search(r"\((?:\?|.)|\\\?|\$|\|", first)
    path = re.sub(r"\\(.)", r"\1", first[: cut.start()] if cut else first).rstrip(")")
    if "|" in first:
        first = re.split(r"\|(?=/)", first)[0]
    plain = re.sub(r"\\(.)", r"\1", first)
    query = re.findall(r"(?:\[\?&\]|&\)\?|\?)(\[?\w+\]?)=(?:\(\?(?:i)?:)?([^&()|?$]*)", plain)
    pairs = [(name.strip("[]"), value) for name, value in query]
    names = Counter[str]()
    parameters = []
    for name, value in pairs:
        name = name[min(names[name], len(name) - 1)] if name == "ab" else name
        names["ab" if name in "ab" else name] += 1
        parameters.append(f"{name}={value}")
    address = path + ("?" + "&".join(parameters) if parameters else "")
    return address if path.startswith("/") and re.match(pattern, address) else None


def pages_of(site: Website, evidence: set[Evidence]) -> dict[str, set[Evidence]]:
    """Pages that a new visitor can open by address, with the evidence in their source."""
    addresses = {address for item in evidence if (address := address_of(item.path)) is not None}
    pages: dict[str, set[Evidence]] = {}
    for address in addresses:
        parts = urlsplit(address)
        query = dict(parse_qsl(parts.query, keep_blank_values=True))
        lists = {key: [value] for key, value in query.items()}
        answer = site.handle(Visit("GET", unquote(parts.path), query, lists, {}, {}))
        if answer.status == 200 and answer.location is None:
            source = fold(re.sub(r"<[^>]*>", " ", answer.body.decode()))
            expected = {item for item in evidence if re.match(item.path, address)}
            contained = {item for item in expected if any(fold(text) in source for text in item.texts)}
            if contained:
                pages[address] = contained
    return pages


def chosen(pages: dict[str, set[Evidence]], per_kind: int) -> Iterator[str]:
    """At most ``per_kind`` pages of every kind, and at least one for every form of evidence."""
    opened: Counter[tuple[str, ...]] = Counter()
    forms: set[tuple[str, ...]] = set()
    for address in sorted(
        pages, key=lambda address: -max(len(text) for item in pages[address] for text in item.texts)
    ):
        parts = urlsplit(address)
        steps = parts.path.split("/")
        kind = (steps[1], str(len(steps)), *sorted(dict(parse_qsl(parts.query))))
        new = {(*kind, _form(text)) for item in pages[address] for text in item.texts} - forms
        if new or opened[kind] < per_kind:
            forms |= new
            opened[kind] += 1
            yield address


def _form(text: str) -> str:
    """The form that values of a kind share: "0:0" for "13:23", the number of words for names."""
    return re.sub(r"\d+", "0", text) if re.search(r"\d", text) and len(text) < 12 else str(len(text) // 8)


async def main() -> int:
    """Print a line per family, and all evidence that is cut off."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--family", help="only websites of this family")
    parser.add_argument(
        "--per-kind", type=int, default=1, help="maximum number of pages per kind and website"
    )
    parser.add_argument("--every", type=int, default=1, help="only every n-th website of a family")
    args = parser.parse_args()
    web = OfflineWeb()
    cut = 0
    seen: Counter[str] = Counter()
    head = f"{'family':14} {'websites':>8} {'evidence':>8} {'in pages':>8} {'pages':>6}"
    print(f"{head} {'cut off':>8} {'others':>7} {'s':>5}")
    by_family: dict[str, list[str]] = defaultdict(list)
    for host, spec in web.specs.items():
        if spec.behaviour not in ("blocks", "down") and args.family in (None, spec.family.family):
            by_family[spec.family.family].append(host)
    with tempfile.TemporaryDirectory() as scratch:
        async with (
            serving(SitesConfig(port=0, latency=0, slow_seconds=0), web) as sites,
            Egress(EgressConfig().allowing(*sites.allowed_hosts)) as egress,
        ):
            slot = Slot(BrowserConfig(freeze=False), find_browser().path, ProfileRoot(Path(scratch)), egress)
            for family, hosts in by_family.items():
                began, lines = time.monotonic(), set()
                counts: Counter[str] = Counter()
                for host in hosts[:: args.every]:
                    site = web.website(host)
                    assert site is not None
                    truths = [task.truth for task in web.tasks_of(host)]
                    evidence = {
                        Evidence(item.path, tuple(item.texts))
                        for truth in truths
                        if truth is not None
                        for fact in truth.facts
                        for item in fact.evidence
                    }
                    pages = pages_of(site, evidence)
                    addresses = list(chosen(pages, args.per_kind))
                    counts["evidence"] += len(evidence)
                    counts["contained"] += len(set().union(*(pages[address] for address in addresses)))
                    for address in addresses:
                        if seen.total() % EPISODE == 0 or not slot.is_open:
                            await slot.close()
                            await slot.open(PageOptions(text=True, cuts=True))
                        look = await slot.step(Navigate(f"http://{host}{address}"))
                        seen[family] += 1
                        counts["others"] += len(look.observation.cuts)
                        for whole, shown in look.observation.cuts:
                            lines |= {
                                f'{host}{address}: "{text}" is cut off: "{shown}"'
                                for one in pages[address]
                                for text in one.texts
                                if says(fold(whole), text) and not says(fold(shown), text)
                            }
                cut += len(lines)
                row = (
                    len(hosts[:: args.every]),
                    counts["evidence"],
                    counts["contained"],
                    seen[family],
                    len(lines),
                )
                print(
                    f"{family:14} {row[0]:8} {row[1]:8,} {row[2]:8,} {row[3]:6,} {row[4]:8} "
                    f"{counts['others'] - len(lines):7} {time.monotonic() - began:5.0f}",
                    flush=True,
                )
                for line in sorted(lines):
                    print(f"  {line}", flush=True)
            await slot.stop()
    return int(cut > 0)


if __name__ == "__main__":
    sys.exit(asyncio.run(main()))
