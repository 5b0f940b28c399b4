"""Caches the offline web's tasks on disk: generating them takes many seconds, reading them one."""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from webgym.core.task import Task
from webgym.offline.web import COLLECTIONS, OfflineWeb, digest_of_code
from webgym.offline.website import Split
from webgym.store.files import write_whole

_log = logging.getLogger(__name__)

KEPT_FILES = 8
"""Most files in the folder; the least recently used are deleted first."""


def cached_tasks(
    web: OfflineWeb,
    split: Split | None = None,
    folder: Path | None = None,
    *,
    tell: Callable[[str], None] | None = None,
) -> list[Task]:
    """The tasks of a web, as :meth:`OfflineWeb.tasks` makes them.

    The cache file's name is a digest of what the tasks are generated from: the web's settings and the content
    of every file of ``webgym.offline`` and ``webgym.core``. A file that is missing or damaged is made anew;
    if it cannot be written, the tasks are not cached. Nor are those of families from elsewhere, whose code is
    not known here.

    Args:
        web: the offline web.
        split: only tasks of this split; by default all.
        folder: of the cache files; by default ``webgym/tasks`` in the user's cache folder.
        tell: called with a message if tasks have to be made, before it takes that long.
    """
    collection = next((name for name, shipped in COLLECTIONS.items() if shipped is web.collection), None)
    if collection is None:
        return list(web.tasks(split))
    folder = folder or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "webgym" / "tasks"
    inputs = f"{sys.version} {digest_of_code()} {web.seed} {web.per_family} {collection} {split}"
    file = folder / f"{hashlib.sha256(inputs.encode()).hexdigest()[:32]}.msgpack"
    try:
        tasks = _checked(file.read_bytes())
        os.utime(file)
    except (OSError, ValueError):
        if tell is not None:
            count = sum(split in (None, spec.split) for spec in web.specs.values())
            tell(f"making the tasks of {count} websites, once for this version of the offline web")
        tasks = list(web.tasks(split))
        _store(tasks, file)
    return tasks


def _checked(raw: bytes) -> list[Task]:
    """The tasks in a file, which begins with the SHA-256 of the rest.

    Raises:
        ValueError: it is damaged.
    """
    digest, body = raw[:32], raw[32:]
    if hashlib.sha256(body).digest() != digest:
        raise ValueError("the checksum does not match")
    return msgspec.msgpack.decode(body, type=list[Task])


def _store(tasks: list[Task], file: Path) -> None:
    body = msgspec.msgpack.encode(tasks)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, hashlib.sha256(body).digest() + body, durable=False)
        # All files, including those that a killed process left half-written.
        files = sorted(file.parent.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in files[:-KEPT_FILES]:
            old.unlink(missing_ok=True)
    except OSError as error:  # such as a full disk or a read-only folder
        _log.debug("tasks are not cached in %s: %s", file.parent, error)
