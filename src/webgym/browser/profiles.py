"""Temporary browser profiles, which the next server removes if a server dies without cleaning up.

Every server keeps its profiles in one folder, on which it holds a lock. The system releases the lock when the
process ends, for any reason, and not before: unlike checks by process id or time, it is not confused by
reused ids, clock changes or containers. The next server to start removes the folders that are not locked,
and ends any processes that still use them.
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
"""How long to wait for a killed process of a dead server to end. What it writes in the meantime is removed
next time."""


def _locked(folder: Path, *, wait: bool) -> int | None:
    """Lock a folder. Returns the descriptor that holds the lock; ``None`` if another process holds it, or the
    folder is gone."""
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
    status = parent.lstat()
    if parent.is_symlink() or status.st_uid != os.getuid():
        raise BrowserLaunchFailed(
            f"{parent} belongs to another user", hint="remove it, or set browser.temporary_root"
        )
    return parent


class ProfileRoot:
    """The folder of one server's browser profiles. Its methods may be called from any thread.

    Args:
        temporary_root: folder to create it in; ``None`` is the system's temporary folder.
    """

    def __init__(self, temporary_root: Path | None = None) -> None:
        self._temporary_root = temporary_root
        self._parent = _shared_parent(temporary_root)
        self.path = self._parent / f"{os.getpid()}-{secrets.token_hex(4)}"
        self._count = 0
        self._lock: int | None = None
        self._remaining: list[Path] = []
        self._mutex = threading.Lock()

    def sweep(self) -> list[Path]:
        """Remove the profiles of dead servers: end their browsers, then delete their folders. Returns
        these."""
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
            OSError: it cannot be created.
        """
        with self._mutex:
            self._count += 1
            try:
                while self._lock is None:
                    _shared_parent(self._temporary_root)  # the system may have removed an unused one
                    self.path.mkdir(mode=0o700, exist_ok=True)
                    self._lock = _locked(self.path, wait=True)  # None if a sweep removed it first
                return Path(tempfile.mkdtemp(prefix=f"{self._count}-", dir=self.path))
            except OSError:
                self._remove_if_empty()
                raise

    async def remove(self, profile: Path) -> None:
        """Remove one browser's folder, and the root if it is then empty."""
        await asyncio.to_thread(self._remove, profile)

    def _remove(self, profile: Path) -> None:
        shutil.rmtree(profile, ignore_errors=True)
        with self._mutex:
            # What could not be removed, for example without a free descriptor, is retried next time.
            self._remaining = [folder for folder in (*self._remaining, profile) if folder.exists()]
            for folder in self._remaining:
                shutil.rmtree(folder, ignore_errors=True)
            self._remove_if_empty()

    def _remove_if_empty(self) -> None:
        """Remove the root, and release its lock, if it is empty."""
        with contextlib.suppress(OSError):  # it is not empty
            self.path.rmdir()
        if self._lock is not None and not self.path.exists():
            os.close(self._lock)
            self._lock = None
