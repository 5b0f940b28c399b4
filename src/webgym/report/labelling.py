"""The page where people label trajectories, and the one thing in the viewer that changes something.

A label is taken only from our own page: the request names this very server as its origin, comes as JSON and
carries a token that stands in the page and nowhere else. Another website can neither read the token nor make
a browser send such a request.
"""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from typing import Any, Final, Protocol

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from webgym.core.errors import UsageError
from webgym.report.config import ViewConfig
from webgym.report.content import blind, page
from webgym.report.live_run import LiveRun
from webgym.report.serving import SAFE, json_reply, page_reply
from webgym.report.template import Document, inert, outcome_words
from webgym.rollout.labels import HumanLabel, Label, LabelStore, labels_path, sample_to_label

TOKEN_HEADER: Final = "X-WebGym-Token"  # noqa: S105 - a header's name
_LARGEST: Final = 65_536
"""Bytes of a request."""
_SCRIPTS: Final = ("dom.js", "theme.js", "source.js", "stage.js", "trajectory.js", "label.js")


class _Put(msgspec.Struct, frozen=True):
    """What the page sends."""

    id: str
    annotator: str
    label: Label
    note: str = ""


class Read(Protocol):
    """Runs a blocking call that reads the run, one at a time."""

    async def __call__(self, call: Callable[..., Any], *args: Any) -> Any:
        """What the call returns."""
        ...


class Labelling:
    """The answers of the labelling page.

    Args:
        run: the run; touched through ``read`` alone.
        read: runs blocking calls.
        config: which file, and which attempts.
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
        """Where it answers."""
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
        """What is to be labelled, and what this person has said so far."""
        return json_reply(await self._read(self._labels, request.query_params.get("annotator", "")))

    def _labels(self, annotator: str) -> dict[str, Any]:
        reader = self._run.reader
        queue = sample_to_label(reader, self._config.label_count, self._config.label_seed)
        levels = {task_id: task.level for task_id, task in reader.tasks.items()}
        return {
            "queue": [{"id": one, "level": levels.get(reader.attempts[one].task_id, "")} for one in queue],
            "labels": {
                one.attempt_id: {"label": one.label, "note": one.note}
                for one in self._book().labels()
                if one.annotator == annotator
            },
        }

    async def trajectory(self, request: Request) -> Response:
        """Everything about one attempt; what judges said of it only to those who have labelled it."""
        asked = request.query_params
        try:
            shown = await self._read(self._trajectory, asked.get("id", ""), asked.get("annotator", ""))
        except KeyError:
            return _refused("no such trajectory", 404)
        return json_reply(shown)

    def _trajectory(self, attempt_id: str, annotator: str) -> dict[str, Any]:
        trajectory = self._run.trajectory(attempt_id)
        task = self._run.reader.tasks.get(trajectory.episode.task_id)
        shown = page(trajectory, task, self._run.verdicts.of(attempt_id))
        said = {(one.attempt_id, one.annotator) for one in self._book().labels()}
        return shown if (attempt_id, annotator) in said else blind(shown)

    async def put(self, request: Request) -> Response:
        """Write down a label; it is on disk when this answers."""
        if (why := self._foreign(request)) is not None:
            return _refused(why, 403)
        try:
            said = msgspec.json.decode(await _body(request), type=_Put)
        except (ValueError, ClientDisconnect) as error:
            return _refused(f"no label: {error}", 400)
        annotator = " ".join(said.annotator.split())
        if not annotator:
            return _refused("who labels?", 400)
        try:
            task_id = await self._read(lambda: self._run.entry(said.id).task_id)
        except KeyError:
            return _refused("no such trajectory", 404)
        note = " ".join(said.note.split())
        label = HumanLabel(said.label, said.id, task_id, annotator, note)
        async with self._writing:
            # A page that is closed meanwhile does not stop the writing half-way.
            await asyncio.shield(asyncio.to_thread(lambda: self._book().put(label)))
        return json_reply({"saved": said.id})

    def _foreign(self, request: Request) -> str | None:
        """Why a request is not our page's; ``None`` if it is."""
        if request.headers.get("origin") != f"http://{request.headers.get('host')}":
            return "labels are taken from this server's own page alone"
        if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
            return "labels are taken as JSON alone"
        if not secrets.compare_digest(request.headers.get(TOKEN_HEADER, "").encode(), self._token.encode()):
            return "the page is of an earlier start of the viewer: load it again"
        return None

    def _book(self) -> LabelStore:
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


def _refused(why: str, status: int) -> Response:
    return PlainTextResponse(why, status_code=status, headers=SAFE)


async def unusable(_: Request, error: Exception) -> Response:
    """The answer where the file of labels cannot be used."""
    assert isinstance(error, UsageError)
    return _refused(str(error), 409)
