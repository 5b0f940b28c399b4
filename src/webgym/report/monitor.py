"""The monitor page of a run: what its collector is doing now, by server-sent events.

It reads ``live.json`` (:mod:`webgym.rollout.feed`) and the last lines of ``metrics.jsonl``, but no
trajectories, so its cost does not depend on their number.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import Route

from webgym.core.errors import StoreCorrupt
from webgym.core.task import LEVELS
from webgym.report.config import ViewConfig
from webgym.report.serving import SAFE, page_reply
from webgym.report.template import Document, outcome_words
from webgym.rollout.feed import read_feed
from webgym.rollout.progress import STATES
from webgym.store.files import METRICS

_SCRIPTS: Final = ("dom.js", "theme.js", "monitor.js")
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

    def __init__(self, run: Path, config: ViewConfig, closing: asyncio.Event) -> None:
        self._run = run
        self._seconds = config.monitor_seconds
        self._closing = closing
        settings = {"live": True, "states": STATES, "levels": LEVELS, "outcomes": outcome_words()}
        self._page = Document(run.resolve().name, _SCRIPTS, settings, live=True)

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
            await _wait(self._closing, self._seconds)

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
