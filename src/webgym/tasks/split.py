"""Training and test tasks that share no website (paper §3; SYSTEM.md 1.5).

Every test task is from a different website, and no training task is on any of these websites, neither at its
start nor later: a task of several websites is on all that its truth names. Nor does a training task name one
of them by its address, in its instruction or its rubric: it may lead there. Websites are compared by brand
(:mod:`webgym.tasks.brands`): a policy that has trained on ``amazon.de`` has seen ``amazon.com``. Families
stay together: a task derived from a test task, or from a task on a test website, is not a training task,
whatever its own website. :func:`refuse_leaks` enforces this before training.

Test tasks are chosen by hashes of their ids and websites, so adding tasks changes as few of them as possible.
A website offers tasks of one or several (level, domain) pairs, and gives at most one task. This is an
assignment problem, solved by augmenting paths: websites are added one by one to the pair with the fewest
tasks, reassigning earlier websites to other pairs where that makes room; then tasks are exchanged between
pairs as long as that improves the balance.
"""

from __future__ import annotations

import hashlib
import heapq
import re
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, Protocol, TypeAlias

import msgspec
from pydantic import Field

from webgym.core.errors import ConfigError, TooFewWebsites
from webgym.core.settings import Settings
from webgym.core.tables import Table, printed
from webgym.core.task import LEVELS, Task
from webgym.core.websites import site_or_text
from webgym.tasks.brands import brand_of, brand_or_text
from webgym.tasks.files import gc_paused

WhyLeftOut: TypeAlias = Literal["test website", "test family", "names a test website", "no website"]


class SplitConfig(Settings):
    """How the test set is chosen."""

    test_tasks: int = Field(default=1_167, ge=0)
    """Number of test tasks, each from a different website (paper §3)."""
    largest_website: int = Field(default=100, ge=1)
    """Largest number of tasks of a test website, because all its other tasks are lost for training. Larger
    websites are used only if the others do not suffice, the smallest first."""
    seed: int = 0
    """Seed of the choice."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A task that is in neither split.

    Attributes:
        id: of the task.
        website: its registrable domain, as from :func:`~webgym.core.websites.site_of`; the task's own text if
            that is not a website.
        why: it, or an ancestor, is on a "test website"; it belongs to the family of a test task ("test
            family"); it "names a test website"; or its website is invalid ("no website").
    """

    id: str
    website: str
    why: WhyLeftOut


@dataclass(frozen=True, slots=True)
class Split:
    """The result of splitting.

    Attributes:
        tasks: the training and test tasks with ``split`` set, in their original order.
        left_out: the other tasks.
        test: number of test tasks by (level, domain).
    """

    tasks: list[Task]
    left_out: list[LeftOut]
    test: Counter[tuple[str, str]]

    def __str__(self) -> str:
        return printed([self.table(), *self.lines()])

    def table(self) -> Table:
        """The test tasks by domain and level."""

        def row(name: str, *domains: str) -> tuple[str, ...]:
            counts = [sum(self.test[level, domain] for domain in domains) for level in LEVELS]
            return (name, *map(str, counts), str(sum(counts)))

        domains = sorted({domain for _, domain in self.test})
        rows = [*(row(domain, domain) for domain in domains), row("all", *domains)]
        return Table("Test tasks", ("domain", *LEVELS, "all"), rows)

    def lines(self) -> list[str]:
        """The number of tasks of both splits, and of those that are left out, by reason."""
        test = self.test.total()
        counts = Counter(task.why for task in self.left_out)
        left_out = [f"{count:,} left out: {why}" for why, count in counts.items()]
        return [f"{len(self.tasks) - test:,} training and {test:,} test tasks", *left_out]


class Member(Protocol):
    """A task of any type, with what its family depends on."""

    @property
    def id(self) -> str:
        """Its id."""

    @property
    def parent_id(self) -> str | None:
        """The id of the task that it was derived from."""


class HeldOut(Member, Protocol):
    """A test task of any type, possibly without a website."""

    @property
    def website(self) -> str | None:
        """The URL where it starts."""


@gc_paused()
def split(
    tasks: Sequence[Task], config: SplitConfig | None = None, held_out: Sequence[HeldOut] = ()
) -> Split:
    """Choose the test tasks, and leave out training tasks that would leak them.

    Only original tasks are chosen for testing, not derived ones. They are balanced over levels, then domains,
    then pairs of both, as far as the websites allow (:func:`webgym.tasks.split.balanced`).

    Args:
        tasks: with unique ids; their ``split`` is ignored.
        config: size and choice of the test set; ``None`` for the defaults.
        held_out: tasks that are for testing already, whether they are among the tasks or not. One of each
            website stays a test task, even if these are more than the config asks for, and no other task of
            their websites and families is in a split.

    Raises:
        TooFewWebsites: there are fewer websites than there should be test tasks.
    """
    config = config or SplitConfig()
    sites = {task.id: _site(task) for task in tasks}
    roots = roots_of([*tasks, *held_out])
    held = {task.id for task in held_out}
    held_sites = {sites.get(task.id) or brand_or_text(task.website or "") for task in held_out}
    kept = {
        site: task.id
        for task in sorted(tasks, key=lambda task: _draw(config.seed, task.id), reverse=True)
        if task.id in held and (site := sites[task.id]) is not None
    }
    chosen = {*kept.values(), *_test_tasks(tasks, sites, config, len(kept), held_sites)}
    tests = [task for task in tasks if task.id in chosen | held]
    test_sites = held_sites.union(*map(_all_sites, tests))
    test_families = {roots.get(id, id) for id in chosen | held}
    on_test_site = inherited(tasks, {task.id: task.id for task in tasks if test_sites & _all_sites(task)})
    remaining: list[Task] = []
    left_out: list[LeftOut] = []
    for task in tasks:
        root, site = roots.get(task.id, task.id), sites[task.id]
        why: WhyLeftOut
        if task.id in chosen:
            remaining.append(msgspec.structs.replace(task, split="test"))
            continue
        if site is None:
            why = "no website"
        elif task.id in on_test_site:
            why = "test website"
        elif root in test_families:
            why = "test family"
        elif not test_sites.isdisjoint(_named_sites(task)):
            why = "names a test website"
        else:
            remaining.append(msgspec.structs.replace(task, split="train"))
            continue
        left_out.append(LeftOut(task.id, site_or_text(task.website), why))
    return Split(
        remaining, left_out, Counter((task.level, task.domain) for task in remaining if task.split == "test")
    )


@dataclass(frozen=True, slots=True)
class Leak:
    """A task that must not be trained on.

    Attributes:
        task: the task.
        of: id of the test task that it leaks; its own id if it is one.
        why: it is a "test task", it or an ancestor is on a "test website", it belongs to a "test family", or
            it "names a test website".
    """

    task: Task
    of: str
    why: Literal["test task", "test website", "test family", "names a test website"]

    def __str__(self) -> str:
        if self.why == "test task":
            return f"{self.task.id} is a test task"
        if self.why == "names a test website":
            return f"{self.task.id} names the website of the test task {self.of}"
        shared = "the website" if self.why == "test website" else "the family"
        return (
            f"{self.task.id} on {site_or_text(self.task.website)} shares {shared} of the test task {self.of}"
        )


def leaks(tasks: Sequence[Task], test: Sequence[Task]) -> list[Leak]:
    """The tasks that must not be trained on, because they share a website or a family with a test task, or
    name its website.

    Websites are compared by brand (:func:`webgym.tasks.brands.brand_of`), which when in doubt merges two
    websites.

    Args:
        tasks: the tasks to train on, with or without a split. A task whose split is ``test`` is a leak
            itself.
        test: the test tasks.
    """
    test_ids = {task.id for task in test}
    test_on = {site: task.id for task in reversed(test) for site in _all_sites(task)}
    roots = roots_of([*tasks, *test])
    own = {task.id: test_on[site] for task in tasks for site in _all_sites(task) & test_on.keys()}
    on_test_site = inherited(tasks, own)
    test_of = {roots.get(task.id, task.id): task.id for task in reversed(test)}
    leaks_found = []
    for task in tasks:
        root = roots.get(task.id, task.id)
        if task.id in test_ids or task.split == "test":
            leaks_found.append(Leak(task, task.id, "test task"))
        elif (test_id := on_test_site.get(task.id)) is not None:
            leaks_found.append(Leak(task, test_id, "test website"))
        elif (test_id := test_of.get(root)) is not None:
            leaks_found.append(Leak(task, test_id, "test family"))
        elif test_on and (named := next((site for site in _named_sites(task) if site in test_on), None)):
            leaks_found.append(Leak(task, test_on[named], "names a test website"))
    return leaks_found


def leaking(tasks: Sequence[Task]) -> dict[str, Leak]:
    """The tasks that must not be trained on because of the test tasks among them, by id."""
    test = [task for task in tasks if task.split == "test"]
    return {leak.task.id: leak for leak in leaks(tasks, test)} if test else {}


def refuse_leaks(tasks: Sequence[Task], test: Sequence[Task]) -> None:
    """Refuse to train on tasks that leak test tasks; trainers call it before they start.

    Args:
        tasks: the tasks to train on.
        test: the test tasks.

    Raises:
        ConfigError: there is a leak (:func:`leaks`); the message counts them and names one.
    """
    if found := leaks(tasks, test):
        raise ConfigError(
            f"{len(found):,} of {len(tasks):,} tasks must not be trained on: {found[0]}",
            hint="train on the training split only; webgym tasks validate lists all of them",
        )


def _site(task: Task) -> str | None:
    """The brand of the task's website; ``None`` if the website is invalid."""
    try:
        return brand_of(task.website)
    except ValueError:
        return None


def _all_sites(task: Task) -> set[str]:
    """The brands of all websites that a task is about."""
    others = () if task.truth is None else map(brand_or_text, task.truth.hosts)
    return {site for site in (_site(task), *others) if site is not None}


# --- families: an original task and all tasks derived from it ---------------------------------------------


def roots_of(tasks: Iterable[Member]) -> dict[str, str]:
    """The id of the first ancestor of every derived task, by id; other tasks are their own root.

    A parent need not be among the tasks. Of tasks that are each other's ancestors, as in a broken file, the
    smallest id is the root.
    """
    parents = {task.id: task.parent_id for task in tasks if task.parent_id is not None}
    roots: dict[str, str] = {}
    for start in parents:
        trail: list[str] = []
        ancestor = start
        while ancestor in parents and ancestor not in roots and ancestor not in trail:
            trail.append(ancestor)
            ancestor = parents[ancestor]
        root = min(trail[trail.index(ancestor) :]) if ancestor in trail else roots.get(ancestor, ancestor)
        for descendant in trail:
            roots[descendant] = root
    return roots


def inherited(tasks: Iterable[Task], values: Mapping[str, str]) -> dict[str, str]:
    """The value of every task that has one or whose ancestor has one, by id: its own, else the nearest
    ancestor's.

    Args:
        tasks: ancestors are looked for among these.
        values: by id.
    """
    parents = {task.id: task.parent_id for task in tasks if task.parent_id is not None}
    found: dict[str, str | None] = dict(values)
    for start in parents:
        trail: dict[str, None] = {}
        ancestor = start
        while ancestor in parents and ancestor not in found and ancestor not in trail:
            trail[ancestor] = None
            ancestor = parents[ancestor]
        found |= dict.fromkeys(trail, found.get(ancestor))
    return {id: value for id, value in found.items() if value is not None}


# --- websites ---------------------------------------------------------------------------------------------


_ADDRESS = re.compile(r"(?<![\w@.-])(?:[^\W_](?:[\w-]*[^\W_])?\.)+(?:xn--[\w-]+|[^\W\d_]{2,})(?![\w-])")


def _named_sites(task: Task) -> Iterator[str]:
    """The brands of the websites whose address a task's instruction or rubric has, by itself or in a URL."""
    groups = task.rubric.groups
    texts = [task.instruction, *(text for group in groups for text in (group.description, *group.facts))]
    return (brand_or_text(name) for text in texts if "." in text for name in _ADDRESS.findall(text))


def _test_tasks(
    tasks: Iterable[Task], sites: dict[str, str | None], config: SplitConfig, kept: int, held: set[str]
) -> set[str]:
    """The ids of the test tasks beside those ``kept``, from websites other than those ``held`` out."""
    sizes = Counter(sites.values())
    by_site: dict[str, list[Task]] = defaultdict(list)
    for task in tasks:
        site = sites[task.id]
        if site is not None and site not in held and task.parent_id is None:
            by_site[site].append(task)
    count = max(config.test_tasks - kept, 0)
    if count > len(by_site):
        raise TooFewWebsites(
            f"{config.test_tasks:,} test tasks need as many websites, and there are {len(by_site) + kept:,}",
            hint="ask for fewer test tasks, or give more tasks",
        )
    allowed = [site for site in by_site if sizes[site] <= config.largest_website]
    if len(allowed) < count:
        allowed = sorted(by_site, key=lambda site: (sizes[site], site))[:count]
    return _choose({site: by_site[site] for site in allowed}, count, config.seed)


def _choose(by_site: dict[str, list[Task]], count: int, seed: int) -> set[str]:
    """The ids of the test tasks: one from each of ``count`` websites."""
    drawn = {site: _draw(seed, site) for site in by_site}
    order = sorted(by_site, key=drawn.__getitem__)
    strata: list[dict[tuple[str, str], str]] = []
    for site in order:
        best: dict[tuple[str, str], tuple[bytes, str]] = {}
        for task in by_site[site]:
            key, candidate = (task.level, task.domain), (_draw(seed, task.id), task.id)
            best[key] = min(best.get(key, candidate), candidate)
        strata.append({key: id for key, (_, id) in best.items()})
    choice = balanced([list(options) for options in strata], count)
    return {strata[index][key] for index, key in choice.items()}


def _draw(seed: int, name: str) -> bytes:
    return hashlib.blake2b(f"split/{seed}/{name}".encode(), digest_size=8).digest()


Pair: TypeAlias = tuple[str, str]
"""Level and domain."""


def balanced(offers: Sequence[Sequence[Pair]], count: int) -> dict[int, Pair]:
    """Choose ``count`` websites and, for each, one of the pairs that it offers.

    Levels are balanced first, then domains, then pairs: in this order, the sum of squares of their counts
    cannot be lowered by replacing one task by a task of another pair. This is optimal except in rare cases of
    few websites, in which only two such replacements together would help.

    Args:
        offers: the pairs that each website offers: at least one, without duplicates. Earlier websites are
            preferred.
        count: at most the number of websites.

    Returns:
        The pair chosen for each chosen website, by its index in ``offers``.
    """
    table = _Table(offers)
    for _ in range(count):
        table.add()
    while table.exchange():
        pass
    return table.chosen


class _Table:
    """The assignment of websites to pairs. In paths, ``None`` stands for the unassigned websites."""

    def __init__(self, offers: Sequence[Sequence[Pair]]) -> None:
        self.chosen: dict[int, Pair] = {}
        self._offers = offers
        self._free: dict[Pair, list[int]] = defaultdict(list)
        for website, pairs in enumerate(offers):
            for pair in pairs:
                self._free[pair].append(website)  # ascending, so a heap already
        self._pairs = sorted(self._free)
        self._extendable = list(self._pairs)
        self._members: dict[Pair, set[int]] = {pair: set() for pair in self._pairs}
        self._movable: dict[Pair, Counter[Pair]] = {pair: Counter() for pair in self._pairs}
        self._levels: Counter[str] = Counter()
        self._domains: Counter[str] = Counter()

    def add(self) -> None:
        """Assign one more website, to the pair with the fewest tasks among those that can have another."""
        for pair in sorted(self._extendable, key=self._weight):
            path = self._path(None, pair)
            if path:
                self._apply(path)
                return
            self._extendable.remove(pair)  # no website that is added later can make room here

    def exchange(self) -> bool:
        """Replace a task of one pair by a task of another, if that improves the balance; whether it did."""
        best, exchanged = (0, 0, 0), None
        for fuller in self._pairs:
            if not self._members[fuller]:
                continue
            reached = self._reachable(fuller)
            for emptier in self._pairs:
                gain = self._gain(fuller, emptier)
                if emptier != fuller and gain < best and emptier in reached:
                    best, exchanged = gain, (fuller, emptier)
        if exchanged is None:
            return False
        self._apply(self._path(*exchanged))
        return True

    def _weight(self, pair: Pair) -> tuple[int, int, int, Pair]:
        level, domain = pair
        return self._levels[level], self._domains[domain], len(self._members[pair]), pair

    def _gain(self, fuller: Pair, emptier: Pair) -> tuple[int, int, int]:
        """Half of the change of the sums of squares of levels, domains and pairs; negative is better."""
        level = domain = 0
        if fuller[0] != emptier[0]:
            level = self._levels[emptier[0]] - self._levels[fuller[0]] + 1
        if fuller[1] != emptier[1]:
            domain = self._domains[emptier[1]] - self._domains[fuller[1]] + 1
        return level, domain, len(self._members[emptier]) - len(self._members[fuller]) + 1

    def _reachable(self, start: Pair | None) -> dict[Pair | None, Pair | None]:
        """The pairs that can get another website if ``start`` gives one up, each with its predecessor on the
        path."""
        predecessors: dict[Pair | None, Pair | None] = {start: start}
        queue = deque([start])
        while queue:
            current = queue.popleft()
            for pair in self._pairs:
                if pair not in predecessors and (
                    self._first_free(pair) if current is None else self._movable[current][pair]
                ):
                    predecessors[pair] = current
                    queue.append(pair)
            if None not in predecessors:
                predecessors[None] = current
                queue.append(None)
        return predecessors

    def _path(self, start: Pair | None, end: Pair) -> list[Pair | None]:
        if start is None and self._first_free(end):
            return [None, end]
        predecessors = self._reachable(start)
        if end not in predecessors:
            return []
        path: list[Pair | None] = [end]
        while path[-1] != start:
            path.append(predecessors[path[-1]])
        return path[::-1]

    def _first_free(self, pair: Pair) -> list[int]:
        """Heap of the unassigned websites that offer a pair, the preferred one first; empty if there is
        none."""
        heap = self._free[pair]
        while heap and heap[0] in self.chosen:
            heapq.heappop(heap)
        return heap

    def _apply(self, path: list[Pair | None]) -> None:
        """Move one website along every edge of the path. All are chosen before the first is moved."""
        moves: list[tuple[int, Pair | None]] = []
        for current, pair in pairwise(path):
            if current is None:
                assert pair is not None
                moves.append((self._first_free(pair)[0], pair))
            elif pair is None:
                moves.append((max(self._members[current]), None))
            else:
                movable = (website for website in self._members[current] if pair in self._offers[website])
                moves.append((min(movable), pair))
        for website, pair in moves:
            self._move(website, pair)

    def _move(self, website: int, target: Pair | None) -> None:
        old = self.chosen.pop(website, None)
        if old is not None:
            self._count(website, old, -1)
            self._members[old].remove(website)
        if target is not None:
            self.chosen[website] = target
            self._members[target].add(website)
            self._count(website, target, 1)
        else:
            for pair in self._offers[website]:
                heapq.heappush(self._free[pair], website)

    def _count(self, website: int, pair: Pair, change: int) -> None:
        self._levels[pair[0]] += change
        self._domains[pair[1]] += change
        for other in self._offers[website]:
            if other != pair:
                self._movable[pair][other] += change
