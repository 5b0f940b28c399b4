"""The pages of a run over HTTP: full-size pictures, and what is new while the run goes on.

For the person at this machine: it listens on loopback, answers only to loopback names (so that no
website can reach it by a name of its own), and serves nothing but the run. It changes nothing either, but for
people's labels (:mod:`webgym.report.labelling`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from webgym.core.errors import StoreError, UsageError
from webgym.report.config import ViewConfig
from webgym.report.content import Row, page, row
from webgym.report.labelling import Labelling, unusable
from webgym.report.monitor import Monitoring
from webgym.report.overview import Overview
from webgym.report.serving import ONLY_LOCAL_NAMES, SAFE, json_reply, page_reply, serve
from webgym.report.template import Page
from webgym.rollout.store import RunReader
from webgym.rollout.verdicts import VerdictReader

_FOREVER = {"Cache-Control": "private, max-age=31536000, immutable"}


class LiveRun:
    """A run as far as it has come. Blocks: call it from a thread, one call at a time.

    Raises:
        RunFolderError: the folder is no run.
    """

    def __init__(self, path: Path) -> None:
        self.reader = RunReader(path, skip_corrupt=True)
        self.verdicts = VerdictReader(path)
        self.rows: list[Row] = []
        self.overview = Overview(self.reader)

    def refresh(self) -> None:
        """Take in what was written since."""
        attempts = self.reader.attempts
        ended = list(attempts)
        if any(attempts[row["id"]].outcome != row["outcome"] for row in self.rows):
            self.rows, self.overview = [], Overview(self.reader)  # some have a verdict now
        for trajectory in self.reader.trajectories(ended[len(self.rows) :]):
            self.overview.add(trajectory)
            self.rows.append(row(trajectory, self.reader.tasks.get(trajectory.episode.task_id)))


class _Pages:
    """The answers. One lock: a run is read by one thread at a time."""

    def __init__(self, run: LiveRun, config: ViewConfig) -> None:
        self._run = run
        self._page = Page(run.reader.path.resolve().name, live=True, refresh_seconds=config.refresh_seconds)
        self._lock = asyncio.Lock()

    async def read(self, call: Callable[..., Any], *args: Any) -> Any:
        """What a blocking call that reads the run returns."""
        async with self._lock:
            return await asyncio.to_thread(call, *args)

    async def document(self, _: Request) -> Response:
        """The page itself."""
        text = await self.read(self._document)
        return page_reply(text, self._page.policy)

    def _document(self) -> str:
        self._run.refresh()
        overview = self._run.overview
        return self._page.head(overview.html(), self._run.rows, whole=overview.is_whole) + self._page.tail()

    async def news(self, request: Request) -> Response:
        """Rows after the first so many, whether the run is over, and the figures if anything is new."""
        after = request.query_params.get("after", "")
        if not (after.isdecimal() and len(after) < 10):
            return PlainTextResponse("after: how many rows are known", status_code=400, headers=SAFE)
        knew_whole = request.query_params.get("whole") == "true"
        return json_reply(await self.read(self._news, int(after), knew_whole))

    def _news(self, after: int, knew_whole: bool) -> dict[str, Any]:
        self._run.refresh()
        rows, overview = self._run.rows[after:], self._run.overview
        whole = overview.is_whole
        is_new = rows or whole != knew_whole
        return {"rows": rows, "whole": whole, "overview": str(overview.html()) if is_new else ""}

    async def trajectory(self, request: Request) -> Response:
        """Everything about one attempt."""
        try:
            shown = await self.read(self._trajectory, request.query_params.get("id", ""))
        except KeyError:
            return PlainTextResponse("no such trajectory", status_code=404, headers=SAFE)
        return json_reply(shown)

    def _trajectory(self, attempt_id: str) -> dict[str, Any]:
        trajectory = self._run.reader.trajectory(attempt_id)
        task = self._run.reader.tasks.get(trajectory.episode.task_id)
        return page(trajectory, task, self._run.verdicts.of(attempt_id))

    async def picture(self, request: Request) -> Response:
        """A screenshot as it was taken."""
        try:
            path = self._run.reader.image_path(request.path_params["name"])
        except StoreError:
            path = None
        if path is None or not await asyncio.to_thread(path.is_file):
            return PlainTextResponse("no such picture", status_code=404, headers=SAFE)
        return FileResponse(path, media_type="image/png", headers={**SAFE, **_FOREVER})


async def _store_failed(_: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), status_code=500, headers=SAFE)


def view_app(
    run_path: Path, config: ViewConfig | None = None, closing: asyncio.Event | None = None
) -> Starlette:
    """The application that serves a run.

    Args:
        run_path: the run folder.
        config: how it is served.
        closing: is set when the monitor's streams are to end.

    Raises:
        RunFolderError: the folder is no run.
    """
    config = config or ViewConfig()
    run = LiveRun(run_path)
    pages = _Pages(run, config)
    return Starlette(
        routes=[
            Route("/", pages.document),
            Route("/api/news", pages.news),
            Route("/api/trajectory", pages.trajectory),
            Route("/screenshots/{prefix}/{name}.png", pages.picture),
            *Labelling(run, pages.read, config).routes(),
            *Monitoring(run_path, config, closing or asyncio.Event()).routes(),
        ],
        middleware=[ONLY_LOCAL_NAMES],
        exception_handlers={StoreError: _store_failed, UsageError: unusable},
    )


async def serve_view(run_path: Path, config: ViewConfig, ready: Callable[[str], None]) -> None:
    """Serve a run until cancelled or interrupted.

    Args:
        run_path: the run folder.
        config: which port, and how often pages ask.
        ready: is told the address as soon as it can be opened.

    Raises:
        RunFolderError: the folder is no run.
        ConfigError: the port cannot be listened on.
    """
    closing = asyncio.Event()
    app = await asyncio.to_thread(view_app, run_path, config, closing)
    await serve(app, config.port, ready, closing)
