"""The records of a run, ``{"sha256":"<hex>","trajectory":<JSON>}`` (:mod:`webgym.store.checksums`), and an
index of them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from webgym.core.errors import StoreCorrupt, StoreError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import ImageRef, Trajectory
from webgym.store.checksums import SealedLines, encode
from webgym.store.files import is_picture

_LINES = SealedLines("trajectory")


class Entry(NamedTuple):
    """Location of a trajectory's record, and what a resumed run needs to know without reading it."""

    attempt_id: str
    task_id: str
    sample: int
    retry: int
    outcome: Outcome
    shard: str
    offset: int
    length: int


class CorruptLine(NamedTuple):
    """A damaged record.

    Attributes:
        file: path relative to the run folder.
        line: from 1.
        reason: what is wrong with it.
    """

    file: str
    line: int
    reason: str

    def __str__(self) -> str:
        return f"{self.file} line {self.line}: {self.reason}"


class _EpisodeHead(msgspec.Struct):
    attempt_id: str
    task_id: str
    sample: int
    retry: int


class _Head(msgspec.Struct):
    episode: _EpisodeHead
    outcome: Outcome


_MOST_PIXELS = 2**26
"""Most pixels of a picture that a request shows; sessions have at most an eighth of it."""
_LAST_MOMENT = 253_402_300_800.0
"""Unix time of the start of the year 10000, which ``datetime`` cannot represent."""

_heads = msgspec.json.Decoder(_Head)
_trajectories = msgspec.json.Decoder(Trajectory)


def seal(trajectory: Trajectory) -> bytes:
    """The line that stores a trajectory.

    Raises:
        StoreError: the trajectory cannot be stored without loss, for example because a duration is NaN.
    """
    try:
        body = encode(trajectory)
        _trajectories.decode(body)
    except (msgspec.MsgspecError, TypeError, OverflowError) as error:
        raise StoreError(f"{trajectory.episode.attempt_id} cannot be stored: {error}") from error
    return _LINES.seal(body)


unseal = _LINES.unseal
"""The JSON of the trajectory in a line; a ``ValueError`` gives the reason why it is damaged."""


def decode(line: bytes) -> Trajectory:
    """The trajectory in a line.

    Raises:
        ValueError: the line is damaged or holds no trajectory; the message is the reason.
    """
    trajectory = _trajectories.decode(unseal(line))  # msgspec's errors are ValueErrors
    _refuse_impossible(trajectory)
    return trajectory


_NAME = re.compile(rb'"attempt_id":("(?:[^"\\]|\\.)*")')


def _attempt_ids_in(line: bytes) -> Iterator[str]:
    """The attempt ids in a damaged line that can still be read."""
    for found in _NAME.finditer(line):
        with suppress(ValueError):
            yield msgspec.json.decode(found.group(1), type=str)


def attempt_ids_in(folder: Path) -> Iterator[str]:
    """The attempt ids in all lines of a folder's shards, damaged or not; a line may be several joined."""
    for shard in folder.glob("*.jsonl"):
        with shard.open("rb") as lines:
            for line in lines:
                yield from _attempt_ids_in(line)


def pictures(trajectory: Trajectory) -> set[str]:
    """The names of all pictures in a trajectory's observations and messages."""
    names = {observation.screenshot for observation in trajectory.episode.observations}
    return names | {ref.screenshot for ref in _refs(trajectory)}


def _refs(trajectory: Trajectory) -> Iterator[ImageRef]:
    for step in trajectory.episode.steps:
        for message in step.messages:
            yield from (part for part in message.content if isinstance(part, ImageRef))


def _refuse_impossible(trajectory: Trajectory) -> None:
    """Refuse values that WebGym never writes and that could harm a reader of a run from elsewhere.

    Raises:
        ValueError: the trajectory holds such a value.
    """
    for name in pictures(trajectory):
        if not is_picture(name):
            raise ValueError(f"{name[:80]!r} does not name a picture")
    for observation in trajectory.episode.observations:
        if not all(0 < side < 2**16 for side in observation.viewport):
            raise ValueError(f"the viewport {observation.viewport} is invalid"[:80])
    for ref in _refs(trajectory):
        if not (0 < ref.width < 2**16 and 0 < ref.height < 2**16 and ref.width * ref.height <= _MOST_PIXELS):
            raise ValueError(f"the picture size {ref.width}×{ref.height} is invalid"[:80])
    if not 0 <= trajectory.episode.started_at < _LAST_MOMENT:
        raise ValueError("the start time is out of range")


class Index:
    """A verified index of a run's shards, which is updated by reading only new lines.

    An attempt without a verdict may be recorded again once it has one; the later record counts.

    Attributes:
        entries: the intact records by attempt id, in order.
        corrupt: the damaged lines.
        retired: attempt ids of damaged records, as far as they can be read.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[str, tuple[int, int]] = {}
        self.entries: dict[str, Entry] = {}
        self.corrupt: list[CorruptLine] = []
        self.retired: set[str] = set()

    def shards(self) -> list[Path]:
        """The files of trajectories, oldest first."""
        return sorted(self._folder.glob("*.jsonl"))

    def end(self, shard: Path) -> int:
        """The offset after the last complete line. An unfinished line, if any, begins there."""
        return self._read[shard.name][0]

    def refresh(self) -> None:
        """Read what was written since the last call, one line in memory at a time."""
        for shard in self.shards():
            if shard.stat().st_size != self._read.setdefault(shard.name, (0, 0))[0]:
                self._scan(shard)

    def _scan(self, shard: Path) -> None:
        offset, number = self._read[shard.name]
        with shard.open("rb") as file:
            file.seek(offset)
            for line in file:
                if not line.endswith(b"\n"):
                    break
                number += 1
                try:
                    self._add(_heads.decode(unseal(line)), shard.name, offset, len(line))
                except (ValueError, RecursionError) as error:
                    self._note(shard, number, error)
                    if name := next(_attempt_ids_in(line), None):
                        self.retired.add(name)
                offset += len(line)
        self._read[shard.name] = (offset, number)

    def drop(self, entry: Entry, error: BaseException) -> None:
        """Drop a record whose checksum matches but which is not a trajectory."""
        shard = self._folder / entry.shard
        with shard.open("rb") as file:
            self._note(shard, file.read(entry.offset).count(b"\n") + 1, error)
        del self.entries[entry.attempt_id]
        self.retired.add(entry.attempt_id)

    def _note(self, shard: Path, number: int, error: BaseException) -> None:
        self.corrupt.append(CorruptLine(f"{self._folder.name}/{shard.name}", number, str(error)))

    def _add(self, head: _Head, *place: Any) -> None:
        e = head.episode
        known = self.entries.get(e.attempt_id)
        if known is not None and known.outcome is not Outcome.JUDGE_ERROR:
            raise ValueError(f"{e.attempt_id} is recorded a second time")
        self.entries[e.attempt_id] = Entry(e.attempt_id, e.task_id, e.sample, e.retry, head.outcome, *place)


def read_at(shard: Path, entry: Entry) -> Trajectory:
    """The trajectory of an index entry.

    Raises:
        StoreCorrupt: the record changed since it was indexed, or does not hold a trajectory.
    """
    with shard.open("rb") as file:
        file.seek(entry.offset)
        line = file.read(entry.length)
    try:
        return decode(line)
    except (ValueError, RecursionError) as error:
        raise StoreCorrupt(f"{entry.attempt_id} in {shard}: {error}") from error


def corruption_error(corrupt: list[CorruptLine]) -> StoreCorrupt:
    """An error that reports all damaged lines."""
    more = f" (and {len(corrupt) - 1} more)" if len(corrupt) > 1 else ""
    return StoreCorrupt(
        f"{corrupt[0]}{more}",
        hint="the other records are intact; webgym verify --set-aside RUN moves the damaged ones away",
    )
