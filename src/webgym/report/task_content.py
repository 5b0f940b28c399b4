"""A task set as data for its pages: figures, rows of the list, and the content of each task's own page.

Untrusted text is passed on unchanged; it is made safe where it enters a page.
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
"""Most values of a filter, the most frequent first; others are found by text search."""
_COLUMNS = 24
"""Most columns of the chart of numbers of facts; the last one includes all larger numbers."""
_PUBLISHED = "published"
"""Key of the line of the published set that a task was read from, which is not shown."""


class TaskRow(TypedDict):
    """A row of the list of tasks."""

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
    """The row of a task."""
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
    """The content of a task's page, with its family."""
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
    """The values of every filter with their numbers of tasks; levels in their order."""
    offered = {facet: list(index.counts(facet).items())[:_CHOICES] for facet in FACETS}
    offered["level"].sort(key=lambda item: LEVELS.index(item[0]))
    return offered


def subdomains(index: TaskIndex) -> dict[str, list[str]]:
    """The subdomains of each domain."""
    by_domain: dict[str, dict[str, None]] = {}
    for task in index.tasks:
        by_domain.setdefault(task.domain, {})[task.subdomain] = None
    return {domain: sorted(filter(None, names)) for domain, names in by_domain.items()}


def tasks_overview(name: str, contents: TaskFile, index: TaskIndex, figures: Sequence[str]) -> Markup:
    """The figures of a task set, as HTML.

    Args:
        name: of the set.
        contents: what was read.
        index: of its tasks.
        figures: file names of its figures.
    """
    sizes = Counter(task.difficulty for task in index.tasks)
    domains: dict[str, Counter[str]] = {}
    for task in index.tasks:
        domains.setdefault(task.domain, Counter())[task.subdomain] += 1
    context: dict[str, Any] = {
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
        "broken": contents.broken,
        "set_aside": len(contents.set_aside),
        "figures": figures,
    }
    return Markup(ENVIRONMENT.get_template("tasks_overview.html.j2").render(context))  # noqa: S704 - autoescaped


def _histogram(sizes: Counter[int]) -> list[tuple[str, str, int]]:
    """Number of facts, its level, and number of tasks, for every number of facts from 1."""
    last = min(max(sizes), _COLUMNS)
    above = sum(count for size, count in sizes.items() if size > last)
    columns: list[tuple[str, str, int]] = [
        (str(size), level_of(size), sizes[size]) for size in range(1, last + 1)
    ]
    if above:
        columns[-1] = (f"{last}+", level_of(last), sizes[last] + above)
    return columns


def figures_of(path: Path) -> dict[str, Path]:
    """The figures drawn of a set, by file name: in its folder, or in ``figures/`` there."""
    folder = path if path.is_dir() else path.parent
    folders = [folder / "figures", *([folder] if path.is_dir() else [])]
    figures: dict[str, Path] = {}
    for ending in (".svg", ".png"):  # SVG is preferred
        for directory in folders:
            for file in sorted(directory.glob(f"*{ending}")):
                if file.stem not in {known.rpartition(".")[0] for known in figures}:
                    figures[file.name] = file
    return dict(sorted(figures.items()))
