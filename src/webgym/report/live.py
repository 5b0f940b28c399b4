"""The pages of a run over HTTP: full-size pictures, and what is new while the run goes on.

For the person at this machine: it listens on loopback, answers only to loopback names (so that no
website can reach it by a name of its own), and serves nothing but the run. It changes nothing either, but for
people's labels (:mod:`webgym.report.labelling`).
"""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from markupsafe import Markup
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route

from webgym.core.errors import StoreError, UsageError
from webgym.core.trajectory import Trajectory
from webgym.report.config import ViewConfig
from webgym.report.content import page
from webgym.report.labelling import Labelling, unusable
from webgym.report.monitor import Monitoring
from webgym.report.overview import Figures, Overview, is_whole, overview_html
from webgym.report.run_index import RunIndex, Wanted
from webgym.report.serving import ONLY_LOCAL_NAMES, SAFE, json_reply, page_reply, serve
from webgym.report.template import Page
from webgym.rollout.files import TASKS, TRAJECTORIES, disk_errors
from webgym.rollout.records import CorruptLine, Entry, read_at
from webgym.rollout.store import RunReader
from webgym.rollout.verdicts import VerdictReader

_FOREVER = {"Cache-Control": "private, max-age=31536000, immutable"}


_OVERVIEW = "overview"
_MOST_ROWS = 20_000


class LiveRun:
    """A run as far as it has come. Blocks: call it from a thread, one call at a time.

    Raises:
        RunFolderError: the folder is no run.
    """

    def __init__(self, path: Path) -> None:
        self.reader = RunReader(path, skip_corrupt=True)
        self.verdicts = VerdictReader(path)
        self.index = RunIndex(path, self.reader.tasks)
        self._overview: Overview | None = None
        self._version = ""

    def refresh(self, told: Callable[[int], object] = lambda _: None) -> None:
        """Take in what was written since; ``told`` is how many records of a file were read."""
        self.index.refresh(told)

    @property
    def is_whole(self) -> bool:
        """Whether nothing more is to come."""
        return is_whole(self.reader, len(self.index))

    @property
    def skipped(self) -> list[CorruptLine]:
        """What cannot be trusted."""
        return [line for line in self.reader.skipped if line.file == TASKS] + self.index.corrupt

    def overview(self) -> str:
        """The figures of all trajectories; of a run that has not changed, those that the index keeps."""
        known, stamp = self.index.kept(_OVERVIEW, _Kept), self._stamp()
        if known is None or known.stamp != stamp:
            if self._overview is None or self._version != self.index.version:
                self._overview, self._version = Overview(self.reader), self.index.version
            for digest in self.index.digests(self._overview.count):
                self._overview.add(digest)
            known = _Kept(stamp, self._overview.figures())
            self.index.keep(_OVERVIEW, known)
        return str(overview_html(self.reader, known.figures, self.skipped))

    def _stamp(self) -> str:
        """Of all that the figures are made from."""
        made_from = [len(self.index), self.index.version, self.reader.summary, self.reader.config]
        return hashlib.sha256(repr(made_from).encode()).hexdigest()

    def entry(self, attempt_id: str) -> Entry:
        """Where a trajectory lies; one that is not known may have been written since.

        Raises:
            KeyError: there is none of this id.
        """
        try:
            return self.index.entry(attempt_id)
        except KeyError:
            self.refresh()
            return self.index.entry(attempt_id)

    def trajectory(self, attempt_id: str) -> Trajectory:
        """One trajectory.

        Raises:
            KeyError: there is none of this id.
            StoreCorrupt: its record changed since it was indexed.
        """
        entry = self.entry(attempt_id)
        with disk_errors(f"reading {self.reader.path}"):
            return read_at(self.reader.path / TRAJECTORIES / entry.shard, entry)


class _Kept(msgspec.Struct):
    stamp: str
    figures: Figures


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
        texts = {name: asked.get(name, "") for name in Wanted._fields if name != "down"}
        wanted = Wanted(**texts, down="down" in asked)
        return json_reply(await self.read(self._rows, wanted, int(after), min(int(count), _MOST_ROWS)))

    def _rows(self, wanted: Wanted, after: int, count: int) -> dict[str, Any]:
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
