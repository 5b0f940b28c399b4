"""Validation of a task set: no leaks between splits, no contradictions (SYSTEM.md 1.1, 1.3, 1.5)."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from webgym.core.task import Task
from webgym.core.text import plain
from webgym.core.websites import OFFLINE, site_of, site_or_text
from webgym.tasks.brands import brand_or_text
from webgym.tasks.published import DIFFICULTY_DIFFERS
from webgym.tasks.split import leaks
from webgym.tasks.taxonomy import DOMAIN_OF, DOMAINS

Rule: TypeAlias = Literal[
    "id", "instruction", "website", "domain", "difficulty", "split", "distinct", "leak", "family", "derived"
]

RULES: Final[dict[Rule, str]] = {
    "id": "every task has an id of its own",
    "instruction": "every task asks for something",
    "website": "every website can be told",
    "domain": "domain and subdomain are of the taxonomy",
    "difficulty": "a difficulty that is given is the number of facts",
    "split": "every task is for training or for testing",
    "distinct": "no two test tasks share a website, but for those of the offline web",
    "leak": "no training task is on a test website",
    "family": "no training task has an ancestor or descendant, however far, among the test tasks",
    "derived": "a derived task asks for some of its parent's groups, a large one among them, and no more",
}
"""The rules that are checked, in the order of the report."""
SPLIT_RULES: Final[frozenset[Rule]] = frozenset({"split", "distinct", "leak", "family"})
"""Rules that can be checked only after the tasks have been split."""


@dataclass(frozen=True, slots=True)
class Violation:
    """A task that breaks a rule.

    Attributes:
        rule: a key of :data:`RULES`.
        id: of the task.
        website: its registrable domain, or the task's own text if that is not a website.
        detail: what is wrong, with the ids of other tasks involved.
    """

    rule: Rule
    id: str
    website: str
    detail: str

    def __str__(self) -> str:
        return plain(f"{self.rule}: {self.id} ({self.website}): {self.detail}")


@dataclass(frozen=True, slots=True)
class Report:
    """The result of a validation.

    Attributes:
        tasks, train, test: number of tasks, of training tasks, and of test tasks.
        websites, test_websites: number of websites of all tasks, and of the test tasks.
        offenders: violations by rule, then in the order of the tasks.
        unchecked: rules that were not checked.
        orphans: ids of derived tasks whose parent is not among the tasks, so that ``derived`` cannot be
            checked. This is no violation: a part of a set may lack parents.
    """

    tasks: int
    train: int
    test: int
    websites: int
    test_websites: int
    offenders: list[Violation]
    orphans: list[str]
    unchecked: list[Rule]

    @property
    def ok(self) -> bool:
        """Whether no violation was found."""
        return not self.offenders

    def counts(self) -> dict[Rule, int]:
        """Number of violations of every rule that was checked."""
        violations = Counter(offender.rule for offender in self.offenders)
        return {rule: violations[rule] for rule in RULES if rule not in self.unchecked}

    def __str__(self) -> str:
        return "\n".join(
            line for head, listed in self.sections() for line in (head, *(f"      {each}" for each in listed))
        )

    def sections(self, broken: Sequence[str] = ()) -> Iterator[tuple[str, Sequence[str]]]:
        """Lines of the report, each with what is listed below it.

        Args:
            broken: records that could not be read as tasks.
        """
        test = f"{self.test:,} for testing, on {self.test_websites:,} websites"
        whole = f"{self.tasks:,} tasks on {self.websites:,} websites"
        yield f"{whole}, {self.train:,} for training and {test}", ()
        for rule, count in self.counts().items():
            listed = [str(each) for each in self.offenders if each.rule == rule]
            yield f"BAD {RULES[rule]}: {count:,} exceptions" if count else f"ok  {RULES[rule]}", listed
        for rule in self.unchecked:
            yield f"--  not checked, as the tasks are not split yet: {RULES[rule]}", ()
        if broken:
            yield f"BAD every record can be read: {len(broken):,} cannot", broken
        if self.orphans:
            some, count = plain(", ".join(self.orphans[:3])), len(self.orphans)
            yield f"{count:,} derived tasks have no parent here, which is allowed: {some}, ...", ()


def validate(tasks: Sequence[Task], *, split: bool = True) -> Report:
    """Check tasks against every one of :data:`RULES`.

    Args:
        tasks: all of a set, training and test tasks together.
        split: whether they have been split; if not, the rules in :data:`SPLIT_RULES` are reported as
            unchecked.
    """
    sites = [site_or_text(task.website) for task in tasks]
    by_id: dict[str, Task] = {}
    for task in tasks:
        by_id.setdefault(task.id, task)
    offenders = list(_task_violations(tasks, sites))
    for task, site in zip(tasks, sites, strict=True):
        parent = by_id.get(task.parent_id) if task.parent_id is not None else None
        if parent is not None and (problem := _why_not_derived(task, parent)):
            offenders.append(Violation("derived", task.id, site, problem))
    if split:
        offenders += _split_violations(tasks)
    order = {rule: position for position, rule in enumerate(RULES)}
    return Report(
        tasks=len(tasks),
        train=sum(task.split == "train" for task in tasks),
        test=sum(task.split == "test" for task in tasks),
        websites=len(set(sites)),
        test_websites=len({site for task, site in zip(tasks, sites, strict=True) if task.split == "test"}),
        offenders=sorted(offenders, key=lambda offender: order[offender.rule]),
        unchecked=[] if split else [rule for rule in RULES if rule in SPLIT_RULES],
        orphans=[task.id for task in tasks if task.parent_id is not None and task.parent_id not in by_id],
    )


def _task_violations(tasks: Sequence[Task], sites: Sequence[str]) -> Iterator[Violation]:
    """Violations of rules about single tasks."""
    seen: set[str] = set()
    for task, site in zip(tasks, sites, strict=True):
        if task.id in seen or not task.id:
            yield Violation("id", task.id, site, "a second task with this id" if task.id else "no id")
        seen.add(task.id)
        if not task.instruction or task.instruction.isspace():
            yield Violation("instruction", task.id, site, "it is empty")
        if site == task.website and not _names_a_website(site):
            yield Violation("website", task.id, site, f"{task.website!r} does not name a website")
        if DOMAIN_OF.get(task.subdomain) != task.domain:
            yield Violation("domain", task.id, site, _domain_problem(task))
        if DIFFICULTY_DIFFERS in task.flags:
            yield Violation(
                "difficulty", task.id, site, f"it has {task.difficulty} facts, and its row says else"
            )


def _names_a_website(website: str) -> bool:
    try:
        site_of(website)
    except ValueError:
        return False
    return True


def _domain_problem(task: Task) -> str:
    if task.domain not in DOMAINS:
        return f"unknown domain {task.domain!r}"
    if task.subdomain not in DOMAIN_OF:
        return f"there is no subdomain {task.subdomain!r}"
    return f"{task.subdomain!r} belongs to {DOMAIN_OF[task.subdomain]!r}, not to {task.domain!r}"


def _split_violations(tasks: Sequence[Task]) -> Iterator[Violation]:
    """Violations of rules about the splits, with websites compared by brand as in the split."""
    test = [task for task in tasks if task.split == "test"]
    test_on: dict[str, str] = {}
    for task in test:
        brand, site = brand_or_text(task.website), site_or_text(task.website)
        if site.endswith(OFFLINE):  # these websites have many tasks each by design
            continue
        if brand in test_on:
            yield Violation("distinct", task.id, site, f"the test task {test_on[brand]} is on it too")
        test_on.setdefault(brand, task.id)
    for task in tasks:
        if task.split is None:
            why = "it is for neither training nor testing"
            yield Violation("split", task.id, site_or_text(task.website), why)
    for leak in leaks([task for task in tasks if task.split == "train"], test):
        site = site_or_text(leak.task.website)
        if leak.why == "test website":
            yield Violation("leak", leak.task.id, site, f"the test task {leak.of} is on it")
        elif leak.why == "names a test website":
            yield Violation("leak", leak.task.id, site, f"it names the website of the test task {leak.of}")
        else:
            yield Violation("family", leak.task.id, site, f"the test task {leak.of} is of its family")


def _why_not_derived(task: Task, parent: Task) -> str:
    """Why a task cannot be derived from its parent by Algorithm 1; empty if it can."""
    whole: dict[tuple[str, ...], int] = defaultdict(int)
    for group in parent.rubric.groups:
        whole[group.facts] += 1
    for group in task.rubric.groups:
        whole[group.facts] -= 1
        if whole[group.facts] < 0:
            return f"its group {group.id} is not one of {parent.id}"
    if task.difficulty >= parent.difficulty:
        return f"it is as hard as {parent.id}"
    if not any(group.is_large for group in task.rubric.groups):
        return "none of its groups is large"
    return ""
