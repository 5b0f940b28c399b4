"""Layout of the run store, and atomic, durable writes to it.

All functions do blocking I/O: call them in a thread.
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
SITES = "sites.jsonl"
LIVE = "live.json"
SUMMARY = "summary.json"
VERDICTS = "verdicts"
SET_ASIDE = "set-aside"
REPORT = "report.html"
ITERATIONS = "iterations"
EVALUATIONS = "evaluations"
"""Subfolders of a training folder (webgym.train.folder): its iterations, and its evaluations, which are
runs."""
LOCK = ".lock"
LEASES = ".leases"
TORN = ".tmp"
"""Suffix of a temporary file that is being written."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_NAME = re.compile(r"[0-9a-f]{64}")


def is_picture(name: str) -> bool:
    """Whether this is a valid name of a picture in the store: a SHA-256 in hex."""
    return _NAME.fullmatch(name) is not None


def image_path(run: Path, name: str) -> Path:
    """The path of a picture in a run folder.

    Raises:
        StoreError: the name is not a SHA-256 in hex.
    """
    if not is_picture(name):
        raise StoreError(f"{name[:80]!r} does not name a picture")
    return run / SCREENSHOTS / name[:2] / f"{name}.png"


def is_training(path: Path) -> bool:
    """Whether a folder is a training, not a run."""
    return (path / ITERATIONS).is_dir() or (path / EVALUATIONS).is_dir()


def check_run(path: Path) -> None:
    """Check that a folder is a run.

    Raises:
        RunFolderError: it is not; of a training, the message names its runs.
    """
    if is_training(path):
        kinds = (f"{ITERATIONS}/*/run/{CONFIG}", f"{EVALUATIONS}/*/{CONFIG}")
        found_of = (sorted(path.glob(kind)) for kind in kinds)
        runs = "".join(f"{found[0].parent}, " for found in found_of if found)
        raise RunFolderError(
            f"{path} is a training, not a run",
            hint=f"its runs are {runs}..." if runs else "it has no run yet",
        )
    _check_file(path, CONFIG)
    refuse_special_files(path, path / TRAJECTORIES, path / VERDICTS)


def check_tasks(path: Path) -> None:
    """Check that a run has its list of tasks.

    Raises:
        RunFolderError: it has not.
    """
    _check_file(path, TASKS)


def _check_file(path: Path, name: str) -> None:
    if not (path / name).is_file():
        raise RunFolderError(
            f"{path} is not a run: " + (f"it has no {name}" if path.exists() else "it does not exist"),
            hint="give the folder that webgym demo or webgym rollout wrote",
        )


def refuse_special_files(*folders: Path) -> None:
    """Refuse folders with pipes, devices or sockets in place of files: reading one may never end.

    Args:
        folders: those that do not exist are ignored.

    Raises:
        RunFolderError: there is one.
    """
    for folder in folders:
        for path in folder.glob("*"):
            if path.exists() and not path.is_file() and not path.is_dir():
                raise RunFolderError(f"{path} is a pipe, a device or a socket", hint="delete it")


@contextmanager
def disk_errors(doing: str, then: str = "resume with --resume") -> Iterator[None]:
    """Turn errors of the file system into errors of the store.

    Args:
        doing: what is being done, for the message, e.g. ``"writing metrics"``.
        then: what to do once there is space.
    """
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StoreFull(
                f"no space left while {doing}", hint=f"no record is lost: free some space, then {then}"
            ) from error
        raise StoreError(f"cannot continue {doing}: {error}") from error


def make_folder(path: Path) -> None:
    """Create a command's output folder, if it does not exist.

    Raises:
        RunFolderError: it cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunFolderError(f"cannot create the folder {path}: {error.strerror}") from error


def refuse_used(path: Path) -> None:
    """Refuse an output folder that holds more than temporary files of a process that was killed.

    Raises:
        RunFolderError: it is not empty.
    """
    if any(not entry.name.endswith(TORN) for entry in path.iterdir()):
        raise RunFolderError(f"{path} is not empty", hint="choose another folder")


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Write a folder whose content appears when it is complete, and not at all if that fails.

    Args:
        path: it must not exist, or be empty.

    Yields:
        the folder to write to, inside of ``path``.

    Raises:
        RunFolderError: it is not empty, or cannot be created.
        StoreLocked: another process writes it.
    """
    is_new = not path.exists()
    make_folder(path)
    with _one_writer(path):
        refuse_used(path)
        unfinished = path / f".unfinished{TORN}"
        shutil.rmtree(unfinished, ignore_errors=True)  # of a process that was killed
        try:
            make_folder(unfinished)
            yield unfinished
            with disk_errors(f"creating {path}"):
                for entry in sorted(unfinished.iterdir(), key=lambda entry: entry.name == CONFIG):
                    entry.rename(path / entry.name)  # a folder with a config.yaml is a run: it comes last
                unfinished.rmdir()
        except BaseException:
            shutil.rmtree(path if is_new else unfinished, ignore_errors=True)
            raise


@contextmanager
def _one_writer(folder: Path) -> Iterator[None]:
    """Lock a folder itself, as a file for that would be left in it."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise StoreLocked(
                f"another process is writing to {folder}", hint="wait for it to end, or stop it"
            ) from None
        except OSError:  # NFS cannot lock folders: there, two writers are not noticed
            pass
        yield
    finally:
        os.close(fd)


def sync_folder(path: Path) -> None:
    """Sync a folder, so that new names of files in it are durable."""
    fd = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_whole(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Write a file atomically. If ``durable``, its content is synced; its name once the folder is synced."""
    write_lines(path, [data], durable=durable)


def write_lines(path: Path, lines: Iterable[bytes], *, append: bool = False, durable: bool = True) -> None:
    """Write a file atomically from parts, or append them to it."""
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
    """Delete temporary files of a process that died.

    Args:
        path: a folder to which only this process writes.
        folders: subfolders to search, as patterns; ``""`` is the folder itself.
    """
    for folder in folders:
        for torn in path.glob(f"{folder}.*{TORN}"):
            shutil.rmtree(torn) if torn.is_dir() else torn.unlink()


def last_line_end(path: Path) -> int:
    """The offset after the last complete line."""
    end = 0
    with path.open("rb") as file:
        for line in file:
            if line.endswith(b"\n"):
                end += len(line)
    return end


class Log:
    """A file to which complete lines are appended. Used from one thread at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        is_new = not path.exists()
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self.size = os.fstat(self._fd).st_size
        if is_new:
            sync_folder(path.parent)

    def append(self, line: bytes, *, durable: bool) -> None:
        """Append a line; if that fails, the file is unchanged.

        Args:
            line: the line, with its end.
            durable: sync it, after a check that the file is still in its place: otherwise it would be lost.
        """
        if durable and not os.path.samestat(os.fstat(self._fd), self.path.stat()):
            raise OSError(errno.ESTALE, "another file took its place", str(self.path))
        try:
            remaining = memoryview(line)
            while remaining:
                remaining = remaining[os.write(self._fd, remaining) :]
            if durable:
                os.fsync(self._fd)
        except OSError:
            os.ftruncate(self._fd, self.size)
            raise
        self.size += len(line)

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)


def take_lock(path: Path) -> int:
    """Lock a run folder for this process, until the returned descriptor is closed.

    Raises:
        StoreLocked: another process has the lock.
    """
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


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a folder for this process.

    Raises:
        StoreLocked: another process has the lock.
    """
    with disk_errors(f"opening {path}"):
        lock = take_lock(path)
    try:
        yield
    finally:
        os.close(lock)
