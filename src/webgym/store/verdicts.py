"""Verdicts made after a run was collected, stored separately from its trajectories, which never change.

``verdicts/<judge>.jsonl`` in the run folder has one checksummed line per judgement,
``{"sha256":"<hex>","judged":<JSON>}``, synced before it counts. A judge's name covers everything that can
change its verdicts, so that other models, rules or settings use other files. A later line about an attempt
replaces an earlier one.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Self

import msgspec

from webgym.core.errors import StoreError, StoreLocked
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Failure
from webgym.core.verdict import Verdict
from webgym.store.checksums import SealedLines, encode
from webgym.store.files import VERDICTS, Log, disk_errors, last_line_end

_LINES = SealedLines("judged")


class Judged(msgspec.Struct, frozen=True, omit_defaults=True):
    """A judge's verdict on an attempt.

    Attributes:
        attempt_id: the attempt.
        judge: its name.
        outcome: of the attempt, according to this judge.
        at: time of the judgement, Unix time, seconds.
        seconds: wall time of judging.
        verdict: ``None`` if there is none.
        failure: why there is no verdict.
    """

    attempt_id: str
    judge: str
    outcome: Outcome
    at: float
    seconds: float
    verdict: Verdict | None = None
    failure: Failure | None = None


_decoder = msgspec.json.Decoder(Judged)


def _unseal(line: bytes) -> Judged | None:
    """The record in a line; ``None`` if it is damaged."""
    try:
        return _decoder.decode(_LINES.unseal(line))
    except ValueError:
        return None


def is_whole_verdict(line: bytes) -> bool:
    """Whether a line of a file of verdicts is intact."""
    return _unseal(line) is not None


def verdicts_path(run: Path, judge: str) -> Path:
    """The file of a judge's verdicts on a run."""
    readable = re.sub(r"[^a-z0-9.]+", "-", judge.casefold()).strip("-.")[:60]
    return run / VERDICTS / f"{readable}-{hashlib.sha256(judge.encode()).hexdigest()[:8]}.jsonl"


def _read(path: Path) -> Iterator[Judged]:
    """The intact records of a file, in order. Attempts of damaged lines are judged again."""
    with disk_errors(f"reading {path}"), path.open("rb") as file:
        for line in file:
            if (judged := _unseal(line)) is not None:
                yield judged


def read_verdicts(run: Path) -> dict[str, dict[str, Judged]]:
    """All verdicts on a run: by judge's name, then by attempt."""
    verdicts: dict[str, dict[str, Judged]] = {}
    for path in sorted((run / VERDICTS).glob("*.jsonl")):
        for judged in _read(path):
            verdicts.setdefault(judged.judge, {})[judged.attempt_id] = judged
    return verdicts


class VerdictReader:
    """Reads the verdicts on a run by attempt; rereads only files that have changed since the last call.

    Args:
        run: the run folder.
    """

    def __init__(self, run: Path) -> None:
        self._folder = run / VERDICTS
        self._sizes: dict[Path, int] = {}
        self._verdicts: dict[Path, dict[str, Judged]] = {}

    def of(self, attempt_id: str) -> list[Judged]:
        """The latest verdict of every judge on an attempt, sorted by the judges' names. Blocks."""
        for path in self._folder.glob("*.jsonl"):
            if self._sizes.get(path) != (size := path.stat().st_size):
                self._verdicts[path] = {judged.attempt_id: judged for judged in _read(path)}
                self._sizes[path] = size
        latest = [verdicts[attempt_id] for verdicts in self._verdicts.values() if attempt_id in verdicts]
        return sorted(latest, key=lambda judged: judged.judge)


class VerdictLog:
    """One judge's verdicts on a run, open for writing. A killed process loses no stored verdict.

    Args:
        run: the run folder.
        judge: the judge's name.

    Raises:
        StoreLocked: another process writes to it.
        StoreError: it cannot be opened.
    """

    def __init__(self, run: Path, judge: str) -> None:
        self.path = verdicts_path(run, judge)
        self._judge = judge
        with disk_errors(f"opening {self.path}"):
            self.path.parent.mkdir(exist_ok=True)
            self._lock = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                os.truncate(self.path, last_line_end(self.path))
                self._log = Log(self.path)
            except BlockingIOError as error:
                os.close(self._lock)
                raise StoreLocked(
                    f"another process judges this run as {judge}", hint="wait for it to end, or stop it"
                ) from error
            except BaseException:
                os.close(self._lock)
                raise
        self._latest = {judged.attempt_id: judged for judged in _read(self.path)}

    @property
    def latest(self) -> Mapping[str, Judged]:
        """The latest judgement on each attempt."""
        return self._latest

    def append(self, judged: Judged) -> None:
        """Record a judgement: on disk when this returns. Blocks.

        Raises:
            StoreFull: there is no space; the file is as it was.
            StoreError: the judgement is another judge's.
        """
        if judged.judge != self._judge:
            raise StoreError(f"a verdict of {judged.judge} does not belong to {self._judge}")
        with disk_errors("writing a verdict"):
            self._log.append(_LINES.seal(encode(judged)), durable=True)
        self._latest[judged.attempt_id] = judged

    def close(self) -> None:
        """Close the file and release its lock."""
        self._log.close()
        os.close(self._lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
