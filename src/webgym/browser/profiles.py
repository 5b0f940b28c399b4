"""Temporary browser profiles that a dead server cannot leave behind.

Every server process keeps its profiles in one folder, named by its process id and the moment it
started, so that an id that the system gave out again is not taken for the old owner. The next
server to start sweeps the folders whose owner is gone, and any process that still uses them.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import shutil
import tempfile
from pathlib import Path

import psutil

from webgym.core.errors import BrowserLaunchFailed

_NAME = re.compile(r"(\d+)-(\d+)")


def _started(pid: int) -> int | None:
    """When a living process started, clock ticks since boot; ``None`` if there is none.

    Not the time of day, as which a clock that is set would make a living owner look dead.
    """
    try:
        # "pid (name) state ... starttime ...", and the name may hold anything
        fields = Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] in "ZX" else int(fields[19])


def _is_abandoned(folder: Path) -> bool:
    match = _NAME.fullmatch(folder.name)
    return match is not None and _started(int(match[1])) != int(match[2])


def _users_of(folder: Path) -> list[psutil.Process]:
    marker = f"--user-data-dir={folder}{os.sep}"
    return [
        process
        for process in psutil.process_iter(["cmdline"])
        if any(part.startswith(marker) for part in process.info["cmdline"] or ())
    ]


def _shared_parent(temporary_root: Path | None) -> Path:
    parent = (temporary_root or Path(tempfile.gettempdir())) / f"webgym-{os.getuid()}"
    parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = parent.lstat()
    if parent.is_symlink() or found.st_uid != os.getuid():
        raise BrowserLaunchFailed(
            f"{parent} belongs to somebody else", hint="remove it, or set browser.temporary_root"
        )
    return parent


class ProfileRoot:
    """The folder of this process's browser profiles.

    Args:
        temporary_root: where to make it; ``None`` is the system's temporary folder.
    """

    def __init__(self, temporary_root: Path | None = None) -> None:
        self._parent = _shared_parent(temporary_root)
        self.path = self._parent / f"{os.getpid()}-{_started(os.getpid())}"
        self._count = 0

    def sweep(self) -> list[Path]:
        """Remove what dead servers left: their browsers first, then their folders. Returns the folders."""
        swept = []
        for folder in self._parent.iterdir():
            if _is_abandoned(folder):
                users = _users_of(folder)
                for process in users:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        process.kill()
                psutil.wait_procs(users, timeout=5)
                shutil.rmtree(folder, ignore_errors=True)
                swept.append(folder)
        return swept

    def new(self) -> Path:
        """A fresh, private folder for one browser."""
        self._count += 1
        while True:
            self.path.mkdir(mode=0o700, exist_ok=True)
            with contextlib.suppress(FileNotFoundError):  # its last browser's end removed it meanwhile
                return Path(tempfile.mkdtemp(prefix=f"{self._count}-", dir=self.path))

    async def remove(self, profile: Path) -> None:
        """Remove one browser's folder, and the root when it was the last."""
        await asyncio.to_thread(shutil.rmtree, profile, True)
        with contextlib.suppress(OSError):  # others still live in it
            self.path.rmdir()
