"""Training and test tasks that share no website (paper §3; SYSTEM.md 1.5).

Every test task is from a website of its own, and no training task is on any of these websites. What counts as
one website here is a brand under whatever suffix (:mod:`webgym.tasks.brands`): a policy that has trained on
``amazon.de`` has seen ``amazon.com``. Families stay together: whatever descends from a test task, or from a
task on a test website, is not a training task, wherever it is itself.
:func:`refuse_leaks` holds a trainer to it.

Which tasks become test tasks is decided by hashes of their ids and websites, so that more tasks in the list
move no more test tasks than they must.
"""

from __future__ import annotations

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import msgspec
from pydantic import Field

from webgym.core.errors import ConfigError, TooFewWebsites
from webgym.core.task import Task
from webgym.core.websites import site_or_text
from webgym.settings import Settings
from webgym.tasks.balance import balanced
from webgym.tasks.brands import brand_of
from webgym.tasks.families import roots_of
from webgym.tasks.files import gc_paused

WhyLeftOut: TypeAlias = Literal["test website", "test family", "no website"]


class SplitConfig(Settings):
    """How the test set is made."""

    test_tasks: int = Field(default=1_167, ge=0)
    """Test tasks, each from a website of its own (paper §3)."""
    largest_website: int = Field(default=100, ge=1)
    """A test website takes all its other tasks out of training. Those with more tasks than this, which would
    take thousands, are for testing only where the others do not suffice, the smallest first."""
    seed: int = 0
    """Of the choice."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A task that is in neither split.

    Attributes:
        id: of the task.
        website: that it is on, as :func:`~webgym.core.websites.site_of` names it; as the task does, if that
            names none.
        why: it, or an ancestor, is on a "test website"; it belongs to a "test family", whose member is a test
            task; or "no website" can be told.
    """

    id: str
    website: str
    why: WhyLeftOut


@dataclass(frozen=True, slots=True)
class Split:
    """The result of splitting.

    Attributes:
        tasks: those for training and for testing, in the order in which they came, ``split`` set.
        left_out: the others.
        test: test tasks by (level, domain).
    """

    tasks: list[Task]
    left_out: list[LeftOut]
    test: Counter[tuple[str, str]]

    def of_level(self, level: str) -> int:
        """Test tasks of a level."""
        return sum(count for pair, count in self.test.items() if pair[0] == level)

    def of_domain(self, domain: str) -> int:
        """Test tasks of a domain."""
        return sum(count for pair, count in self.test.items() if pair[1] == domain)


@gc_paused()
def split(tasks: Sequence[Task], config: SplitConfig | None = None) -> Split:
    """Choose the test tasks, and drop from training what would give them away.

    Only tasks of a source are chosen for testing, not derived ones. Over the levels, and then over the
    domains, and then over each pair of both, they are as even as the websites allow
    (:func:`webgym.tasks.balance.balanced`).

    Args:
        tasks: with unique ids. What they say about their split does not matter.

    Raises:
        TooFewWebsites: there are fewer websites than there should be test tasks.
    """
    config = config or SplitConfig()
    sites = {task.id: _site(task) for task in tasks}
    roots = roots_of(tasks)
    chosen = _test_tasks(tasks, sites, config)
    test_sites = {sites[id] for id in chosen}
    test_families = {roots.get(id, id) for id in chosen}
    kept: list[Task] = []
    left_out: list[LeftOut] = []
    for task in tasks:
        root, site = roots.get(task.id, task.id), sites[task.id]
        why: WhyLeftOut
        if task.id in chosen:
            kept.append(msgspec.structs.replace(task, split="test"))
            continue
        if site is None:
            why = "no website"
        elif site in test_sites or sites.get(root) in test_sites:
            why = "test website"
        elif root in test_families:
            why = "test family"
        else:
            kept.append(msgspec.structs.replace(task, split="train"))
            continue
        left_out.append(LeftOut(task.id, site_or_text(task.website), why))
    return Split(kept, left_out, Counter((task.level, task.domain) for task in kept if task.split == "test"))


@dataclass(frozen=True, slots=True)
class Leak:
    """A task that must not be trained on.

    Attributes:
        task: the task.
        of: id of the test task that it gives away; its own if it is one.
        why: it is a "test task", it or an ancestor is on a "test website", or it belongs to a "test family".
    """

    task: Task
    of: str
    why: Literal["test task", "test website", "test family"]

    def __str__(self) -> str:
        if self.why == "test task":
            return f"{self.task.id} is a test task"
        shared = "the website" if self.why == "test website" else "the family"
        return (
            f"{self.task.id} on {site_or_text(self.task.website)} shares {shared} of the test task {self.of}"
        )


def leaks(tasks: Sequence[Task], test: Sequence[Task]) -> list[Leak]:
    """Which of the tasks would let a policy train on what it is tested on.

    Websites are compared by brand (:func:`webgym.tasks.brands.brand_of`), which rather takes two websites for
    one than one for two.

    Args:
        tasks: to train on, with or without a split. One whose split is test is a leak by itself.
        test: what is tested on.
    """
    test_ids = {task.id for task in test}
    test_on = {site: task.id for task in reversed(test) if (site := _site(task)) is not None}
    roots = roots_of([*tasks, *test])
    site_of_root = {task.id: _site(task) for task in tasks if task.parent_id is None}
    test_of = {roots.get(task.id, task.id): task.id for task in reversed(test)}
    found = []
    for task in tasks:
        root = roots.get(task.id, task.id)
        if task.id in test_ids or task.split == "test":
            found.append(Leak(task, task.id, "test task"))
        elif (of := test_on.get(_site(task) or "") or test_on.get(site_of_root.get(root) or "")) is not None:
            found.append(Leak(task, of, "test website"))
        elif (of := test_of.get(root)) is not None:
            found.append(Leak(task, of, "test family"))
    return found


def refuse_leaks(tasks: Sequence[Task], test: Sequence[Task]) -> None:
    """Refuse to train on tasks that give away what is tested on; the guard of whatever trains.

    Args:
        tasks: to train on.
        test: what is tested on.

    Raises:
        ConfigError: there is a leak (:func:`leaks`); counts them and names one.
    """
    if found := leaks(tasks, test):
        raise ConfigError(
            f"{len(found):,} of {len(tasks):,} tasks must not be trained on: {found[0]}",
            hint="train on the training split alone; webgym tasks validate names every offender",
        )


def _site(task: Task) -> str | None:
    """What the split takes for the task's website; ``None`` if it names none."""
    try:
        return brand_of(task.website)
    except ValueError:
        return None


def _test_tasks(tasks: Iterable[Task], sites: dict[str, str | None], config: SplitConfig) -> set[str]:
    sizes = Counter(sites.values())
    by_site: dict[str, list[Task]] = defaultdict(list)
    for task in tasks:
        site = sites[task.id]
        if site is not None and task.parent_id is None:
            by_site[site].append(task)
    if config.test_tasks > len(by_site):
        raise TooFewWebsites(
            f"{config.test_tasks:,} test tasks need as many websites, and there are {len(by_site):,}",
            hint="ask for fewer test tasks, or give more tasks",
        )
    allowed = [site for site in by_site if sizes[site] <= config.largest_website]
    if len(allowed) < config.test_tasks:
        allowed = sorted(by_site, key=lambda site: (sizes[site], site))[: config.test_tasks]
    return _choose({site: by_site[site] for site in allowed}, config)


def _choose(by_site: dict[str, list[Task]], config: SplitConfig) -> set[str]:
    """One task from each of so many websites."""
    drawn = {site: _draw(config.seed, site) for site in by_site}
    order = sorted(by_site, key=drawn.__getitem__)
    strata: list[dict[tuple[str, str], str]] = []
    for site in order:
        best: dict[tuple[str, str], tuple[bytes, str]] = {}
        for task in by_site[site]:
            key, candidate = (task.level, task.domain), (_draw(config.seed, task.id), task.id)
            best[key] = min(best.get(key, candidate), candidate)
        strata.append({key: id for key, (_, id) in best.items()})
    choice = balanced([list(options) for options in strata], config.test_tasks)
    return {strata[index][key] for index, key in choice.items()}


def _draw(seed: int, name: str) -> bytes:
    return hashlib.blake2b(f"split/{seed}/{name}".encode(), digest_size=8).digest()
