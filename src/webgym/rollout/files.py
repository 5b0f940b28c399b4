"""Layout of the run store, and atomic, durable writes to it.

Everything here blocks and belongs in a thread.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from webgym.core.errors import RunFolderError, StoreError, StoreFull, StoreLocked

CONFIG = "config.yaml"
TASKS = "tasks.jsonl"
TRAJECTORIES = "trajectories"
SCREENSHOTS = "screenshots"
METRICS = "metrics.jsonl"
LIVE = "live.json"
SUMMARY = "summary.json"
VERDICTS = "verdicts"
SET_ASIDE = "set-aside"
REPORT = "report.html"
ITERATIONS = "iterations"
EVALUATIONS = "evaluations"
"""Of a training folder (webgym.train.folder): its iterations, and its evaluations, which are runs."""
LOCK = ".lock"
TORN = ".tmp"
"""Suffix of a file that is being written and does not count yet."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NAME = re.compile(r"[0-9a-f]{64}")


def is_picture(name: str) -> bool:
    """Whether this is a name as the store gives it to pictures: a SHA-256 in hex, so no path."""
    return _NAME.fullmatch(name) is not None


def image_path(run: Path, name: str) -> Path:
    """Where the picture of this name lies in a run folder.

    Raises:
        StoreError: the name is not a SHA-256 in hex.
    """
    if not is_picture(name):
        raise StoreError(f"{name[:80]!r} does not name a picture")
    return run / SCREENSHOTS / name[:2] / f"{name}.png"


def check_run(path: Path) -> None:
    """Be sure that a folder is a run.

    Raises:
        RunFolderError: it is not.
    """
    if not (path / CONFIG).is_file():
        raise RunFolderError(
            f"{path} is not a run: it has no {CONFIG}",
            hint="give the folder that webgym demo or webgym rollout wrote",
        )


@contextmanager
def disk_errors(doing: str) -> Iterator[None]:
    """Errors of the file system, as errors of the store."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StoreFull(
                f"no space left while {doing}",
                hint="nothing counted is lost: free some space, then resume with --resume",
            ) from error
        raise StoreError(f"cannot go on {doing}: {error}") from error


def make_folder(path: Path) -> None:
    """Make the folder that a command was given to write to.

    Raises:
        RunFolderError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot make the folder {path}: {error.strerror}") from error


def sync_folder(path: Path) -> None:
    """Make names in a folder as durable as the files they name."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_whole(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Write a file whole or not at all. If durable, so is its name once its folder is synced."""
    write_lines(path, [data], durable=durable)


def write_lines(path: Path, lines: Iterable[bytes], *, append: bool = False, durable: bool = True) -> None:
    """Write a file as its parts come, whole or not at all, or add them to its end."""
    if append:
        with path.open("ab") as file:
            _write(file, lines, durable=durable)
        return
    torn = path.with_name(f".{path.name}.{uuid.uuid4().hex}{TORN}")
    try:
        with torn.open("wb") as file:
            _write(file, lines, durable=durable)
        torn.replace(path)
    except BaseException:
        torn.unlink(missing_ok=True)
        raise


def _write(file: BinaryIO, lines: Iterable[bytes], *, durable: bool) -> None:
    file.writelines(lines)
    if durable:
        file.flush()
        os.fsync(file.fileno())


def delete_torn(path: Path, *folders: str) -> None:
    """Delete what a process that died was writing.

    Args:
        path: a folder that this process alone writes to.
        folders: where in it to look, as patterns; ``""`` is the folder itself.
    """
    for folder in folders:
        for torn in path.glob(f"{folder}.*{TORN}"):
            shutil.rmtree(torn) if torn.is_dir() else torn.unlink()


def last_line_end(path: Path) -> int:
    """The offset after the last line that ends."""
    end = 0
    with path.open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                end += len(line)
    return end


class Log:
    """A file that grows by whole lines. Used from one thread at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        is_new = not path.exists()
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self.size = os.fstat(self._fd).st_size
        if is_new:
            sync_folder(path.parent)

    def append(self, line: bytes, *, durable: bool) -> None:
        """Add a line, or leave the file as it was."""
        try:
            rest = memoryview(line)
            while rest:
                rest = rest[os.write(self._fd, rest) :]
            if durable:
                os.fsync(self._fd)
        except OSError:
            os.ftruncate(self._fd, self.size)
            raise
        self.size += len(line)

    def close(self) -> None:
        """Let the file go."""
        os.close(self._fd)


def take_lock(path: Path) -> int:
    """Take a run folder for this process, for as long as the returned descriptor stays open."""
    fd = os.open(path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.truncate(fd, 0)
        os.pwrite(fd, str(os.getpid()).encode(), 0)
    except BlockingIOError as error:
        holder = os.pread(fd, 32, 0).decode(errors="replace") or "unknown"
        os.close(fd)
        raise StoreLocked(
            f"process {holder} is writing to {path}", hint="wait for it to end, or stop it"
        ) from error
    except BaseException:
        os.close(fd)
        raise
    return fd
