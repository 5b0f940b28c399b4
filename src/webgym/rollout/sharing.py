"""Several collectors share one task list, on a disk that all of them see.

Each has a run folder of its own and the same tasks. Before a sample is attempted it is claimed; nobody
attempts what somebody else has claimed. A collector shows that it lives; what a dead one has claimed and not
finished is taken over. Two things are asked of the disk: that a hard link to a name that is taken fails, and
that all see the same modification times. No collector's clock is looked at.

    DIR/
      tasks                the digest of the list: collectors of another are refused
      collectors/ID        the run folder of a collector; it lives if this was touched lately
      claims/ab/KEY.N      who has claimed a sample; the highest N counts
      done/ab/KEY          whose run holds the end of the sample: it needs no further attempt

A claim is never changed, only followed by another, so that of several who take over one wins. A collector
that was thought dead finds its claim followed, and drops the attempt. What a collector has done and wants to
attempt again, because its record is lost or somebody asked for it, is its own as before.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import uuid
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from enum import Enum
from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, Field

from webgym.core.errors import ConfigError, RunFolderError, StoreError
from webgym.core.task import Task
from webgym.rollout.files import disk_errors, write_whole
from webgym.rollout.store import RunReader
from webgym.settings import Settings

COLLECTORS: Final = "collectors"
"""Subfolder with a file for every collector, which holds the path of its run folder."""


class SharingConfig(Settings):
    """Where a task list is shared, and when a collector counts as dead."""

    folder: Annotated[Path, AfterValidator(Path.absolute)] | None = None
    """Folder on a disk that other collectors of the same tasks see too: each task is attempted by one of
    them."""

    beat_seconds: float = Field(default=5.0, gt=0)
    """Between two signs of life."""

    dead_seconds: float = Field(default=60.0, gt=0)
    """A collector without a sign of life for so long is dead. Several times the beat, and longer than the
    disk takes to show what others wrote."""

    look_seconds: float = Field(default=5.0, gt=0)
    """Between two looks at what others have claimed, when nothing else is left to do."""


class Claim(Enum):
    """The result of a claim on a sample."""

    OURS = "ours"
    TAKEN = "taken"
    DONE = "done"


class Claims:
    """What a collector has claimed. Blocks: call it from a thread.

    Args:
        config: limits; its folder is there.
        name: of the collector, the same whenever its run is resumed.
    """

    def __init__(self, config: SharingConfig, name: str) -> None:
        assert config.folder is not None
        self.config = config
        self._folder = config.folder
        self._name = name
        self._life = self._folder / COLLECTORS / name
        self._finished: dict[tuple[str, int], frozenset[tuple[str, int]]] = {}
        """Samples that dead collectors had finished, by name and last sign of life."""

    def join(self, tasks: Sequence[Task], samples: int, run: Path, *, goes_on: bool = False) -> None:
        """Begin to live.

        Args:
            tasks: the list, in its order.
            samples: wanted of every task.
            run: our run folder.
            goes_on: we have shared before, so that others may have done much of the list.

        Raises:
            ConfigError: others share another list there, or nobody does where we have before.
            StoreError: nothing can be written there.
        """
        told = "\n".join([str(samples), *(task.id for task in tasks)]).encode()
        digest = hashlib.sha256(told).hexdigest().encode()
        with disk_errors(f"sharing tasks in {self._folder}"):
            if goes_on and not (self._folder / "tasks").exists():
                raise ConfigError(
                    f"{self._folder}, where this run has shared its tasks, does not hold them any more",
                    hint="mount its disk, or name its new place in config.yaml (collector.sharing.folder)",
                )
            self._life.parent.mkdir(parents=True, exist_ok=True)
            self._link_new(self._folder / "tasks", digest)
            if (self._folder / "tasks").read_bytes() != digest:
                raise ConfigError(
                    f"{self._folder} is shared for another list of tasks",
                    hint="give all collectors the same tasks, seed and samples, or another folder",
                )
            write_whole(self._life, str(run.resolve()).encode())

    def leave(self) -> None:
        """What was claimed and not finished may be taken over at once."""
        with disk_errors(f"sharing tasks in {self._folder}"):
            os.utime(self._life, (0, 0))  # it stays: it says where our run is

    def beat(self) -> None:
        """Give a sign of life."""
        with disk_errors(f"sharing tasks in {self._folder}"):
            os.utime(self._life)

    def claim(self, task_id: str, sample: int) -> Claim:
        """Claim a sample.

        Raises:
            StoreError: the disk cannot be read or written.
        """
        key = _key(task_id, sample)
        with disk_errors(f"sharing tasks in {self._folder}"):
            whose = self._finisher(key)
            if whose not in (None, self._name):
                return Claim.DONE
            if whose is not None:  # our run does not hold it any more, or is to attempt it once more
                self._done(key).unlink(missing_ok=True)
            number, owner = self._newest(key)
            if owner == self._name:
                return Claim.OURS
            if owner is not None:
                if self._lives(owner):
                    return Claim.TAKEN
                if (task_id, sample) in self._finished_by(owner):
                    self._mark_done(key, owner)
                    return Claim.DONE
            if not self._link_new(self._claim(key, number), self._name.encode()):
                return Claim.TAKEN
            # Between our looks its owner may have ended: what is done is not done again.
            return Claim.DONE if self._done(key).exists() else Claim.OURS

    def holds(self, task_id: str, sample: int) -> bool:
        """Whether a sample that we claimed is still ours; a sign of life, too."""
        self.beat()
        with disk_errors(f"sharing tasks in {self._folder}"):
            return self._newest(_key(task_id, sample))[1] == self._name

    def finish(self, task_id: str, sample: int) -> None:
        """A sample of ours needs no further attempt, and is on disk."""
        with disk_errors(f"sharing tasks in {self._folder}"):
            self._mark_done(_key(task_id, sample), self._name)

    def _mark_done(self, key: str, whose: str) -> None:
        self._link_new(self._done(key), whose.encode())

    def _finisher(self, key: str) -> str | None:
        """Whose run holds the end of a sample; ``None`` if it has none."""
        try:
            return self._done(key).read_text()
        except FileNotFoundError:
            return None

    def _newest(self, key: str) -> tuple[int, str | None]:
        """The number that the next claim has, and who made the last."""
        number, owner = 0, None
        while True:
            try:
                owner = self._claim(key, number).read_text()
            except FileNotFoundError:
                return number, owner
            number += 1

    def _lives(self, owner: str) -> bool:
        try:
            age = self._life.stat().st_mtime - (self._life.parent / owner).stat().st_mtime
        except FileNotFoundError:
            return False
        return age < self.config.dead_seconds

    def _finished_by(self, owner: str) -> frozenset[tuple[str, int]]:
        """What a dead collector has recorded: it may have died before it said so."""
        life = self._life.parent / owner
        try:
            died = owner, life.stat().st_mtime_ns
            if died not in self._finished:
                entries = RunReader(Path(life.read_text()), skip_corrupt=True).attempts.values()
                self._finished[died] = frozenset(
                    (entry.task_id, entry.sample) for entry in entries if not entry.outcome.is_retried
                )
        except (FileNotFoundError, RunFolderError, StoreError):
            return frozenset()  # its run is gone, and what was in it
        return self._finished[died]

    def _claim(self, key: str, number: int) -> Path:
        return self._folder / "claims" / key[:2] / f"{key}.{number}"

    def _done(self, key: str) -> Path:
        return self._folder / "done" / key[:2] / key

    def _link_new(self, path: Path, content: bytes) -> bool:
        """Make a file whole; ``False`` if there is one."""
        made = self._life.parent / f".{uuid.uuid4().hex}"
        made.write_bytes(content)
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(made, path)
        except FileExistsError:
            return False
        finally:
            made.unlink()
        return True


def _key(task_id: str, sample: int) -> str:
    return hashlib.sha256(f"{task_id}\x1f{sample}".encode()).hexdigest()[:32]


@asynccontextmanager
async def sharing(
    config: SharingConfig, name: str, tasks: Sequence[Task], samples: int, run: Path, *, goes_on: bool = False
) -> AsyncIterator[Claims | None]:
    """Take part for the block; ``None`` where nothing is shared.

    Args:
        config: where.
        name: of the collector, the same whenever its run is resumed.
        tasks: the list, in its order.
        samples: wanted of every task.
        run: the collector's run folder.
        goes_on: it holds attempts already.

    Raises:
        ConfigError: as in :meth:`Claims.join`.
        StoreError: the disk cannot be read or written.
    """
    if config.folder is None:
        yield None
        return
    claims = Claims(config, name)
    await asyncio.to_thread(claims.join, tasks, samples, run, goes_on=goes_on)
    try:
        async with asyncio.TaskGroup() as group:
            beating = group.create_task(_beat(claims))
            yield claims
            beating.cancel()
    finally:
        await asyncio.shield(asyncio.to_thread(claims.leave))


async def _beat(claims: Claims) -> None:
    while True:
        await asyncio.sleep(claims.config.beat_seconds)
        await asyncio.to_thread(claims.beat)
