"""Shares a task list between several collectors, on a common disk.

Each collector has its own run folder and the same tasks. A sample is claimed before it is attempted, and
nobody else attempts it then. Collectors send heartbeats; claims of a dead collector that are not finished
are taken over. The disk must refuse a hard link to an existing name and show all collectors the same
modification times. The collectors' clocks do not matter.

    DIR/
      tasks                digest of the list and its tasks' content: collectors of another list are refused
      settings.json        settings that influence attempts and rewards; with others, too
      collectors/ID        the run folder of a collector; its modification time is the last heartbeat
      claims/ab/KEY.N      the collector that claimed a sample; the highest N counts
      done/ab/KEY          the collector whose run finished the sample

A claim is never changed, only superseded by the next number, so that exactly one collector takes over. A
collector that was wrongly considered dead finds its claim superseded and drops the attempt. A collector may
repeat its own finished samples, for example because a record was lost.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import uuid
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
from pydantic import AfterValidator, Field

from webgym.core.errors import ConfigError, RunFolderError, StoreError
from webgym.core.settings import Settings
from webgym.core.task import Task
from webgym.store.files import disk_errors, write_whole
from webgym.store.runs import RunReader

COLLECTORS: Final = "collectors"
"""Subfolder with a file for every collector, which holds the path of its run folder."""

_SAME: Final = ("seed", "samples", "policy", "agent", "judge", "attempt")
"""Settings that influence attempts and rewards; machines, browsers and limits may differ between runs."""
_LOCAL: Final = frozenset({"base_url", "cache", "concurrency"})
"""Settings of a model's endpoint that may differ between machines: its address and its limits."""


def shared_settings(config: Mapping[str, Any]) -> dict[str, Any]:
    """The part of a run's resolved config that must be the same for all collectors of a list."""

    def shared_part(settings: Any) -> Any:
        if isinstance(settings, dict):
            return {name: shared_part(value) for name, value in settings.items() if name not in _LOCAL}
        return settings

    return {name: shared_part(config.get(name)) for name in _SAME}


def difference(ours: Mapping[str, Any], theirs: Mapping[str, Any]) -> str | None:
    """The first of the shared settings that differs."""
    return next((name for name in _SAME if ours.get(name) != theirs.get(name)), None)


class SharingConfig(Settings):
    """Folder of a shared task list, and times."""

    folder: Annotated[Path, AfterValidator(Path.absolute)] | None = None
    """Folder on a disk common to several collectors of the same tasks; each sample is attempted by one of
    them."""

    beat_seconds: float = Field(default=5.0, gt=0)
    """Time between heartbeats."""

    dead_seconds: float = Field(default=60.0, gt=0)
    """A collector without a heartbeat for this long counts as dead. Set it to several heartbeats, and longer
    than the disk takes to show what others wrote."""

    look_seconds: float = Field(default=5.0, gt=0)
    """Time between checks of others' claims, when nothing else is left to do."""


class Claim(Enum):
    """The result of a claim on a sample."""

    OURS = "ours"
    TAKEN = "taken"
    DONE = "done"


class Claims:
    """A collector's claims on samples. All methods block; call them from a thread.

    Args:
        config: with a folder.
        name: of the collector; the same when its run is resumed.
    """

    def __init__(self, config: SharingConfig, name: str) -> None:
        assert config.folder is not None
        self.config = config
        self._folder = config.folder
        self._name = name
        self._heartbeat_file = self._folder / COLLECTORS / name
        self._readers: dict[str, RunReader] = {}
        """Readers of the runs of dead collectors, by path."""

    def join(
        self, tasks: Sequence[Task], config: Mapping[str, Any], run: Path, *, is_resumed: bool = False
    ) -> None:
        """Join the collectors of a list.

        Args:
            tasks: the list, in order.
            config: the resolved config of this collector's run.
            run: this collector's run folder.
            is_resumed: whether this collector has joined before; the folder must then exist.

        Raises:
            ConfigError: the folder is shared for another list or with other settings, or is missing for a
                resumed run.
            StoreError: the folder cannot be written to.
        """
        listing = b"\n".join([str(config["samples"]).encode(), *map(msgspec.json.encode, tasks)])
        digest = hashlib.sha256(listing).hexdigest().encode()
        with disk_errors(f"sharing tasks in {self._folder}"):
            if is_resumed and not (self._folder / "tasks").exists():
                raise ConfigError(
                    f"{self._folder}, where this run has shared its tasks, no longer holds them",
                    hint="mount its disk, or name its new place in config.yaml (collector.sharing.folder)",
                )
            self._heartbeat_file.parent.mkdir(parents=True, exist_ok=True)
            self._link_new(self._folder / "tasks", digest)
            if (self._folder / "tasks").read_bytes() != digest:
                raise ConfigError(
                    f"{self._folder} is shared for another list of tasks",
                    hint="give all collectors the same tasks, seed and samples, or another folder",
                )
            settings = shared_settings(config)
            self._link_new(self._folder / "settings.json", json.dumps(settings, indent=1).encode())
            if name := difference(settings, json.loads((self._folder / "settings.json").read_bytes())):
                raise ConfigError(
                    f"{self._folder} is shared by collectors with other settings of {name!r}",
                    hint="give all collectors the same settings, or another folder",
                )
            write_whole(self._heartbeat_file, str(run.resolve()).encode())

    def leave(self) -> None:
        """Stop: unfinished claims may be taken over immediately."""
        with disk_errors(f"sharing tasks in {self._folder}"):
            os.utime(self._heartbeat_file, (0, 0))  # kept, because it names the run folder

    def beat(self) -> None:
        """Send a heartbeat."""
        with disk_errors(f"sharing tasks in {self._folder}"):
            os.utime(self._heartbeat_file)

    def claim(self, task_id: str, sample: int) -> Claim:
        """Claim a sample.

        Raises:
            StoreError: the disk cannot be read or written.
        """
        key = _key(task_id, sample)
        with disk_errors(f"sharing tasks in {self._folder}"):
            finisher = self._finisher(key)
            if finisher not in (None, self._name):
                return Claim.DONE
            if finisher is not None:  # this run lost the record, or repeats the sample
                self._done(key).unlink(missing_ok=True)
            number, owner = self._newest(key)
            if owner == self._name:
                return Claim.OURS
            if owner is not None:
                if self._is_alive(owner):
                    return Claim.TAKEN
                if self._has_recorded(owner, task_id, sample):
                    self._mark_done(key, owner)
                    return Claim.DONE
            if not self._link_new(self._claim(key, number), self._name.encode()):
                return Claim.TAKEN
            # The owner may have finished the sample since the first check.
            return Claim.DONE if self._done(key).exists() else Claim.OURS

    def holds(self, task_id: str, sample: int) -> bool:
        """Whether a sample is still this collector's: done by it, or else claimed by nobody later. Sends a
        heartbeat, too."""
        self.beat()
        key = _key(task_id, sample)
        with disk_errors(f"sharing tasks in {self._folder}"):
            return (self._finisher(key) or self._newest(key)[1]) == self._name

    def finish(self, task_id: str, sample: int) -> None:
        """Mark a sample as done; its record must be on disk."""
        with disk_errors(f"sharing tasks in {self._folder}"):
            self._mark_done(_key(task_id, sample), self._name)

    def _mark_done(self, key: str, finisher: str) -> None:
        self._link_new(self._done(key), finisher.encode())

    def _finisher(self, key: str) -> str | None:
        """The collector that finished a sample; ``None`` if it is not done."""
        try:
            return self._done(key).read_text()
        except FileNotFoundError:
            return None

    def _newest(self, key: str) -> tuple[int, str | None]:
        """The number of the next claim on a sample, and the owner of the last one."""
        number, owner = 0, None
        while True:
            try:
                owner = self._claim(key, number).read_text()
            except FileNotFoundError:
                return number, owner
            number += 1

    def _is_alive(self, owner: str) -> bool:
        try:
            age = self._heartbeat_file.stat().st_mtime - (self._heartbeat_file.parent / owner).stat().st_mtime
        except FileNotFoundError:
            return False
        return age < self.config.dead_seconds

    def _has_recorded(self, owner: str, task_id: str, sample: int) -> bool:
        """Whether a dead collector recorded a sample; it may have died before it marked it as done."""
        try:
            run = (self._heartbeat_file.parent / owner).read_text()
            if run not in self._readers:
                self._readers[run] = RunReader(run, skip_corrupt=True)
            entries = self._readers[run].refresh().values()  # reads only what is new
        except (FileNotFoundError, RunFolderError, StoreError):
            return False  # its run folder is gone
        return any(
            (entry.task_id, entry.sample) == (task_id, sample) and not entry.outcome.is_retried
            for entry in entries
        )

    def _claim(self, key: str, number: int) -> Path:
        return self._folder / "claims" / key[:2] / f"{key}.{number}"

    def _done(self, key: str) -> Path:
        return self._folder / "done" / key[:2] / key

    def _link_new(self, path: Path, content: bytes) -> bool:
        """Create a file atomically; ``False`` if it exists already."""
        temporary = self._heartbeat_file.parent / f".{uuid.uuid4().hex}"
        temporary.write_bytes(content)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(temporary, path)
        except FileExistsError:
            return False
        finally:
            temporary.unlink()
        return True


def _key(task_id: str, sample: int) -> str:
    return hashlib.sha256(f"{task_id}\x1f{sample}".encode()).hexdigest()[:32]


@asynccontextmanager
async def sharing(
    config: SharingConfig, name: str, tasks: Sequence[Task], run: Path, *, is_resumed: bool = False
) -> AsyncIterator[Claims | None]:
    """Join the shared list for the duration of the block; yields ``None`` if nothing is shared.

    Args:
        config: the shared folder and times.
        name: of the collector; the same when its run is resumed.
        tasks: the list, in order.
        run: the collector's run folder.
        is_resumed: whether the run holds attempts already.

    Raises:
        ConfigError: as in :meth:`Claims.join`.
        StoreError: the disk cannot be read or written.
    """
    if config.folder is None:
        yield None
        return
    claims = Claims(config, name)
    settings = await asyncio.to_thread(lambda: RunReader(run).config)
    await asyncio.to_thread(claims.join, tasks, settings, run, is_resumed=is_resumed)
    try:
        async with asyncio.TaskGroup() as group:
            heartbeats = group.create_task(_beat(claims))
            yield claims
            heartbeats.cancel()
    finally:
        await asyncio.shield(asyncio.to_thread(claims.leave))


async def _beat(claims: Claims) -> None:
    while True:
        await asyncio.sleep(claims.config.beat_seconds)
        await asyncio.to_thread(claims.beat)
