"""Tracks what the tab is loading: frames, requests in flight, channels that await an answer, and workers.

A worker is a target with a session of its own: the page's session does not report what it loads, nor when the
script of a shared one has come. Whether it computes is found out by evaluating a trivial expression, which it
answers once it is idle. Pages without workers cost nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
from http import HTTPStatus
from urllib.parse import urlsplit

import msgspec

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import (
    AttachedToTarget,
    CdpMessage,
    DataReceived,
    DetachedFromTarget,
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
from webgym.browser.desktop import Told
from webgym.browser.isolated_worlds import ADDRESS_CHARACTERS, NAME_CHARACTERS
from webgym.browser.notices import NOTICES_PER_OBSERVATION
from webgym.core.errors import BrowserError

_NEVER_AWAITED = frozenset(
    {"Ping", "WebSocket", "Media", "Prefetch", "Preflight", "CSPViolationReport", "Manifest"}
)
"""Resource types that may stay open forever, or that are not visible."""

_OUT_OF_VIEW = frozenset({"Medium", "Low", "VeryLow"})
"""Priorities of pictures outside of the viewport: the browser raises those in the viewport to ``High``."""

_SYNCHRONOUS = "VeryHigh"
"""Priority of an XMLHttpRequest for which the script waits; that of others is ``High``."""

_BROKEN = re.compile(
    r"net::ERR_(CONNECTION|SOCK|EMPTY_RESPONSE|TIMED_OUT|NETWORK|INTERNET|ADDRESS_UNREACHABLE|HTTP2"
    r"|CONTENT_LENGTH_MISMATCH|INCOMPLETE_CHUNKED)"
)
"""The browser's errors that mean that a connection failed or broke off."""

_FOLLOW_SECONDS = 0.4
"""How long after an answer on a WebSocket another message may belong to it."""

_DIGITS = re.compile(r"\d+")

_BODY_BYTES = 200
"""Of a request's body that tell it from others to the same URL."""

_NAMES = {
    "Document": "a frame from",
    "Stylesheet": "a style sheet from",
    "Image": "a picture from",
    "Font": "a font from",
    "Script": "a script from",
}
"""How notices name requests, by resource type; "a request to" is the name of others."""

_PATH_CHARACTERS = 60
"""Longest path that a notice quotes."""

_TELLINGS = 3
"""A request that is still open after so many actions is a stream or a long poll, and no longer told."""

_NAMED_AT_ONCE = 3
"""Most requests that a notice names."""

LOAD_SECONDS = 2.0
"""How long to wait for a page's load event after its document is complete."""

PICTURE_SECONDS = 3.0
"""A picture in the viewport in flight for longer is no longer awaited."""

LOADING_SECONDS = 8.0
"""How long to wait for timers and requests while the page shows that it is loading: a spinner, a skeleton,
``aria-busy``, "Loading…", or a blank page."""


class _DomContent(CdpMessage, frozen=True):
    pass


class _InFlight(msgspec.Struct):
    """A request or another activity that settling waits for.

    Attributes:
        since: when it began, event loop time.
        seconds: time limit of the wait for it.
        name: what a notice calls it that names what is still open; empty if none does.
        url: its URL without the query; empty if it is no request.
        address: identifies its like, in :attr:`Traffic._own`; empty if it has none.
        is_patient: whether the limit is longer while the page shows that it is loading.
        is_request: whether it counts as an open request after the limit.
        has_answer: whether the response's headers, or a first message, have arrived.
        left: bytes of the body that have not arrived. Chromium does not report the end of a response that the
            page does not read, such as the answer to a report.
        is_synchronous: whether it is a request for which the page's script waits.
        is_acted: whether it began after an action on this document.
        actions: number of actions that began since.
    """

    since: float
    seconds: float
    name: str = ""
    url: str = ""
    address: str = ""
    is_patient: bool = False
    is_request: bool = True
    is_synchronous: bool = False
    is_acted: bool = False
    has_answer: bool = False
    left: float = math.inf
    actions: int = 0

    def describe(self, now: float) -> str:
        path = self.url.partition("://")[2].partition("/")[2][:_PATH_CHARACTERS]
        return f"{self.name}{f' /{path}' if self.url else ''}, {now - self.since:.0f} s so far"

    def until(self, patience: float) -> float:
        return self.since + (max(self.seconds, patience) if self.is_patient else self.seconds)


class Traffic:
    """Tracks what one tab is loading, from the browser's events.

    What the page began by itself and is still open when a wait ends, such as a long poll, is its own: its
    like is not awaited again in this document. What follows an action always is, up to its limit, unless it
    kept the page from ever being idle.

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
        self._own: dict[str, bool] = {}
        """Addresses of what this document does by itself, which is not awaited, and whether it has kept the
        page from ever being idle."""
        self._is_acting = False
        """Whether the document is the one that was acted on, and the wait after the action has not ended."""
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
        session.on("Network.dataReceived", DataReceived, self._on_data)
        session.on("Network.resourceChangedPriority", PriorityChanged, self._on_priority)
        for name in ("loadingFinished", "eventSourceMessageReceived", "webSocketClosed"):
            session.on(f"Network.{name}", RequestDone, lambda done: self.end(done.request_id))
        session.on("Network.loadingFailed", RequestFailed, self._on_failed)
        session.on("Network.webSocketCreated", SocketCreated, self._on_socket)
        session.on("Network.webSocketFrameSent", RequestDone, self._on_sent)
        session.on("Network.webSocketFrameReceived", RequestDone, self._on_received)

    # --- what is in flight --------------------------------------------------------------------------

    def begin(self, key: str, seconds: float, *, name: str = "") -> None:
        """Record that something is in flight.

        Args:
            key: identifies it, for :meth:`end`.
            seconds: time limit of the wait for it.
            name: what a notice calls it; empty if none names it.
        """
        self._add(key, _InFlight(self._clock(), seconds, name))

    def _add(self, key: str, activity: _InFlight) -> None:
        activity.is_acted = self._is_acting
        if self._is_own(activity.address):
            activity.seconds, activity.name, activity.is_patient = 0.0, "", False
        self._in_flight[key] = activity
        self._changed.set()

    def _is_own(self, address: str) -> bool:
        is_polled = self._own.get(address)
        if is_polled is False:  # a second one at the same time is the action's
            return all(it.address != address or it.has_answer for it in self._in_flight.values())
        return bool(is_polled)

    def end(self, key: str) -> None:
        """Record that something is no longer in flight."""
        if self._in_flight.pop(key, None) is not None:
            self._changed.set()

    def clear(self) -> None:
        """Forget everything in flight: the renderer is gone."""
        self._in_flight.clear()
        self._changed.set()

    def begin_action(self) -> None:
        """Start an action: what the document asks for until the end of the wait may be for it."""
        self.started.clear()
        self._is_acting = True
        for activity in self._in_flight.values():
            activity.actions += 1

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

    def end_wait(self, *, is_over: bool = False) -> None:
        """End of a wait: what the page began by itself and is still open is its own.

        Args:
            is_over: whether the page was never idle: then so is all that is open, and awaited no longer.
        """
        self._is_acting = False
        for key, activity in tuple(self._in_flight.items()):
            if not activity.is_request:
                self._end_message(key, activity)
            elif activity.address and (is_over or not activity.is_acted or activity.has_answer):
                self._own[activity.address] = is_over or self._own.get(activity.address, False)
            if is_over:
                activity.seconds, activity.is_patient = 0.0, False

    def still_open(self) -> list[str]:
        """What of it a notice should name: what is no stream of the page's own, the oldest first."""
        now = self._clock()
        told = [it for it in self._in_flight.values() if it.name and it.actions < _TELLINGS]
        told.sort(key=lambda it: it.since)
        names = [it.describe(now) for it in told[:_NAMED_AT_ONCE]]
        return [*names, *([f"{len(told) - len(names)} more"] if len(told) > len(names) else [])]

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
            self._begin_main(math.inf)
            self.started.set()
        else:  # its document gets a limit of its own once its URL is known
            self.begin(event.frame_id, self._config.minor_seconds)

    def _begin_main(self, seconds: float) -> None:
        self.begin(self._main_frame, seconds, name="the page itself")

    def _on_frame_stopped(self, event: FrameEvent) -> None:
        self.end(event.frame_id)

    def _on_navigated(self, event: FrameNavigated) -> None:
        if event.frame.id != self._main_frame:
            return
        self._site = _site(event.frame.url)
        self._own.clear()
        self._is_acting = False
        kept = {event.frame.id, event.frame.loader_id}
        self._in_flight = {key: activity for key, activity in self._in_flight.items() if key in kept}
        if self._main_frame in self._in_flight:
            self._begin_main(math.inf)
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
                self._begin_main(math.inf)
            return
        if request.type in _NEVER_AWAITED or request.request_id in self._in_flight:
            return  # a redirect does not start the clock again
        if request.type == "EventSource":
            self._await_message(request.request_id)
            return
        is_minor = request.type == "Image" and request.request.initial_priority in _OUT_OF_VIEW
        is_minor |= bool(request.frame_id) and _site(request.document_url) != self._site
        activity = _InFlight(
            self._clock(),
            self._config.minor_seconds if is_minor else self._config.long_poll_seconds,
            name="" if is_minor else _NAMES.get(request.type, "a request to"),
            url=request.request.url.partition("?")[0],
            address=_address(request),
            is_patient=not is_minor,
            is_synchronous=request.type == "XHR" and request.request.initial_priority == _SYNCHRONOUS,
        )
        self._add(request.request_id, activity)
        if request.type == "Document" and not activity.seconds:
            self.end(request.frame_id)  # one of the frames that come and go for ever

    def _on_response(self, event: ResponseReceived) -> None:
        activity = self._in_flight.get(event.request_id)
        if activity is None:
            return
        activity.has_answer = True
        if event.response.status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            self._add_broken(activity.url, f"HTTP status {event.response.status}")
        lengths = (
            value for name, value in event.response.headers.items() if name.lower() == "content-length"
        )
        length = next(lengths, "")
        activity.left = float(length) if length.isdigit() else math.inf
        self._changed.set()

    def _on_data(self, event: DataReceived) -> None:
        """Extend the limit while a response's body arrives."""
        activity = self._in_flight.get(event.request_id)
        if activity is None or not activity.has_answer:
            return
        activity.left -= event.encoded_data_length
        if activity.left <= 0:
            self.end(event.request_id)
        elif activity.seconds:
            more = self._clock() - activity.since + self._config.minor_seconds
            activity.seconds = max(activity.seconds, min(more, LOADING_SECONDS))
            self._changed.set()

    def _on_failed(self, failed: RequestFailed) -> None:
        activity = self._in_flight.get(failed.request_id)
        if activity is not None and not failed.canceled and _BROKEN.match(failed.error_text):
            self._add_broken(activity.url, failed.error_text)
        self.end(failed.request_id)

    def _add_broken(self, url: str, why: str) -> None:
        if _site(url) == self._site and len(self._broken) < NOTICES_PER_OBSERVATION:
            self._broken.append((url[:NAME_CHARACTERS], why))

    def take_broken(self) -> list[tuple[str, str]]:
        """The requests to the page's own website that failed since the last call: URL and reason."""
        broken, self._broken = self._broken, []
        return broken

    def _on_priority(self, changed: PriorityChanged) -> None:
        activity = self._in_flight.get(changed.request_id)
        if activity is not None and activity.seconds and changed.new_priority not in _OUT_OF_VIEW:
            activity.seconds, activity.name = max(activity.seconds, PICTURE_SECONDS), _NAMES["Image"]
            self._changed.set()

    # --- messages -----------------------------------------------------------------------------------

    def _on_socket(self, socket: SocketCreated) -> None:
        self._await_message(socket.request_id)

    def _await_message(self, channel: str) -> None:
        """A channel was opened: a message may come."""
        self._add(channel, _InFlight(self._clock(), self._config.reply_seconds, is_request=False))

    def _on_sent(self, socket: RequestDone) -> None:
        seconds = self._config.reply_seconds * (2 if self._is_acting else 1)
        address = f"{socket.request_id} {self._is_acting}"
        self._add(socket.request_id, _InFlight(self._clock(), seconds, address=address, is_request=False))

    def _on_received(self, socket: RequestDone) -> None:
        """More may follow: an answer in several messages."""
        activity = self._in_flight.get(socket.request_id)
        if activity is None or not activity.seconds:
            return
        activity.has_answer = True
        more = self._clock() - activity.since + _FOLLOW_SECONDS
        activity.seconds = min(more, self._config.busy_seconds)
        self._changed.set()

    def _end_message(self, key: str, activity: _InFlight) -> None:
        """A channel that did not answer, or never stopped, is not waited for again."""
        if not activity.has_answer or activity.seconds >= self._config.busy_seconds:
            self._own[activity.address] = True
        self.end(key)


def _address(request: RequestWillBeSent) -> str:
    """What a request has in common with its like: all but its numbers."""
    body = b"".join(part.data for part in request.request.post_data_entries)[:_BODY_BYTES]
    url = request.request.url[:ADDRESS_CHARACTERS]
    return _DIGITS.sub("0", f"{request.request.method} {url} {body!r}")


def _site(url: str) -> str:
    """The website of a document, approximately: the last two labels of its host."""
    try:
        host = urlsplit(url).hostname or ""
    except ValueError:
        return ""
    return host if host.replace(".", "").isdigit() else ".".join(host.split(".")[-2:])


# --- workers ------------------------------------------------------------------------------------------

AUTO_ATTACH = {
    "autoAttach": True,
    "waitForDebuggerOnStart": True,
    "flatten": True,
    "filter": [{"type": "worker", "exclude": False}, {"exclude": True}],
}
"""Parameters of ``Target.setAutoAttach`` in a page's session, which is told of dedicated workers only."""


_PROBE_SECONDS = 3600.0
"""Until a worker that does not answer is asked again. One that blocks its thread for ever is awaited once."""


def introduce(worker: Session, told: Told) -> None:
    """Tell a worker that does not run yet who the browser is, and let it run."""
    for method, params in told.of_workers:
        worker.send(method, params)
    worker.send("Runtime.runIfWaitingForDebugger")


class Workers:
    """The workers of one page. Attaches to each before it runs.

    Args:
        session: the page's session.
        traffic: records what the workers load.
        config: deadlines.
        told: who the browser says that it is.
    """

    def __init__(self, session: Session, traffic: Traffic, config: BrowserConfig, told: Told) -> None:
        self._session = session
        self._traffic = traffic
        self._config = config
        self._told = told
        self._sessions: dict[str, Session] = {}
        self._probes: dict[str, asyncio.Task[None]] = {}
        session.on("Target.attachedToTarget", AttachedToTarget, self.adopt)
        session.on("Target.detachedFromTarget", DetachedFromTarget, self.forget)

    def __len__(self) -> int:
        return len(self._sessions)

    def probe(self) -> None:
        """Check whether every worker is idle; the page's traffic waits for the answers."""
        for session_id, session in self._sessions.items():
            if session_id not in self._probes:
                task = asyncio.get_running_loop().create_task(self._probe(session))
                self._probes[session_id] = task

    async def _probe(self, session: Session) -> None:
        key = f"worker {session.id}"
        self._traffic.begin(key, self._config.minor_seconds, name="a worker that computes")
        try:
            with contextlib.suppress(BrowserError):
                await session.do("Runtime.evaluate", {"expression": "0"}, seconds=_PROBE_SECONDS)
        finally:
            self._probes.pop(session.id, None)
            self._traffic.end(key)

    async def close(self) -> None:
        """Cancel the checks."""
        for task in tuple(self._probes.values()):
            task.cancel()
        await asyncio.gather(*self._probes.values(), return_exceptions=True)

    def adopt(self, attached: AttachedToTarget) -> None:
        """Handle a new worker, which is attached to and does not run yet."""
        session = Session(self._session.connection, attached.session_id)
        self._sessions[session.id] = session
        self._traffic.follow(session)
        session.send("Network.enable", {"maxTotalBufferSize": 0, "maxResourceBufferSize": 0})
        introduce(session, self._told)

    def forget(self, detached: DetachedFromTarget) -> None:
        """Handle that a worker is gone."""
        session = self._sessions.pop(detached.session_id, None)
        if session is not None:
            self._traffic.end(detached.target_id)  # the request for its script
            session.connection.drop_session(session.id, BrowserError("the worker ended"))
