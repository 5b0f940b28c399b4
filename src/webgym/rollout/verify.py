"""Checks that a run is complete and intact, and sets aside records that are not.

Every record is read and compared with its checksum, every picture with its name. What cannot be trusted is
named; on demand it is moved to ``set-aside/`` in the run folder, under its own path. The rest is then a
whole run, and a resumed run makes those attempts anew. Nothing is ever deleted.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import msgspec

from webgym.core.errors import StoreCorrupt
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.rollout.files import (
    CONFIG,
    LOCK,
    METRICS,
    SCREENSHOTS,
    SET_ASIDE,
    SUMMARY,
    TASKS,
    TORN,
    TRAJECTORIES,
    VERDICTS,
    check_run,
    disk_errors,
    image_path,
    is_picture,
    sync_folder,
    take_lock,
    write_lines,
)
from webgym.rollout.records import decode, pictures
from webgym.rollout.store import RunReader
from webgym.rollout.verdicts import is_whole_verdict

HALF_WRITTEN: Final = "half-written"
_LOG: Final = "log.jsonl"


class Problem(NamedTuple):
    """Something in a run that cannot be trusted.

    Attributes:
        file: path relative to the run folder.
        line: from 1; 0 for the whole file.
        reason: what is wrong with it.
        is_set_aside: whether it was moved away.
    """

    file: str
    line: int
    reason: str
    is_set_aside: bool = False

    def __str__(self) -> str:
        place = f"{self.file} line {self.line}" if self.line else self.file
        return f"{place}: {self.reason}{' (set aside)' if self.is_set_aside else ''}"


class Findings(NamedTuple):
    """What a verification found.

    Attributes:
        trajectories: whole records.
        pictures: whole pictures.
        problems: the rest.
    """

    trajectories: int
    pictures: int
    problems: list[Problem]

    @property
    def is_whole(self) -> bool:
        """Whether all that is still in its place can be trusted."""
        return all(problem.is_set_aside for problem in self.problems)


class VerifyProgress(Protocol):
    """Is told how far a verification has come."""

    def __call__(self, what: str, done: int) -> None:
        """So many things of this kind (``"pictures"``, ``"trajectories"``) are verified."""
        ...


def quiet(what: str, done: int) -> None:
    """For those who do not ask."""


def verify(run: Path, *, set_aside: bool = False, progress: VerifyProgress = quiet) -> Findings:
    """Read all of a run and say what cannot be trusted. Blocks.

    Args:
        run: the run folder. It may be written to meanwhile, unless something is to be set aside.
        set_aside: move what cannot be trusted to ``set-aside/``. Settings and tasks stay: they are the run.
        progress: is told how far it has come.

    Raises:
        RunFolderError: the folder is no run.
        StoreLocked: a process writes to the run, and something is to be set aside.
        StoreFull: there is no space to set it aside.
    """
    check_run(run)
    with disk_errors(f"verifying {run}"):
        lock = take_lock(run) if set_aside else None
        try:
            verification = _Verification(run, set_aside, progress)
            verification.run()
        finally:
            if lock is not None:
                os.close(lock)
    return Findings(len(verification.attempts), len(verification.good), verification.problems)


class _Verification:
    def __init__(self, run: Path, set_aside: bool, progress: VerifyProgress) -> None:
        self.problems: list[Problem] = []
        self.good: set[bytes] = set()
        self.attempts: dict[str, Outcome] = {}
        self._run = run
        self._sets_aside = set_aside
        self._progress = progress
        self._is_growing = not set_aside and _is_written_to(run)

    def run(self) -> None:
        self._settings()
        self._pictures()
        for shard in sorted((self._run / TRAJECTORIES).glob("*.jsonl")):
            self._lines(shard, self._trajectory)
        for book in sorted((self._run / VERDICTS).glob("*.jsonl")):
            self._lines(book, lambda line: "" if is_whole_verdict(line) else "the checksum does not match")
        if (metrics := self._run / METRICS).exists():
            self._lines(metrics, _metric)
        if self._sets_aside and self.problems:
            sync_folder(self._run)

    def _settings(self) -> None:
        """The files that are written once."""
        reader = RunReader(self._run, skip_corrupt=True)
        for name, attribute in ((CONFIG, "config"), (SUMMARY, "summary")):
            try:
                getattr(reader, attribute)
            except StoreCorrupt as error:
                moved = name == SUMMARY and self._move(self._run / name)
                self._note(name, 0, error.message, moved=moved)
        self._lines(self._run / TASKS, _task, stays=True)

    def _pictures(self) -> None:
        files = sorted((self._run / SCREENSHOTS).glob("*/*"))
        with ThreadPoolExecutor(thread_name_prefix="verify") as pool:
            for number, (file, reason) in enumerate(zip(files, pool.map(_picture, files), strict=True), 1):
                self._progress("pictures", number)
                if not reason:
                    self.good.add(bytes.fromhex(file.stem))
                elif not (reason == HALF_WRITTEN and self._is_growing):
                    name = str(file.relative_to(self._run))
                    self._note(name, 0, reason, moved=self._move(file))

    def _trajectory(self, line: bytes) -> str:
        """What is wrong with the line of a shard."""
        try:
            trajectory = decode(line)
        except (ValueError, RecursionError) as error:
            return str(error)
        attempt_id = trajectory.episode.attempt_id
        if self.attempts.get(attempt_id, Outcome.JUDGE_ERROR) is not Outcome.JUDGE_ERROR:
            return f"{attempt_id} is recorded a second time"
        if missing := self._missing(trajectory):
            return f"{attempt_id} shows {len(missing)} pictures that are missing or broken, as {missing[0]}"
        self.attempts[attempt_id] = trajectory.outcome
        self._progress("trajectories", len(self.attempts))
        return ""

    def _missing(self, trajectory: Trajectory) -> list[str]:
        missing = []
        for name in sorted(pictures(trajectory)):
            if bytes.fromhex(name) not in self.good:
                if _picture(image_path(self._run, name)):
                    missing.append(name)
                else:  # it came while we read
                    self.good.add(bytes.fromhex(name))
        return missing

    def _lines(self, path: Path, reason_of: Callable[[bytes], str], *, stays: bool = False) -> None:
        """Check a file line by line; move those that cannot be trusted, unless all of it has to stay."""
        name, bad = str(path.relative_to(self._run)), dict[int, str]()
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                if line.endswith(b"\n"):
                    reason = reason_of(line)
                else:
                    reason = "" if self._is_growing else f"{HALF_WRITTEN}, {len(line)} bytes"
                if reason:
                    bad[number] = reason
        moves = self._sets_aside and not stays
        if bad and moves:
            target = self._target(path)
            write_lines(target, (line for number, line in _numbered(path) if number in bad), append=True)
            write_lines(path, (line for number, line in _numbered(path) if number not in bad))
        for number, reason in bad.items():
            self._note(name, number, reason, moved=moves)

    def _move(self, file: Path) -> bool:
        if self._sets_aside:
            file.replace(self._target(file))
        return self._sets_aside

    def _target(self, file: Path) -> Path:
        target = self._run / SET_ASIDE / file.relative_to(self._run)
        target.parent.mkdir(parents=True, exist_ok=True)
        return target

    def _note(self, name: str, line: int, reason: str, *, moved: bool) -> None:
        self.problems.append(Problem(name, line, reason, moved))
        if moved:
            told = {"at": time.time(), "file": name, "line": line, "reason": reason}
            log = self._run / SET_ASIDE / _LOG
            write_lines(log, [msgspec.json.encode(told) + b"\n"], append=True)


def _numbered(path: Path) -> Iterator[tuple[int, bytes]]:
    with path.open("rb") as file:
        yield from enumerate(file, 1)


def _picture(file: Path) -> str:
    """What is wrong with a picture."""
    if file.name.endswith(TORN):
        return HALF_WRITTEN
    if file.suffix != ".png" or not is_picture(file.stem) or file.parent.name != file.stem[:2]:
        return "not a picture of the store"
    try:
        with file.open("rb") as opened:
            digest = hashlib.file_digest(opened, "sha256").hexdigest()
    except (FileNotFoundError, IsADirectoryError):
        return "not there"
    return "" if digest == file.stem else "its content is not what its name says"


_tasks = msgspec.json.Decoder(Task)
_metrics = msgspec.json.Decoder(dict[str, Any])


def _task(line: bytes) -> str:
    return _problem(_tasks, line)


def _metric(line: bytes) -> str:
    return _problem(_metrics, line)


def _problem(decoder: msgspec.json.Decoder[Any], line: bytes) -> str:
    try:
        decoder.decode(line)
    except (ValueError, RecursionError) as error:
        return str(error)
    return ""


def _is_written_to(run: Path) -> bool:
    """Whether a process holds the run's lock now."""
    with _opened(run / LOCK) as fd:
        if fd is None:
            return False
        try:
            fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        return False


@contextmanager
def _opened(path: Path) -> Iterator[int | None]:
    try:
        fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except FileNotFoundError:
        yield None
        return
    try:
        yield fd
    finally:
        os.close(fd)
