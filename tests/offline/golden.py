"""Digests of what a version of the web means: all websites of each collection, some pages of a website of
each family, and the tasks of some websites of each family.

``PYTHONPATH=src python tests/offline/golden.py > tests/offline/golden.txt`` after a change that is meant to
change them; the difference then shows on which websites. Names that were published keep theirs.
"""

from __future__ import annotations

import hashlib
import html
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qsl, unquote, urlsplit

import webgym.offline
from webgym.offline.config import TASK_SETS
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Visit

ASSETS = Path(webgym.offline.__file__).parent / "assets"
PER_FAMILY = 3
PAGES = 12


def lines() -> Iterator[str]:
    """Lines of four kinds, each but the last with the name of the version.

    - split, host, number of tasks, and a digest of their ids, instructions and truths
    - ``websites``, their number, and a digest of what they are built from
    - ``pages``, family, and a digest of some pages of its first website
    - ``assets``, their number, and a digest of the style sheets and scripts that all websites share
    """
    for name, collection in TASK_SETS.items():
        web = OfflineWeb(per_family=PER_FAMILY, collection=collection)
        for host, spec in web.specs.items():
            tasks = list(web.tasks_of(host))
            said = "\n".join(f"{task.id}\t{task.instruction}\t{task.truth}" for task in tasks)
            yield f"{name} {spec.split} {host} {len(tasks)} {digest(said.encode())}"
    for name, collection in TASK_SETS.items():
        web = OfflineWeb(collection=collection)
        specs = "\n".join(
            f"{host}\t{spec.family.family}\t{spec.seed}\t{spec.brand}\t{spec.split}\t{spec.behaviour}"
            for host, spec in web.specs.items()
        )
        yield f"{name} websites {len(web.specs)} {digest(specs.encode())}"
        if collection == "cross":  # the large collection's websites
            continue
        first = {spec.family.family: host for host, spec in reversed(web.specs.items())}
        for family in sorted(first):
            seen = b"".join(url.encode() + body for url, body in pages(web, first[family]))
            yield f"{name} pages {family} {digest(seen)}"
    assets = sorted(path for path in ASSETS.rglob("*") if path.is_file())
    held = b"".join(path.relative_to(ASSETS).as_posix().encode() + path.read_bytes() for path in assets)
    yield f"assets {len(assets)} {digest(held)}"


def pages(web: OfflineWeb, host: str) -> Iterator[tuple[str, bytes]]:
    """The front page of a website, and some that it links to or shows: addresses and contents."""
    site = web.website(host)
    assert site is not None
    todo = ["/"]
    for url in todo:
        parts = urlsplit(url)
        query = parse_qsl(parts.query)
        lists = {key: [value for name, value in query if name == key] for key, _ in query}
        body = site.handle(Visit("GET", unquote(parts.path), dict(query), lists, {}, {})).body
        yield url, body
        if len(todo) == 1:
            links = re.findall(r'(?:href|src)="(/[^"#]*)"', body.decode())
            todo += [html.unescape(link) for link in dict.fromkeys(links) if "/assets/" not in link][:PAGES]


def digest(data: bytes) -> str:
    """The first 16 hexadecimal digits of a SHA-256."""
    return hashlib.sha256(data).hexdigest()[:16]


if __name__ == "__main__":
    print("\n".join(lines()))
