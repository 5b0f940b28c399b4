"""The tasks of a run: read, selected and drawn according to its settings.

Those of the offline web are cached on disk: generating them takes many seconds, reading them one.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from webgym.core.errors import ConfigError
from webgym.core.settings import set_values
from webgym.core.task import Task
from webgym.offline.web import COLLECTIONS, OfflineWeb, digest_of_code
from webgym.offline.website import Split
from webgym.rollout.site_health import SiteHealth
from webgym.run.config import RunConfig, Tell, say
from webgym.store.files import write_whole
from webgym.tasks.benchmarks import read_benchmark
from webgym.tasks.brands import brand_or_text
from webgym.tasks.files import BrokenRecord, TaskFile, unfit
from webgym.tasks.formats import read_tasks
from webgym.tasks.sampling import Sampler, SamplerConfig, draw, draw_spread
from webgym.tasks.selection import Selected, select
from webgym.tasks.split import leaking


class Chosen(NamedTuple):
    """The tasks of a run.

    Attributes:
        tasks: in the order of their attempts.
        broken, set_aside: records of the file that were skipped, and tasks without a fact to judge.
        selected: what the tasks were drawn from.
    """

    tasks: list[Task]
    broken: list[BrokenRecord]
    set_aside: list[BrokenRecord]
    selected: Selected


def choose_tasks(config: RunConfig, tell: Tell | None = None) -> Chosen:
    """The tasks of a run; of tasks of all splits, training tasks that leak test tasks have none.

    Args:
        config: of the run.
        tell: is told what takes long.

    Raises:
        TaskFileError: the file cannot be read or holds no task.
        ConfigError: no task is left, or there is no such domain.
    """
    choice = config.tasks
    split = choice.split if choice.split in ("train", "test") else None
    available = _read(config, split, tell)
    selected = select(available.tasks, choice, health_of(config).blocked())
    if not selected.tasks:
        why = selected.told() or f"none of {config.sites.per_family} websites per family is for it"
        raise ConfigError(
            f"there is no task to attempt for the split {choice.split!r}: {why}",
            hint="choose another split or more domains",
        )
    tasks = _drawn(selected.tasks, config)
    if choice.split == "all":  # the run may hold them without the test tasks that they leak
        leaked = leaking(available.tasks)
        is_leak = [task.split == "train" and task.id in leaked for task in tasks]
        tasks = [
            replace(task, split=None) if leak else task for task, leak in zip(tasks, is_leak, strict=True)
        ]
    return Chosen(tasks, available.broken, available.set_aside, selected)


def health_of(config: RunConfig, own: Path | None = None) -> SiteHealth:
    """The record of which websites answer a run's browsers.

    Args:
        config: of the run.
        own: the run's own file.
    """
    identity = config.browser.identity.over(set_values(config.attempt.identity))
    return SiteHealth(config.health, own, identity.label)


def all_tasks(config: RunConfig, tell: Tell | None = None) -> list[Task]:
    """The whole task set that a run's tasks are chosen from, every split of it.

    Args:
        config: of the run.
        tell: is told what takes long, and what is left out.

    Raises:
        TaskFileError: the file cannot be read or holds no task.
    """
    read = _read(config, None, tell)
    tell_left_out(read.broken, read.set_aside, tell)
    return read.tasks


def tell_left_out(broken: list[BrokenRecord], set_aside: list[BrokenRecord], tell: Tell | None) -> None:
    """Tell the user which records of a task file are left out."""
    for line in broken:
        say(tell, f"skipped {line}")
    if set_aside:
        say(tell, f"set aside {len(set_aside):,} tasks without a fact to judge; the first: {set_aside[0]}")


def _read(config: RunConfig, split: Split | None, tell: Tell | None) -> TaskFile:
    """All tasks of the file, or the offline web's tasks of a split."""
    if config.tasks.file is not None:
        benchmark, file = config.tasks.benchmark, config.tasks.file
        return read_tasks(file) if benchmark is None else read_benchmark(benchmark, file)
    sites = config.sites
    web = OfflineWeb(sites.seed, per_family=sites.per_family, collection=sites.collection)
    return TaskFile(cached_tasks(web, split, tell=tell), [])


def given_tasks(tasks: Sequence[Task], config: RunConfig) -> Chosen:
    """Tasks that the caller has drawn.

    Raises:
        ConfigError: the config excludes some of them, or they have nothing to judge.
    """
    selected = select(tasks, config.tasks)
    if len(selected.tasks) != len(tasks):
        raise ConfigError(f"of {len(tasks)} given tasks some cannot be attempted: {selected.told()}")
    for task in tasks:
        if reason := unfit(task):
            raise ConfigError(f"the task {task.id[:80]} cannot be attempted: {reason}")
    return Chosen(list(tasks), [], [], selected)


def _drawn(tasks: list[Task], config: RunConfig) -> list[Task]:
    choice, count = config.tasks, config.tasks.drawn(len(tasks))
    if choice.ratio is not None and count is not None:
        sampler_config = SamplerConfig(split="all", ratio=choice.ratio, seed=config.seed)
        return Sampler(tasks, sampler_config).draw(count)
    if choice.spread:
        return draw_spread(tasks, count, config.seed, key=lambda task: brand_or_text(task.website))
    return draw(tasks, count, config.seed)


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
