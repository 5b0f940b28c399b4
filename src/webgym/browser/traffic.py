"""Tracks what the tab is loading: frames, requests in flight, and channels that await an answer."""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from collections import Counter
from http import HTTPStatus
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
from webgym.browser.isolated_worlds import NAME_CHARACTERS
from webgym.browser.notices import NOTICES_PER_OBSERVATION

_NEVER_AWAITED = frozenset(
    {"Ping", "WebSocket", "Media", "Prefetch", "Preflight", "CSPViolationReport", "Manifest"}
)
"""Resource types that may stay open forever, or that are not visible."""

_OUT_OF_VIEW = frozenset({"Medium", "Low", "VeryLow"})
"""Priorities of pictures outside of the viewport: the browser raises those in the viewport to ``High``."""

_SYNCHRONOUS = "VeryHigh"
"""Priority of an XMLHttpRequest for which the script waits; that of others is ``High``."""

_READ_BY_SCRIPTS = frozenset({"Fetch", "XHR"})

_POLLS = 6
"""If an address is requested this often in a wait that reaches its deadline, it counts as polled."""

_BURST = 0.1
"""Seconds in which requests to an address count once: the tiles of a map differ only in digits, and are not
polled."""

_BROKEN = re.compile(
    r"net::ERR_(CONNECTION|SOCK|EMPTY_RESPONSE|TIMED_OUT|NETWORK|INTERNET|ADDRESS_UNREACHABLE|HTTP2"
    r"|CONTENT_LENGTH_MISMATCH|INCOMPLETE_CHUNKED)"
)
"""The browser's errors that mean that a connection failed or broke off."""

_FOLLOW_SECONDS = 0.4
"""How long after an answer on a WebSocket another message may belong to it."""

_ALONE = 2
"""After this many answers in a row that no other message followed, none is waited for."""

_FRAMES = "frames"
"""Counted as an address: documents that start to load in frames, for pages that load such ones for ever."""

_DIGITS = re.compile(r"\d+")

LOAD_SECONDS = 2.0
"""How long to wait for a page's load event after its document is complete."""

PICTURE_SECONDS = 3.0
"""A picture in the viewport in flight for longer is no longer awaited."""

UNREAD_SECONDS = 0.5
"""How long to wait for the body of a response to a script, if its length is known and none of it was read: a
page that only reports something never reads the response, which then never ends."""

LOADING_SECONDS = 8.0
"""How long to wait for timers and requests while the page shows that it is loading: a spinner, a skeleton,
``aria-busy``, "Loading…", or a blank page."""


class _DomContent(CdpMessage, frozen=True):
    pass


class _Channel(msgspec.Struct):
    """What was learned about the answers to messages on a WebSocket.

    Attributes:
        tries: how many more messages in a row may stay without an answer. One, if none was ever answered.
        alone: number of answers in a row that no other message followed; -1 while one follows.
    """

    tries: int = 1
    alone: int = 0


class _InFlight(msgspec.Struct):
    """A request or another activity that settling waits for.

    Attributes:
        since: when it began, event loop time.
        seconds: time limit of the wait for it.
        endpoint: identifies later requests of the same kind, which are not awaited if this one exceeds the
            limit; empty for none.
        is_patient: whether the limit is longer while the page shows that it is loading.
        is_request: whether it counts as an open request after the limit.
        has_answer: whether the response's headers have arrived. Its body does not end while the page does not
            read it, as with responses to reports.
        is_synchronous: whether it is a request for which the page's script waits.
        is_acted: whether it began after an action on this document, until it exceeds its limit.
        channel: where a message was sent, if it is one.
    """

    since: float
    seconds: float
    endpoint: str = ""
    is_patient: bool = False
    is_request: bool = True
    has_answer: bool = False
    is_synchronous: bool = False
    is_acted: bool = False
    channel: _Channel | None = None

    def until(self, patience: float) -> float:
        return self.since + (max(self.seconds, patience) if self.is_patient else self.seconds)


class Traffic:
    """Tracks what one tab is loading, from the browser's events.

    What exceeds its time limit is a long poll, a stream, or too slow. The next request to the same address,
    or the next message on the same channel, is then not awaited at all, until one is answered in time. What
    begins after an action is learned apart from what the page begins by itself: an application may have one
    address for everything.

    Args:
        session: the tab's session.
        main_frame: id of its main frame.
        config: the slot's limits.
    """

    def __init__(self, session: Session, main_frame: str, config: BrowserConfig) -> None:
        self.started = asyncio.Event()
        """Set when a navigation of the main frame starts or has happened; cleared by the code that waits."""
        self._main_frame = main_frame
        self._config = config
        self._clock = asyncio.get_running_loop().time
        self._in_flight: dict[str, _InFlight] = {}
        self._too_slow: set[str] = set()
        """Endpoints that did not answer in time at the last request."""
        self._too_slow_acted: set[str] = set()
        """The same, of requests after an action."""
        self._channels: dict[tuple[str, bool], _Channel] = {}
        """WebSockets by address, and whether the message was sent after an action."""
        self._sockets: dict[str, str] = {}
        """The addresses of the open ones."""
        self._is_acting = False
        """Whether the document is the one that was acted on, and the wait after the action has not ended."""
        self._unread: set[str] = set()
        """Endpoints whose responses did not end in time: only their headers are awaited."""
        self._request_counts: Counter[str] = Counter()
        """Number of requests by address, with digits replaced, since the wait began."""
        self._counted: dict[str, float] = {}
        """When each of these addresses was last counted."""
        self._polled: set[str] = set()
        """Addresses that this document polls."""
        self._changed = asyncio.Event()
        self._document = ("", "")
        """Loader and URL of the last request for a main document, redirects followed."""
        self._site = ""
        self._broken: list[tuple[str, str]] = []
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
        session.on("Network.loadingFailed", RequestFailed, self._on_failed)
        session.on("Network.webSocketCreated", SocketCreated, self._on_socket)
        session.on("Network.webSocketFrameSent", RequestDone, self._on_sent)
        session.on("Network.webSocketFrameReceived", RequestDone, self._on_received)
        session.on("Network.webSocketClosed", RequestDone, self._on_closed)

    # --- what is in flight --------------------------------------------------------------------------

    def begin(
        self,
        key: str,
        seconds: float,
        *,
        endpoint: str = "",
        is_patient: bool = False,
        is_request: bool = True,
        is_synchronous: bool = False,
        is_acted: bool = False,
    ) -> None:
        """Record that something is in flight.

        Args:
            key: identifies it, for :meth:`end`.
            seconds: time limit of the wait for it.
            endpoint, is_patient, is_request, is_synchronous, is_acted: see :class:`_InFlight`.
        """
        limit = self._limit(endpoint, seconds, is_acted=is_acted)
        self._in_flight[key] = _InFlight(
            self._clock(),
            limit,
            endpoint,
            is_patient and limit > 0,
            is_request,
            is_synchronous=is_synchronous,
            is_acted=is_acted,
        )
        self._changed.set()

    def _limit(self, endpoint: str, seconds: float, *, is_acted: bool) -> float:
        """The time limit, given what was learned about the endpoint."""
        if endpoint in (self._too_slow_acted if is_acted else self._too_slow):
            return 0.0
        if endpoint not in self._too_slow:
            return seconds
        now = self._clock()
        is_another = any(it.endpoint == endpoint and it.until(0.0) <= now for it in self._in_flight.values())
        return seconds if is_another else min(seconds, self._config.minor_seconds)  # or the page asks again

    def end(self, key: str) -> None:
        """Record that something is no longer in flight."""
        ended = self._in_flight.pop(key, None)
        if ended is None:
            return
        if self._clock() - ended.since < self._config.minor_seconds:
            self._too_slow.discard(ended.endpoint)
            self._too_slow_acted.discard(ended.endpoint)
        self._changed.set()

    def clear(self) -> None:
        """Forget everything in flight: the renderer is gone."""
        self._in_flight.clear()
        self._changed.set()

    def begin_action(self) -> None:
        """Start an action: what the document asks for until the end of the wait may be for it."""
        self.started.clear()
        self._is_acting = True

    async def starts(self, seconds: float) -> bool:
        """Whether the main frame has started a navigation, or does within ``seconds``."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self.started.wait()
        return self.started.is_set()

    def pass_over(self, seconds: float) -> None:
        """Do not count the last ``seconds``, during which the page was stopped."""
        for activity in self._in_flight.values():
            activity.since += seconds

    def give_up(self, *, all_of_it: bool = False) -> None:
        """End of a wait: remember what exceeded its time limit, so that it is not awaited next time.

        Args:
            all_of_it: whether to give up what has time left too.
        """
        now, self._is_acting = self._clock(), False
        counts, self._request_counts, self._counted = self._request_counts, Counter(), {}
        if all_of_it:
            self._polled |= {address for address, count in counts.items() if count >= _POLLS}
        for key, activity in tuple(self._in_flight.items()):
            if activity.channel is not None:
                self._learn_answer(key, activity, activity.channel)
            if all_of_it:
                self._give_up(activity)
            if activity.endpoint and activity.until(0.0) <= now:
                (self._unread if activity.has_answer else self._too_slow).add(activity.endpoint)
                if activity.is_acted and not activity.has_answer:
                    self._too_slow_acted.add(activity.endpoint)
                activity.is_acted = False

    def _learn_answer(self, key: str, activity: _InFlight, channel: _Channel) -> None:
        if activity.has_answer:
            is_endless = activity.seconds >= self._config.stir_seconds
            channel.alone = _ALONE if is_endless else channel.alone + 1
            self.end(key)
        elif activity.seconds:
            channel.tries -= 1
            activity.seconds = 0.0

    @staticmethod
    def _give_up(activity: _InFlight) -> None:
        activity.seconds, activity.is_patient = 0.0, False

    @property
    def synchronous(self) -> frozenset[str]:
        """Ids of the requests for which scripts wait. One that the browser repeats keeps its id."""
        return frozenset(key for key, activity in self._in_flight.items() if activity.is_synchronous)

    def is_idle(self, patience: float = 0.0) -> bool:
        """Whether nothing is awaited.

        Args:
            patience: least time limit while the page shows that it is loading, seconds.
        """
        return not self._ends(patience)

    def _ends(self, patience: float) -> list[float]:
        """When the time limits of everything that is awaited end."""
        now = self._clock()
        return [end for activity in self._in_flight.values() if (end := activity.until(patience)) > now]

    @property
    def is_empty(self) -> bool:
        """Whether no request is in flight, not even one that is no longer awaited."""
        return not any(activity.is_request for activity in self._in_flight.values())

    def __len__(self) -> int:
        return len(self._in_flight)

    async def idle(self, patience: float = 0.0) -> None:
        """Return when nothing is awaited. Without a deadline of its own."""
        while ends := self._ends(patience):
            soonest = min(ends)
            self._changed.clear()
            try:
                async with asyncio.timeout_at(None if soonest == math.inf else soonest):
                    await self._changed.wait()
            except TimeoutError:
                continue

    def document_url(self, loader: str) -> str:
        """The URL of a load of the main document after redirects; empty if it is not the last one."""
        return self._document[1] if self._document[0] == loader else ""

    # --- frames -------------------------------------------------------------------------------------

    def _on_frame_started(self, event: FrameEvent) -> None:
        if event.frame_id == self._main_frame:
            self.begin(event.frame_id, math.inf)
            self.started.set()
        else:  # its document gets a limit of its own once its URL is known
            self._count(_FRAMES)
            self.begin(event.frame_id, 0.0 if _FRAMES in self._polled else self._config.minor_seconds)

    def _on_frame_stopped(self, event: FrameEvent) -> None:
        self.end(event.frame_id)

    def _on_navigated(self, event: FrameNavigated) -> None:
        if event.frame.id != self._main_frame:
            return
        self._site = _site(event.frame.url)
        self._polled.clear()
        self._sockets.clear()
        self._is_acting = False
        kept = {event.frame.id, event.frame.loader_id}
        self._in_flight = {key: activity for key, activity in self._in_flight.items() if key in kept}
        if self._main_frame in self._in_flight:
            self.begin(self._main_frame, math.inf)
        self.started.set()
        self._changed.set()

    def _on_dom_content(self, _: _DomContent) -> None:
        if self._main_frame in self._in_flight:
            self.begin(self._main_frame, LOAD_SECONDS)

    def _on_within_document(self, event: FrameEvent) -> None:
        if event.frame_id == self._main_frame:
            self.started.set()

    def _on_scheduled(self, event: ScheduledNavigation) -> None:
        """A refresh by HTTP header or ``<meta>`` element."""
        if event.frame_id == self._main_frame and event.delay <= self._config.silent_timer_seconds:
            self.begin(f"refresh {event.frame_id}", event.delay + self._config.minor_seconds)

    def _on_unscheduled(self, event: FrameEvent) -> None:
        self.end(f"refresh {event.frame_id}")

    # --- requests -----------------------------------------------------------------------------------

    def _on_request(self, request: RequestWillBeSent) -> None:
        if request.request_id == request.loader_id and request.frame_id == self._main_frame:
            self._document = (request.loader_id, request.document_url)
            if self._main_frame in self._in_flight:  # the main document is awaited as the main frame
                self.begin(self._main_frame, math.inf)
            return
        if request.type in _NEVER_AWAITED or request.request_id in self._in_flight:
            return  # a redirect does not start the clock again
        if request.type == "EventSource":
            self._await_message(request.request_id, request.request.url)
            return
        is_minor = request.type == "Image" and request.request.initial_priority in _OUT_OF_VIEW
        address = _DIGITS.sub("0", f"{request.request.method} {request.request.url}")
        self._count(address)
        is_foreign = bool(request.frame_id) and _site(request.document_url) != self._site
        seconds = self._config.minor_seconds if is_minor or is_foreign else self._config.long_poll_seconds
        self.begin(
            request.request_id,
            0.0 if address in self._polled else seconds,
            endpoint=f"{request.request.method} {request.request.url.partition('?')[0]}",
            is_patient=not (is_minor or is_foreign),
            is_synchronous=request.type == "XHR" and request.request.initial_priority == _SYNCHRONOUS,
            is_acted=self._is_acting,
        )

    def _count(self, address: str) -> None:
        if self._clock() - self._counted.get(address, -math.inf) >= _BURST:
            self._counted[address] = self._clock()
            self._request_counts[address] += 1

    def _on_response(self, event: ResponseReceived) -> None:
        activity = self._in_flight.get(event.request_id)
        if activity is None:
            return
        activity.has_answer = True
        if event.response.status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            self._add_broken(activity, f"HTTP status {event.response.status}")
        if activity.endpoint in self._unread:
            self._give_up(activity)
        elif event.type in _READ_BY_SCRIPTS and "content-length" in {
            name.lower() for name in event.response.headers
        }:
            # A body that the page reads arrives at once.
            activity.seconds = min(activity.seconds, self._clock() - activity.since + UNREAD_SECONDS)
            activity.is_patient = False
        self._changed.set()

    def _on_data(self, event: RequestDone) -> None:
        """Extend the limit while a response's body arrives."""
        activity = self._in_flight.get(event.request_id)
        if activity is not None and activity.has_answer and activity.seconds:
            more = self._clock() - activity.since + self._config.minor_seconds
            activity.seconds = max(activity.seconds, min(more, LOADING_SECONDS))
            self._changed.set()

    def _on_failed(self, failed: RequestFailed) -> None:
        activity = self._in_flight.get(failed.request_id)
        if activity is not None and not failed.canceled and _BROKEN.match(failed.error_text):
            self._add_broken(activity, failed.error_text)
        self.end(failed.request_id)

    def _add_broken(self, activity: _InFlight, why: str) -> None:
        url = activity.endpoint.partition(" ")[2]
        if _site(url) == self._site and len(self._broken) < NOTICES_PER_OBSERVATION:
            self._broken.append((url[:NAME_CHARACTERS], why))

    def take_broken(self) -> list[tuple[str, str]]:
        """The requests to the page's own website that failed since the last call: URL and reason."""
        broken, self._broken = self._broken, []
        return broken

    def _on_priority(self, changed: PriorityChanged) -> None:
        activity = self._in_flight.get(changed.request_id)
        if activity is not None and activity.seconds and changed.new_priority not in _OUT_OF_VIEW:
            activity.seconds = max(activity.seconds, PICTURE_SECONDS)
            self._changed.set()

    def _on_socket(self, socket: SocketCreated) -> None:
        self._sockets[socket.request_id] = socket.url.partition("?")[0]
        self._await_message(socket.request_id, socket.url)

    def _on_sent(self, socket: RequestDone) -> None:
        address = self._sockets.get(socket.request_id, "")
        channel = self._channels.setdefault((address, self._is_acting), _Channel())
        seconds = self._answer_seconds if self._is_acting else self._config.reply_seconds
        self.begin(socket.request_id, seconds if channel.tries else 0.0, is_request=False)
        self._in_flight[socket.request_id].channel = channel

    @property
    def _answer_seconds(self) -> float:
        return 2 * self._config.reply_seconds

    def _on_received(self, socket: RequestDone) -> None:
        activity = self._in_flight.get(socket.request_id)
        if activity is None or activity.channel is None:
            self.end(socket.request_id)
            return
        channel = activity.channel
        age = self._clock() - activity.since
        if not activity.has_answer:
            activity.has_answer = True
            channel.tries = 2 if age < self._answer_seconds else channel.tries
        elif age < activity.seconds:
            channel.alone = -1
        else:
            self._learn_answer(socket.request_id, activity, channel)
            return
        if channel.alone >= _ALONE:
            self.end(socket.request_id)
        activity.seconds = min(age + _FOLLOW_SECONDS, self._config.stir_seconds)
        self._changed.set()

    def _on_closed(self, socket: RequestDone) -> None:
        self._sockets.pop(socket.request_id, None)
        self.end(socket.request_id)

    def _await_message(self, channel: str, endpoint: str) -> None:
        """A channel was opened, or a message was sent on it: an answer may come."""
        self.begin(channel, self._config.reply_seconds, endpoint=endpoint, is_request=False)


def _site(url: str) -> str:
    """The website of a document, approximately: the last two labels of its host."""
    try:
        host = urlsplit(url).hostname or ""
    except ValueError:
        return ""
    return host if host.replace(".", "").isdigit() else ".".join(host.split(".")[-2:])
