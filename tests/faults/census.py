"""What exists before and after a fault: whatever is there afterwards and was not before has leaked."""

from __future__ import annotations

import asyncio
import os
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import psutil

from webgym.server.worker import RunningServer

LAUNCHED: set[int] = set()
"""Process groups of all browsers that this process ever started."""

SECONDS = 40.0
"""Until everything must be gone; on an idle machine it takes one or two."""


class Census(msgspec.Struct):
    """Of this process.

    Attributes:
        descriptors: open ones, by what they are.
        files: beside the browsers' profiles, in the temporary folder.
    """

    descriptors: Counter[str]
    files: set[str]
    tasks: int


def open_descriptors() -> list[str]:
    """What this process has open."""
    found = []
    for path in Path("/proc/self/fd").iterdir():
        try:
            found.append(str(path.readlink()))
        except FileNotFoundError:  # that of the listing itself
            continue
    return found


def _descriptors() -> Counter[str]:
    return Counter(name.split(":")[0] for name in open_descriptors())


def _take(temporary: Path) -> Census:
    files = {str(path) for path in temporary.glob("*")}
    return Census(_descriptors(), files, len(asyncio.all_tasks()))


def of_groups(groups: set[int]) -> dict[int, int]:
    """Group by process id, of all processes in these groups, zombies of ours included."""
    found = {}
    for process in psutil.process_iter():
        try:
            group = os.getpgid(process.pid)
            is_ours = process.status() != psutil.STATUS_ZOMBIE or process.ppid() == os.getpid()
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
        if group in groups and is_ours:
            found[process.pid] = group
    return found


def _in_use(server: RunningServer) -> list[str]:
    """What is not yet ready for the next."""
    service = server.service
    load = service.pool.load
    found = []
    if load.free != load.total:
        found.append(f"slots: {load}")
    if len(service.leases):
        found.append(f"{len(service.leases)} leases")
    if service.gate.permits.running:
        found.append(f"permits: {service.gate.permits}")
    return found


def _leaked(server: RunningServer, temporary: Path, before: Census) -> list[str]:
    """What is there and was not before."""
    found = []
    browsers = [slot.process for slot in server.service.pool.slots if slot.process is not None]
    if processes := of_groups(LAUNCHED - {browser.pid for browser in browsers}):
        found.append(f"processes of ended browsers: {processes}")
    profiles = {path for path in temporary.glob("webgym-*/*/*") if path.is_dir()}
    if profiles != {browser.profile for browser in browsers}:
        found.append(f"profiles: {sorted(map(str, profiles))}")
    after = _take(temporary)
    if more := after.descriptors - before.descriptors:
        found.append(f"descriptors: {dict(more)}")
    if after.files != before.files:
        found.append(f"files: {after.files ^ before.files}")
    if after.tasks > before.tasks:
        found.append(f"tasks: {after.tasks - before.tasks} more")
    return found


async def _until_none(look: Callable[[], list[str]]) -> None:
    loop = asyncio.get_running_loop()
    deadline = loop.time() + SECONDS
    while found := look():
        assert loop.time() < deadline, f"left behind: {found}"
        await asyncio.sleep(0.05)


@asynccontextmanager
async def nothing_leaks(server: RunningServer, temporary: Path) -> AsyncIterator[None]:
    """Whatever happens in the block: soon afterwards every slot serves again, and nothing has leaked."""
    await _until_none(lambda: _in_use(server))
    before = _take(temporary)
    yield
    await _until_none(lambda: _in_use(server) or _leaked(server, temporary, before))
