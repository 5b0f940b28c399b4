"""The pages of a task set over HTTP: its figures, a list to search, and every task with its family.

The set stays with the server, which finds and counts; a page holds a hundred rows at a time, so that 300,000
tasks are as quick to look at as 300.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from webgym.report.config import ViewConfig
from webgym.report.serving import ONLY_LOCAL_NAMES, SAFE, json_reply, page_reply, serve
from webgym.report.task_content import choices, figures_of, subdomains, task_page, task_row, tasks_overview
from webgym.report.template import Document
from webgym.tasks.formats import read_tasks
from webgym.tasks.index import FACETS, TaskIndex, TaskQuery

_SCRIPTS: Final = ("dom.js", "theme.js", "tasks.js")
_ASKED: Final = (*FACETS, "website", "text")
_MOST: Final = 500
"""Rows in one answer."""
_REMEMBERED: Final = 16
"""Searches whose result is kept, for the next page of it."""
_PICTURE: Final = {**SAFE, "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'"}
"""A drawing may bring its style, and nothing that runs."""


class TaskSet:
    """A task set as it was when it was read. Blocks: call it from a thread.

    Raises:
        TaskFileError: there are no tasks.
    """

    def __init__(self, path: Path, page_size: int) -> None:
        found = read_tasks(path)
        self.index = TaskIndex(found.tasks)
        self.figures = figures_of(path)
        self.find = lru_cache(_REMEMBERED)(self.index.find)
        name = path.resolve().name
        offered = choices(self.index)
        settings = {
            "outcomes": {},
            "page": page_size,
            "choices": offered,
            "subdomains": subdomains(self.index),
        }
        document = Document(name, _SCRIPTS, settings, live=True)
        overview = tasks_overview(name, found, self.index, list(self.figures))
        self.policy = document.policy
        self.html = document.render("tasks.html.j2", overview=overview) + document.tail()

    def rows(self, wanted: TaskQuery, after: int, count: int) -> dict[str, Any]:
        """So many of the tasks that fit, after the first so many."""
        places = self.find(wanted)
        chosen = places[after : after + count]
        return {"total": len(places), "rows": [task_row(self.index.tasks[place]) for place in chosen]}

    def task(self, task_id: str) -> dict[str, Any] | None:
        """Everything about one task."""
        task = self.index.get(task_id)
        return None if task is None else task_page(task, self.index)


class _Pages:
    """The answers."""

    def __init__(self, tasks: TaskSet) -> None:
        self._tasks = tasks

    async def document(self, _: Request) -> Response:
        """The page itself."""
        return page_reply(self._tasks.html, self._tasks.policy)

    async def rows(self, request: Request) -> Response:
        """Tasks that fit, as rows."""
        asked = request.query_params
        after, count = asked.get("after", "0"), asked.get("count", "1")
        if not (after.isdecimal() and count.isdecimal() and len(after + count) < 18):
            return PlainTextResponse("after and count: whole numbers", status_code=400, headers=SAFE)
        wanted = TaskQuery(**{name: asked.get(name, "") for name in _ASKED})
        rows = await asyncio.to_thread(self._tasks.rows, wanted, int(after), min(int(count), _MOST))
        return json_reply(rows)

    async def task(self, request: Request) -> Response:
        """One task."""
        shown = await asyncio.to_thread(self._tasks.task, request.query_params.get("id", ""))
        if shown is None:
            return PlainTextResponse("no such task", status_code=404, headers=SAFE)
        return json_reply(shown)

    async def figure(self, request: Request) -> Response:
        """A picture that lies beside the set."""
        path = self._tasks.figures.get(request.path_params["name"])
        if path is None or not await asyncio.to_thread(path.is_file):
            return PlainTextResponse("no such figure", status_code=404, headers=SAFE)
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
        config: which port, and how many rows a page has.
        ready: is told the address as soon as it can be opened.

    Raises:
        TaskFileError: there are no tasks.
        ConfigError: the port cannot be listened on.
    """
    await serve(await asyncio.to_thread(tasks_app, path, config), config.port, ready)
