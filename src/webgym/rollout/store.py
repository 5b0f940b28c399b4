"""The run store: a run is a folder of plain files, written once and never lost.

    RUN/
      config.yaml               everything resolved; its presence makes the folder a run
      tasks.jsonl               the tasks as they were drawn, hidden truth included: a run can be judged again
                                from itself
      trajectories/00000.jsonl  one checksummed line per trajectory (see `records`), rotated by size
      screenshots/ab/<name>.png named by content, so that equal pictures are stored once
      metrics.jsonl             figures over time
      live.json                 what the collector is doing now, while it does (see `feed`)
      verdicts/<judge>.jsonl    what other judges said afterwards (see `verdicts`)
      set-aside/                what could not be trusted any more (see `verify`)
      summary.json, report.html made from the above

No two attempts ever have one name, also if the record of one is lost: verdicts and labels go by it. An
attempt that ended without a verdict and gets one later has two lines with the same episode; the later one
counts. Only the end of a file is ever written to, so kill -9 leaves at most one torn line, which the next
writer cuts off. Readers need no lock and may follow a run that is being written.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import msgspec
import yaml
from pydantic import Field

from webgym.core.errors import RunFolderError, StoreCorrupt, StoreError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.rollout.files import (
    CONFIG,
    LIVE,
    LOCK,
    METRICS,
    REPORT,
    SCREENSHOTS,
    SET_ASIDE,
    SUMMARY,
    TASKS,
    TORN,
    TRAJECTORIES,
    VERDICTS,
    Log,
    check_run,
    delete_torn,
    disk_errors,
    image_path,
    last_line_end,
    make_folder,
    sync_folder,
    take_lock,
    write_whole,
)
from webgym.rollout.records import CorruptLine, Entry, Index, complain, names_in, pictures, read_at, seal
from webgym.rollout.verdicts import read_verdicts
from webgym.settings import Settings

_OURS = {CONFIG, TASKS, TRAJECTORIES, SCREENSHOTS, METRICS, LIVE, SUMMARY, REPORT, LOCK, VERDICTS}

T = TypeVar("T")


def refuse_taken(path: Path) -> None:
    """Refuse a folder in which no run can be made.

    Raises:
        RunFolderError: it holds a run or something else already, or cannot be read.
    """
    try:
        held = {entry.name for entry in path.iterdir()} if path.exists() else set()
    except OSError as error:
        raise RunFolderError(f"cannot make the run folder {path}: {error.strerror}") from error
    if CONFIG in held:
        raise RunFolderError(
            f"{path} holds a run already", hint="resume with --resume, or choose another folder"
        )
    if foreign := sorted(name for name in held - _OURS if not name.endswith(TORN)):
        raise RunFolderError(f"{path} is not empty ({', '.join(foreign[:3])})", hint="choose another folder")


class StoreLimits(Settings):
    """What a writer may use."""

    shard_bytes: int = Field(default=64 * 2**20, gt=0)
    """A file of trajectories that has reached this size is followed by the next."""
    image_threads: int = Field(default=4, gt=0)
    """Pictures written at the same time. They wait for the disk, not for a processor."""


# --- writing ----------------------------------------------------------------------------------------


class RunWriter:
    """The one writer of a run. Make it with :meth:`create` or :meth:`reopen`; close it when done.

        async with await RunWriter.create(path, config, tasks) as writer:
            await writer.put_image(name, png)
            await writer.append(trajectory)  # on disk, with its pictures, when this returns

    Safe to use from many tasks of one event loop; files are touched in threads. A call that is cancelled is
    carried through before it is: :attr:`attempts` says what is on disk.

    Attributes:
        path: the run folder.
        attempts: an entry for every trajectory on disk, by attempt id.
        retired: names of attempts that this run recorded or judged before it was opened, as far as anything
            still tells them, and whose records are not there any more.
        skipped: the corrupt lines that :meth:`reopen` was told to continue without.
        torn_bytes: how much of an unfinished, never counted line :meth:`reopen` cut off.
        on_metric: is told every line of ``metrics.jsonl`` once it is written, in the thread that wrote it.
    """

    def __init__(self, path: Path, limits: StoreLimits, lock: int) -> None:
        self.path = path
        self.torn_bytes = 0
        self.retired: set[str] = set()
        self.on_metric: Callable[[Mapping[str, Any]], object] = lambda _: None
        self._limits = limits
        self._lock = lock
        self._index = Index(path / TRAJECTORIES)
        self._images: set[str] = set()
        self._unsynced: set[str] = set()
        self._shard: Log | None = None
        self._metrics: Log | None = None
        self._journal = ThreadPoolExecutor(1, thread_name_prefix="store-journal")
        self._painters = ThreadPoolExecutor(limits.image_threads, thread_name_prefix="store-image")
        self._closed = False

    @property
    def attempts(self) -> Mapping[str, Entry]:
        """An entry for every trajectory on disk, by attempt id."""
        return self._index.entries

    @property
    def skipped(self) -> list[CorruptLine]:
        """The corrupt lines that were found when the run was opened again."""
        return self._index.corrupt

    @classmethod
    async def create(
        cls,
        path: Path,
        config: Mapping[str, Any],
        tasks: list[Task],
        *,
        limits: StoreLimits | None = None,
    ) -> Self:
        """Make a run folder.

        Args:
            path: does not exist yet, or is empty.
            config: everything resolved, as plain data; no secrets.
            tasks: all the tasks of the run, in their order; one that was drawn twice comes twice.

        Raises:
            RunFolderError: the folder holds a run or something else already, or cannot be made.
            StoreLocked: another process is making it.
            StoreFull: there is no space.
        """
        return await asyncio.to_thread(cls._create, path, config, tasks, limits or StoreLimits())

    @classmethod
    def _create(cls, path: Path, config: Mapping[str, Any], tasks: list[Task], limits: StoreLimits) -> Self:
        make_folder(path)
        refuse_taken(path)
        with disk_errors(f"making {path}"):
            writer = cls(path, limits, take_lock(path))
            try:
                refuse_taken(path)  # again: nobody else can make it now
                writer._make_folders()
                write_whole(path / TASKS, b"".join(msgspec.json.encode(task) + b"\n" for task in tasks))
                text = yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
                write_whole(path / CONFIG, text.encode())
                sync_folder(path)
                writer._begin()
            except BaseException:
                os.close(writer._lock)
                raise
        return writer

    @classmethod
    async def reopen(
        cls, path: Path, *, skip_corrupt: bool = False, limits: StoreLimits | None = None
    ) -> Self:
        """Go on with a run, after a clean end or a dead writer.

        Every record is verified. A torn last line is cut off, temporary files are swept.

        Args:
            skip_corrupt: continue without records whose checksum does not match; they stay in the file
                and are listed in :attr:`skipped`.

        Raises:
            RunFolderError: the folder is no run.
            StoreLocked: another process writes to it.
            StoreCorrupt: records do not match their checksums; names file and line.
        """
        return await asyncio.to_thread(cls._reopen, path, skip_corrupt, limits or StoreLimits())

    @classmethod
    def _reopen(cls, path: Path, skip_corrupt: bool, limits: StoreLimits) -> Self:
        check_run(path)
        with disk_errors(f"opening {path}"):
            writer = cls(path, limits, take_lock(path))
            try:
                writer._recover(skip_corrupt)
                writer._begin()
            except BaseException:
                os.close(writer._lock)
                raise
        return writer

    def _recover(self, skip_corrupt: bool) -> None:
        self._make_folders()
        self._images = {file.stem for file in (self.path / SCREENSHOTS).glob("*/*.png")}
        self._unsynced = {name[:2] for name in self._images}  # nobody knows what the dead writer synced
        self._index.refresh()
        if self._index.corrupt and not skip_corrupt:
            raise complain(self._index.corrupt)
        for shard in self._index.shards():
            self.torn_bytes += self._cut(shard, self._index.end(shard))
        judged = (attempt_id for held in read_verdicts(self.path).values() for attempt_id in held)
        aside = names_in(self.path / SET_ASIDE / TRAJECTORIES)
        self.retired = self._index.retired.union(aside, judged).difference(self.attempts)
        if (metrics := self.path / METRICS).exists():
            self._cut(metrics, last_line_end(metrics))

    def _make_folders(self) -> None:
        delete_torn(self.path, "", f"{SCREENSHOTS}/*/")
        for byte in range(256):
            (self.path / SCREENSHOTS / f"{byte:02x}").mkdir(parents=True, exist_ok=True)
        self._folder.mkdir(exist_ok=True)
        sync_folder(self.path / SCREENSHOTS)

    @staticmethod
    def _cut(path: Path, end: int) -> int:
        torn = path.stat().st_size - end
        if torn:
            with path.open("r+b") as file:
                file.truncate(end)
                os.fsync(file.fileno())
        return torn

    def _begin(self) -> None:
        shards = self._index.shards()
        self._shard = Log(shards[-1] if shards else self.path / TRAJECTORIES / "00000.jsonl")
        self._metrics = Log(self.path / METRICS)

    async def _in(self, threads: ThreadPoolExecutor, call: Callable[..., T], *args: Any) -> T:
        if self._closed:
            raise StoreError(f"the writer of {self.path} is closed")
        job = asyncio.get_running_loop().run_in_executor(threads, call, *args)
        stopped: asyncio.CancelledError | None = None
        while not job.done():
            try:
                await asyncio.wait([job])  # unlike the job itself, it can be cancelled without loss
            except asyncio.CancelledError as error:
                stopped = error
        if stopped is not None and job.exception() is None:
            raise stopped
        return job.result()

    async def put_image(self, name: str, data: bytes) -> None:
        """Keep a picture. One that is there already is not written again.

        Args:
            name: the SHA-256 of ``data``, hex.
            data: the encoded picture.

        Raises:
            StoreCorrupt: the name does not fit the data.
            StoreFull: there is no space.
        """
        if name not in self._images:
            await self._in(self._painters, self._put_image, name, data)

    def _put_image(self, name: str, data: bytes) -> None:
        if hashlib.sha256(data).hexdigest() != name:
            raise StoreCorrupt(f"a picture of {len(data)} bytes is not the one that {name[:80]} names")
        path = image_path(self.path, name)
        with disk_errors("writing a screenshot"):
            write_whole(path, data)
        self._unsynced.add(path.parent.name)
        self._images.add(name)

    async def append(self, trajectory: Trajectory) -> None:
        """Record a trajectory: whole, checksummed and synced, with its pictures, when this returns.

        The very same trajectory may be appended again: it is on disk once.

        Raises:
            StoreFull: there is no space; the files are as they were.
            StoreError: a picture was not put before, the attempt is recorded already with another
                content, or the trajectory would not read back.
        """
        await self._in(self._journal, self._append, trajectory)

    def _append(self, trajectory: Trajectory) -> None:
        episode = trajectory.episode
        names = pictures(trajectory)
        if missing := names - self._images:
            raise StoreError(f"{episode.attempt_id} shows {len(missing)} pictures that were never stored")
        line = seal(trajectory)
        assert self._shard is not None
        if known := self.attempts.get(episode.attempt_id):
            held = read_at(self._folder / known.shard, known)
            if seal(held) == line:
                return
            has_none = known.outcome is Outcome.JUDGE_ERROR and trajectory.outcome is not Outcome.JUDGE_ERROR
            if not has_none or held.episode != episode:
                raise StoreError(f"{episode.attempt_id} is recorded already, and was another")
        with disk_errors("writing a trajectory"):
            for prefix in {name[:2] for name in names} & self._unsynced:
                self._sync_pictures(prefix)
            if self._shard.size >= self._limits.shard_bytes:
                full = self._shard
                self._shard = Log(self._folder / f"{int(full.path.stem) + 1:05d}.jsonl")
                full.close()
            offset = self._shard.size
            self._shard.append(line, durable=True)
        e, place = episode, (self._shard.path.name, offset, len(line))
        entry = Entry(e.attempt_id, e.task_id, e.sample, e.retry, trajectory.outcome, *place)
        self._index.entries[e.attempt_id] = entry

    def _sync_pictures(self, prefix: str) -> None:
        self._unsynced.discard(prefix)  # before the sync: what is put meanwhile needs another
        try:
            sync_folder(self.path / SCREENSHOTS / prefix)
        except OSError:
            self._unsynced.add(prefix)
            raise

    @property
    def _folder(self) -> Path:
        return self.path / TRAJECTORIES

    async def metric(self, values: Mapping[str, Any]) -> None:
        """Add a line to ``metrics.jsonl``. Not synced: figures may be lost with the machine's power.

        Raises:
            StoreFull: there is no space.
        """
        await self._in(self._journal, self._metric, dict(values))

    def _metric(self, values: Mapping[str, Any]) -> None:
        assert self._metrics is not None
        with disk_errors("writing metrics"):
            self._metrics.append(msgspec.json.encode(values) + b"\n", durable=False)
        self.on_metric(values)

    async def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Write ``summary.json``, whole or not at all.

        Raises:
            StoreFull: there is no space.
        """
        data = msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"
        await self._in(self._journal, self._write_summary, data)

    def _write_summary(self, data: bytes) -> None:
        with disk_errors("writing the summary"):
            write_whole(self.path / SUMMARY, data)
            sync_folder(self.path)

    async def aclose(self) -> None:
        """Finish what is being written and let the run go. May be called twice."""
        if not self._closed:
            self._closed = True
            await asyncio.to_thread(self._close)

    def _close(self) -> None:
        self._painters.shutdown()
        self._journal.shutdown()
        for log in (self._shard, self._metrics):
            if log is not None:
                log.close()
        os.close(self._lock)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.aclose()


# --- reading ----------------------------------------------------------------------------------------


class RunReader:
    """Reads a run, also one that is being written.

    Args:
        path: the run folder.
        skip_corrupt: continue without records that cannot be trusted; :attr:`skipped` lists them.

    Raises:
        RunFolderError: the folder is no run.
    """

    def __init__(self, path: Path, *, skip_corrupt: bool = False) -> None:
        check_run(path)
        self.path = path
        self._skip_corrupt = skip_corrupt
        self._index = Index(path / TRAJECTORIES)
        self._no_tasks: list[CorruptLine] = []

    @property
    def config(self) -> dict[str, Any]:
        """What the run was started with.

        Raises:
            StoreCorrupt: the file is not a YAML mapping.
        """
        try:
            config = yaml.safe_load((self.path / CONFIG).read_bytes())
        except yaml.YAMLError as error:
            raise StoreCorrupt(f"{self.path / CONFIG} is not YAML: {error}") from error
        if not isinstance(config, dict):
            raise StoreCorrupt(f"{self.path / CONFIG} is not a mapping")
        return config

    @cached_property
    def tasks(self) -> dict[str, Task]:
        """The tasks of the run by id, hidden truth included.

        Raises:
            StoreCorrupt: a line is not a task, and such may not be skipped; names file, line and reason.
        """
        return {task.id: task for task in self.drawn}

    @cached_property
    def drawn(self) -> list[Task]:
        """The tasks of the run as they were drawn: in their order, and one that was drawn twice comes twice.

        Raises:
            StoreCorrupt: as for :attr:`tasks`.
        """
        decoder = msgspec.json.Decoder(Task)
        drawn = []
        with disk_errors(f"reading {self.path}"), (self.path / TASKS).open("rb") as file:
            for number, line in enumerate(file, 1):
                try:
                    drawn.append(decoder.decode(line))
                except (ValueError, RecursionError) as error:
                    self._no_tasks.append(CorruptLine(TASKS, number, str(error)))
                    if not self._skip_corrupt:
                        raise StoreCorrupt(str(self._no_tasks[-1])) from error
        return drawn

    def refresh(self) -> Mapping[str, Entry]:
        """Take note of what was written since, and return :attr:`attempts`.

        Raises:
            StoreCorrupt: records do not match their checksums, unless they may be skipped.
        """
        with disk_errors(f"reading {self.path}"):
            self._index.refresh()
        if self._index.corrupt and not self._skip_corrupt:
            raise complain(self._index.corrupt)
        return self._index.entries

    @property
    def attempts(self) -> Mapping[str, Entry]:
        """An entry for every trajectory on disk, by attempt id, in the order in which they ended."""
        return self.refresh()

    @property
    def skipped(self) -> list[CorruptLine]:
        """The records that cannot be trusted, as far as they have been read."""
        return [*self._no_tasks, *self._index.corrupt]

    def trajectory(self, attempt_id: str) -> Trajectory:
        """One trajectory.

        Args:
            attempt_id: ``task#sample.retry``, as in :attr:`attempts`.

        Raises:
            KeyError: there is none of this id.
            StoreCorrupt: its record changed since it was indexed.
        """
        entry = self._index.entries.get(attempt_id) or self.attempts[attempt_id]
        with disk_errors(f"reading {self.path}"):
            return read_at(self.path / TRAJECTORIES / entry.shard, entry)

    def trajectories(self, attempt_ids: Iterable[str] | None = None) -> Iterator[Trajectory]:
        """Trajectories, one in memory at a time. Where records may be skipped, :attr:`attempts` is then
        without those that proved to be no trajectories.

        Args:
            attempt_ids: which; ``None`` gives all, in the order in which they ended.

        Raises:
            StoreCorrupt: a record cannot be trusted, unless it may be skipped.
        """
        for attempt_id in list(self.attempts) if attempt_ids is None else attempt_ids:
            try:
                trajectory = self.trajectory(attempt_id)
            except StoreCorrupt as error:
                if not self._skip_corrupt:
                    raise
                self._index.leave_out(self._index.entries[attempt_id], error.__cause__ or error)
                continue
            yield trajectory

    def image_path(self, name: str) -> Path:
        """Where the picture of this name lies, whether it is there or not.

        Args:
            name: SHA-256 of the picture, in hex.

        Raises:
            StoreError: the name is not a SHA-256 in hex.
        """
        return image_path(self.path, name)

    def image(self, name: str) -> bytes:
        """The picture of this name.

        Args:
            name: SHA-256 of the picture, in hex.

        Raises:
            StoreCorrupt: the run does not hold it.
        """
        try:
            return self.image_path(name).read_bytes()
        except FileNotFoundError as error:
            raise StoreCorrupt(f"{self.path} does not hold the picture {name}") from error

    @property
    def summary(self) -> dict[str, Any] | None:
        """``summary.json``, or ``None`` while it has not been written.

        Raises:
            StoreCorrupt: it is not a JSON object.
        """
        try:
            return msgspec.json.decode((self.path / SUMMARY).read_bytes(), type=dict[str, Any])
        except FileNotFoundError:
            return None
        except ValueError as error:
            raise StoreCorrupt(f"{self.path / SUMMARY} is not a JSON object: {error}") from error
