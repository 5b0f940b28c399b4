"""A control group (cgroup v2) per browser: the kernel's bound on all of its processes together.

The memory watch looks now and then, and a limit per process bounds none together. Where the machine gives us
a cgroup to divide (``browser.cgroup``), every browser gets one of its own in it: memory and tasks are bounded
between two looks as well, and whatever a browser started ends with it, what left its process group included.
"""

from __future__ import annotations

import contextlib
import itertools
import os
from pathlib import Path
from typing import Final

from webgym.browser.config import BrowserConfig
from webgym.core.errors import ConfigError

_CONTROLLERS: Final = frozenset({"memory", "pids"})
_numbers = itertools.count(1)


class Cgroup:
    """One browser's. Make it with :func:`new_cgroup`."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def command(self, arguments: list[str]) -> list[str]:
        """The command that runs this one inside: a shell enters it and becomes that."""
        return ["/bin/sh", "-c", 'echo $$ > "$0" && exec "$@"', str(self.path / "cgroup.procs"), *arguments]

    @property
    def ran_out(self) -> bool:
        """Whether the kernel ended it because it took more memory than it may."""
        try:
            events = dict(line.split() for line in (self.path / "memory.events").read_text().splitlines())
        except OSError:
            return False
        return events.get("oom_kill", "0") != "0"

    @property
    def is_empty(self) -> bool:
        """Whether nothing lives in it."""
        try:
            return "populated 1" not in (self.path / "cgroup.events").read_text()
        except OSError:
            return True

    def kill(self) -> None:
        """End everything in it. Says nothing when that has happened already."""
        with contextlib.suppress(OSError):
            (self.path / "cgroup.kill").write_text("1\n")

    def remove(self) -> None:
        """Take it away, when it is empty."""
        with contextlib.suppress(OSError):
            self.path.rmdir()


def new_cgroup(config: BrowserConfig) -> Cgroup | None:
    """A cgroup for one browser, with the limits of the settings; ``None`` where none was given to us.

    Raises:
        ConfigError: ``browser.cgroup`` is no cgroup that we may divide.
    """
    parent = config.cgroup
    if parent is None:
        return None
    try:
        given = set((parent / "cgroup.controllers").read_text().split()) & _CONTROLLERS
        if not given:
            raise ConfigError(
                f"the cgroup {parent} has neither the memory nor the pids controller",
                hint="write `+memory +pids` to cgroup.subtree_control of the one above it",
            )
        (parent / "cgroup.subtree_control").write_text(" ".join(f"+{name}" for name in sorted(given)))
        _sweep(parent)
        path = parent / f"{os.getpid()}-{next(_numbers)}"
        path.mkdir()
        for name, value in _limits(config, given).items():
            (path / name).write_text(f"{value}\n")
    except OSError as error:
        raise ConfigError(
            f"{parent} is no cgroup that we may divide: {error.strerror} ({error.filename})",
            hint="it must be of version 2, hold no process itself and be writable; see docs/container.md",
        ) from None
    return Cgroup(path)


def _limits(config: BrowserConfig, given: set[str]) -> dict[str, int]:
    limits: dict[str, int] = {}
    if "memory" in given:
        # As much as one process may take. All of the browser ends then: half of one is of no use.
        limits |= {"memory.max": 2 * config.slot_bytes, "memory.oom.group": 1}
    if "pids" in given:
        limits["pids.max"] = config.slot_tasks
    return limits


def _sweep(parent: Path) -> None:
    """Remove what dead servers left. A cgroup that is not empty stays: the kernel sees to that."""
    for path in parent.iterdir():
        pid = path.name.partition("-")[0]
        if path.is_dir() and pid.isdigit() and not Path("/proc", pid).exists():
            Cgroup(path).remove()
