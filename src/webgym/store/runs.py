"""The run store: a run is a folder of plain files, to which records are only appended.

    RUN/
      config.yaml               the resolved config; its presence makes the folder a run folder
      tasks.jsonl               the tasks as drawn, including the hidden truth, so that the run can be judged
                                again without its task set
      trajectories/00000.jsonl  one checksummed line per trajectory (see `records`), rotated by size
      screenshots/ab/<name>.png named by content, so that identical pictures are stored once
      metrics.jsonl             figures over time
      live.json                 the state of the running collector (see `feed`)
      verdicts/<judge>.jsonl    later verdicts by other judges (see `verdicts`)
      set-aside/                damaged records (see `verify`)
      summary.json, report.html made from the above

Attempt ids are never reused, even if a record is lost, because verdicts and labels refer to them. An attempt
that ended without a verdict and gets one later has two lines with the same episode; the later one counts.
Files are only appended to, so a killed process leaves at most one incomplete line, which the next writer
removes. Readers need no lock and may follow a run that is being written.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any, Self, TypeVar

import msgspec
import yaml

from webgym.core.consent import remember
from webgym.core.errors import RunFolderError, StoreCorrupt, StoreError
from webgym.core.outcome import Outcome
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.store.files import (
    CONFIG,
    LOCK,
    METRICS,
    SCREENSHOTS,
    SET_ASIDE,
    SUMMARY,
    TASKS,
    TORN,
    TRAJECTORIES,
    Log,
    check_run,
    check_tasks,
    delete_torn,
    disk_errors,
    image_path,
    is_training,
    last_line_end,
    make_folder,
    sync_folder,
    take_lock,
    write_whole,
)
from webgym.store.records import (
    CorruptLine,
    Entry,
    Index,
    attempt_ids_in,
    corruption_error,
    pictures,
    read_at,
    seal,
)
from webgym.store.verdicts import Judged, read_verdicts

RECORDED = "recorded"
"""Name for the verdicts that were made when the run was collected."""

_IMAGE_THREADS = 4
_LEFT_BY_A_START = {TASKS, TRAJECTORIES, SCREENSHOTS, LOCK}
"""What a process that was killed while it created a run may leave, the folders empty."""

T = TypeVar("T")


def refuse_taken(path: Path) -> None:
    """Refuse a folder in which no run can be created.

    Raises:
        RunFolderError: it already holds a run, a part of one or other files, or cannot be read.
    """
    try:
        names = {entry.name for entry in path.iterdir()} if path.exists() else set()
        names |= {f"{TRAJECTORIES}/{shard.name}" for shard in (path / TRAJECTORIES).glob("*")}
    except OSError as error:
        raise RunFolderError(f"cannot create the run folder {path}: {error.strerror}") from error
    if CONFIG in names:
        kind, verb = ("training", "train") if is_training(path) else ("run", "rollout")
        command = f"webgym {verb} --resume {shlex.quote(str(path))}"
        raise RunFolderError(
            f"{path} holds a {kind} already", hint=f"{command} continues it; or choose another folder"
        )
    if foreign := sorted(name for name in names - _LEFT_BY_A_START if not name.endswith(TORN)):
        raise RunFolderError(f"{path} is not empty ({', '.join(foreign[:3])})", hint="choose another folder")


SHARD_BYTES = 64 * 2**20
"""Size at which the next file of trajectories is started."""


# --- writing ----------------------------------------------------------------------------------------


class RunWriter:
    """The only writer of a run. Make it with :meth:`create` or :meth:`reopen`; close it when done.

        async with await RunWriter.create(path, config, tasks) as writer:
            await writer.put_image(name, png)
            await writer.append(trajectory)  # on disk, with its pictures, when this returns

    Safe to use from many tasks of one event loop; threads access the files. A cancelled call completes its
    writing before it raises, so that :attr:`attempts` always matches the disk.

    Attributes:
        path: the run folder.
        attempts: an entry for every trajectory on disk, by attempt id.
        retired: ids of attempts that were recorded or judged earlier and whose records are lost, as far as
            they are still known.
        skipped: the damaged lines that :meth:`reopen` skipped.
        torn_bytes: size of the incomplete line that :meth:`reopen` removed.
        on_metric: called with every line of ``metrics.jsonl`` once it is written, in the writing thread.
    """

    def __init__(self, path: Path, lock: int) -> None:
        self.path = path
        self.torn_bytes = 0
        self.retired: set[str] = set()
        self.on_metric: Callable[[Mapping[str, Any]], object] = lambda _: None
        self._lock = lock
        self._index = Index(path / TRAJECTORIES)
        self._images: set[str] = set()
        self._unsynced: set[str] = set()  # folders of pictures that have entries which are not synced
        self._folders: set[str] = set()  # folders of pictures whose own entries are synced
        self._shard: Log | None = None
        self._metrics: Log | None = None
        self._append_thread = ThreadPoolExecutor(1, thread_name_prefix="store-journal")
        self._image_threads = ThreadPoolExecutor(_IMAGE_THREADS, thread_name_prefix="store-image")
        self._closed = False

    @property
    def attempts(self) -> Mapping[str, Entry]:
        """An entry for every trajectory on disk, by attempt id."""
        return self._index.entries

    @property
    def skipped(self) -> list[CorruptLine]:
        """The damaged lines that were found when the run was reopened."""
        return self._index.corrupt

    @classmethod
    async def create(cls, path: Path, config: Mapping[str, Any], tasks: list[Task]) -> Self:
        """Create a run folder.

        Args:
            path: must be missing or empty.
            config: the resolved config as plain data, without secrets.
            tasks: all tasks of the run, in order; one that was drawn twice is listed twice.

        Raises:
            RunFolderError: the folder already holds a run or other files, or cannot be created.
            StoreLocked: another process is creating it.
            StoreFull: there is no space.
        """
        return await asyncio.to_thread(cls._create, path, config, tasks)

    @classmethod
    def _create(cls, path: Path, config: Mapping[str, Any], tasks: list[Task]) -> Self:
        make_folder(path)
        refuse_taken(path)
        with disk_errors(f"making {path}", then="start the run again"):
            writer = cls(path, take_lock(path))
            try:
                refuse_taken(path)  # again, now that the lock is held
                writer._make_folders()
                write_whole(path / TASKS, b"".join(msgspec.json.encode(task) + b"\n" for task in tasks))
                text = yaml.safe_dump(dict(config), sort_keys=False, allow_unicode=True)
                write_whole(path / CONFIG, text.encode())
                remember(config, path / CONFIG)
                sync_folder(path)
                writer._open_logs()
            except BaseException:
                for folder in () if (path / CONFIG).exists() else (writer._folder, path / SCREENSHOTS):
                    with suppress(OSError):  # it holds something, or is not there
                        folder.rmdir()
                os.close(writer._lock)
                raise
        return writer

    @classmethod
    async def reopen(cls, path: Path, *, skip_corrupt: bool = False) -> Self:
        """Continue a run, after a clean end or a crash of its writer.

        Every record is verified. An incomplete last line and temporary files are removed.

        Args:
            skip_corrupt: continue without damaged records; they stay in the file and are listed in
                :attr:`skipped`.

        Raises:
            RunFolderError: the folder is not a run folder.
            StoreLocked: another process writes to it.
            StoreCorrupt: records do not match their checksums; the message names file and line.
        """
        return await asyncio.to_thread(cls._reopen, path, skip_corrupt)

    @classmethod
    def _reopen(cls, path: Path, skip_corrupt: bool) -> Self:
        check_run(path)
        with disk_errors(f"opening {path}"):
            writer = cls(path, take_lock(path))
            try:
                writer._recover(skip_corrupt)
                writer._open_logs()
            except BaseException:
                os.close(writer._lock)
                raise
        return writer

    def _recover(self, skip_corrupt: bool) -> None:
        self._make_folders()
        self._images = {file.stem for file in (self.path / SCREENSHOTS).glob("*/*.png")}
        self._unsynced = {name[:2] for name in self._images}  # the earlier writer may not have synced them
        self._index.refresh()
        if self._index.corrupt and not skip_corrupt:
            raise corruption_error(self._index.corrupt)
        for shard in self._index.shards():
            self.torn_bytes += self._cut(shard, self._index.end(shard))
        judged = (attempt_id for verdicts in read_verdicts(self.path).values() for attempt_id in verdicts)
        set_aside = attempt_ids_in(self.path / SET_ASIDE / TRAJECTORIES)
        self.retired = self._index.retired.union(set_aside, judged).difference(self.attempts)
        if (metrics := self.path / METRICS).exists():
            self._cut(metrics, last_line_end(metrics))

    def _make_folders(self) -> None:
        delete_torn(self.path, "", f"{SCREENSHOTS}/*/")
        (self.path / SCREENSHOTS).mkdir(exist_ok=True)
        self._folder.mkdir(exist_ok=True)

    @staticmethod
    def _cut(path: Path, end: int) -> int:
        torn = path.stat().st_size - end
        if torn:
            with path.open("r+b") as file:
                file.truncate(end)
                os.fsync(file.fileno())
        return torn

    def _open_logs(self) -> None:
        shards = self._index.shards()
        self._shard = Log(shards[-1] if shards else self.path / TRAJECTORIES / "00000.jsonl")
        self._metrics = Log(self.path / METRICS)

    async def _run_in(self, threads: ThreadPoolExecutor, call: Callable[..., T], *args: Any) -> T:
        if self._closed:
            raise StoreError(f"the writer of {self.path} is closed")
        job = asyncio.get_running_loop().run_in_executor(threads, call, *args)
        cancelled: asyncio.CancelledError | None = None
        while not job.done():
            try:
                await asyncio.wait([job])  # cancelling the wait does not cancel the job
            except asyncio.CancelledError as error:
                cancelled = error
        if cancelled is not None and job.exception() is None:
            raise cancelled
        return job.result()

    async def put_image(self, name: str, data: bytes) -> None:
        """Store a picture, unless it is stored already.

        Args:
            name: the SHA-256 of ``data``, hex.
            data: the encoded picture.

        Raises:
            StoreCorrupt: the name is not the digest of the data.
            StoreFull: there is no space.
        """
        if name not in self._images:
            await self._run_in(self._image_threads, self._put_image, name, data)

    def _put_image(self, name: str, data: bytes) -> None:
        if hashlib.sha256(data).hexdigest() != name:
            raise StoreCorrupt(f"the SHA-256 of a picture of {len(data)} bytes is not its name {name[:80]}")
        path = image_path(self.path, name)
        with disk_errors("writing a screenshot"):
            path.parent.mkdir(exist_ok=True)
            write_whole(path, data)
        self._unsynced.add(path.parent.name)
        self._images.add(name)

    async def append(self, trajectory: Trajectory) -> None:
        """Record a trajectory: on disk and synced, with its pictures, when this returns.

        Appending an identical trajectory again has no effect.

        Raises:
            StoreFull: there is no space; the files are unchanged.
            StoreError: a picture is not stored, the attempt is already recorded with other content, or the
                trajectory cannot be stored without loss.
        """
        await self._run_in(self._append_thread, self._append, trajectory)

    def _append(self, trajectory: Trajectory) -> None:
        episode = trajectory.episode
        names = pictures(trajectory)
        if missing := names - self._images:
            raise StoreError(f"{episode.attempt_id} shows {len(missing)} pictures that were never stored")
        line = seal(trajectory)
        assert self._shard is not None
        if known := self.attempts.get(episode.attempt_id):
            recorded = read_at(self._folder / known.shard, known)
            if seal(recorded) == line:
                return
            gets_verdict = (
                known.outcome is Outcome.JUDGE_ERROR and trajectory.outcome is not Outcome.JUDGE_ERROR
            )
            if not gets_verdict or recorded.episode != episode:
                raise StoreError(f"{episode.attempt_id} is already recorded, with other content")
        with disk_errors("writing a trajectory"):
            prefixes = {name[:2] for name in names}
            for prefix in prefixes & self._unsynced:
                self._sync_pictures(prefix)
            if not prefixes <= self._folders:
                sync_folder(self.path / SCREENSHOTS)
                self._folders |= prefixes
            if self._shard.size >= SHARD_BYTES:
                full = self._shard
                self._shard = Log(self._folder / f"{int(full.path.stem) + 1:05d}.jsonl")
                full.close()
            offset = self._shard.size
            self._shard.append(line, durable=True)
        e, location = episode, (self._shard.path.name, offset, len(line))
        entry = Entry(e.attempt_id, e.task_id, e.sample, e.retry, trajectory.outcome, *location)
        self._index.entries[e.attempt_id] = entry

    def _sync_pictures(self, prefix: str) -> None:
        self._unsynced.discard(prefix)  # before the sync: later pictures need another
        try:
            sync_folder(self.path / SCREENSHOTS / prefix)
        except OSError:
            self._unsynced.add(prefix)
            raise

    @property
    def _folder(self) -> Path:
        return self.path / TRAJECTORIES

    async def metric(self, values: Mapping[str, Any]) -> None:
        """Add a line to ``metrics.jsonl``. It is not synced, so that a power failure may lose it.

        Raises:
            StoreFull: there is no space.
        """
        await self._run_in(self._append_thread, self._metric, dict(values))

    def _metric(self, values: Mapping[str, Any]) -> None:
        assert self._metrics is not None
        with disk_errors("writing metrics"):
            self._metrics.append(msgspec.json.encode(values) + b"\n", durable=False)
        self.on_metric(values)

    async def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Write ``summary.json`` atomically.

        Raises:
            StoreFull: there is no space.
        """
        data = msgspec.json.format(msgspec.json.encode(summary), indent=2) + b"\n"
        await self._run_in(self._append_thread, self._write_summary, data)

    def _write_summary(self, data: bytes) -> None:
        with disk_errors("writing the summary"):
            write_whole(self.path / SUMMARY, data)
            sync_folder(self.path)

    async def aclose(self) -> None:
        """Finish writing and release the lock. Safe to call twice."""
        if not self._closed:
            self._closed = True
            await asyncio.to_thread(self._close)

    def _close(self) -> None:
        self._image_threads.shutdown()
        self._append_thread.shutdown()
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
    """Reads a run, even while it is being written.

    Args:
        path: the run folder.
        skip_corrupt: continue without damaged records; :attr:`skipped` lists them.

    Raises:
        RunFolderError: the folder is not a run folder.
    """

    def __init__(self, path: Path | str, *, skip_corrupt: bool = False) -> None:
        path = Path(path)
        check_run(path)
        self.path = path
        self._skip_corrupt = skip_corrupt
        self._index = Index(path / TRAJECTORIES)
        self._corrupt_tasks: list[CorruptLine] = []

    @property
    def config(self) -> dict[str, Any]:
        """The config that the run was started with.

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

    @property
    def samples(self) -> int:
        """Planned samples per task.

        Raises:
            StoreCorrupt: the config says something else than a number from 1 on.
        """
        samples = self.config.get("samples", 1)
        if not isinstance(samples, int) or samples < 1:
            raise StoreCorrupt(f"{self.path / CONFIG}: samples is not a number from 1 on: {samples!r}")
        return samples

    @cached_property
    def tasks(self) -> dict[str, Task]:
        """The tasks of the run by id, including the hidden truth.

        Raises:
            StoreCorrupt: a line is not a task, unless ``skip_corrupt`` is set; the message names file and
                line.
        """
        return {task.id: task for task in self.drawn}

    @cached_property
    def drawn(self) -> list[Task]:
        """The tasks of the run in the order drawn; one that was drawn twice is listed twice.

        Raises:
            RunFolderError: there is no list of tasks.
            StoreCorrupt: as for :attr:`tasks`.
        """
        check_tasks(self.path)
        decoder = msgspec.json.Decoder(Task)
        drawn = []
        with disk_errors(f"reading {self.path}"), (self.path / TASKS).open("rb") as file:
            for number, line in enumerate(file, 1):
                try:
                    drawn.append(decoder.decode(line))
                except (ValueError, RecursionError) as error:
                    self._corrupt_tasks.append(CorruptLine(TASKS, number, str(error)))
                    if not self._skip_corrupt:
                        raise StoreCorrupt(str(self._corrupt_tasks[-1])) from error
        return drawn

    def refresh(self) -> Mapping[str, Entry]:
        """Read what was written since the last call, and return :attr:`attempts`.

        Raises:
            StoreCorrupt: records do not match their checksums, unless ``skip_corrupt`` is set.
        """
        with disk_errors(f"reading {self.path}"):
            self._index.refresh()
        if self._index.corrupt and not self._skip_corrupt:
            raise corruption_error(self._index.corrupt)
        return self._index.entries

    @property
    def attempts(self) -> Mapping[str, Entry]:
        """An entry for every trajectory on disk, by attempt id, in the order in which they ended."""
        return self.refresh()

    @property
    def skipped(self) -> list[CorruptLine]:
        """The damaged records among those read so far."""
        return [*self._corrupt_tasks, *self._index.corrupt]

    def trajectory(self, attempt_id: str) -> Trajectory:
        """One trajectory.

        Args:
            attempt_id: ``task#sample.retry``, as in :attr:`attempts`.

        Raises:
            KeyError: there is no attempt with this id.
            StoreCorrupt: its record changed since it was indexed.
        """
        entry = self._index.entries.get(attempt_id) or self.attempts[attempt_id]
        with disk_errors(f"reading {self.path}"):
            return read_at(self.path / TRAJECTORIES / entry.shard, entry)

    def trajectories(self, attempt_ids: Iterable[str] | None = None) -> Iterator[Trajectory]:
        """Trajectories, one in memory at a time. With ``skip_corrupt``, damaged ones are skipped and removed
        from :attr:`attempts`.

        Args:
            attempt_ids: which; by default all, in the order in which they ended.

        Raises:
            StoreCorrupt: a record is damaged, unless ``skip_corrupt`` is set.
        """
        for attempt_id in list(self.attempts) if attempt_ids is None else attempt_ids:
            try:
                trajectory = self.trajectory(attempt_id)
            except StoreCorrupt as error:
                if not self._skip_corrupt:
                    raise
                self._index.drop(self._index.entries[attempt_id], error.__cause__ or error)
                continue
            yield trajectory

    def image_path(self, name: str) -> Path:
        """The path of a picture, whether it exists or not.

        Args:
            name: SHA-256 of the picture, in hex.

        Raises:
            StoreError: the name is not a SHA-256 in hex.
        """
        return image_path(self.path, name)

    def image(self, name: str) -> bytes:
        """A picture, encoded.

        Args:
            name: SHA-256 of the picture, in hex.

        Raises:
            StoreCorrupt: the run does not hold the picture.
            StoreError: the name is not a SHA-256 in hex.
        """
        try:
            return self.image_path(name).read_bytes()
        except FileNotFoundError as error:
            raise StoreCorrupt(f"{self.path} does not hold the picture {name}") from error

    @property
    def summary(self) -> dict[str, Any] | None:
        """The content of ``summary.json``; ``None`` before it is written.

        Raises:
            StoreCorrupt: it is not a JSON object.
        """
        try:
            return msgspec.json.decode((self.path / SUMMARY).read_bytes(), type=dict[str, Any])
        except FileNotFoundError:
            return None
        except ValueError as error:
            raise StoreCorrupt(f"{self.path / SUMMARY} is not a JSON object: {error}") from error


def verdicts_of(run: Path, judge: str) -> tuple[str, dict[str, Judged]]:
    """A judge's verdicts on the attempts that a run holds.

    Args:
        run: the run folder.
        judge: its name or a unique prefix of it, or :data:`RECORDED`.

    Returns:
        The judge's full name and its judgements by attempt.

    Raises:
        RunFolderError: no judge or several judges match.
    """
    if judge == RECORDED:
        return RECORDED, recorded(run)
    verdicts = read_verdicts(run)
    matching = [judge] if judge in verdicts else [name for name in verdicts if name.startswith(judge)]
    if len(matching) != 1:
        known = ", ".join([RECORDED, *verdicts])
        raise RunFolderError(
            f"{'no judge' if not matching else 'more than one judge'} of this run is called {judge!r}",
            hint=f"there are: {known}",
        )
    attempts = RunReader(run, skip_corrupt=True).attempts
    return matching[0], {key: judged for key, judged in verdicts[matching[0]].items() if key in attempts}


def recorded(run: Path) -> dict[str, Judged]:
    """The verdicts that were made when the run was collected."""
    judgements = {}
    for trajectory in RunReader(run, skip_corrupt=True).trajectories():
        episode, verdict = trajectory.episode, trajectory.verdict
        if trajectory.is_judged:
            judgements[episode.attempt_id] = Judged(
                episode.attempt_id,
                verdict.judge if verdict else RECORDED,
                trajectory.outcome,
                episode.started_at + episode.seconds,
                trajectory.judge_seconds,
                verdict,
                trajectory.judge_failure,
            )
    return judgements
