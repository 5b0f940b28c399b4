"""What exists before and afterwards. Looks at the machine, not at what the server says about itself."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import psutil

from webgym.bench.usage import MEGABYTE


class Process(msgspec.Struct, frozen=True):
    """One of the server's.

    Attributes:
        kind: ``gateway``, ``worker``, ``browser``, ``renderer``, ``gpu-process``, ``zygote``, ``utility``.
        group: its process group; of a browser's processes, the browser.
        is_running: whether it is not stopped.
    """

    pid: int
    kind: str
    group: int
    is_running: bool


def processes_of(gateway: int) -> list[Process]:
    """A gateway and everything below it, the dead left out. Blocks for some milliseconds."""
    found = []
    try:
        top = psutil.Process(gateway)
        below = top.children(recursive=True)
    except psutil.NoSuchProcess:
        return []
    for process in (top, *below):
        try:
            status = process.status()
            if status == psutil.STATUS_ZOMBIE:
                continue
            kind = _kind(process, gateway)
            found.append(Process(process.pid, kind, os.getpgid(process.pid), status != psutil.STATUS_STOPPED))
        except (psutil.NoSuchProcess, ProcessLookupError):
            continue
    return found


def _kind(process: psutil.Process, gateway: int) -> str:
    if process.pid == gateway:
        return "gateway"
    if process.ppid() == gateway:
        return "worker"
    types = [part for part in process.cmdline() if part.startswith("--type=")]
    return types[0].partition("=")[2] if types else "browser"


class Census(msgspec.Struct, frozen=True):
    """Of everything that belongs to a server.

    Attributes:
        workers: processes.
        browsers: process groups with a living browser.
        zombies: dead children that the gateway or a worker has not collected.
        strays: processes that use the server's folder and have lost their parent.
        profiles: of browsers.
        folders: of profiles, one per worker.
        others: files beside them.
        descriptors: open ones by what they are; of the gateway, and of the worker that has most of a kind.
        megabytes: resident in our own processes.
    """

    workers: int
    browsers: int
    zombies: int
    strays: tuple[str, ...]
    profiles: int
    folders: int
    others: tuple[str, ...]
    descriptors: dict[str, dict[str, int]]
    megabytes: float


def take(gateway: int, root: Path) -> Census:
    """Look at a server's processes and at its folder. Blocks for some milliseconds.

    Raises:
        psutil.NoSuchProcess: it is gone.
    """
    processes = processes_of(gateway)
    by_kind = {kind: [one.pid for one in processes if one.kind == kind] for kind in ("gateway", "worker")}
    ours = [*by_kind["gateway"], *by_kind["worker"]]
    profiles = {path for path in root.glob("webgym-*/*/*") if path.is_dir()}
    folders = {path.parent for path in profiles}
    known = profiles | folders | {path.parent for path in folders}
    return Census(
        workers=len(by_kind["worker"]),
        browsers=len({one.group for one in processes if one.kind == "browser"}),
        zombies=sum(1 for child in _children(ours) if child.status() == psutil.STATUS_ZOMBIE),
        strays=tuple(_strays(root, {one.pid for one in processes})),
        profiles=len(profiles),
        folders=len(folders),
        others=tuple(sorted(str(path) for depth in ("*", "*/*") for path in {*root.glob(depth)} - known)),
        descriptors={kind: _most(_descriptors(pid) for pid in pids) for kind, pids in by_kind.items()},
        megabytes=sum(psutil.Process(pid).memory_info().rss for pid in ours) / MEGABYTE,
    )


def _children(pids: list[int]) -> Iterator[psutil.Process]:
    for pid in pids:
        yield from psutil.Process(pid).children()


def _strays(root: Path, known: set[int]) -> Iterator[str]:
    for process in psutil.process_iter(["cmdline", "status"]):
        line = " ".join(process.info["cmdline"] or ())
        if f"--user-data-dir={root}{os.sep}" in line and process.pid not in known:
            yield f"{process.pid} ({process.info['status']})"


def left_behind(root: Path) -> list[str]:
    """What is there of a server that has ended, and should not be."""
    found = [f"a process outlived the server: {stray}" for stray in _strays(root, set())]
    return found + [f"a folder outlived the server: {path.name}" for path in root.glob("webgym-*/*")]


def _descriptors(pid: int) -> Counter[str]:
    found: Counter[str] = Counter()
    for path in Path(f"/proc/{pid}/fd").iterdir():
        try:
            name = str(path.readlink())
        except OSError:  # closed meanwhile
            continue
        found[name.partition(":")[0] if ":" in name else "file"] += 1
    return found


def _most(each: Iterator[Counter[str]]) -> dict[str, int]:
    most: Counter[str] = Counter()
    for one in each:
        most |= one
    return dict(most)


def leaked(before: Census, after: Census, slots: int) -> list[str]:
    """What is there now and was not before, when nothing is at work."""
    found = []
    for what, there, wanted in (
        ("worker processes", after.workers, before.workers),
        ("browsers", after.browsers, slots),
        ("zombies", after.zombies, 0),
        ("profiles", after.profiles, slots),
        ("profile folders", after.folders, before.workers),
    ):
        if there != wanted:
            found.append(f"{there} {what} instead of {wanted}")
    found += [f"a stray process: {stray}" for stray in after.strays]
    found += [f"a stray file: {path}" for path in after.others if path not in before.others]
    for process, now in after.descriptors.items():
        more = Counter(now) - Counter(before.descriptors[process])
        found += [f"{count} more open descriptors of a {process}: {what}" for what, count in more.items()]
    return found
