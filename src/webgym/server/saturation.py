"""Measures the load of the processors that this process may use, from the kernel's counters."""

from __future__ import annotations

import os
import time
from pathlib import Path

_STAT = Path("/proc/stat")
_CGROUP = Path("/sys/fs/cgroup")


class Processors:
    """The busy share of the processors between two calls of :meth:`busy`.

    The larger of two shares counts: that of the processors in this process's affinity mask (which other
    processes may use as well), and that of its control group's CPU quota, if it has one.
    """

    def __init__(self) -> None:
        self.affinity = os.sched_getaffinity(0)
        self._group = _own_group()
        self._measured_at, self._ticks, self._used = (
            time.monotonic(),
            _ticks(self.affinity),
            _group_seconds(self._group),
        )

    def busy(self) -> float:
        """Share in use since the last call, 0 to 1. Meaningful over 0.1 s and more."""
        now, ticks, used = time.monotonic(), _ticks(self.affinity), _group_seconds(self._group)
        all_ticks = ticks[1] - self._ticks[1]
        shares = [(ticks[0] - self._ticks[0]) / all_ticks if all_ticks else 0.0]
        quota = _quota(self._group)
        if quota is not None and now > self._measured_at:
            shares.append((used - self._used) / (quota * (now - self._measured_at)))
        self._measured_at, self._ticks, self._used = now, ticks, used
        return min(1.0, max(shares))


def _ticks(processors: set[int]) -> tuple[int, int]:
    """Busy ticks and all ticks of these processors since boot."""
    busy = total = 0
    for line in _STAT.read_text().splitlines():
        name, *rest = line.split()
        if name.startswith("cpu") and name != "cpu" and int(name[3:]) in processors:
            counts = [int(field) for field in rest[:8]]  # guest time is in user time already
            total += sum(counts)
            busy += sum(counts) - counts[3] - counts[4]  # idle, waiting for disks
    return busy, total


def _own_group() -> Path | None:
    """The cgroup v2 of this process, if its CPU controller is available."""
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return None
    name = next((line[3:] for line in lines if line.startswith("0::")), None)
    group = None if name is None else _CGROUP / name.lstrip("/")
    return group if group and (group / "cpu.max").exists() else None


def _quota(group: Path | None) -> float | None:
    """Number of processors that the group may use; ``None`` if it is not limited."""
    if group is None:
        return None
    allowed, period = (group / "cpu.max").read_text().split()
    return None if allowed == "max" else int(allowed) / int(period)


def _group_seconds(group: Path | None) -> float:
    if group is None:
        return 0.0
    for line in (group / "cpu.stat").read_text().splitlines():
        name, value = line.split()
        if name == "usage_usec":
            return int(value) / 1e6
    return 0.0
