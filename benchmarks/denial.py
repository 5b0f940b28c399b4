"""The effect of hostile pages on the session of a neighbour, in alternating rounds.

    .venv/bin/python benchmarks/denial.py --rounds 5

Two browsers share one proxy. One opens a page that resolves ever more names whose servers never respond, or a
page that reloads itself forever; the other opens pages under new names, which are resolved by a real name
server on this machine. Its time per page is measured alone and next to each hostile page, in the same round.
As the processors are shared, a ratio of 1 cannot be reached on few of them.
"""

from __future__ import annotations

import argparse
import asyncio
import itertools
import statistics
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

from aiodns import DNSResolver

from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.egress.resolver import Machine
from webgym.browser.find import find_browser
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate

PAGES_PER_ROUND = 5
KNOWN = "ok.test"
HOSTILE = {
    "names that are never answered": (
        "names",
        "let n = 0; setInterval(() => { for (let i = 0; i < 50; i++)"
        " fetch(`http://n${n++}.d${n % 50}.silent.test/`).catch(() => {}) }, 20)",
    ),
    "reloads without end": ("reloads", "location.reload()"),
}


class NameServer(asyncio.DatagramProtocol):
    """A name server that knows the names of one domain, and never responds to others."""

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        end = data.index(b"\0", 12)
        name, is_v4 = data[12:end], data[end + 2] == 1
        if not name.endswith(b"".join(bytes([len(part)]) + part.encode() for part in KNOWN.split("."))):
            return
        answer = b"\xc0\x0c\0\1\0\1\0\0\0\x3c\0\4\x7f\0\0\1" if is_v4 else b""
        counts = b"\0\1\0" + (b"\1" if answer else b"\0") + b"\0\0\0\0"
        self._transport.sendto(data[:2] + b"\x81\x80" + counts + data[12 : end + 5] + answer, addr)


async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    try:
        while head := await reader.readuntil(b"\r\n\r\n"):
            path = head.split(b" ", 2)[1].decode()
            script = next((code for name, code in HOSTILE.values() if path == f"/{name}"), "")
            body = f"<!doctype html><title>here</title><p>Hello<script>{script}</script>".encode()
            told = f"HTTP/1.1 200 OK\r\ncontent-type: text/html\r\ncontent-length: {len(body)}\r\n\r\n"
            writer.write(told.encode() + body)
            await writer.drain()
    except (asyncio.IncompleteReadError, ConnectionError):
        return
    finally:
        writer.close()


@asynccontextmanager
async def two_browsers() -> AsyncIterator[tuple[int, Slot, Slot]]:
    """Run two browsers until the block ends.

    Yields:
        The port of the pages, the slot of the hostile page, the slot of the neighbour.
    """
    pages = await asyncio.start_server(answer, "127.0.0.1", 0)
    loop = asyncio.get_running_loop()
    names, _ = await loop.create_datagram_endpoint(NameServer, local_addr=("127.0.0.1", 0))
    port = names.get_extra_info("sockname")[1]
    machine = Machine(DNSResolver(["127.0.0.1"], udp_port=port, timeout=5, tries=1, domains=[]))
    async with Egress(EgressConfig(allow=(f"*.{KNOWN}",)), machine=machine) as egress:
        slots = [Slot(BrowserConfig(), find_browser().path, ProfileRoot(), egress) for _ in range(2)]
        try:
            for slot in slots:
                await slot.open(PageOptions())
            yield pages.sockets[0].getsockname()[1], slots[0], slots[1]
        finally:
            for slot in slots:
                await slot.stop()
            pages.close()
            names.close()


async def opened(slot: Slot, port: int, fresh: Iterator[int]) -> tuple[float, int]:
    """The median time of a page in milliseconds, and the number of pages that failed."""
    times, missed = [], 0
    for _ in range(PAGES_PER_ROUND):
        start = time.perf_counter()
        look = await slot.step(Navigate(f"http://n{next(fresh)}.{KNOWN}:{port}/"))
        times.append((time.perf_counter() - start) * 1000)
        missed += look.observation.title != "here"
    return statistics.median(times), missed


async def measure(rounds: int) -> Iterator[str]:
    """Measure, and return the lines of the table."""
    fresh = itertools.count()
    alone: dict[str, list[float]] = {name: [] for name in HOSTILE}
    beside: dict[str, list[float]] = {name: [] for name in HOSTILE}
    missed = dict.fromkeys(HOSTILE, 0)
    recovered = dict.fromkeys(HOSTILE, 0)
    async with two_browsers() as (port, hostile, neighbour):
        for _ in range(rounds):
            for name, (path, _) in HOSTILE.items():
                alone[name].append((await opened(neighbour, port, fresh))[0])
                await hostile.step(Navigate(f"http://bad.{KNOWN}:{port}/{path}"))
                took, lost = await opened(neighbour, port, fresh)
                beside[name].append(took)
                missed[name] += lost
                await hostile.close()
                await hostile.open(PageOptions())
                recovered[name] += not (await opened(hostile, port, fresh))[1]
    lines = [
        "| beside a page with | ms per page, alone | beside | ratio | missed | next session whole |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for name in HOSTILE:
        ratios = [later / before for before, later in zip(alone[name], beside[name], strict=True)]
        lines.append(
            f"| {name} | {statistics.median(alone[name]):.0f} | {statistics.median(beside[name]):.0f}"
            f" | {statistics.median(ratios):.2f} ({min(ratios):.2f}-{max(ratios):.2f})"
            f" | {missed[name]} of {rounds * PAGES_PER_ROUND} | {recovered[name]} of {rounds} |"
        )
    return iter(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5)
    for line in asyncio.run(measure(parser.parse_args().rounds)):
        print(line)


if __name__ == "__main__":
    main()
