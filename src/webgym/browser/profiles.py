"""Temporary browser profiles that a dead server cannot leave behind.

Every server keeps its profiles in one folder, which it holds locked. The system lets the lock go when the
process ends, however it ends, and nobody else can take it before: no process id that was given out again, no
clock that was set and no container that sees other processes makes a living server look dead. The next
server to start sweeps the folders that nobody holds, and any process that still uses them.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import secrets
import shutil
import tempfile
import threading
from pathlib import Path

import psutil

from webgym.core.errors import BrowserLaunchFailed

_END_SECONDS = 5.0
"""For a killed process of a dead server to be gone. What it still writes meanwhile is swept next time."""


def _locked(folder: Path, *, wait: bool) -> int | None:
    """A descriptor that holds a folder's lock; ``None`` if somebody else holds it, or the folder is gone."""
    try:
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError):
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        if os.path.samestat(os.fstat(descriptor), folder.lstat()):
            return descriptor
    except (BlockingIOError, FileNotFoundError):
        pass
    except BaseException:
        os.close(descriptor)
        raise
    os.close(descriptor)
    return None


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
    """The folder of one server's browser profiles. Its methods may be called from any thread.

    Args:
        temporary_root: where to make it; ``None`` is the system's temporary folder.
    """

    def __init__(self, temporary_root: Path | None = None) -> None:
        self._temporary_root = temporary_root
        self._parent = _shared_parent(temporary_root)
        self.path = self._parent / f"{os.getpid()}-{secrets.token_hex(4)}"
        self._count = 0
        self._lock: int | None = None
        self._stayed: list[Path] = []
        self._turn = threading.Lock()

    def sweep(self) -> list[Path]:
        """Remove what dead servers left: their browsers first, then their folders. Returns the folders."""
        swept = []
        for folder in self._parent.iterdir():
            lock = _locked(folder, wait=False)
            if lock is None:
                continue
            try:
                users = _users_of(folder)
                for process in users:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        process.kill()
                psutil.wait_procs(users, timeout=_END_SECONDS)
                shutil.rmtree(folder, ignore_errors=True)
            finally:
                os.close(lock)
            swept.append(folder)
        return swept

    def new(self) -> Path:
        """A fresh, private folder for one browser.

        Raises:
            OSError: it cannot be made.
        """
        with self._turn:
            self._count += 1
            try:
                while self._lock is None:
                    _shared_parent(
                        self._temporary_root
                    )  # temporary folders are tidied while nobody uses them
                    self.path.mkdir(mode=0o700, exist_ok=True)
                    self._lock = _locked(self.path, wait=True)  # none if a sweep was quicker
                return Path(tempfile.mkdtemp(prefix=f"{self._count}-", dir=self.path))
            except OSError:
                self._leave()
                raise

    async def remove(self, profile: Path) -> None:
        """Remove one browser's folder, and the root when it was the last."""
        await asyncio.to_thread(self._remove, profile)

    def _remove(self, profile: Path) -> None:
        shutil.rmtree(profile, ignore_errors=True)
        with self._turn:
            # What stays, say for want of a descriptor, is tried again at the next one's end.
            self._stayed = [folder for folder in (*self._stayed, profile) if folder.exists()]
            for folder in self._stayed:
                shutil.rmtree(folder, ignore_errors=True)
            self._leave()

    def _leave(self) -> None:
        """Give the root up if nothing is in it."""
        with contextlib.suppress(OSError):  # others still live in it
            self.path.rmdir()
        if self._lock is not None and not self.path.exists():
            os.close(self._lock)
            self._lock = None
