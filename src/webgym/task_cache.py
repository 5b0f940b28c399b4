"""Tasks of the offline web, kept on disk between commands: making all takes many seconds, reading one."""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path

import msgspec

from webgym.core.task import Task
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Split
from webgym.rollout.files import write_whole

_log = logging.getLogger(__name__)

KEPT_FILES = 8
"""In the folder; the longest unused goes first."""


def cached_tasks(
    web: OfflineWeb,
    split: Split | None = None,
    folder: Path | None = None,
    *,
    tell: Callable[[str], None] | None = None,
) -> list[Task]:
    """The tasks of a web, as :meth:`OfflineWeb.tasks` makes them.

    They are read from a file whose name says what they were made from: the web's settings and the content
    of every file of ``webgym.offline`` and ``webgym.core``. A file that is missing or damaged is made anew;
    where none can be written, nothing is kept.

    Args:
        web: one of the collections.
        split: the split, or all.
        folder: of the files; by default ``webgym/tasks`` in the user's cache folder.
        tell: is told if tasks have to be made, before it takes that long.
    """
    folder = folder or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "webgym" / "tasks"
    said = f"{_digest_of_code()} {web.seed} {web.per_family} {web.collection} {split}"
    file = folder / f"{hashlib.sha256(said.encode()).hexdigest()[:32]}.msgpack"
    try:
        tasks = _checked(file.read_bytes())
        os.utime(file)
    except (OSError, ValueError):
        if tell is not None:
            count = sum(split in (None, spec.split) for spec in web.specs.values())
            tell(f"making the tasks of {count} websites, once for this version of the offline web")
        tasks = list(web.tasks(split))
        _keep(tasks, file)
    return tasks


def _checked(raw: bytes) -> list[Task]:
    """The tasks of a file, which begins with the digest of what follows.

    Raises:
        ValueError: it is damaged.
    """
    digest, body = raw[:32], raw[32:]
    if hashlib.sha256(body).digest() != digest:
        raise ValueError("the digest does not fit")
    return msgspec.msgpack.decode(body, type=list[Task])


def _keep(tasks: list[Task], file: Path) -> None:
    body = msgspec.msgpack.encode(tasks)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, hashlib.sha256(body).digest() + body, durable=False)
        # All files: also what a process that was killed had begun to write.
        kept = sorted(file.parent.iterdir(), key=lambda each: each.stat().st_mtime)
        for old in kept[:-KEPT_FILES]:
            old.unlink(missing_ok=True)
    except OSError as error:  # a full disk, a folder that may not be written
        _log.debug("tasks are not kept in %s: %s", file.parent, error)


@lru_cache(maxsize=1)
def _digest_of_code() -> str:
    """Of all files that tasks are made by."""
    digest = hashlib.sha256(sys.version.encode())
    for file in _files():
        digest.update(f"{file.name} {file.stat().st_size}\n".encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _files() -> Iterator[Path]:
    root = Path(__file__).parent
    for package in ("offline", "core"):
        yield from sorted(
            file for file in (root / package).rglob("*") if file.suffix in (".py", ".toml") and file.is_file()
        )
