"""The viewer of a task set over HTTP: its figures, a searchable list, and every task with its family.

The server searches and counts; a page has a hundred rows at a time, so 300,000 tasks are as fast to browse as
300.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, TypedDict

import msgspec
from markupsafe import Markup
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route

from webgym.core.task import LEVELS, Task, level_of
from webgym.report.config import ViewConfig
from webgym.report.serving import (
    BAD_RANGE,
    ONLY_LOCAL_NAMES,
    SAFE,
    error_reply,
    json_reply,
    page_reply,
    row_range,
    serve,
)
from webgym.report.template import ENVIRONMENT, Document
from webgym.tasks.files import TaskFile
from webgym.tasks.formats import read_tasks
from webgym.tasks.index import FACETS, TaskIndex, TaskQuery, website_key

_SCRIPTS: Final = ("dom.js", "theme.js", "list.js", "tasks.js")
_FILTERS: Final = (*FACETS, "website", "text")
_MOST_ROWS: Final = 500
"""Most rows in one reply."""
_CACHED_SEARCHES: Final = 16
"""Number of searches whose results are cached, for their next pages."""
_PICTURE: Final = {**SAFE, "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'"}
"""An SVG may contain style, but no script."""

PAGE_SIZE = 100
"""Rows per page in the list of a task set."""


class TaskSet:
    """A task set, read once, and the handlers of requests for it. Made in a thread, as reading blocks.

    Raises:
        TaskFileError: there are no tasks.
    """

    def __init__(self, path: Path) -> None:
        contents = read_tasks(path)
        self.index = TaskIndex(contents.tasks)
        self.figures = figures_of(path)
        self.find = lru_cache(_CACHED_SEARCHES)(self.index.find)
        name = path.resolve().name
        filter_values = choices(self.index)
        settings = {
            "outcomes": {},
            "page": PAGE_SIZE,
            "choices": filter_values,
            "subdomains": subdomains(self.index),
        }
        document = Document(name, _SCRIPTS, settings, live=True)
        overview = tasks_overview(name, contents, self.index, list(self.figures))
        self.policy = document.policy
        self.html = document.render("tasks.html.j2", overview=overview) + document.tail()

    async def document(self, _: Request) -> Response:
        """The page itself."""
        return page_reply(self.html, self.policy)

    async def rows(self, request: Request) -> Response:
        """Matching tasks, as rows, and their total number."""
        params = request.query_params
        if (rows := row_range(params, _MOST_ROWS)) is None:
            return error_reply(BAD_RANGE, 400)
        query, (after, count) = TaskQuery(**{name: params.get(name, "") for name in _FILTERS}), rows
        places = await asyncio.to_thread(self.find, query)
        chosen = places[after : after + count]
        found = [task_row(self.index.tasks[place]) for place in chosen]
        return json_reply({"total": len(places), "rows": found})

    async def task(self, request: Request) -> Response:
        """The content of one task's page."""
        task = await asyncio.to_thread(self.index.get, request.query_params.get("id", ""))
        if task is None:
            return error_reply("no such task", 404)
        return json_reply(await asyncio.to_thread(task_page, task, self.index))

    async def figure(self, request: Request) -> Response:
        """A figure of the set."""
        path = self.figures.get(request.path_params["name"])
        if path is None or not await asyncio.to_thread(path.is_file):
            return error_reply("no such figure", 404)
        return FileResponse(path, headers=_PICTURE)


def tasks_app(path: Path) -> Starlette:
    """The application that serves a task set.

    Raises:
        TaskFileError: there are no tasks.
    """
    pages = TaskSet(path)
    return Starlette(
        routes=[
            Route("/", pages.document),
            Route("/api/tasks", pages.rows),
            Route("/api/task", pages.task),
            Route("/figures/{name}", pages.figure),
        ],
        middleware=[ONLY_LOCAL_NAMES],
    )


async def serve_tasks(path: Path, config: ViewConfig, ready: Callable[[str], None]) -> None:
    """Serve a task set until cancelled or interrupted.

    Args:
        path: a task file of any format, or a folder of them.
        config: the port.
        ready: called with the address once it accepts connections.

    Raises:
        TaskFileError: there are no tasks.
        ConfigError: the port cannot be listened on.
    """
    await serve(await asyncio.to_thread(tasks_app, path), config.port, ready)


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
