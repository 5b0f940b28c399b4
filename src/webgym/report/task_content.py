"""A task set as data for its pages: figures, a row of the list per task, and a page each.

What comes from outside is passed on as it is; it is made safe where it enters a page.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypedDict

import msgspec
from markupsafe import Markup

from webgym.core.task import LEVELS, Task, level_of
from webgym.report.template import ENVIRONMENT
from webgym.tasks.files import TaskFile
from webgym.tasks.index import FACETS, TaskIndex, website_key

_CHOICES = 300
"""Values of a filter to offer at most, the most frequent first; a search by text finds the others."""
_COLUMNS = 24
"""Numbers of facts with a column of their own; the last one stands for all above, too."""
_PUBLISHED = "published"
"""Where a task keeps the line of the published set that it was read from: of no interest to a reader."""


class TaskRow(TypedDict):
    """A line of the list of tasks."""

    id: str
    task: str
    site: str
    domain: str
    subdomain: str
    level: str
    difficulty: int
    source: str
    split: str
    derived: bool


def task_row(task: Task) -> TaskRow:
    """A task in one line."""
    return {
        "id": task.id,
        "task": task.instruction,
        "site": website_key(task.website),
        "domain": task.domain,
        "subdomain": task.subdomain,
        "level": task.level,
        "difficulty": task.difficulty,
        "source": task.source,
        "split": task.split or "",
        "derived": task.parent_id is not None,
    }


def task_page(task: Task, index: TaskIndex) -> dict[str, Any]:
    """A task with everything that its own page shows, and its family."""
    extra = {name: value for name, value in task.extra.items() if name != _PUBLISHED}
    return {
        **task_row(task),
        "website": task.website,
        "websiteFrom": task.website_from,
        "flags": task.flags,
        "reference": task.reference_answer,
        "example": task.example_answer,
        "groups": _groups(task),
        "parentId": task.parent_id,
        "parent": _relative(index.get(task.parent_id)) if task.parent_id is not None else None,
        "children": [_relative(child) for child in index.children(task.id)],
        "solution": [repr(move) for move in task.truth.moves] if task.truth else [],
        "extra": {name: msgspec.json.encode(value).decode() for name, value in extra.items()},
    }


def _groups(task: Task) -> list[dict[str, Any]]:
    return [
        {"id": group.id, "description": group.description, "facts": group.facts}
        for group in task.rubric.groups
    ]


def _relative(task: Task | None) -> dict[str, Any] | None:
    return None if task is None else {**task_row(task), "groups": _groups(task)}


def choices(index: TaskIndex) -> dict[str, list[tuple[str, int]]]:
    """What every filter offers: values and how many tasks have them; levels in their order."""
    offered = {facet: list(index.counts(facet).items())[:_CHOICES] for facet in FACETS}
    offered["level"].sort(key=lambda item: LEVELS.index(item[0]))
    return offered


def subdomains(index: TaskIndex) -> dict[str, list[str]]:
    """The subdomains that stand under each domain."""
    found: dict[str, dict[str, None]] = {}
    for task in index.tasks:
        found.setdefault(task.domain, {})[task.subdomain] = None
    return {domain: sorted(filter(None, named)) for domain, named in found.items()}


def tasks_overview(name: str, found: TaskFile, index: TaskIndex, figures: Sequence[str]) -> Markup:
    """The figures of a task set, as HTML.

    Args:
        name: of the set.
        found: what was read.
        index: of its tasks.
        figures: names of pictures that lie beside it.
    """
    sizes = Counter(task.difficulty for task in index.tasks)
    domains: dict[str, Counter[str]] = {}
    for task in index.tasks:
        domains.setdefault(task.domain, Counter())[task.subdomain] += 1
    shown: dict[str, Any] = {
        "name": name,
        "total": len(index.tasks),
        "websites": index.websites,
        "derived": sum(task.parent_id is not None for task in index.tasks),
        "splits": index.counts("split"),
        "levels": {level: index.counts("level").get(level, 0) for level in LEVELS},
        "domains": sorted(domains.items(), key=lambda item: -item[1].total())[:_CHOICES],
        "sources": index.counts("source"),
        "flags": index.counts("flag"),
        "facts": _histogram(sizes),
        "broken": found.broken,
        "set_aside": len(found.set_aside),
        "figures": figures,
    }
    return Markup(ENVIRONMENT.get_template("tasks_overview.html.j2").render(shown))  # noqa: S704 - autoescaped


def _histogram(sizes: Counter[int]) -> list[tuple[str, str, int]]:
    """Number of facts, its level, how many tasks; without gaps from 1."""
    last = min(max(sizes), _COLUMNS)
    above = sum(count for size, count in sizes.items() if size > last)
    columns: list[tuple[str, str, int]] = [
        (str(size), level_of(size), sizes[size]) for size in range(1, last + 1)
    ]
    if above:
        columns[-1] = (f"{last}+", level_of(last), sizes[last] + above)
    return columns


def figures_of(path: Path) -> dict[str, Path]:
    """Pictures that were drawn of a set, by name: those of its folder, or in ``figures/`` there."""
    folder = path if path.is_dir() else path.parent
    places = [folder / "figures", *([folder] if path.is_dir() else [])]
    found: dict[str, Path] = {}
    for ending in (".svg", ".png"):  # of two forms of one figure, the sharper
        for place in places:
            for file in sorted(place.glob(f"*{ending}")):
                if file.stem not in {known.rpartition(".")[0] for known in found}:
                    found[file.name] = file
    return dict(sorted(found.items()))
