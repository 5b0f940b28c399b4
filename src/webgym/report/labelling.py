"""The page where people label trajectories: the only part of the viewer that writes.

A label is accepted only from the labelling page itself: the request's origin is this server, its body is
JSON, and it has a token that only the page contains. Another website can neither read the token nor make a
browser send such a request.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from typing import Any, Final, Protocol

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import Route

from webgym.core.errors import UsageError
from webgym.report.config import ViewConfig
from webgym.report.content import blind, page
from webgym.report.live_run import LiveRun
from webgym.report.serving import error_reply, json_reply, page_reply
from webgym.report.template import Document, inert, outcome_words
from webgym.results.labels import HumanLabel, Label, LabelStore, labels_path, sample_to_label

TOKEN_HEADER: Final = "X-WebGym-Token"  # noqa: S105 - a header's name
_LARGEST: Final = 65_536
"""Most bytes of a request's body."""
_SCRIPTS: Final = ("dom.js", "theme.js", "source.js", "stage.js", "trajectory.js", "label.js")


class _SentLabel(msgspec.Struct, frozen=True):
    """A label as the page sends it."""

    id: str
    annotator: str
    label: Label
    note: str = ""


class Read(Protocol):
    """Runs a blocking call that reads the run, one at a time."""

    async def __call__(self, call: Callable[..., Any], *args: Any) -> Any:
        """Run the call and return its result."""
        ...


class Labelling:
    """The request handlers of the labelling page.

    Args:
        run: the run; accessed only through ``read``.
        read: runs blocking calls.
        config: the file of the labels, and the choice of the attempts.
    """

    def __init__(self, run: LiveRun, read: Read, config: ViewConfig) -> None:
        self._run = run
        self._read = read
        self._config = config
        self._token = secrets.token_urlsafe(32)
        settings = {"live": True, "refresh": 0, "outcomes": outcome_words(), "token": self._token}
        self._page = Document(run.reader.path.resolve().name, _SCRIPTS, settings, live=True)
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
