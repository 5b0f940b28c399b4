"""One record of a run: a line of JSON that carries its own checksum, and the index that finds it again.

A line is ``{"sha256":"<hex>","trajectory":<JSON>}``. The digest covers the exact bytes of the
trajectory's JSON, so that a record is proven whole without being understood, and stays readable by
anything that reads JSON lines.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from webgym.core.errors import StoreCorrupt, StoreError
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Trajectory

_OPEN = b'{"sha256":"'
_MIDDLE = b'","trajectory":'
_CLOSE = b"}\n"
_DIGEST = slice(len(_OPEN), len(_OPEN) + 64)
_BODY = slice(_DIGEST.stop + len(_MIDDLE), -len(_CLOSE))


class Entry(NamedTuple):
    """Where a trajectory lies, and what a resumed run needs to know about it without reading it."""

    attempt_id: str
    task_id: str
    sample: int
    retry: int
    outcome: Outcome
    shard: str
    offset: int
    length: int


class CorruptLine(NamedTuple):
    """A record that cannot be trusted.

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


_heads = msgspec.json.Decoder(_Head)
_trajectories = msgspec.json.Decoder(Trajectory)


def whole_text(value: Any) -> Any:
    """The same value with lone surrogates, which no UTF-8 file can hold, replaced by U+FFFD."""
    if isinstance(value, str):
        return value.encode("utf-16", "surrogatepass").decode("utf-16", "replace")
    if isinstance(value, dict):
        return {whole_text(key): whole_text(item) for key, item in value.items()}
    return [whole_text(item) for item in value] if isinstance(value, list | tuple) else value


def seal(trajectory: Trajectory) -> bytes:
    """The line that records this trajectory.

    Raises:
        StoreError: it holds something that would not read back, such as NaN for a duration.
    """
    try:
        try:
            body = msgspec.json.encode(trajectory)
        except UnicodeEncodeError:  # page text and replies may hold halves of a surrogate pair
            body = msgspec.json.encode(whole_text(msgspec.to_builtins(trajectory)))
        _trajectories.decode(body)
    except (msgspec.MsgspecError, TypeError, OverflowError) as error:
        raise StoreError(f"{trajectory.episode.attempt_id} would not read back: {error}") from error
    return b"".join((_OPEN, hashlib.sha256(body).hexdigest().encode(), _MIDDLE, body, _CLOSE))


def unseal(line: bytes) -> bytes:
    """The JSON of the trajectory that a line records.

    Raises:
        ValueError: with the reason, if the line is not whole.
    """
    framed = line.startswith(_OPEN) and line.endswith(_CLOSE) and line[_DIGEST.stop : _BODY.start] == _MIDDLE
    if not framed:
        raise ValueError("not a record")
    body = line[_BODY]
    if hashlib.sha256(body).hexdigest().encode() != line[_DIGEST]:
        raise ValueError("the checksum does not match")
    return body


def decode(line: bytes) -> Trajectory:
    """The trajectory that a line records.

    Raises:
        ValueError: with the reason, if the line is not whole or does not hold a trajectory.
    """
    return _trajectories.decode(unseal(line))  # msgspec's errors are ValueErrors


class Index:
    """What the shards of a run hold, verified, and kept up to date by reading only what is new.

    An attempt without a verdict may be recorded again, once it has one: the later record counts.

    Attributes:
        entries: the whole records by attempt id, in order.
        corrupt: the lines that are none.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: dict[str, tuple[int, int]] = {}
        self.entries: dict[str, Entry] = {}
        self.corrupt: list[CorruptLine] = []

    def shards(self) -> list[Path]:
        """The files of trajectories, oldest first."""
        return sorted(self._folder.glob("*.jsonl"))

    def end(self, shard: Path) -> int:
        """The offset after the last whole line that was read. A torn line, if any, begins here."""
        return self._read[shard.name][0]

    def refresh(self) -> None:
        """Read what was written since the last look, one line in memory at a time."""
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
                except ValueError as error:
                    name = f"{self._folder.name}/{shard.name}"
                    self.corrupt.append(CorruptLine(name, number, str(error)))
                offset += len(line)
        self._read[shard.name] = (offset, number)

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
    except ValueError as error:
        raise StoreCorrupt(f"{entry.attempt_id} in {shard}: {error}") from error


def complain(corrupt: list[CorruptLine]) -> StoreCorrupt:
    """One error for all the lines that cannot be trusted."""
    more = f" (and {len(corrupt) - 1} more)" if len(corrupt) > 1 else ""
    return StoreCorrupt(
        f"{corrupt[0]}{more}",
        hint="the other records are whole; --skip-corrupt goes on without the broken ones",
    )
