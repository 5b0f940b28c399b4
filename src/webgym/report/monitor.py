"""The page of a run's monitor: what its collector is doing at this moment, by server-sent events.

It reads ``live.json`` (:mod:`webgym.rollout.feed`) and the last lines of ``metrics.jsonl``, and never the
trajectories: it costs the same whether there are ten or a hundred thousand.
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
from webgym.rollout.files import METRICS
from webgym.rollout.progress import STATES

_SCRIPTS: Final = ("dom.js", "theme.js", "monitor.js")
_HISTORY_BYTES: Final = 200_000
"""Of the end of ``metrics.jsonl``: about 600 lines, 50 minutes."""
_STILL_HERE_AFTER: Final = 30
"""Looks without news after which a comment is sent, so that a page that is gone is noticed."""


class Monitoring:
    """The answers of the monitor's page.

    Args:
        run: the run folder.
        config: how often it looks.
        closing: is set when the server is to end; streams end then, too.
    """

    def __init__(self, run: Path, config: ViewConfig, closing: asyncio.Event) -> None:
        self._run = run
        self._seconds = config.monitor_seconds
        self._closing = closing
        settings = {"live": True, "states": STATES, "levels": LEVELS, "outcomes": outcome_words()}
        self._page = Document(run.resolve().name, _SCRIPTS, settings, live=True)

    def routes(self) -> list[Route]:
        """Where it answers."""
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
            told = await asyncio.to_thread(self._read)
            feed = told["feed"] or {}
            now = (feed.get("at"), feed.get("is_stale"), told["error"])
            unchanged = unchanged + 1 if now == before else 0
            if now != before:
                yield _event("feed", told)
            elif unchanged % _STILL_HERE_AFTER == 0:
                yield b": still here\n\n"
            before = now
            await _either(self._closing, self._seconds)

    def _read(self) -> dict[str, Any]:
        """The feed, ``None`` if no collector is at work, and what is wrong with it."""
        try:
            return {"feed": read_feed(self._run), "error": ""}
        except StoreCorrupt as error:
            return {"feed": None, "error": str(error)}


async def _either(event: asyncio.Event, seconds: float) -> None:
    """Until the event, or for so long."""
    try:
        async with asyncio.timeout(seconds):
            await event.wait()
    except TimeoutError:
        return


def read_history(run: Path) -> list[dict[str, Any]]:
    """The end of ``metrics.jsonl``, oldest first; lines that are half written or no figures are left out."""
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
            continue  # the first is cut, the last may be under way
    return history


def _event(name: str, value: Any) -> bytes:
    return b"event: %s\ndata: %s\n\n" % (name.encode(), msgspec.json.encode(value))
