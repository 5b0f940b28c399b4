"""A page of an episode: its documents, navigations, dialogs and notices."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any, Literal, TypeVar
from urllib.parse import urldefrag

import msgspec

from webgym.browser import desktop
from webgym.browser.access import Access
from webgym.browser.cdp import CommandFailed, Session, TargetGone
from webgym.browser.cdp_messages import (
    DialogOpening,
    DownloadWillBegin,
    EmptyReply,
    FileChooser,
    FrameNavigated,
    FrameTree,
    LayoutMetrics,
    Navigated,
    NavigatedWithinDocument,
    NavigationStarted,
    RequestedNavigation,
    RequestFailed,
    RequestPaused,
    ResponseReceived,
    ScheduledNavigation,
    TargetInfo,
    Window,
)
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.desktop import Told
from webgym.browser.dialogs import Dialogs
from webgym.browser.egress.proxy import ProxyListener
from webgym.browser.isolated_worlds import ADDRESS_CHARACTERS, DocumentGone, Worlds
from webgym.browser.notices import Notices
from webgym.browser.pdf import DOCUMENTS, Pdfs
from webgym.browser.pictures import Stillness
from webgym.browser.shared_parts import PartSharing
from webgym.browser.timers import Timers
from webgym.browser.traffic import AUTO_ATTACH, Traffic, Workers
from webgym.core.errors import BrowserTimeout, EgressRefused, NavigationFailed, RouteFailed
from webgym.core.identity import credentials_of, origin_of
from webgym.core.observation import Fault, FaultKind, NoticeKind
from webgym.core.websites import site_or_text

log = logging.getLogger(__name__)

T = TypeVar("T")

BLANK = "about:blank"
_NO_CONTENT = (204, 205)
"""HTTP statuses after which a browser stays on the current page."""

_QUOTED_LENGTH = 300
"""Characters of a URL that a notice quotes."""

_CLEAR_CLIPBOARD = """
addEventListener('copy', (event) => {
  event.clipboardData.setData('text/plain', '');
  event.preventDefault();
}, { capture: true, once: true });
document.execCommand('copy');
"""
"""Clears the clipboard, which all contexts of a browser share: the next episode must not paste from it."""

_SIGN_IN = (
    "the website asks for a user name and a password before it shows this page; with them its address is "
    "http://NAME:PASSWORD@host/path"
)

_NAMED_HOSTS = 3
"""Most hosts that a notice names."""

_SCHEMES = ("http://", "https://")
_NAVIGABLE_SCHEMES = frozenset({"", "http", "https", "about", "blob", "javascript"})
"""Schemes that a page can navigate to; for any other, Chromium stays on the page."""

_PROXY_ERRORS = frozenset({"net::ERR_SOCKS_CONNECTION_FAILED", "net::ERR_ADDRESS_UNREACHABLE"})
"""Chromium's errors when the proxy could not connect, whatever the reason."""

_FORM_RESULT = "net::ERR_CACHE_MISS"
"""Chromium's error for a page in the history that requires submitting a form again."""

MOST_DOCUMENTS = 12
"""Documents that may follow one another in the tab after an action. A page that redirects further, such as
one that reloads itself, is then kept at its current document until the next action, so that it can be
observed. Signing in somewhere takes five or six."""

TERMINATE_SECONDS = 1.0
"""Until a script that is terminated has ended. A chain of callbacks outlives the end of one of them; then the
page's scripts are switched off until it answers, as long again at most."""


def _not_opened_message(url: str) -> str:
    return f'"{url[:_QUOTED_LENGTH]}" was not opened: only http and https addresses are'


class ActionResult(msgspec.Struct, frozen=True):
    """What came of an action.

    Attributes:
        changes: number of changes of the document so far.
        contents: the content of the document as JSON, if it looks as in the early screenshot.
        effect: whether the action had any; ``unseen`` if the page contains something whose changes only a
            screenshot shows, such as a canvas.
        missed: whether the page changed during a click, so that the button went down or up on something else.
    """

    changes: int
    contents: tuple[msgspec.Raw, ...]
    effect: Literal["some", "none", "unseen"]
    missed: bool


class Returned(msgspec.Struct, frozen=True):
    """The result of going back.

    Attributes:
        index: index of the entry in the tab's history that the action went back to.
        left: loader id of the document that it left.
    """

    index: int
    left: str


class Page:
    """A tab or window.

    Args:
        session: session attached to the tab, which waits for the debugger.
        target_id: target id of the tab; also the id of its main frame.
        config: the slot's limits.
        listener: the proxy of its connections, which knows why one failed.
        timers: the pending timers of the browser's pages.
        told: who the browser says that it is.
        opener: the page in front of which it was opened; ``None`` for an episode's first page.
    """

    def __init__(
        self,
        session: Session,
        target_id: str,
        config: BrowserConfig,
        listener: ProxyListener,
        timers: Timers,
        told: Told,
        opener: Page | None = None,
    ) -> None:
        self.session = session
        self.target_id = target_id
        self.config = config
        self.options: PageOptions = opener.options if opener else PageOptions()
        self.notices: Notices = opener.notices if opener else Notices()
        self.dialogs: Dialogs = opener.dialogs if opener else Dialogs(self.notices)
        """Both are shared by all pages of the episode."""
        self.is_window = opener is not None
        """Whether another page of the episode lies behind it, which closing this one uncovers."""
        self._listener = listener
        self.url = BLANK
        self.status: int | None = None
        self.changes = -1
        """Number of changes of the document when it was last quiet; -1 if it never was."""
        self.points: dict[int, tuple[float, float]] = {}
        """The point to click for each element of the last observation, by number, CSS pixels."""
        self.expected: tuple[float, float] | None = None
        """The point at which the page's script expects the next mouse event already."""
        self.told: set[tuple[str, str]] = set()
        """What the browser said (``PageContent.said``) and an observation told: document and number."""
        self.is_gone = False
        """Whether the page was closed."""
        self.leads_nowhere = False
        """Whether it is a window that was opened for something else than a page."""
        self.has_scripts = True
        """Whether scripts of the page may run."""
        self.is_substitute = True
        """Whether the document is the initial blank page or an error page."""
        self.traffic = Traffic(session, target_id, config)
        self.timers = timers
        self.timers_set: tuple[int, dict[int, int]] = 0, {}
        """Number of timers that the document had set when it was last quiet, and its frames of other origins,
        by world."""
        self._still_loading = ""
        """What the last wait said to be under way when it ended."""
        self.acted = time.monotonic()
        """When the last action began, seconds of ``time.monotonic()``."""
        self.is_first = opener is None
        """Whether no page was opened yet: its address is the caller's, and not typed by the agent."""
        self.is_typed = False
        """Whether the document was opened by an address that was typed."""
        self.next_is_typed = False
        """The same of documents that are opened from now on."""
        self._statuses: dict[str, int | None] = {}
        """HTTP status by loader, until the document is committed."""
        self._left: dict[str, int | None] = {}
        """The same of documents that were left, which the back-forward cache may restore."""
        self._failures: dict[str, str] = {}
        """The browser's error code by loader, until the error page is committed."""
        self.loader = ""
        """Loader id of the current document."""
        self.result: ActionResult | None = None
        """What came of the action, once the page is quiet."""
        self.returned: Returned | None = None
        """The result of going back in this action, if it did."""
        self._loaded = ("", 0)
        """Loader of the document, and its number of changes at the first action on it."""
        self._changed: set[str] = set()
        """Addresses of documents that were changed by scripts later, and then left."""
        self._keeper = ""
        """Loader of a document that went back within itself in vain."""
        self._reported_failure = ""
        """Loader of a failed navigation that was reported by an exception."""
        self._is_navigating = False
        """Whether :meth:`navigate` waits for its reply."""
        self._untrusted: NavigationFailed | None = None
        """Why :meth:`navigate` is about to fail, if its address has a certificate that was refused."""
        self._reported_unopened = ""
        """URL of another scheme that the page tried to open in this action, and that a notice names."""
        self._leaving_for = ""
        """Loader of the navigation that was started last."""
        self._typed_url = ""
        """Its address, if that was typed and the page has not come yet."""
        self._documents = 0
        """Number of documents since the action began."""
        self._release: Callable[[], None] | None = None
        """Set while the tab is kept at its document: unsubscribes from paused requests."""
        self.origins: set[str] = opener.origins if opener else set()
        """Origins of the episode's documents, which may keep something in the browser."""
        self.files: dict[str, Path] = opener.files if opener else {}
        """Files that can be uploaded, by name."""
        self.requests = 0
        """Number of requests started and messages sent on sockets."""
        self.ineffective_if_same = ""
        """Text of a "no_effect" notice, to be added if the next screenshot equals ``picture``, the last
        one."""
        self.picture = ""
        self.image = b""
        """The last picture, if what it shows tells where a click at a point of it lands."""
        self.ineffective_if_unscrolled = ""
        """The same, if the page is next observed at ``scrolled``, where it last was: a turn of the wheel may
        have an effect late."""
        self.scrolled = 0.0
        self.is_calm = False
        """Whether the screenshot of the last step was taken while the page was settling, and used."""
        self.choosers: list[FileChooser] | None = None
        """File choosers that were opened, while an action waits for one; else ``None``."""
        self.worlds = Worlds(session, target_id, config)
        self.pdfs = Pdfs(session, lambda text: self.note("download_refused", text))
        self.who = told
        credentials = opener.access.credentials if opener else credentials_of(told.identity)
        self.access: Access = Access(session, told.identity, credentials, self._on_untrusted)
        group = opener.sharing.group if opener else ""
        self.sharing: PartSharing = PartSharing(session, listener.parts, self.access, group)
        self.workers = Workers(session, self.traffic, config, told)
        self.stillness = Stillness(session)
        session.on("Page.frameStartedNavigating", NavigationStarted, self._on_leaving)
        session.on("Page.frameScheduledNavigation", ScheduledNavigation, self._on_navigation_requested)
        session.on("Page.frameRequestedNavigation", RequestedNavigation, self._on_navigation_requested)
        session.on("Page.frameNavigated", FrameNavigated, self._on_navigated)
        session.on("Page.navigatedWithinDocument", NavigatedWithinDocument, self._on_within_document)
        session.on(
            "Page.javascriptDialogOpening",
            DialogOpening,
            lambda event: self.dialogs.on_opening(session, event),
        )
        session.on("Page.downloadWillBegin", DownloadWillBegin, self._on_download)
        session.on("Page.fileChooserOpened", FileChooser, self._on_file_chooser)
        session.on("Network.requestWillBeSent", EmptyReply, self._on_sent)
        session.on("Network.webSocketFrameSent", EmptyReply, self._on_sent)
        session.on("Network.responseReceived", ResponseReceived, self._on_response)
        session.on("Network.loadingFailed", RequestFailed, self._on_request_failed)
        session.on("Inspector.targetCrashed", EmptyReply, self._on_crashed)
        self._ended = asyncio.Event()
        """Set while there is no renderer, so that nothing waits for it."""
        self._forget_browser = session.connection.when_lost(self._on_ended)

    # --- life ---------------------------------------------------------------------------------------

    async def prepare(self) -> None:
        """Set the tab up and let it run."""
        clear = ("Runtime.evaluate", {"expression": _CLEAR_CLIPBOARD, "userGesture": True})
        await self._do_all([*self._preparation(), clear])

    def _preparation(self) -> list[tuple[str, dict[str, Any]]]:
        return [
            ("Page.enable", {}),
            ("Inspector.enable", {}),
            ("Target.setAutoAttach", AUTO_ATTACH),
            ("Network.enable", {"maxTotalBufferSize": 0, "maxResourceBufferSize": 0}),
            self._metrics,
            ("Emulation.setFocusEmulationEnabled", {"enabled": True}),
            ("Page.setInterceptFileChooserDialog", {"enabled": True}),
            ("Page.addScriptToEvaluateOnNewDocument", self.worlds.script_in_page),
            *self.who.commands,
            *self.access.commands,
            self._pausing,
            ("Runtime.runIfWaitingForDebugger", {}),
        ]

    @property
    def _pausing(self) -> tuple[str, dict[str, Any]]:
        """The command that has requests and responses paused for those who handle them."""
        patterns = [DOCUMENTS, *self.access.patterns, *self.sharing.patterns]
        return "Fetch.enable", {"patterns": patterns, "handleAuthRequests": bool(self.access.credentials)}

    @property
    def _metrics(self) -> tuple[str, dict[str, Any]]:
        scale = self.who.identity.device_scale
        return "Emulation.setDeviceMetricsOverride", desktop.metrics(self.options.viewport, scale)

    def beside(self, session: Session, target: TargetInfo) -> Page:
        """The page of a window of the same episode, which waits for the debugger, and then runs."""
        page = Page(session, target.target_id, self.config, self._listener, self.timers, self.who, self)
        page.traffic.begin(target.target_id, self.config.minor_seconds)
        for method, params in page._preparation():
            session.send(method, params)  # its errors are ignored: it may be closed already
        return page

    async def catch_up(self) -> None:
        """Ask for the document that came before the page was attached to, if one did."""
        seconds = self.config.execute_seconds
        with contextlib.suppress(CommandFailed, TargetGone, BrowserTimeout):
            tree = await self.session.call("Page.getFrameTree", reply=FrameTree, seconds=seconds)
            if not self.loader:
                self._on_navigated(FrameNavigated(tree.frame_tree.frame))

    async def begin(self, options: PageOptions) -> None:
        """Start an episode in this tab. Needs no command if the options are those of every tab."""
        commands: list[tuple[str, dict[str, Any]]] = []
        has_own_size = options.viewport != self.options.viewport
        self.options = options
        if has_own_size:
            commands.append(self._metrics)
            await self._fit_window()
        credentials = credentials_of(self.who.identity) | options.credentials
        if (credentials, options.shared) != (self.access.credentials, self.sharing.group):
            self.access.credentials, self.sharing.group = credentials, options.shared
            commands.append(self._pausing)
        if options.cookies:
            cookies = [msgspec.to_builtins(cookie) for cookie in options.cookies]
            commands.append(("Network.setCookies", {"cookies": cookies}))
        await self._do_all(commands)

    async def begin_again(self, options: PageOptions) -> None:
        """Start another episode in this tab: without cookies, history, notices and what was learned."""
        self.begin_action()
        self.notices.take()
        self.take_faults()
        self.take_usage()
        self.is_first, self.is_typed = True, False
        self.points, self.picture, self.image = {}, "", b""
        self._changed.clear()
        self.stillness.forget()
        await self._do_all([("Network.clearBrowserCookies", {}), ("Page.resetNavigationHistory", {})])
        await self.begin(options)

    async def _fit_window(self) -> None:
        """Make the window as large as the viewport, so that pages are told of a window that can hold them."""
        seconds, (width, height) = self.config.open_seconds, self.options.viewport
        window = await self.session.call("Browser.getWindowForTarget", reply=Window, seconds=seconds)
        bounds = {"windowId": window.window_id, "bounds": {"width": width, "height": height}}
        await self.session.do("Browser.setWindowBounds", bounds, seconds=seconds)

    async def _do_all(self, commands: list[tuple[str, dict[str, Any]]]) -> None:
        seconds = self.config.open_seconds
        await asyncio.gather(  # sent at once, handled in order
            *(self.session.do(method, params, seconds=seconds) for method, params in commands)
        )

    @property
    def capture_scale(self) -> float:
        """Pixels of a screenshot for each CSS pixel."""
        given = self.options.capture_scale
        return self.config.capture_scale if given is None else given

    async def picture_params(self, quality: int | None) -> dict[str, Any]:
        """Parameters of ``Page.captureScreenshot`` for what is in view now.

        Args:
            quality: of a JPEG, 1 to 100; ``None`` for a PNG, which is lossless.

        Raises:
            DocumentGone: the page is being replaced.
        """
        lossless = {"format": "png", "optimizeForSpeed": True}
        params = lossless if quality is None else {"format": "jpeg", "quality": quality}
        scale = self.capture_scale / self.who.identity.device_scale
        if scale == 1:
            return params
        seconds, (width, height) = self.config.execute_seconds, self.options.viewport
        try:
            metrics = await self.session.call("Page.getLayoutMetrics", reply=LayoutMetrics, seconds=seconds)
        except CommandFailed as error:
            raise DocumentGone(error.message) from error
        view = metrics.css_visual_viewport
        clip = {"x": view.page_x, "y": view.page_y, "width": width, "height": height}
        return params | {"clip": clip | {"scale": scale}}

    @property
    def address(self) -> str:
        """Its URL, truncated to ``ADDRESS_CHARACTERS``."""
        return self.url[:ADDRESS_CHARACTERS]

    @property
    def route(self) -> str:
        """The name of the route by which it came; empty without upstream proxies."""
        return self._listener.route_to(self.url)

    @property
    def is_chosen(self) -> bool:
        """Whether an address that was typed opened the page, or the one that comes."""
        return self.is_typed or bool(self._typed_url)

    @property
    def is_crashed(self) -> bool:
        """Whether its renderer is gone, or the tab itself."""
        return self.session.crashed is not None

    @property
    def can_reload(self) -> bool:
        """Whether it can be loaded again after a crash: what a script wrote into a window cannot."""
        return not self.is_window or self.url.startswith(_SCHEMES)

    @property
    def is_new_window(self) -> bool:
        """Whether it is a window in which no page was opened; a script may have written into it."""
        return self.is_window and self.is_substitute

    async def close(self) -> None:
        """Stop the page's background tasks. The tab itself is closed with its context."""
        self._forget_browser()
        await self.pdfs.close()
        await self.workers.close()
        self.session.connection.drop_session(self.session.id, TargetGone("the page was closed"))

    def end(self) -> None:
        """Handle that it was closed."""
        self.is_gone = True
        self.session.crashed = TargetGone("the page closed itself")
        self._on_ended()
        self.session.connection.fail_session(self.session.id, self.session.crashed)

    def close_target(self) -> None:
        """Close the tab itself; :meth:`end` follows."""
        self.session.connection.send("Target.closeTarget", {"targetId": self.target_id})

    def discard(self) -> None:
        """Close the tab itself, without waiting for it."""
        self.close_target()
        self.end()

    def begin_action(self) -> None:
        """Start an action: reset the state and the counters that are per action."""
        self._documents = 0
        if self._loaded[0] != self.loader:
            self._loaded = self.loader, self.changes
        self.next_is_typed &= self.dialogs.is_open  # the one that it asks about is yet to be left
        if self._release is not None:
            self._release()
            self._release = None
            self.session.send(*self._pausing)
        self.returned = self.expected = None
        self._reported_unopened = self.ineffective_if_same = self.ineffective_if_unscrolled = ""
        self.acted = time.monotonic()
        self.traffic.begin_action()

    async def rest(self, seconds: float) -> None:
        """Wait, or return early if the page's renderer is lost."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._ended.wait()

    def tell_reloaded(self) -> None:
        """Add a notice if going back has loaded a page again that its scripts had changed."""
        if self.returned is None or self.returned.left == self.loader:
            return
        if urldefrag(self.url).url in self._changed:
            what = "the page was loaded again; what its scripts had shown since it was opened may be gone"
            self.note("reloaded", what)

    def keeps_back(self) -> bool:
        """Whether the page went back within its document for the first time although the document then added
        itself to the history again."""
        before, self._keeper = self._keeper, self.loader
        return self.returned is not None and self.returned.left == self.loader != before

    # --- notices ------------------------------------------------------------------------------------

    def note(self, kind: NoticeKind, text: str) -> None:
        """Add a notice to the next observation."""
        self.notices.add(kind, text)

    def note_still_loading(self, text: str) -> None:
        """Add a notice of what is under way at the end of a wait, in place of what an earlier wait said.

        Args:
            text: names it; empty if nothing is.
        """
        self.notices.drop("still_loading", self._still_loading)
        self._still_loading = text
        if text:
            self.note("still_loading", text)

    def fail(self, error: NavigationFailed, *, is_typed: bool | None = None) -> None:
        """Add a notice that a document could not be opened, and the fault, unless our own limits refused it.

        Args:
            error: why, and what was asked for.
            is_typed: whether its address was typed; ``None`` for a document that this action asked for.
        """
        self.note("navigation_failed", error.message)
        if error.url and not isinstance(error, EgressRefused):
            is_typed = self.next_is_typed if is_typed is None else is_typed
            kind: FaultKind = "route" if isinstance(error, RouteFailed) else "connection"
            self._add_fault(kind, error.url, error.message, is_typed, error.error)

    def _add_fault(self, kind: FaultKind, url: str, why: str, is_typed: bool, error: str = "") -> None:
        self.notices.add_fault(Fault(kind, url[:ADDRESS_CHARACTERS], why, is_typed, error))

    def take_faults(self) -> tuple[Fault, ...]:
        """The faults since the last call."""
        explained = ((url, *self._explain(url, error)) for url, error in self.traffic.take_broken())
        parts = [
            Fault("route" if kind is RouteFailed else "part", url, f"{url}: {why}")
            for url, why, kind in explained
            if kind is not EgressRefused
        ]
        return (*self.notices.take_faults(), *parts)

    def take_usage(self) -> tuple[dict[str, int], dict[str, int], dict[str, int]]:
        """Bytes, and connections that our own limits refused, by host, since the last call; with a notice of
        those, unless one says already that the page could not be opened."""
        sent, limited, crowded = self._listener.budget.counted()
        if limited and self.status is not None:
            hosts = ", ".join(f"{host} ({count})" for host, count in list(limited.items())[:_NAMED_HOSTS])
            self.note("limited", f"{hosts}. The website did not refuse them: wait, and open the page again")
        return sent, limited, crowded

    def pictured(self, name: str, scrolled: float) -> None:
        """Record the name of a new screenshot, and how far the page is scrolled. If they are unchanged, the
        action may have had no effect."""
        is_same, is_still = name == self.picture, scrolled == self.scrolled
        text = (is_same and self.ineffective_if_same) or (is_still and self.ineffective_if_unscrolled)
        if text and not self.notices.happened:
            self.note("no_effect", text)
        self.ineffective_if_same, self.picture = "", name
        self.ineffective_if_unscrolled, self.scrolled = "", scrolled

    # --- scripts ------------------------------------------------------------------------------------

    async def run(
        self,
        function: str,
        *arguments: object,
        reply: type[T],
        seconds: float | None = None,
        frame: str | None = None,
    ) -> T:
        """Call ``webgym.<function>`` in a frame's isolated world; see :meth:`Worlds.run`."""
        limit = self.config.execute_seconds if seconds is None else seconds
        return await self.worlds.run(function, *arguments, reply=reply, seconds=limit, frame=frame)

    def post(self, function: str) -> None:
        """Call ``webgym.<function>()`` in the main frame, before any later call; do not wait."""
        self.worlds.post(function)

    async def end_script(self) -> bool:
        """Terminate the running script, which keeps the page from answering.

        Nothing terminates one that waits for a synchronous request: all connections of the session are cut.
        One that ends only to be called again, such as a callback of a mutation observer that changes what it
        observes, is ended by switching scripts off until the page answers.

        Returns:
            Whether it did; else Chromium itself is busy, such as with the layout of a huge document.
        """
        self.session.send("Runtime.terminateExecution")
        if waited_for := self.traffic.synchronous:
            self._listener.cut(lambda: bool(waited_for & self.traffic.synchronous))
        if await self._answers():
            return True
        self._switch_scripts(on=False)
        try:
            if await self._answers():
                return True
            self.session.send("Runtime.terminateExecution")  # a timer may have fired ahead of that
            return await self._answers()
        finally:
            self._switch_scripts(on=True)

    def _switch_scripts(self, *, on: bool) -> None:
        """Unlike most commands, this one takes effect while the page is blocked."""
        self.has_scripts = on
        self.session.send("Emulation.setScriptExecutionDisabled", {"value": not on})

    async def _answers(self) -> bool:
        """Whether the page answers a command within ``TERMINATE_SECONDS``."""
        try:
            await self.session.do("Page.enable", seconds=TERMINATE_SECONDS)  # has no effect
        except (BrowserTimeout, CommandFailed):
            return False
        return True

    async def unblock(self) -> None:
        """Free a page that does not answer, with a notice. The scripts of one that is blocked again at once
        are switched off until the next document.

        Chromium itself asks a page nothing while it is being replaced, which takes as long as a service
        worker needs for its answer.
        """
        is_freed = await self.end_script()
        if self._leaving_for not in ("", self.loader):
            self.session.send("Page.stopLoading")
            self.note(
                "still_loading", "the page did not react; the next one, which did not come, was given up"
            )
        elif not is_freed:
            self.session.send("Page.stopLoading")
            self.note("still_loading", "the page did not react; what it had not loaded yet was given up")
        else:
            self.note("still_loading", "the page did not react; the script that ran was ended")
            await self.rest(TERMINATE_SECONDS)
            if not await self._answers():
                self._switch_scripts(on=False)
                self.session.send("Runtime.terminateExecution")
                self.note("still_loading", "it was blocked again at once; its scripts are switched off")

    @property
    def has_broken_off(self) -> bool:
        """Whether the connection ended before the document did."""
        return self.loader in self._failures

    # --- navigation ---------------------------------------------------------------------------------

    async def navigate(self, url: str) -> None:
        """Open a URL, and wait for the first byte that replaces the page.

        Args:
            url: the URL.

        Raises:
            NavigationFailed: it could not be opened; with the browser's own error code.
            EgressRefused: the egress policy refused the connection.
        """
        quoted_url = url[:_QUOTED_LENGTH]
        if not url.lower().startswith(_SCHEMES):
            raise NavigationFailed(_not_opened_message(url))
        self._leaving_for = ""
        self._listener.budget.site = site_or_text(url)
        self._is_navigating = True
        unload = asyncio.create_task(self._end_unload())
        try:
            navigated = await self.session.call(
                "Page.navigate", {"url": url}, reply=Navigated, seconds=self.config.navigate_seconds
            )
        except BrowserTimeout:
            self.session.send("Page.stopLoading")
            failed = self.traffic.document_url(self._leaving_for) or url
            raise NavigationFailed(
                f"{quoted_url} gave no answer within {self.config.navigate_seconds:g} s",
                url=failed,
                error="net::ERR_TIMED_OUT",
            ) from None
        except CommandFailed as error:
            raise NavigationFailed(f"{quoted_url}: {error.message}", url=url) from error
        finally:
            unload.cancel()
            self._is_navigating = False
        if untrusted := self._untrusted:
            self._untrusted = None
            raise untrusted
        if navigated.is_download or navigated.error_text == "net::ERR_ABORTED":
            return  # a download has its own notice; an aborted navigation leaves the page as it is
        if navigated.error_text:
            self._reported_failure = navigated.loader_id  # its error page needs no further notice
            raise self._failure(url, navigated)

    def _on_untrusted(self, url: str, error: str) -> None:
        """Handle a certificate that was refused: Chromium only says that what asked for it was given up."""
        if url != urldefrag(self.traffic.document_url(self._leaving_for)).url:
            return
        failure = NavigationFailed(f"{url[:_QUOTED_LENGTH]}: net::{error}", url=url, error=f"net::{error}")
        if self._is_navigating:
            self._untrusted = failure
        else:
            self.fail(failure)

    async def _end_unload(self) -> None:
        """End a script of the page that blocks leaving it: until it returns, nothing is requested."""
        await asyncio.sleep(self.config.execute_seconds)
        if not self.traffic.document_url(self._leaving_for):
            self.note("still_loading", "the page would not be left; its script was ended")
            await self.end_script()

    def _on_leaving(self, event: NavigationStarted) -> None:
        if event.frame_id != self.target_id:
            return
        self._leaving_for = event.loader_id
        self._listener.budget.site = site_or_text(event.url)
        self._typed_url = event.url if self.next_is_typed else ""
        if not self.has_scripts:  # before the next document is asked for, whose scripts are to run
            self._switch_scripts(on=True)

    def _failure(self, url: str, navigated: Navigated) -> NavigationFailed:
        """The error for a failed navigation, with the URL that it was redirected to."""
        failed = self.traffic.document_url(navigated.loader_id) or url
        why, kind = self._explain(failed, navigated.error_text)
        quoted_url = url[:_QUOTED_LENGTH]
        if urldefrag(failed).url != urldefrag(url).url:
            quoted_url = f"{quoted_url} (which leads to {failed[:_QUOTED_LENGTH]})"
        return kind(f"{quoted_url}: {why}", url=failed, error=why)

    def _explain(self, url: str, error: str) -> tuple[str, type[NavigationFailed]]:
        """The reason for a browser's error, and what kind of failure it is."""
        if error == _FORM_RESULT:
            return f"{error}, this page was the answer to a form, which is not sent again", NavigationFailed
        failure = self._listener.failure(url) if error in _PROXY_ERRORS else None
        return (failure.message, failure.kind) if failure is not None else (error, NavigationFailed)

    async def revive(self, why: str) -> None:
        """Reload a crashed page at its URL, or load the one whose address was typed and that has not come.

        Args:
            why: why it crashed; empty if that is not known.

        Raises:
            TargetGone: it crashed again.
        """
        url = self._typed_url or self.url
        self._begin_renderer(f"the page crashed and was loaded again{f': {why}' if why else ''}", url)
        try:
            await self.navigate(url)
        except NavigationFailed as error:
            self.fail(error)

    async def give_up(self, why: str) -> None:
        """Leave a page that crashes whenever it is loaded, for a blank one.

        Args:
            why: as in :meth:`revive`.

        Raises:
            TargetGone: that crashed, too.
        """
        self._begin_renderer(
            f"the page crashed again and was left{f': {why}' if why else ''}", self._typed_url or self.url
        )
        await self.session.do("Page.navigate", {"url": BLANK}, seconds=self.config.navigate_seconds)

    def give_up_window(self, why: str) -> None:
        """Close a window that has crashed.

        Args:
            why: as in :meth:`revive`.
        """
        what = f"the window crashed and was closed{f': {why}' if why else ''}"
        self._add_fault("renderer", self.url, what, self.is_chosen)
        self.note("crashed", what)
        self.discard()

    def _begin_renderer(self, what: str, url: str) -> None:
        """Record the loss of the renderer of a page, and take commands for the next one."""
        self.next_is_typed = self.is_chosen
        self._add_fault("renderer", url, what, self.is_chosen)
        self.session.crashed = None
        self._ended.clear()
        self.traffic.clear()
        # Chromium ignores a navigation to the address to which one is under way (`ERR_ABORTED`).
        self.session.send("Page.stopLoading")
        self.note("crashed", what)

    # --- events -------------------------------------------------------------------------------------

    def _on_navigation_requested(self, event: ScheduledNavigation | RequestedNavigation) -> None:
        """The page tries to navigate. There may be an event of each kind for the same attempt."""
        if event.frame_id != self.target_id or event.url.split(":")[0] in _NAVIGABLE_SCHEMES:
            return
        self.traffic.end(self.target_id)  # a document that was still loading is never reported as complete
        self.leads_nowhere |= self.is_new_window
        if event.url != self._reported_unopened:
            self._reported_unopened = event.url
            self.note("navigation_failed", _not_opened_message(event.url))

    def _on_navigated(self, event: FrameNavigated) -> None:
        frame = event.frame
        if frame.url.startswith(_SCHEMES):
            self.origins.add(origin_of(frame.url))
        if frame.id != self.target_id:
            return
        if not self.has_scripts:
            self._switch_scripts(on=True)
        self._documents += 1
        if self._documents > MOST_DOCUMENTS and self._release is None:
            self._keep_document()
        if self.loader == self._loaded[0] and self.changes > self._loaded[1]:
            self._changed.add(urldefrag(self.url).url)
        self.url = (frame.unreachable_url or frame.url) + frame.url_fragment
        self._left[self.loader] = self.status
        if event.type == "BackForwardCacheRestore":
            self._statuses[frame.loader_id] = self._left.get(frame.loader_id)
            self._changed.discard(urldefrag(frame.url).url)
        self.status = self._statuses.get(frame.loader_id)
        self.loader = frame.loader_id
        self.is_substitute = bool(frame.unreachable_url) or frame.url == BLANK
        self.is_first &= self.is_substitute
        self.is_typed, self._typed_url = self.next_is_typed, ""
        # The error page of our own navigation may be committed before the reply to it is processed.
        if frame.unreachable_url and not self._is_navigating and frame.loader_id != self._reported_failure:
            failure = self._failures.get(frame.loader_id, "it could not be opened")
            why, kind = self._explain(self.url, failure)
            self.fail(kind(f"{self.url[:_QUOTED_LENGTH]}: {why}", url=self.url, error=why))
        self._statuses.clear()
        self._failures.clear()
        self.changes = -1
        self.timers_set = 0, {}
        self.points = {}

    def _keep_document(self) -> None:
        """Block further navigations until the next action."""
        self._release = self.session.on("Fetch.requestPaused", RequestPaused, self._on_paused)
        self.session.send("Fetch.enable", {"patterns": [{"urlPattern": "*", "resourceType": "Document"}]})
        self.note("still_loading", f"the page led on {MOST_DOCUMENTS} times; it is held here for now")

    def _on_paused(self, event: RequestPaused) -> None:
        if event.frame_id != self.target_id:
            self.session.send("Fetch.continueRequest", {"requestId": event.request_id})
        else:  # Chromium never draws a document while the next one is only delayed
            self.session.send("Fetch.failRequest", {"requestId": event.request_id, "errorReason": "Aborted"})

    def _on_within_document(self, event: NavigatedWithinDocument) -> None:
        if event.frame_id == self.target_id:
            self.url = event.url

    def _on_sent(self, _: EmptyReply) -> None:
        self.requests += 1

    def _on_response(self, event: ResponseReceived) -> None:
        if event.type != "Document" or event.frame_id != self.target_id:
            return
        status = event.response.status
        self._statuses[event.loader_id] = status
        if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
            url = event.response.url
            self._add_fault(
                "status", url, f"{url[:_QUOTED_LENGTH]}: HTTP status {status}", self.next_is_typed
            )
        if "www-authenticate" in map(str.lower, event.response.headers):
            self.note("browser", _SIGN_IN)
        if status in _NO_CONTENT:
            quoted_url = event.response.url[:_QUOTED_LENGTH]
            self.note(
                "navigation_failed", f"{quoted_url}: answered {status}, no content; the page stays as it is"
            )

    def _on_request_failed(self, event: RequestFailed) -> None:
        if event.type != "Document":
            return
        self._failures[event.request_id] = event.error_text
        if event.request_id == self.loader and not event.canceled:
            why = f"{self.url[:_QUOTED_LENGTH]}: the page broke off, {event.error_text}"
            failure = NavigationFailed(why, url=self.url, error=event.error_text)
            self.fail(failure, is_typed=self.is_typed)

    def _on_download(self, event: DownloadWillBegin) -> None:
        self.leads_nowhere |= self.is_new_window
        name = event.suggested_filename or event.url
        self.note("download_refused", f'the download of "{name[:_QUOTED_LENGTH]}" was refused')

    def _on_file_chooser(self, event: FileChooser) -> None:
        if self.choosers is not None:
            self.choosers.append(event)
        else:
            can_choose = self.files and event.backend_node_id
            how = "upload chooses one of the task's" if can_choose else "files cannot be uploaded"
            self.note("action_failed", f"the page asked for a file; {how}")

    def _on_crashed(self, _: EmptyReply) -> None:
        self.session.crashed = TargetGone("the page crashed")
        self.worlds.forget()
        self._on_ended()
        self.session.connection.fail_session(self.session.id, self.session.crashed)

    def _on_ended(self) -> None:
        self.traffic.clear()
        self._ended.set()
