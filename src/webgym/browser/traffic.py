"""What the tab is loading at this moment: frames, and requests in flight."""

from __future__ import annotations

import asyncio
import math

from webgym.browser.cdp import Session
from webgym.browser.wire import (
    FrameEvent,
    FrameNavigated,
    RequestDone,
    RequestFailed,
    RequestWillBeSent,
    Wire,
)

_NEVER_AWAITED = frozenset(
    {"Ping", "EventSource", "WebSocket", "Media", "Prefetch", "Preflight", "CSPViolationReport", "Manifest"}
)
"""Resource types that may stay open for ever, or that nobody sees."""


class _DomContent(Wire, frozen=True):
    pass


class Traffic:
    """Keeps the books of one tab's loading, from the browser's events.

    Args:
        session: the tab's.
        main_frame: id of its main frame.
        long_poll_seconds: age at which a request is no longer waited for.
        load_seconds: how long after its document is complete a page's remaining parts are waited for.
    """

    def __init__(
        self, session: Session, main_frame: str, *, long_poll_seconds: float, load_seconds: float
    ) -> None:
        self.started = asyncio.Event()
        """Set when a navigation of the main frame starts or has happened; cleared by whoever waits."""
        self._main_frame = main_frame
        self._long_poll_seconds = long_poll_seconds
        self._load_seconds = load_seconds
        self._clock = asyncio.get_running_loop().time
        self._waits: dict[str, float] = {}
        """What is in flight, and the moment after which it is no longer waited for."""
        self._changed = asyncio.Event()
        self._document = ("", "")
        """Loader and address of the main document that was last asked for, redirects followed."""
        session.on("Page.frameStartedLoading", FrameEvent, self._on_frame_started)
        session.on("Page.frameStoppedLoading", FrameEvent, self._on_frame_stopped)
        session.on("Page.frameDetached", FrameEvent, self._on_frame_stopped)
        session.on("Page.frameNavigated", FrameNavigated, self._on_navigated)
        session.on("Page.domContentEventFired", _DomContent, self._on_dom_content)
        session.on("Page.navigatedWithinDocument", FrameEvent, self._on_within_document)
        session.on("Network.requestWillBeSent", RequestWillBeSent, self._on_request)
        session.on("Network.loadingFinished", RequestDone, lambda done: self.end(done.request_id))
        session.on("Network.loadingFailed", RequestFailed, lambda failed: self.end(failed.request_id))

    # --- the books ----------------------------------------------------------------------------------

    def begin(self, key: str, seconds: float) -> None:
        """Something is in flight and waited for until it ends, ``seconds`` at most."""
        self._waits[key] = self._clock() + seconds
        self._changed.set()

    def end(self, key: str) -> None:
        """It is no longer in flight."""
        if self._waits.pop(key, None) is not None:
            self._changed.set()

    def clear(self) -> None:
        """Nothing is in flight: the renderer is gone."""
        self._waits.clear()
        self._changed.set()

    def pass_over(self, seconds: float) -> None:
        """The page was stopped for so long: what is in flight is as old as it was before."""
        self._waits = {key: until + seconds for key, until in self._waits.items()}

    @property
    def is_idle(self) -> bool:
        """Whether nothing is waited for."""
        now = self._clock()
        return all(until <= now for until in self._waits.values())

    @property
    def is_empty(self) -> bool:
        """Whether nothing at all is in flight, not even what is no longer waited for."""
        return not self._waits

    def __len__(self) -> int:
        return len(self._waits)

    async def idle(self) -> None:
        """Return when nothing is waited for. No deadline of its own."""
        while not self.is_idle:
            now = self._clock()
            soonest = min(until for until in self._waits.values() if until > now)
            self._changed.clear()
            try:
                async with asyncio.timeout_at(None if soonest == math.inf else soonest):
                    await self._changed.wait()
            except TimeoutError:
                continue

    def document_url(self, loader: str) -> str:
        """Where a load of the main document has been led, if it is the last one that was asked for."""
        return self._document[1] if self._document[0] == loader else ""

    # --- events -------------------------------------------------------------------------------------

    def _on_frame_started(self, event: FrameEvent) -> None:
        is_main = event.frame_id == self._main_frame
        self.begin(event.frame_id, math.inf if is_main else self._long_poll_seconds)
        if is_main:
            self.started.set()

    def _on_frame_stopped(self, event: FrameEvent) -> None:
        self.end(event.frame_id)

    def _on_navigated(self, event: FrameNavigated) -> None:
        if event.frame.id != self._main_frame:
            return
        own = {event.frame.id, event.frame.loader_id}
        self._waits = {key: until for key, until in self._waits.items() if key in own}
        self.started.set()
        self._changed.set()

    def _on_dom_content(self, _: _DomContent) -> None:
        if self._main_frame in self._waits:
            self.begin(self._main_frame, self._load_seconds)

    def _on_within_document(self, event: FrameEvent) -> None:
        if event.frame_id == self._main_frame:
            self.started.set()

    def _on_request(self, request: RequestWillBeSent) -> None:
        is_main_document = request.request_id == request.loader_id and request.frame_id == self._main_frame
        if is_main_document:
            self._document = (request.loader_id, request.document_url)
        if request.type in _NEVER_AWAITED or is_main_document:
            return  # the main document is waited for as the main frame
        if request.request_id not in self._waits:  # a redirect does not start the clock again
            self.begin(request.request_id, self._long_poll_seconds)
