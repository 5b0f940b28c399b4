"""What the tab is loading at this moment: frames, requests in flight, and channels that owe an answer."""

from __future__ import annotations

import asyncio
import math
import re
from collections import Counter
from urllib.parse import urlsplit

import msgspec

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import (
    CdpMessage,
    FrameEvent,
    FrameNavigated,
    PriorityChanged,
    RequestDone,
    RequestFailed,
    RequestWillBeSent,
    ResponseReceived,
    ScheduledNavigation,
    SocketCreated,
)
from webgym.browser.config import BrowserConfig

_NEVER_AWAITED = frozenset(
    {"Ping", "WebSocket", "Media", "Prefetch", "Preflight", "CSPViolationReport", "Manifest"}
)
"""Resource types that may stay open for ever, or that nobody sees."""

_UNSEEN = frozenset({"Medium", "Low", "VeryLow"})
"""Priorities of pictures that are not in the viewport: the browser raises those that are to ``High``."""

_READ_BY_SCRIPTS = frozenset({"Fetch", "XHR"})

_POLLS = 6
"""Times that an address is asked in a wait that the deadline ends, until it counts as asked for ever."""

_BURST = 0.1
"""Seconds in which an address counts as asked once: the tiles of a map differ in digits alone, and are no
poll."""

_DIGITS = re.compile(r"\d+")


class _DomContent(CdpMessage, frozen=True):
    pass


class _InFlight(msgspec.Struct):
    """Something that is waited for.

    Attributes:
        since: when it began.
        seconds: for how long it is waited for.
        endpoint: by which it is known again, if it outlasts that; empty for what is not.
        is_patient: whether it is waited for longer while the page shows that it is loading.
        is_request: whether it counts as an open request when it is no longer waited for.
        has_answer: whether the head of the answer is there. Its body does not end while the page leaves it
            unread, as it does with the answers to what it reports.
    """

    since: float
    seconds: float
    endpoint: str = ""
    is_patient: bool = False
    is_request: bool = True
    has_answer: bool = False

    def until(self, patience: float) -> float:
        return self.since + (max(self.seconds, patience) if self.is_patient else self.seconds)


class Traffic:
    """Tracks what one tab is loading, from the browser's events.

    What outlasts the time that is given to it is a long poll, a stream, or just too slow. The next request
    to the same address, or the next word on the same channel, is then not waited for at all, until one is
    answered in time.

    Args:
        session: the tab's.
        main_frame: id of its main frame.
        config: the slot's limits.
    """

    def __init__(self, session: Session, main_frame: str, config: BrowserConfig) -> None:
        self.started = asyncio.Event()
        """Set when a navigation of the main frame starts or has happened; cleared by whoever waits."""
        self._main_frame = main_frame
        self._config = config
        self._clock = asyncio.get_running_loop().time
        self._in_flight: dict[str, _InFlight] = {}
        self._outlasting: set[str] = set()
        """Endpoints that did not answer in time when they were last asked."""
        self._unread: set[str] = set()
        """Endpoints whose answers did not end in time: only their heads are waited for."""
        self._asked: Counter[str] = Counter()
        """How often addresses were asked since the wait began, numbers in them left out."""
        self._counted: dict[str, float] = {}
        """When each of them was counted last."""
        self._polled: set[str] = set()
        """Addresses that this document asks again and again."""
        self._changed = asyncio.Event()
        self._document = ("", "")
        """Loader and address of the main document that was last asked for, redirects followed."""
        self._site = ""
        session.on("Page.frameStartedLoading", FrameEvent, self._on_frame_started)
        session.on("Page.frameStoppedLoading", FrameEvent, self._on_frame_stopped)
        session.on("Page.frameDetached", FrameEvent, self._on_frame_stopped)
        session.on("Page.frameNavigated", FrameNavigated, self._on_navigated)
        session.on("Page.domContentEventFired", _DomContent, self._on_dom_content)
        session.on("Page.navigatedWithinDocument", FrameEvent, self._on_within_document)
        session.on("Page.frameScheduledNavigation", ScheduledNavigation, self._on_scheduled)
        session.on("Page.frameClearedScheduledNavigation", FrameEvent, self._on_unscheduled)
        self.follow(session)

    def follow(self, session: Session) -> None:
        """Track another target's requests too."""
        session.on("Network.requestWillBeSent", RequestWillBeSent, self._on_request)
        session.on("Network.responseReceived", ResponseReceived, self._on_response)
        session.on("Network.dataReceived", RequestDone, self._on_data)
        session.on("Network.resourceChangedPriority", PriorityChanged, self._on_priority)
        for name in ("loadingFinished", "eventSourceMessageReceived"):
            session.on(f"Network.{name}", RequestDone, lambda done: self.end(done.request_id))
        session.on("Network.loadingFailed", RequestFailed, lambda failed: self.end(failed.request_id))
        session.on("Network.webSocketCreated", SocketCreated, self._on_socket)
        session.on("Network.webSocketFrameSent", RequestDone, self._on_said)
        for name in ("webSocketFrameReceived", "webSocketClosed"):
            session.on(f"Network.{name}", RequestDone, lambda socket: self.end(socket.request_id))

    # --- the records --------------------------------------------------------------------------------

    def begin(
        self,
        key: str,
        seconds: float,
        *,
        endpoint: str = "",
        is_patient: bool = False,
        is_request: bool = True,
    ) -> None:
        """Something is in flight and waited for until it ends, ``seconds`` at most."""
        limit = 0.0 if endpoint in self._outlasting else seconds
        self._in_flight[key] = _InFlight(self._clock(), limit, endpoint, is_patient and limit > 0, is_request)
        self._changed.set()

    def end(self, key: str) -> None:
        """It is no longer in flight."""
        ended = self._in_flight.pop(key, None)
        if ended is None:
            return
        if ended.endpoint in self._outlasting and self._clock() - ended.since < self._config.minor_seconds:
            self._outlasting.discard(ended.endpoint)
        self._changed.set()

    def clear(self) -> None:
        """Nothing is in flight: the renderer is gone."""
        self._in_flight.clear()
        self._changed.set()

    def pass_over(self, seconds: float) -> None:
        """The page was stopped for so long: what is in flight is as old as it was before."""
        for one in self._in_flight.values():
            one.since += seconds

    def give_up(self, *, all_of_it: bool = False) -> None:
        """Know again what outlasted its time: it is not waited for next time.

        Args:
            all_of_it: what has time left is given up too.
        """
        now = self._clock()
        asked, self._asked, self._counted = self._asked, Counter(), {}
        if all_of_it:
            self._polled |= {address for address, times in asked.items() if times >= _POLLS}
        for one in self._in_flight.values():
            if all_of_it:
                self._give_up(one)
            if one.endpoint and one.until(0.0) <= now:
                (self._unread if one.has_answer else self._outlasting).add(one.endpoint)

    @staticmethod
    def _give_up(one: _InFlight) -> None:
        one.seconds, one.is_patient = 0.0, False

    def is_idle(self, patience: float = 0.0) -> bool:
        """Whether nothing is waited for. ``patience``: for how long at least, seconds, while the page shows
        that it is loading."""
        return not self._ends(patience)

    def _ends(self, patience: float) -> list[float]:
        """Until when each of what is waited for is."""
        now = self._clock()
        return [end for one in self._in_flight.values() if (end := one.until(patience)) > now]

    @property
    def is_empty(self) -> bool:
        """Whether no request is in flight, not even one that is no longer waited for."""
        return not any(one.is_request for one in self._in_flight.values())

    def __len__(self) -> int:
        return len(self._in_flight)

    async def idle(self, patience: float = 0.0) -> None:
        """Return when nothing is waited for. No deadline of its own."""
        while ends := self._ends(patience):
            soonest = min(ends)
            self._changed.clear()
            try:
                async with asyncio.timeout_at(None if soonest == math.inf else soonest):
                    await self._changed.wait()
            except TimeoutError:
                continue

    def document_url(self, loader: str) -> str:
        """Where a load of the main document has been led, if it is the last one that was asked for."""
        return self._document[1] if self._document[0] == loader else ""

    # --- frames -------------------------------------------------------------------------------------

    def _on_frame_started(self, event: FrameEvent) -> None:
        if event.frame_id == self._main_frame:
            self.begin(event.frame_id, math.inf)
            self.started.set()
        else:  # its document has a time of its own, once it is known where it comes from
            self.begin(event.frame_id, self._config.minor_seconds)

    def _on_frame_stopped(self, event: FrameEvent) -> None:
        self.end(event.frame_id)

    def _on_navigated(self, event: FrameNavigated) -> None:
        if event.frame.id != self._main_frame:
            return
        self._site = _site(event.frame.url)
        self._polled.clear()
        own = {event.frame.id, event.frame.loader_id}
        self._in_flight = {key: one for key, one in self._in_flight.items() if key in own}
        if self._main_frame in self._in_flight:
            self.begin(self._main_frame, math.inf)
        self.started.set()
        self._changed.set()

    def _on_dom_content(self, _: _DomContent) -> None:
        if self._main_frame in self._in_flight:
            self.begin(self._main_frame, self._config.load_seconds)

    def _on_within_document(self, event: FrameEvent) -> None:
        if event.frame_id == self._main_frame:
            self.started.set()

    def _on_scheduled(self, event: ScheduledNavigation) -> None:
        """A refresh, by header or by element."""
        if event.frame_id == self._main_frame and event.delay <= self._config.silent_timer_seconds:
            self.begin(f"refresh {event.frame_id}", event.delay + self._config.minor_seconds)

    def _on_unscheduled(self, event: FrameEvent) -> None:
        self.end(f"refresh {event.frame_id}")

    # --- requests -----------------------------------------------------------------------------------

    def _on_request(self, request: RequestWillBeSent) -> None:
        if request.request_id == request.loader_id and request.frame_id == self._main_frame:
            self._document = (request.loader_id, request.document_url)
            if self._main_frame in self._in_flight:  # the main document is waited for as the main frame
                self.begin(self._main_frame, math.inf)
            return
        if request.type in _NEVER_AWAITED or request.request_id in self._in_flight:
            return  # a redirect does not start the clock again
        if request.type == "EventSource":
            self._await_word(request.request_id, request.request.url)
            return
        is_minor = request.type == "Image" and request.request.initial_priority in _UNSEEN
        address = _DIGITS.sub("0", f"{request.request.method} {request.request.url}")
        if self._clock() - self._counted.get(address, -math.inf) >= _BURST:
            self._counted[address] = self._clock()
            self._asked[address] += 1
        is_foreign = bool(request.frame_id) and _site(request.document_url) != self._site
        seconds = self._config.minor_seconds if is_minor or is_foreign else self._config.long_poll_seconds
        self.begin(
            request.request_id,
            0.0 if address in self._polled else seconds,
            endpoint=f"{request.request.method} {request.request.url.partition('?')[0]}",
            is_patient=not (is_minor or is_foreign),
        )

    def _on_response(self, event: ResponseReceived) -> None:
        one = self._in_flight.get(event.request_id)
        if one is None:
            return
        one.has_answer = True
        if one.endpoint in self._unread:
            self._give_up(one)
        elif event.type in _READ_BY_SCRIPTS and "content-length" in {
            name.lower() for name in event.response.headers
        }:
            # What is read comes at once.
            one.seconds = min(one.seconds, self._clock() - one.since + self._config.unread_seconds)
            one.is_patient = False
        self._changed.set()

    def _on_data(self, event: RequestDone) -> None:
        """A body that still comes is waited for."""
        one = self._in_flight.get(event.request_id)
        if one is not None and one.has_answer and one.seconds:
            more = self._clock() - one.since + self._config.reply_seconds
            one.seconds = max(one.seconds, min(more, self._config.loading_seconds))
            self._changed.set()

    def _on_priority(self, changed: PriorityChanged) -> None:
        one = self._in_flight.get(changed.request_id)
        if one is not None and one.seconds and changed.new_priority not in _UNSEEN:
            one.seconds = max(one.seconds, self._config.picture_seconds)
            self._changed.set()

    def _on_socket(self, socket: SocketCreated) -> None:
        self._await_word(socket.request_id, socket.url)

    def _on_said(self, socket: RequestDone) -> None:
        self._await_word(socket.request_id, f"{socket.request_id} answers")

    def _await_word(self, channel: str, endpoint: str) -> None:
        """A channel was opened, or something was said on it: an answer may come."""
        self.begin(channel, self._config.reply_seconds, endpoint=endpoint, is_request=False)


def _site(url: str) -> str:
    """Who a document belongs to, as far as a name can tell: the last two labels of its host."""
    try:
        host = urlsplit(url).hostname or ""
    except ValueError:
        return ""
    return host if host.replace(".", "").isdigit() else ".".join(host.split(".")[-2:])
