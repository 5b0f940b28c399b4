"""Checks that a run is complete and intact, and sets aside records that are not.

Every record is compared with its checksum, every picture with its name. Damaged records and files are
reported and, on demand, moved to ``set-aside/`` in the run folder, under the same path. The rest is then an
intact run, which repeats those attempts when it is resumed. Nothing is deleted.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import msgspec

from webgym.core.errors import StoreCorrupt
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.text import counted, plain
from webgym.core.trajectory import Trajectory
from webgym.store import files
from webgym.store.records import decode, pictures
from webgym.store.runs import RunReader
from webgym.store.verdicts import is_whole_verdict

HALF_WRITTEN: Final = "half-written"
_LOG: Final = "log.jsonl"


class Problem(NamedTuple):
    """A damaged record or file of a run.

    Attributes:
        file: path relative to the run folder.
        line: from 1; 0 for the whole file.
        reason: what is wrong with it.
        is_set_aside: whether it was moved to ``set-aside/``.
    """

    file: str
    line: int
    reason: str
    is_set_aside: bool = False

    def __str__(self) -> str:
        place = f"{self.file} line {self.line}" if self.line else self.file
        return f"{place}: {self.reason}{' (set aside)' if self.is_set_aside else ''}"


class Findings(NamedTuple):
    """The result of a verification.

    Attributes:
        trajectories: number of intact records.
        pictures: number of intact pictures.
        problems: the damaged records and files.
    """

    trajectories: int
    pictures: int
    problems: list[Problem]

    @property
    def is_whole(self) -> bool:
        """Whether everything that is not set aside is intact."""
        return all(problem.is_set_aside for problem in self.problems)

    def __str__(self) -> str:
        lines = [plain(str(problem)) for problem in self.problems]
        lines.append(f"{self.trajectories} trajectories and {self.pictures} pictures are intact")
        return "\n".join(lines if self.is_whole else [*lines, counted(len(self.problems), "problem")])


VerifyProgress: TypeAlias = Callable[[str, int], None]
"""Called with a kind of items (``"pictures"``, ``"trajectories"``), and how many of them are verified."""


def verify(run: Path, *, set_aside: bool = False, progress: VerifyProgress = lambda *_: None) -> Findings:
    """Read all of a run and report what is damaged. Blocks.

    Args:
        run: the run folder. It may be written to meanwhile, unless ``set_aside`` is set.
        set_aside: move what is damaged to ``set-aside/``, except for config and tasks.
        progress: called with the progress.

    Raises:
        RunFolderError: the folder is not a run folder.
        StoreLocked: a process writes to the run, and ``set_aside`` is set.
        StoreFull: there is no space for ``set-aside/``.
    """
    files.check_run(run)
    files.check_tasks(run)
    with files.disk_errors(f"verifying {run}"):
        lock = files.take_lock(run) if set_aside else None
        try:
            verification = _Verification(run, set_aside, progress)
            verification.run()
        finally:
            if lock is not None:
                os.close(lock)
    return Findings(len(verification.attempts), len(verification.intact_pictures), verification.problems)


class _Verification:
    def __init__(self, run: Path, set_aside: bool, progress: VerifyProgress) -> None:
        self.problems: list[Problem] = []
        self.intact_pictures: set[bytes] = set()
        self.attempts: dict[str, Outcome] = {}
        self._without_task: list[str] = []
        self._run = run
        self._sets_aside = set_aside
        self._progress = progress
        self._is_growing = not set_aside and _is_written_to(run)

    def run(self) -> None:
        self._settings()
        self._pictures()
        for shard in sorted((self._run / files.TRAJECTORIES).glob("*.jsonl")):
            self._lines(shard, self._trajectory)
        if self._without_task:
            count, first = len(self._without_task), self._without_task[0]
            lack = "1 attempt lacks its task" if count == 1 else f"{count} attempts lack their tasks"
            self._note(files.TASKS, 0, f"{lack}, as {first}", moved=False)
        for verdict_file in sorted((self._run / files.VERDICTS).glob("*.jsonl")):
            self._lines(
                verdict_file, lambda line: "" if is_whole_verdict(line) else "the checksum does not match"
            )
        if (metrics := self._run / files.METRICS).exists():
            self._lines(metrics, partial(_problem, _metrics))
        if self._sets_aside and self.problems:
            files.sync_folder(self._run)

    def _settings(self) -> None:
        """Check the config, the summary and the tasks."""
        reader = RunReader(self._run, skip_corrupt=True)
        for name, attribute in ((files.CONFIG, "config"), (files.SUMMARY, "summary")):
            try:
                getattr(reader, attribute)
            except StoreCorrupt as error:
                moved = name == files.SUMMARY and self._move(self._run / name)
                self._note(name, 0, error.message, moved=moved)
        self._lines(self._run / files.TASKS, partial(_problem, _tasks), stays=True)
        self._tasks = reader.tasks

    def _pictures(self) -> None:
        stored = sorted((self._run / files.SCREENSHOTS).glob("*/*"))
        with ThreadPoolExecutor(thread_name_prefix="verify") as pool:
            for number, (file, reason) in enumerate(zip(stored, pool.map(_picture, stored), strict=True), 1):
                self._progress("pictures", number)
                if not reason:
                    self.intact_pictures.add(bytes.fromhex(file.stem))
                elif not (reason == HALF_WRITTEN and self._is_growing):
                    name = str(file.relative_to(self._run))
                    self._note(name, 0, reason, moved=self._move(file))

    def _trajectory(self, line: bytes) -> str:
        """What is wrong with a line of a shard; empty if nothing."""
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
        if trajectory.episode.task_id not in self._tasks:
            self._without_task.append(attempt_id)
        self._progress("trajectories", len(self.attempts))
        return ""

    def _missing(self, trajectory: Trajectory) -> list[str]:
        missing = []
        for name in sorted(pictures(trajectory)):
            if bytes.fromhex(name) not in self.intact_pictures:
                if _picture(files.image_path(self._run, name)):
                    missing.append(name)
                else:  # it was written meanwhile
                    self.intact_pictures.add(bytes.fromhex(name))
        return missing

    def _lines(self, path: Path, reason_of: Callable[[bytes], str], *, stays: bool = False) -> None:
        """Check a file line by line; move damaged lines, unless ``stays`` is set."""
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
            moved = (line.rstrip(b"\n") + b"\n" for number, line in _numbered(path) if number in bad)
            files.write_lines(target, moved, append=True)
            files.write_lines(path, (line for number, line in _numbered(path) if number not in bad))
        for number, reason in bad.items():
            self._note(name, number, reason, moved=moves)

    def _move(self, file: Path) -> bool:
        if self._sets_aside:
            file.replace(self._target(file))
        return self._sets_aside

    def _target(self, file: Path) -> Path:
        target = self._run / files.SET_ASIDE / file.relative_to(self._run)
        target.parent.mkdir(parents=True, exist_ok=True)
        return target

    def _note(self, name: str, line: int, reason: str, *, moved: bool) -> None:
        self.problems.append(Problem(name, line, reason, moved))
        if moved:
            entry = {"at": time.time(), "file": name, "line": line, "reason": reason}
            log = self._run / files.SET_ASIDE / _LOG
            files.write_lines(log, [msgspec.json.encode(entry) + b"\n"], append=True)


def _numbered(path: Path) -> Iterator[tuple[int, bytes]]:
    with path.open("rb") as file:
        yield from enumerate(file, 1)


def _picture(file: Path) -> str:
    """What is wrong with a picture; empty if nothing."""
    if file.name.endswith(files.TORN):
        return HALF_WRITTEN
    if file.suffix != ".png" or not files.is_picture(file.stem) or file.parent.name != file.stem[:2]:
        return "not a picture of the store"
    try:
        with file.open("rb") as opened:
            digest = hashlib.file_digest(opened, "sha256").hexdigest()
    except (FileNotFoundError, IsADirectoryError):
        return "missing"
    return "" if digest == file.stem else "the content does not match the name"


_tasks = msgspec.json.Decoder(Task)
_metrics = msgspec.json.Decoder(dict[str, Any])


def _problem(decoder: msgspec.json.Decoder[Any], line: bytes) -> str:
    try:
        decoder.decode(line)
    except (ValueError, RecursionError) as error:
        return str(error)
    return ""


def _is_written_to(run: Path) -> bool:
    """Whether a process holds the run's lock."""
    with _opened(run / files.LOCK) as fd:
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
