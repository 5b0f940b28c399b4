"""The viewer of a task set over HTTP: its figures, a searchable list, and every task with its family.

The server searches and counts; a page has a hundred rows at a time, so 300,000 tasks are as fast to browse as
300.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route

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
from webgym.report.task_content import choices, figures_of, subdomains, task_page, task_row, tasks_overview
from webgym.report.template import Document
from webgym.tasks.formats import read_tasks
from webgym.tasks.index import FACETS, TaskIndex, TaskQuery

_SCRIPTS: Final = ("dom.js", "theme.js", "tasks.js")
_FILTERS: Final = (*FACETS, "website", "text")
_MOST_ROWS: Final = 500
"""Most rows in one reply."""
_CACHED_SEARCHES: Final = 16
"""Number of searches whose results are cached, for their next pages."""
_PICTURE: Final = {**SAFE, "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'"}
"""An SVG may contain style, but no script."""


class TaskSet:
    """A task set, read once. Blocking: call it from a thread.

    Raises:
        TaskFileError: there are no tasks.
    """

    def __init__(self, path: Path, page_size: int) -> None:
        contents = read_tasks(path)
        self.index = TaskIndex(contents.tasks)
        self.figures = figures_of(path)
        self.find = lru_cache(_CACHED_SEARCHES)(self.index.find)
        name = path.resolve().name
        filter_values = choices(self.index)
        settings = {
            "outcomes": {},
            "page": page_size,
            "choices": filter_values,
            "subdomains": subdomains(self.index),
        }
        document = Document(name, _SCRIPTS, settings, live=True)
        overview = tasks_overview(name, contents, self.index, list(self.figures))
        self.policy = document.policy
        self.html = document.render("tasks.html.j2", overview=overview) + document.tail()

    def rows(self, query: TaskQuery, after: int, count: int) -> dict[str, Any]:
        """The number of matching tasks, and ``count`` of their rows after the first ``after``."""
        places = self.find(query)
        chosen = places[after : after + count]
        return {"total": len(places), "rows": [task_row(self.index.tasks[place]) for place in chosen]}

    def task(self, task_id: str) -> dict[str, Any] | None:
        """The content of one task's page; ``None`` if there is none with this id."""
        task = self.index.get(task_id)
        return None if task is None else task_page(task, self.index)


class _Pages:
    """The request handlers."""

    def __init__(self, tasks: TaskSet) -> None:
        self._tasks = tasks

    async def document(self, _: Request) -> Response:
        """The page itself."""
        return page_reply(self._tasks.html, self._tasks.policy)

    async def rows(self, request: Request) -> Response:
        """Matching tasks, as rows, and their total number."""
        params = request.query_params
        if (rows := row_range(params, _MOST_ROWS)) is None:
            return error_reply(BAD_RANGE, 400)
        query = TaskQuery(**{name: params.get(name, "") for name in _FILTERS})
        return json_reply(await asyncio.to_thread(self._tasks.rows, query, *rows))

    async def task(self, request: Request) -> Response:
        """The content of one task's page."""
        content = await asyncio.to_thread(self._tasks.task, request.query_params.get("id", ""))
        if content is None:
            return error_reply("no such task", 404)
        return json_reply(content)

    async def figure(self, request: Request) -> Response:
        """A figure of the set."""
        path = self._tasks.figures.get(request.path_params["name"])
        if path is None or not await asyncio.to_thread(path.is_file):
            return error_reply("no such figure", 404)
        return FileResponse(path, headers=_PICTURE)


def tasks_app(path: Path, config: ViewConfig | None = None) -> Starlette:
    """The application that serves a task set.

    Raises:
        TaskFileError: there are no tasks.
    """
    pages = _Pages(TaskSet(path, (config or ViewConfig()).page_size))
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
        config: port, and rows per page.
        ready: called with the address once it accepts connections.

    Raises:
        TaskFileError: there are no tasks.
        ConfigError: the port cannot be listened on.
    """
    await serve(await asyncio.to_thread(tasks_app, path, config), config.port, ready)
