"""Processes, files and descriptors of a server, as seen by the operating system, and what of them leaked."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import psutil

from webgym.bench.stepping import MEGABYTE


class Process(msgspec.Struct, frozen=True):
    """A process of the server.

    Attributes:
        pid: its process id.
        kind: ``gateway``, ``worker``, ``browser``, ``renderer``, ``gpu-process``, ``zygote``, ``utility``.
        group: its process group; the processes of a browser share that of the browser.
        is_running: false if it is stopped by a signal.
    """

    pid: int
    kind: str
    group: int
    is_running: bool


def processes_of(gateway: int) -> list[Process]:
    """A gateway and its descendants, without zombies. Blocks for some milliseconds."""
    processes = []
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
            processes.append(
                Process(process.pid, kind, os.getpgid(process.pid), status != psutil.STATUS_STOPPED)
            )
        except (psutil.NoSuchProcess, ProcessLookupError):
            continue
    return processes


def _kind(process: psutil.Process, gateway: int) -> str:
    if process.pid == gateway:
        return "gateway"
    if process.ppid() == gateway:
        return "worker"
    types = [part for part in process.cmdline() if part.startswith("--type=")]
    return types[0].partition("=")[2] if types else "browser"


class Census(msgspec.Struct, frozen=True):
    """Everything that belongs to a server at one moment.

    Attributes:
        workers: number of worker processes.
        browsers: number of process groups with a running browser.
        zombies: number of dead children of the gateway and the workers.
        strays: processes that use the server's folder and are not its descendants.
        profiles: number of browser profiles.
        folders: number of folders of profiles, one per worker.
        others: other files in the server's folder.
        descriptors: number of open descriptors by kind, of the gateway and of the worker with the most.
        megabytes: resident memory of gateway and workers.
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
    """Take a census of a server's processes and of its folder. Blocks for some milliseconds.

    Args:
        gateway: its process id.
        root: the folder of the browsers' profiles.

    Raises:
        psutil.NoSuchProcess: a process ended meanwhile.
    """
    processes = processes_of(gateway)
    by_kind = {
        kind: [process.pid for process in processes if process.kind == kind] for kind in ("gateway", "worker")
    }
    ours = [*by_kind["gateway"], *by_kind["worker"]]
    profiles = {path for path in root.glob("webgym-*/*/*") if path.is_dir()}
    folders = {path.parent for path in profiles}
    known = profiles | folders | {path.parent for path in folders}
    return Census(
        workers=len(by_kind["worker"]),
        browsers=len({process.group for process in processes if process.kind == "browser"}),
        zombies=sum(1 for child in _children(ours) if child.status() == psutil.STATUS_ZOMBIE),
        strays=tuple(_strays(root, {process.pid for process in processes})),
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
    """What is left of a server that has ended."""
    problems = [f"a process outlived the server: {stray}" for stray in _strays(root, set())]
    return problems + [f"a folder outlived the server: {path.name}" for path in root.glob("webgym-*/*")]


def _descriptors(pid: int) -> Counter[str]:
    counts: Counter[str] = Counter()
    for path in Path(f"/proc/{pid}/fd").iterdir():
        try:
            name = str(path.readlink())
        except OSError:  # closed meanwhile
            continue
        counts[name.partition(":")[0] if ":" in name else "file"] += 1
    return counts


def _most(counters: Iterator[Counter[str]]) -> dict[str, int]:
    most: Counter[str] = Counter()
    for counter in counters:
        most |= counter
    return dict(most)


def leaked(before: Census, after: Census, slots: int) -> list[str]:
    """What an idle server has now, and did not have before.

    Args:
        before: the census of the idle server before.
        after: the census now.
        slots: the number of slots, each of which has a browser and a profile.
    """
    problems = []
    for name, count, expected in (
        ("worker processes", after.workers, before.workers),
        ("browsers", after.browsers, slots),
        ("zombies", after.zombies, 0),
        ("profiles", after.profiles, slots),
        ("profile folders", after.folders, before.workers),
    ):
        if count != expected:
            problems.append(f"{count} {name} instead of {expected}")
    problems += [f"a stray process: {stray}" for stray in after.strays]
    problems += [f"a stray file: {path}" for path in after.others if path not in before.others]
    for process, now in after.descriptors.items():
        more = Counter(now) - Counter(before.descriptors[process])
        problems += [f"{count} more open descriptors of a {process}: {kind}" for kind, count in more.items()]
    return problems
