"""The viewer of a run over HTTP, with full-size screenshots, updated while the run goes on.

It is for the user of this machine: it listens on loopback, accepts only loopback host names, and serves only
the run. It writes nothing but people's labels. What the rollout is doing at the moment has a page of its own.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any, Final

import msgspec
from markupsafe import Markup
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import Route

from webgym.core.errors import StoreCorrupt, StoreError, UsageError
from webgym.core.task import LEVELS
from webgym.report.config import ViewConfig
from webgym.report.content import blind, page
from webgym.report.live_run import LiveRun
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
from webgym.report.template import Document, Page, inert, outcome_words
from webgym.results.labels import HumanLabel, Label, LabelStore, labels_path, sample_to_label
from webgym.results.run_index import TrajectoryQuery
from webgym.rollout.live_file import read_feed
from webgym.rollout.progress import STATES
from webgym.store.files import METRICS

_FOREVER = {"Cache-Control": "private, max-age=31536000, immutable"}


_MOST_ROWS = 20_000

REFRESH_SECONDS = 2.0
"""Interval at which an open page polls for new trajectories."""

MONITOR_SECONDS = 0.5
"""Interval at which the monitor checks for new figures of the collector."""


class _Pages:
    """The request handlers. A lock ensures that only one thread reads the run at a time."""

    def __init__(self, run: LiveRun) -> None:
        self._run = run
        self._page = Page(run.reader.path.resolve().name, live=True, refresh_seconds=REFRESH_SECONDS)
        self._lock = asyncio.Lock()

    async def read(self, call: Callable[..., Any], *args: Any) -> Any:
        """Run a blocking call that reads the run, and return its result."""
        async with self._lock:
            return await asyncio.to_thread(call, *args)

    async def document(self, _: Request) -> Response:
        """The page itself."""
        text = await self.read(self._document)
        return page_reply(text, self._page.policy)

    def _document(self) -> str:
        self._run.refresh()
        overview = Markup(self._run.overview())  # noqa: S704 - rendered with autoescape
        return self._page.head(overview, self._list_state(), whole=self._run.is_whole) + self._page.tail()

    def _list_state(self) -> dict[str, Any]:
        index = self._run.index
        return {"count": len(index), "version": index.version, "options": index.options()}

    async def rows(self, request: Request) -> Response:
        """Matching trajectories, as rows, and their total number."""
        params = request.query_params
        if (rows := row_range(params, _MOST_ROWS)) is None:
            return error_reply(BAD_RANGE, 400)
        texts = {name: params.get(name, "") for name in TrajectoryQuery._fields if name != "down"}
        query = TrajectoryQuery(**texts, down="down" in params)
        return json_reply(await self.read(self._rows, query, *rows))

    def _rows(self, query: TrajectoryQuery, after: int, count: int) -> dict[str, Any]:
        if not len(self._run.index):
            self._run.refresh()
        total, rows = self._run.index.find(query, after, count)
        return {"total": total, "rows": rows}

    async def news(self, request: Request) -> Response:
        """The number of trajectories, whether the run is finished, and the figures if anything changed."""
        known = request.query_params.get("known", "")
        if not (known.isdecimal() and len(known) < 10):
            return error_reply("known must be a number of rows", 400)
        version, was_finished = (request.query_params.get(name) for name in ("version", "whole"))
        return json_reply(await self.read(self._news, int(known), version, was_finished == "true"))

    def _news(self, known: int, version: str | None, was_finished: bool) -> dict[str, Any]:
        self._run.refresh()
        whole, now = self._run.is_whole, self._list_state()
        is_new = (known, version, was_finished) != (now["count"], now["version"], whole)
        return {**now, "whole": whole, "overview": self._run.overview() if is_new else ""}

    async def trajectory(self, request: Request) -> Response:
        """The content of one attempt's page."""
        try:
            content = await self.read(self._trajectory, request.query_params.get("id", ""))
        except KeyError:
            return error_reply("no such trajectory", 404)
        return json_reply(content)

    def _trajectory(self, attempt_id: str) -> dict[str, Any]:
        trajectory = self._run.trajectory(attempt_id)
        task = self._run.reader.tasks.get(trajectory.episode.task_id)
        return page(trajectory, task, self._run.verdicts.of(attempt_id))

    async def picture(self, request: Request) -> Response:
        """A screenshot in full size."""
        try:
            path = self._run.reader.image_path(request.path_params["name"])
        except StoreError:
            path = None
        if path is None or not await asyncio.to_thread(path.is_file):
            return error_reply("no such screenshot", 404)
        return FileResponse(path, media_type="image/png", headers={**SAFE, **_FOREVER})


async def _store_failed(_: Request, error: Exception) -> Response:
    return error_reply(str(error), 500)


def view_app(run_path: Path, config: ViewConfig | None = None) -> Starlette:
    """The application that serves a run.

    Raises:
        RunFolderError: the folder is not a run.
    """
    return _app(LiveRun(run_path), config or ViewConfig(), asyncio.Event())


def _app(run: LiveRun, config: ViewConfig, closing: asyncio.Event) -> Starlette:
    pages = _Pages(run)
    return Starlette(
        routes=[
            Route("/", pages.document),
            Route("/api/news", pages.news),
            Route("/api/rows", pages.rows),
            Route("/api/trajectory", pages.trajectory),
            Route("/screenshots/{prefix}/{name}.png", pages.picture),
            *Labelling(run, pages.read, config).routes(),
            *Monitoring(run.reader.path, closing).routes(),
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
        config: port and polling intervals.
        ready: called with the address once it accepts connections.
        reading: called before that, with the number of records of a file that were read for the index.

    Raises:
        RunFolderError: the folder is not a run.
        ConfigError: the port cannot be listened on.
    """
    closing = asyncio.Event()
    run = await asyncio.to_thread(LiveRun, run_path)
    try:
        await asyncio.to_thread(run.refresh, reading)
        await serve(_app(run, config, closing), config.port, ready, closing)
    finally:
        run.index.stop()  # a thread that is still reading would keep the process alive


_MONITOR_SCRIPTS: Final = ("dom.js", "theme.js", "monitor.js")
_HISTORY_BYTES: Final = 200_000
"""Bytes at the end of ``metrics.jsonl`` that are read: about 600 lines, 50 minutes."""
_KEEP_ALIVE_AFTER: Final = 30
"""Checks without news after which a comment is sent, so that a closed page is noticed."""


class Monitoring:
    """The request handlers of the monitor page.

    Args:
        run: the run folder.
        config: the interval of the checks.
        closing: is set when the server shuts down; streams then end.
    """

    def __init__(self, run: Path, closing: asyncio.Event) -> None:
        self._run = run
        self._closing = closing
        settings = {"live": True, "states": STATES, "levels": LEVELS, "outcomes": outcome_words()}
        self._page = Document(run.resolve().name, _MONITOR_SCRIPTS, settings, live=True)

    def routes(self) -> list[Route]:
        """The routes of these handlers."""
        return [Route("/monitor", self.document), Route("/api/monitor", self.events)]

    async def document(self, _: Request) -> Response:
        """The page itself."""
        text = self._page.render("monitor.html.j2", states=STATES) + self._page.tail()
        return page_reply(text, self._page.policy)

    async def events(self, _: Request) -> Response:
        """The history once, then the feed whenever it changes."""
        return StreamingResponse(self._stream(), media_type="text/event-stream", headers=SAFE)

    async def _stream(self) -> AsyncIterator[bytes]:
        yield _event("history", await asyncio.to_thread(read_history, self._run))
        before: object = ()
        unchanged = 0
        while not self._closing.is_set():
            message = await asyncio.to_thread(self._read)
            feed = message["feed"] or {}
            now = (feed.get("at"), feed.get("is_stale"), message["error"])
            unchanged = unchanged + 1 if now == before else 0
            if now != before:
                yield _event("feed", message)
            elif unchanged % _KEEP_ALIVE_AFTER == 0:
                yield b": still here\n\n"
            before = now
            await _wait(self._closing, MONITOR_SECONDS)

    def _read(self) -> dict[str, Any]:
        """The feed, ``None`` if no collector is running, and the error if it cannot be read."""
        try:
            return {"feed": read_feed(self._run), "error": ""}
        except StoreCorrupt as error:
            return {"feed": None, "error": str(error)}


async def _wait(event: asyncio.Event, seconds: float) -> None:
    """Wait for the event, for at most ``seconds`` seconds."""
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        return


def read_history(run: Path) -> list[dict[str, Any]]:
    """Time and steps per second of the last lines of ``metrics.jsonl``, oldest first; broken lines are left
    out."""
    path = run / METRICS
    if not path.is_file():
        return []
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _HISTORY_BYTES))
        lines = file.read().splitlines()
    history = []
    for line in lines:
        try:
            row = msgspec.json.decode(line, type=dict[str, Any])
            history.append({"at": float(row["at"]), "steps_per_second": float(row["steps_per_second"])})
        except (ValueError, KeyError, TypeError):
            continue  # the first line may be cut off, the last incomplete
    return history


def _event(name: str, value: Any) -> bytes:
    return b"event: %s\ndata: %s\n\n" % (name.encode(), msgspec.json.encode(value))


TOKEN_HEADER: Final = "X-WebGym-Token"  # noqa: S105 - a header's name
_LARGEST: Final = 65_536
"""Most bytes of a request's body."""
_LABEL_SCRIPTS: Final = ("dom.js", "theme.js", "source.js", "stage.js", "trajectory.js", "label.js")


class _SentLabel(msgspec.Struct, frozen=True):
    """A label as the page sends it."""

    id: str
    annotator: str
    label: Label
    note: str = ""


class Labelling:
    """The request handlers of the page where people label trajectories: the only part that writes.

    A label is accepted only from the labelling page itself: the request's origin is this server, its body is
    JSON, and it has a token that only the page contains. Another website can neither read the token nor make
    a browser send such a request.

    Args:
        run: the run; accessed only through ``read``.
        read: runs blocking calls.
        config: the file of the labels, and the choice of the attempts.
    """

    def __init__(self, run: LiveRun, read: Callable[..., Awaitable[Any]], config: ViewConfig) -> None:
        self._run = run
        self._read = read
        self._config = config
        self._token = secrets.token_urlsafe(32)
        settings = {"live": True, "refresh": 0, "outcomes": outcome_words(), "token": self._token}
        self._page = Document(run.reader.path.resolve().name, _LABEL_SCRIPTS, settings, live=True)
        self._writing = asyncio.Lock()

    def routes(self) -> list[Route]:
        """The routes of these handlers."""
        return [
            Route("/label", self.document),
            Route("/api/labels", self.labels, methods=["GET"]),
            Route("/api/labels", self.put, methods=["POST"]),
            Route("/api/labels/trajectory", self.trajectory),
        ]

    async def document(self, _: Request) -> Response:
        """The page itself."""
        text = self._page.render("label.html.j2", rows=inert([])) + self._page.tail()
        return page_reply(text, self._page.policy)

    async def labels(self, request: Request) -> Response:
        """The attempts to label, and this annotator's labels so far."""
        return json_reply(await self._read(self._labels, request.query_params.get("annotator", "")))

    def _labels(self, annotator: str) -> dict[str, Any]:
        reader = self._run.reader
        queue = sample_to_label(reader, self._config.label_count, self._config.label_seed)
        levels = {task_id: task.level for task_id, task in reader.tasks.items()}
        return {
            "queue": [
                {"id": attempt, "level": levels.get(reader.attempts[attempt].task_id, "")}
                for attempt in queue
            ],
            "labels": {
                label.attempt_id: {"label": label.label, "note": label.note}
                for label in self._store().labels()
                if label.annotator == annotator
            },
        }

    async def trajectory(self, request: Request) -> Response:
        """The content of one attempt's page; with verdicts only if this annotator has labelled it."""
        params = request.query_params
        try:
            content = await self._read(self._trajectory, params.get("id", ""), params.get("annotator", ""))
        except KeyError:
            return error_reply("no such trajectory", 404)
        return json_reply(content)

    def _trajectory(self, attempt_id: str, annotator: str) -> dict[str, Any]:
        trajectory = self._run.trajectory(attempt_id)
        task = self._run.reader.tasks.get(trajectory.episode.task_id)
        content = page(trajectory, task, self._run.verdicts.of(attempt_id))
        labelled = {(label.attempt_id, label.annotator) for label in self._store().labels()}
        return content if (attempt_id, annotator) in labelled else blind(content)

    async def put(self, request: Request) -> Response:
        """Save a label; it is on disk when the reply is sent."""
        if (problem := self._origin_problem(request)) is not None:
            return error_reply(problem, 403)
        try:
            sent = msgspec.json.decode(await _body(request), type=_SentLabel)
        except (ValueError, ClientDisconnect) as error:
            return error_reply(f"invalid label: {error}", 400)
        annotator = " ".join(sent.annotator.split())
        if not annotator:
            return error_reply("the name of the annotator is missing", 400)
        try:
            task_id = await self._read(lambda: self._run.entry(sent.id).task_id)
        except KeyError:
            return error_reply("no such trajectory", 404)
        note = " ".join(sent.note.split())
        label = HumanLabel(sent.label, sent.id, task_id, annotator, note)
        async with self._writing:
            # Shielded, so that closing the page does not interrupt the writing.
            await asyncio.shield(asyncio.to_thread(lambda: self._store().put(label)))
        return json_reply({"saved": sent.id})

    def _origin_problem(self, request: Request) -> str | None:
        """Why a request does not come from the labelling page; ``None`` if it does."""
        if request.headers.get("origin") != f"http://{request.headers.get('host')}":
            return "labels are accepted only from this server's own page"
        if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return "labels are accepted only as JSON"
        if not secrets.compare_digest(request.headers.get(TOKEN_HEADER, "").encode(), self._token.encode()):
            return "the viewer was restarted: reload the page"
        return None

    def _store(self) -> LabelStore:
        return LabelStore(self._config.labels or labels_path(self._run.reader.path))


async def _body(request: Request) -> bytes:
    """A request's body.

    Raises:
        ValueError: it is too large.
    """
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _LARGEST:
            raise ValueError("it is too large")
    return body


async def unusable(_: Request, error: Exception) -> Response:
    """The reply if the file of labels cannot be used."""
    assert isinstance(error, UsageError)
    return error_reply(str(error), 409)
