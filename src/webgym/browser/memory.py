"""How much memory browsers take, and the end of what takes too much.

A page can ask for memory without end. The machine would swap, and then kill whom it likes. So a watch
looks at the browsers that run (one that is stopped cannot grow) and ends the greediest: its renderer, which
costs the page one reload, or the whole browser where that is not enough.

Three lines of defence: the watch holds every browser to ``slot_bytes`` and the machine to its reserve; the
kernel holds every process to twice ``slot_bytes`` between two looks.

What is counted is a browser's own: anonymous and shared memory. The pages of the binary, which all browsers
have in common, are not.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import re
import resource
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

import msgspec

from webgym.browser.config import BrowserConfig

log = logging.getLogger(__name__)

MIB = 1024 * 1024

_PROC = Path("/proc")
_CGROUP = Path("/sys/fs/cgroup")
_COUNTED = (b"RssAnon:", b"RssShmem:")
_TYPE = re.compile(rb"--type=([a-z-]+)")


class Browser(Protocol):
    """What the watch asks of a browser process."""

    pid: int
    is_frozen: bool
    standing_bytes: int

    def relieve(self, renderer: int | None, why: str) -> None:
        """End this renderer, or the whole browser."""


class MemoryUse(msgspec.Struct):
    """Of one browser, bytes.

    Attributes:
        standing: of the processes that stay when an episode ends: all but renderers.
        largest: of the largest renderer, whose process id is ``renderer``.
    """

    total: int = 0
    standing: int = 0
    largest: int = 0
    renderer: int | None = None

    def add(self, pid: int, own: int, *, is_renderer: bool) -> None:
        """Count one more process."""
        self.total += own
        if not is_renderer:
            self.standing += own
        elif own > self.largest:
            self.largest, self.renderer = own, pid


class Census:
    """Which processes belong to which group. Remembers what it has seen: a look reads only what is new."""

    def __init__(self) -> None:
        self._group_of: dict[int, int] = {}
        self._types: dict[int, bytes] = {}

    def sizes(self, groups: Iterable[int]) -> dict[int, MemoryUse]:
        """How large the processes of these groups are. Blocks for some milliseconds."""
        found = {group: MemoryUse() for group in groups}
        living = {int(name) for name in os.listdir(_PROC) if name.isdigit()}  # noqa: PTH208 - names alone
        for pid in self._group_of.keys() - living:
            del self._group_of[pid]
            self._types.pop(pid, None)
        for pid in living:
            with contextlib.suppress(OSError):  # it ended while we looked
                group = self._group_of.get(pid) or self._meet(pid)
                size = found.get(group)
                if size is not None:
                    size.add(pid, own_bytes(pid), is_renderer=self._type(pid) == b"renderer")
        return found

    def _meet(self, pid: int) -> int:
        group = self._group_of[pid] = os.getpgid(pid)
        return group

    def _type(self, pid: int) -> bytes:
        """What kind of a Chromium's process it is. What was just forked still looks like its parent, so
        browsers and zygotes are looked at again."""
        found = self._types.get(pid) or process_type(pid)
        if found not in (b"", b"zygote"):
            self._types[pid] = found
        return found


def own_bytes(pid: int) -> int:
    """Memory that is a process's own, bytes.

    Raises:
        OSError: there is no such process any more.
    """
    counted = 0
    for line in (_PROC / str(pid) / "status").read_bytes().splitlines():
        if line.startswith(_COUNTED):
            counted += int(line.split()[1]) * 1024
    return counted


def process_type(pid: int) -> bytes:
    """What a process of a Chromium is for, as it says itself: ``renderer``, ``gpu-process``; the browser
    says nothing.

    Raises:
        OSError: there is no such process any more.
    """
    found = _TYPE.search((_PROC / str(pid) / "cmdline").read_bytes())
    return found[1] if found else b""


def available_bytes() -> int:
    """What the machine, or the container that we are in, can still give."""
    lines = (_PROC / "meminfo").read_text().splitlines()
    [available] = [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    try:
        limit = int((_CGROUP / "memory.max").read_text())  # "max" where there is none
        used = int((_CGROUP / "memory.current").read_text())
        held = dict(line.split() for line in (_CGROUP / "memory.stat").read_text().splitlines())
    except (OSError, ValueError):
        return available
    return min(available, limit - used + int(held.get("inactive_file", 0)))


def bound(pids: Iterable[int], config: BrowserConfig) -> None:
    """Have the kernel refuse memory to these processes, and their children, beyond twice ``slot_bytes``."""
    limit = 2 * config.slot_bytes
    for pid in pids:
        with contextlib.suppress(ProcessLookupError, PermissionError):  # gone, or bounded by its sandbox
            _, most = resource.prlimit(pid, resource.RLIMIT_DATA)
            if most == resource.RLIM_INFINITY or most > limit:
                resource.prlimit(pid, resource.RLIMIT_DATA, (limit, limit))


class MemoryWatch:
    """Ends what takes more memory than it may.

    Args:
        config: the limits.
        browsers: all living ones.
    """

    def __init__(self, config: BrowserConfig, browsers: Callable[[], Iterable[Browser]]) -> None:
        self._config = config
        self._browsers = browsers
        self._census = Census()
        self.relieved = 0
        """How often something was ended."""

    async def run(self) -> None:
        """Look again and again, until cancelled."""
        while True:
            await asyncio.sleep(self._config.memory_look_seconds)
            await self.look()

    async def look(self) -> None:
        """Look once, at what runs."""
        running = {browser.pid: browser for browser in self._browsers() if not browser.is_frozen}
        if not running:
            return
        sizes = await asyncio.to_thread(self._census.sizes, running)
        limit = self._config.slot_bytes
        for pid, size in sizes.items():
            running[pid].standing_bytes = size.standing
            if size.total > limit:
                self._relieve(running[pid], size, f"it took more than {limit // MIB} MiB of memory")
        await self._keep_reserve()

    async def _keep_reserve(self) -> None:
        available = await asyncio.to_thread(available_bytes)
        if available >= self._config.reserve_bytes:
            return
        everyone = {browser.pid: browser for browser in self._browsers()}
        sizes = await asyncio.to_thread(self._census.sizes, everyone)
        if sizes:
            pid, size = max(sizes.items(), key=lambda item: item[1].total)
            why = f"the machine had only {available // MIB} MiB of memory left, and it took the most"
            self._relieve(everyone[pid], size, why)

    def _relieve(self, browser: Browser, size: MemoryUse, why: str) -> None:
        self.relieved += 1
        log.warning("browser %d, %d MiB: %s", browser.pid, size.total // MIB, why)
        # A renderer that holds the smaller part would not help.
        browser.relieve(size.renderer if 2 * size.largest > size.total else None, why)
