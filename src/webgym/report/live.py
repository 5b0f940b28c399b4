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

from markupsafe import Markup
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from webgym.core.errors import StoreError, UsageError
from webgym.report.config import ViewConfig
from webgym.report.content import page
from webgym.report.labelling import Labelling, unusable
from webgym.report.live_run import LiveRun
from webgym.report.monitor import Monitoring
from webgym.report.run_index import TrajectoryQuery
from webgym.report.serving import ONLY_LOCAL_NAMES, SAFE, json_reply, page_reply, serve
from webgym.report.template import Page

_FOREVER = {"Cache-Control": "private, max-age=31536000, immutable"}


_MOST_ROWS = 20_000


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
        overview = Markup(self._run.overview())  # noqa: S704 - rendered with autoescape
        return self._page.head(overview, self._list(), whole=self._run.is_whole) + self._page.tail()

    def _list(self) -> dict[str, Any]:
        return {"count": len(self._run.index), "options": self._run.index.options()}

    async def rows(self, request: Request) -> Response:
        """Trajectories that fit, as rows, and how many there are."""
        asked = request.query_params
        after, count = asked.get("after", "0"), asked.get("count", "1")
        if not (after.isdecimal() and count.isdecimal() and len(after + count) < 18):
            return PlainTextResponse("after and count: whole numbers", status_code=400, headers=SAFE)
        texts = {name: asked.get(name, "") for name in TrajectoryQuery._fields if name != "down"}
        wanted = TrajectoryQuery(**texts, down="down" in asked)
        return json_reply(await self.read(self._rows, wanted, int(after), min(int(count), _MOST_ROWS)))

    def _rows(self, wanted: TrajectoryQuery, after: int, count: int) -> dict[str, Any]:
        if not len(self._run.index):
            self._run.refresh()
        total, rows = self._run.index.find(wanted, after, count)
        return {"total": total, "rows": rows}

    async def news(self, request: Request) -> Response:
        """How many trajectories there are, whether the run is over, and the figures if anything is new."""
        known = request.query_params.get("known", "")
        if not (known.isdecimal() and len(known) < 10):
            return PlainTextResponse("known: how many rows are known", status_code=400, headers=SAFE)
        knew_whole = request.query_params.get("whole") == "true"
        return json_reply(await self.read(self._news, int(known), knew_whole))

    def _news(self, known: int, knew_whole: bool) -> dict[str, Any]:
        self._run.refresh()
        whole = self._run.is_whole
        is_new = known != len(self._run.index) or whole != knew_whole
        return {**self._list(), "whole": whole, "overview": self._run.overview() if is_new else ""}

    async def trajectory(self, request: Request) -> Response:
        """Everything about one attempt."""
        try:
            shown = await self.read(self._trajectory, request.query_params.get("id", ""))
        except KeyError:
            return PlainTextResponse("no such trajectory", status_code=404, headers=SAFE)
        return json_reply(shown)

    def _trajectory(self, attempt_id: str) -> dict[str, Any]:
        trajectory = self._run.trajectory(attempt_id)
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


def view_app(run_path: Path, config: ViewConfig | None = None) -> Starlette:
    """The application that serves a run.

    Raises:
        RunFolderError: the folder is no run.
    """
    return _app(LiveRun(run_path), config or ViewConfig(), asyncio.Event())


def _app(run: LiveRun, config: ViewConfig, closing: asyncio.Event) -> Starlette:
    pages = _Pages(run, config)
    return Starlette(
        routes=[
            Route("/", pages.document),
            Route("/api/news", pages.news),
            Route("/api/rows", pages.rows),
            Route("/api/trajectory", pages.trajectory),
            Route("/screenshots/{prefix}/{name}.png", pages.picture),
            *Labelling(run, pages.read, config).routes(),
            *Monitoring(run.reader.path, config, closing).routes(),
        ],
        middleware=[ONLY_LOCAL_NAMES],
        exception_handlers={StoreError: _store_failed, UsageError: unusable},
    )


async def serve_view(
    run_path: Path,
    config: ViewConfig,
    ready: Callable[[str], None],
    reading: Callable[[int], object] = lambda _: None,
) -> None:
    """Serve a run until cancelled or interrupted.

    Args:
        run_path: the run folder.
        config: which port, and how often pages ask.
        ready: is told the address as soon as it can be opened.
        reading: is told, before that, how many records of a file were read for the index.

    Raises:
        RunFolderError: the folder is no run.
        ConfigError: the port cannot be listened on.
    """
    closing = asyncio.Event()
    run = await asyncio.to_thread(LiveRun, run_path)
    try:
        await asyncio.to_thread(run.refresh, reading)
        await serve(_app(run, config, closing), config.port, ready, closing)
    finally:
        run.index.stop()  # a thread that reads would keep the process from ending
