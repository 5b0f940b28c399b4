"""Resource usage of process trees: CPU time by kind of process, and memory."""

from __future__ import annotations

from collections.abc import Iterable

import psutil

MEGABYTE = 1024 * 1024


def _kind(process: psutil.Process, root: int) -> str:
    if process.pid == root:
        return "server"
    types = [part for part in process.cmdline() if part.startswith("--type=")]
    return types[0].partition("=")[2] if types else "browser"


class CpuTimes:
    """CPU seconds of a process and its descendants, by kind: ``server``, ``browser``, ``renderer``, …

    A process that starts and ends between two readings is missed.

    Args:
        root: process id of the ``server``.
    """

    def __init__(self, root: int) -> None:
        self._root = root
        self._seen: dict[tuple[int, float], tuple[str, float]] = {}
        self._seen = self._read()

    def _read(self) -> dict[tuple[int, float], tuple[str, float]]:
        top = psutil.Process(self._root)
        now = {}
        for process in (top, *top.children(recursive=True)):
            try:
                key = (process.pid, process.create_time())
                kind = self._seen[key][0] if key in self._seen else _kind(process, self._root)
                spent = process.cpu_times()
                now[key] = (kind, spent.user + spent.system)
            except psutil.Error:
                continue
        return now

    def since_last(self) -> dict[str, float]:
        """CPU seconds by kind since the last call, or since the object was made."""
        now: dict[tuple[int, float], tuple[str, float]] = self._read()
        used: dict[str, float] = {}
        for key, (kind, seconds) in now.items():
            used[kind] = used.get(kind, 0.0) + seconds - self._seen.get(key, (kind, 0.0))[1]
        self._seen = now
        return used


def proportional_bytes(processes: Iterable[psutil.Process]) -> int:
    """The proportional set size (PSS) of processes, bytes: shared memory is divided among its users."""
    total = 0
    for process in processes:
        try:
            total += process.memory_full_info().pss
        except psutil.Error:
            continue
    return total


def browser_bytes(root: int) -> int:
    """The proportional set size of all descendants of a server, bytes."""
    return proportional_bytes(psutil.Process(root).children(recursive=True))
