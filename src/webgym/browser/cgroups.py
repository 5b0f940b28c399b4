"""A control group (cgroup v2) per browser: the kernel's limit on all of its processes together.

The memory watch only checks at intervals, and a limit per process does not limit their sum. With a cgroup
to divide (``browser.cgroup``), every browser gets a child cgroup: memory and tasks are limited at all times,
and all processes of a browser end with it, including those that left its process group.
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
