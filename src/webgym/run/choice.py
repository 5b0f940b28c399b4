"""The tasks of a run: read, selected and drawn according to its settings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace

from webgym.core.errors import ConfigError
from webgym.core.task import Task
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Split
from webgym.rollout.blocklist import Blocklist
from webgym.run.cache import cached_tasks
from webgym.run.config import RunConfig, Tell, say
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
    selected = select(available.tasks, choice, Blocklist(config.blocklist).blocked())
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
        return read_tasks(config.tasks.file)
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
