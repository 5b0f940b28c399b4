"""Memory use of browsers; those that use too much are ended.

A page can allocate memory without limit, until the kernel kills an arbitrary process. So a watch checks the
running browsers (a stopped one cannot grow) and ends the largest: its renderer, which costs the page one
reload, or the whole browser if that is not enough.

The watch limits every browser to ``slot_bytes`` and keeps the machine's reserve; between two checks, the
kernel limits every process to twice ``slot_bytes``.

Only a browser's own memory counts: anonymous and shared memory, but not the pages of the executable, which
all browsers share.

The watch only checks at intervals, and a limit per process does not limit their sum. With a cgroup (v2) to
divide (``browser.cgroup``), every browser gets a child cgroup: memory and tasks are limited at all times, and
all processes of a browser end with it, including those that left its process group.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import os
import re
import resource
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, Protocol

import msgspec

from webgym.browser.config import BrowserConfig
from webgym.core.errors import ConfigError

log = logging.getLogger(__name__)

MIB = 1024 * 1024

_PROC = Path("/proc")
_CGROUP = Path("/sys/fs/cgroup")
_COUNTED = (b"RssAnon:", b"RssShmem:")
_TYPE = re.compile(rb"--type=([a-z-]+)")

MEMORY_LOOK_SECONDS = 0.5
"""Interval between two checks of memory use. A page can allocate 500 MB in this time."""


class Browser(Protocol):
    """A browser process, as far as the watch needs it."""

    pid: int
    is_frozen: bool
    standing_bytes: int

    def relieve(self, renderer: int | None, why: str) -> None:
        """End this renderer, or the whole browser."""


class MemoryUse(msgspec.Struct):
    """Memory use of one browser, bytes.

    Attributes:
        total: all of its processes.
        standing: the processes that remain when an episode ends: all but renderers.
        largest: the largest renderer.
        renderer: process id of the largest renderer; ``None`` if there is none.
    """

    total: int = 0
    standing: int = 0
    largest: int = 0
    renderer: int | None = None

    def add(self, pid: int, own: int, *, is_renderer: bool) -> None:
        """Add the memory of one process."""
        self.total += own
        if not is_renderer:
            self.standing += own
        elif own > self.largest:
            self.largest, self.renderer = own, pid


class ProcessTable:
    """The processes of process groups. Caches their group and type, so that only new ones are examined."""

    def __init__(self) -> None:
        self._group_of: dict[int, int] = {}
        self._types: dict[int, bytes] = {}

    def sizes(self, groups: Iterable[int]) -> dict[int, MemoryUse]:
        """Memory use of these process groups. Blocks for some milliseconds."""
        sizes = {group: MemoryUse() for group in groups}
        living = {int(name) for name in os.listdir(_PROC) if name.isdigit()}  # noqa: PTH208 - names alone
        for pid in self._group_of.keys() - living:
            del self._group_of[pid]
            self._types.pop(pid, None)
        for pid in living:
            with contextlib.suppress(OSError):  # it ended in the meantime
                group = self._group_of.get(pid) or self._read_group(pid)
                size = sizes.get(group)
                if size is not None:
                    size.add(pid, own_bytes(pid), is_renderer=self._type(pid) == b"renderer")
        return sizes

    def _read_group(self, pid: int) -> int:
        group = self._group_of[pid] = os.getpgid(pid)
        return group

    def _type(self, pid: int) -> bytes:
        """The type of a Chromium process. A process that was just forked still looks like its parent, so the
        types of browsers and zygotes are not cached."""
        kind = self._types.get(pid) or process_type(pid)
        if kind not in (b"", b"zygote"):
            self._types[pid] = kind
        return kind


def own_bytes(pid: int) -> int:
    """Memory of a process that it does not share with the executable, bytes.

    Raises:
        OSError: the process has ended.
    """
    counted = 0
    for line in (_PROC / str(pid) / "status").read_bytes().splitlines():
        if line.startswith(_COUNTED):
            counted += int(line.split()[1]) * 1024
    return counted


def process_type(pid: int) -> bytes:
    """The type of a Chromium process on its command line: ``renderer``, ``gpu-process``; empty for the
    browser.

    Raises:
        OSError: the process has ended.
    """
    match = _TYPE.search((_PROC / str(pid) / "cmdline").read_bytes())
    return match[1] if match else b""


def available_bytes() -> int:
    """Available memory of the machine, or of the container that this process runs in, bytes."""
    lines = (_PROC / "meminfo").read_text().splitlines()
    [available] = [int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")]
    try:
        limit = int((_CGROUP / "memory.max").read_text())  # "max" where there is none
        used = int((_CGROUP / "memory.current").read_text())
        statistics = dict(line.split() for line in (_CGROUP / "memory.stat").read_text().splitlines())
    except (OSError, ValueError):
        return available
    return min(available, limit - used + int(statistics.get("inactive_file", 0)))


def bound(pids: Iterable[int], config: BrowserConfig) -> None:
    """Limit the memory of each of these processes, and of their children, to twice ``slot_bytes``."""
    limit = 2 * config.slot_bytes
    for pid in pids:
        with contextlib.suppress(ProcessLookupError, PermissionError):  # gone, or bounded by its sandbox
            _, most = resource.prlimit(pid, resource.RLIMIT_DATA)
            if most == resource.RLIM_INFINITY or most > limit:
                resource.prlimit(pid, resource.RLIMIT_DATA, (limit, limit))


class MemoryWatch:
    """Ends browsers, or renderers, that exceed the memory limits.

    Args:
        config: the limits.
        browsers: returns all running browsers.
    """

    def __init__(self, config: BrowserConfig, browsers: Callable[[], Iterable[Browser]]) -> None:
        self._config = config
        self._browsers = browsers
        self._processes = ProcessTable()
        self.relieved = 0
        """How often a browser or renderer was ended."""

    async def run(self) -> None:
        """Check at intervals, until cancelled. Checks that fail, because no file is left, are made again."""
        is_blind = False
        while True:
            await asyncio.sleep(MEMORY_LOOK_SECONDS)
            try:
                await self.check()
                is_blind = False
            except Exception as error:  # also RuntimeError: no thread is left
                if not is_blind:
                    log.error("the memory of browsers is not watched until it can be read again: %s", error)
                is_blind = True

    async def check(self) -> None:
        """Check all running browsers once."""
        running = {browser.pid: browser for browser in self._browsers() if not browser.is_frozen}
        if not running:
            return
        sizes = await asyncio.to_thread(self._processes.sizes, running)
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
        browsers = {browser.pid: browser for browser in self._browsers()}
        sizes = await asyncio.to_thread(self._processes.sizes, browsers)
        if sizes:
            pid, size = max(sizes.items(), key=lambda item: item[1].total)
            why = f"the machine had only {available // MIB} MiB of memory left, and it took the most"
            self._relieve(browsers[pid], size, why)

    def _relieve(self, browser: Browser, size: MemoryUse, why: str) -> None:
        self.relieved += 1
        log.warning("browser %d, %d MiB: %s", browser.pid, size.total // MIB, why)
        # Ending a renderer that has the smaller part would not help.
        browser.relieve(size.renderer if 2 * size.largest > size.total else None, why)


_CONTROLLERS: Final = frozenset({"memory", "pids"})
_numbers = itertools.count(1)


class Cgroup:
    """The cgroup of one browser. Create it with :func:`new_cgroup`."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def command(self, arguments: list[str]) -> list[str]:
        """A command that runs ``arguments`` in the cgroup: a shell enters it and executes them in its
        place."""
        return ["/bin/sh", "-c", 'echo $$ > "$0" && exec "$@"', str(self.path / "cgroup.procs"), *arguments]

    @property
    def ran_out(self) -> bool:
        """Whether the kernel killed its processes because they exceeded the memory limit."""
        try:
            events = dict(line.split() for line in (self.path / "memory.events").read_text().splitlines())
        except OSError:
            return False
        return events.get("oom_kill", "0") != "0"

    @property
    def is_empty(self) -> bool:
        """Whether it contains no process."""
        try:
            return "populated 1" not in (self.path / "cgroup.events").read_text()
        except OSError:
            return True

    def kill(self) -> None:
        """Kill all processes in it. Does nothing if it is gone."""
        with contextlib.suppress(OSError):
            (self.path / "cgroup.kill").write_text("1\n")

    def remove(self) -> None:
        """Remove it if it is empty."""
        with contextlib.suppress(OSError):
            self.path.rmdir()


def new_cgroup(config: BrowserConfig) -> Cgroup | None:
    """Create a cgroup for one browser, with the limits of the settings; ``None`` if ``browser.cgroup`` is not
    set.

    Raises:
        ConfigError: ``browser.cgroup`` is not a cgroup in which children can be created.
    """
    parent = config.cgroup
    if parent is None:
        return None
    try:
        controllers = set((parent / "cgroup.controllers").read_text().split()) & _CONTROLLERS
        if not controllers:
            raise ConfigError(
                f"the cgroup {parent} has neither the memory nor the pids controller",
                hint="write `+memory +pids` to cgroup.subtree_control of the one above it",
            )
        (parent / "cgroup.subtree_control").write_text(" ".join(f"+{name}" for name in sorted(controllers)))
        _sweep(parent)
        path = parent / f"{os.getpid()}-{next(_numbers)}"
        path.mkdir()
        for name, value in _limits(config, controllers).items():
            (path / name).write_text(f"{value}\n")
    except OSError as error:
        raise ConfigError(
            f"{parent} is not a cgroup that can be divided: {error.strerror} ({error.filename})",
            hint="it must be version 2, contain no process itself and be writable; see docs/scaling.md",
        ) from None
    return Cgroup(path)


def _limits(config: BrowserConfig, controllers: set[str]) -> dict[str, int]:
    limits: dict[str, int] = {}
    if "memory" in controllers:
        # The same limit as for one process. All of the browser ends then: a part of it is of no use.
        limits |= {"memory.max": 2 * config.slot_bytes, "memory.oom.group": 1}
    if "pids" in controllers:
        limits["pids.max"] = config.slot_tasks
    return limits


def _sweep(parent: Path) -> None:
    """Remove the cgroups of dead servers. The kernel keeps those that are not empty."""
    for path in parent.iterdir():
        pid = path.name.partition("-")[0]
        if path.is_dir() and pid.isdigit() and not Path("/proc", pid).exists():
            Cgroup(path).remove()
