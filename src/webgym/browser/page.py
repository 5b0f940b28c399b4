"""The tab of an episode: its documents, navigations, dialogs and notices."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urldefrag

import msgspec

from webgym.browser.cdp import CommandFailed, Session, TargetGone
from webgym.browser.cdp_messages import (
    DialogOpening,
    DownloadWillBegin,
    EmptyReply,
    FileChooser,
    FrameNavigated,
    Navigated,
    NavigatedWithinDocument,
    NavigationStarted,
    RequestedNavigation,
    RequestFailed,
    RequestPaused,
    ResponseReceived,
    ScheduledNavigation,
)
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.isolated_worlds import DocumentGone, Worlds
from webgym.browser.popups import Popups
from webgym.browser.timers import IdleTimers, Timers
from webgym.browser.traffic import Traffic
from webgym.browser.workers import AUTO_ATTACH, Workers
from webgym.core.errors import BrowserTimeout, EgressRefused, NavigationFailed
from webgym.core.observation import Notice, NoticeKind

log = logging.getLogger(__name__)

T = TypeVar("T")

BLANK = "about:blank"
_NO_CONTENT = (204, 205)
"""HTTP statuses after which a browser stays where it is."""

_NO_DIALOGS = "window.alert = window.confirm = window.prompt = () => undefined"
"""What a browser offers to its user when a page opens one dialog after the other."""

_SAID_LENGTH = 300
"""Characters of a dialog's message, or of an address, that a notice repeats."""

_CLEAR_CLIPBOARD = """
addEventListener('copy', (event) => {
  event.clipboardData.setData('text/plain', '');
  event.preventDefault();
}, { capture: true, once: true });
document.execCommand('copy');
"""
"""A browser has one clipboard for all its contexts: what an episode copied, the next one must not paste."""

_SCHEMES = ("http://", "https://")
_WITHIN_REACH = frozenset({"http", "https", "about", "blob", "javascript"})
"""Schemes that a page may lead to; Chromium leaves the page as it is for any other."""

_PROXY_SAID_NO = frozenset({"net::ERR_SOCKS_CONNECTION_FAILED", "net::ERR_ADDRESS_UNREACHABLE"})
"""All that Chromium says when the proxy has no connection for it, whatever the reason."""

_FORM_RESULT = "net::ERR_CACHE_MISS"
"""What Chromium says of a page in the history that it would have to send a form for."""


def _not_opened(url: str) -> str:
    return f'"{url[:_SAID_LENGTH]}" was not opened: only http and https addresses are'


class Returned(msgspec.Struct, frozen=True):
    """Where in the tab's history an action went back to, and the loader of the document that it left."""

    index: int
    left: str


class Page:
    """A tab in a fresh browser context.

    Args:
        session: attached to the tab, which waits for the debugger.
        target_id: the tab's; also the id of its main frame.
        config: the slot's limits.
        egress: knows why a connection failed, of which the browser only hears that it did.
        timers: knows what the browser's pages have planned.
    """

    def __init__(
        self, session: Session, target_id: str, config: BrowserConfig, egress: Egress, timers: Timers
    ) -> None:
        self.session = session
        self.target_id = target_id
        self.config = config
        self.options = PageOptions()
        self._egress = egress
        self.url = BLANK
        self.status: int | None = None
        self.changes = -1
        """Of the document, when it was last seen quiet; -1 for a document that never was."""
        self.points: dict[int, tuple[float, float]] = {}
        """Where a click hits each element of the last observation, by number."""
        self.is_gone = False
        """The page closed itself: there is no tab any more."""
        self.is_closed = False
        self.is_substitute = True
        """No document is there, but the blank one that a tab begins with, or one that a failure left."""
        self.traffic = Traffic(session, target_id, config)
        self.timers = timers
        self.timers_set = 0
        """Timers that the document had set when it was last seen quiet."""
        self.idlers = IdleTimers()
        """Timers that were waited for and brought nothing to see."""
        self.acted = time.monotonic()
        """When the last action began, seconds of ``time.monotonic()``."""
        self._notices: list[Notice] = []
        self._more_notices = 0
        self._happened: list[Notice] = []
        self._dialogs = 0
        self._statuses: dict[str, int] = {}
        """HTTP status by loader, until the document is committed."""
        self._failures: dict[str, str] = {}
        """The browser's error word by loader, until the error page is committed."""
        self.loader = ""
        """Of the document that is there."""
        self.returned: Returned | None = None
        """Where this action has gone back to."""
        self._told_failure = ""
        self._is_asked = False
        self._told_unopened = ""
        """Where this action wanted to lead, and was said not to."""
        self._leaving_for = ""
        """Loader of the navigation that was begun last."""
        self._documents = 0
        """That have been there since the action began."""
        self._forget_hold: Callable[[], None] | None = None
        """Set while the tab is kept at its document."""
        self.files: dict[str, Path] = {}  # that can be chosen, by name
        self.requests = 0  # begun, and words that were sent on sockets
        self.ineffective_if_same = ""
        """What to say of the last action if the next picture is ``picture``, the last one, again."""
        self.picture = ""
        self.choosers: list[FileChooser] | None = None
        """What asks for files, while an action waits for that."""
        self.worlds = Worlds(session, target_id, config)
        self.popups = Popups(self)
        self.workers = Workers(session, self.traffic, config)
        session.on("Page.frameStartedNavigating", NavigationStarted, self._on_leaving)
        session.on("Page.frameScheduledNavigation", ScheduledNavigation, self._on_wanted)
        session.on("Page.frameRequestedNavigation", RequestedNavigation, self._on_wanted)
        session.on("Page.frameNavigated", FrameNavigated, self._on_navigated)
        session.on("Page.navigatedWithinDocument", NavigatedWithinDocument, self._on_within_document)
        session.on("Page.javascriptDialogOpening", DialogOpening, self._on_dialog)
        session.on("Page.downloadWillBegin", DownloadWillBegin, self._on_download)
        session.on("Page.fileChooserOpened", FileChooser, self._on_file_chooser)
        session.on("Network.requestWillBeSent", EmptyReply, self._on_asked)
        session.on("Network.webSocketFrameSent", EmptyReply, self._on_asked)
        session.on("Network.responseReceived", ResponseReceived, self._on_response)
        session.on("Network.loadingFailed", RequestFailed, self._on_request_failed)
        session.on("Inspector.targetCrashed", EmptyReply, self._on_crashed)
        self._ended = asyncio.Event()
        """Set while there is no renderer: nothing can be waited for."""
        self._forget_browser = session.connection.when_lost(self._on_ended)

    # --- life ---------------------------------------------------------------------------------------

    async def prepare(self) -> None:
        """Set the tab up and let it run."""
        commands: list[tuple[str, dict[str, Any]]] = [
            ("Page.enable", {}),
            ("Inspector.enable", {}),
            ("Target.setAutoAttach", AUTO_ATTACH),
            ("Network.enable", {"maxTotalBufferSize": 0, "maxResourceBufferSize": 0}),
            ("Emulation.setDeviceMetricsOverride", self._metrics()),
            ("Emulation.setFocusEmulationEnabled", {"enabled": True}),
            ("Page.setInterceptFileChooserDialog", {"enabled": True}),
            ("Page.addScriptToEvaluateOnNewDocument", self.worlds.script_in_page),
        ]
        commands.append(("Runtime.runIfWaitingForDebugger", {}))
        commands.append(("Runtime.evaluate", {"expression": _CLEAR_CLIPBOARD, "userGesture": True}))
        await self._do_all(commands)

    async def begin(self, options: PageOptions) -> None:
        """An episode begins in this tab. Costs nothing if it wants what every tab has."""
        commands: list[tuple[str, dict[str, Any]]] = []
        has_own_size = options.viewport != self.options.viewport
        self.options = options
        if has_own_size:
            commands.append(("Emulation.setDeviceMetricsOverride", self._metrics()))
        if options.cookies:
            cookies = [msgspec.to_builtins(cookie) for cookie in options.cookies]
            commands.append(("Network.setCookies", {"cookies": cookies}))
        await self._do_all(commands)

    def _metrics(self) -> dict[str, Any]:
        width, height = self.options.viewport
        return {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}

    async def _do_all(self, commands: list[tuple[str, dict[str, Any]]]) -> None:
        seconds = self.config.open_seconds
        await asyncio.gather(  # sent at once, taken in order
            *(self.session.do(method, params, seconds=seconds) for method, params in commands)
        )

    @property
    def address(self) -> str:
        """Where it is, at most ``address_characters`` of it."""
        return self.url[: self.config.address_characters]

    @property
    def is_crashed(self) -> bool:
        """Whether its renderer is gone."""
        return self.session.crashed is not None

    @property
    def is_lost(self) -> bool:
        """Whether the tab cannot be used any more."""
        return self.is_gone or self.is_crashed or self.is_closed

    async def close(self) -> None:
        """Stop what runs for the page here. The tab itself goes with its context."""
        self.is_closed = True
        self._forget_browser()
        await self.popups.close()
        await self.workers.close()
        self.session.connection.drop_session(self.session.id, TargetGone("the page was closed"))

    def begin_action(self) -> None:
        """An action starts: what is limited per action is counted anew."""
        self._happened.clear()
        self._dialogs = self._documents = 0
        if self._forget_hold is not None:
            self._forget_hold()
            self._forget_hold = None
            self.session.send("Fetch.disable")
        self.returned = None
        self._told_unopened = self.ineffective_if_same = ""
        self.popups.begin_action()
        self.acted = time.monotonic()
        self.traffic.started.clear()

    async def rest(self, seconds: float) -> None:
        """Let the page go on for so long. One that is lost meanwhile is not waited for."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._ended.wait()

    # --- notices ------------------------------------------------------------------------------------

    def note(self, kind: NoticeKind, text: str) -> None:
        """Keep something for the next observation to say."""
        if len(self._happened) < self.config.notices_per_observation:
            self._happened.append(Notice(kind, text))
        if len(self._notices) < self.config.notices_per_observation:
            self._notices.append(Notice(kind, text))
        else:
            self._more_notices += 1

    @property
    def happened(self) -> tuple[Notice, ...]:
        """What there was to note since the last action began; the next observation says it too."""
        return tuple(self._happened)

    def pictured(self, name: str) -> None:
        """A picture was taken. One that is the same as before may say that the action had no effect."""
        if self.ineffective_if_same and name == self.picture and not self._happened:
            self.note("no_effect", self.ineffective_if_same)
        self.ineffective_if_same, self.picture = "", name

    def take_notices(self) -> tuple[Notice, ...]:
        """What happened since the last call."""
        notices = self._notices
        if self._more_notices:
            last = notices[-1]
            notices[-1] = Notice(last.kind, f"{last.text} (and {self._more_notices} more notices)")
        self._notices, self._more_notices = [], 0
        return tuple(notices)

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
        """Call ``webgym.<function>()`` in the tab's own frame before whatever comes next; do not wait."""
        self.worlds.post(function)

    def end_script(self) -> None:
        """End the script that keeps the page from answering."""
        self.session.send("Runtime.terminateExecution")

    async def complete(self) -> None:
        """Give a document that ended before its body an empty one: Chromium never draws it otherwise.

        A script in its head has led to another program, say for mail, and the rest was not read any more.
        """
        with contextlib.suppress(DocumentGone, CommandFailed, BrowserTimeout):
            if await self.run("isCutOff", reply=bool):
                content = {"frameId": self.target_id, "html": ""}
                await self.session.do("Page.setDocumentContent", content, seconds=self.config.execute_seconds)

    # --- navigation ---------------------------------------------------------------------------------

    async def navigate(self, url: str, referrer: str = "") -> None:
        """Open a URL, up to the first byte that replaces the page.

        Raises:
            NavigationFailed: with the browser's own error word.
            EgressRefused: the egress policy says no.
        """
        params = {"url": url, "referrer": referrer} if referrer else {"url": url}
        said = url[:_SAID_LENGTH]
        if not url.lower().startswith(_SCHEMES):
            raise NavigationFailed(_not_opened(url))
        self._leaving_for = ""
        self._is_asked = True
        loop = asyncio.get_running_loop()
        hold_up = loop.call_later(self.config.execute_seconds, self._end_hold_up)
        try:
            navigated = await self.session.call(
                "Page.navigate", params, reply=Navigated, seconds=self.config.navigate_seconds
            )
        except BrowserTimeout:
            self.session.send("Page.stopLoading")
            raise NavigationFailed(
                f"{said} gave no answer within {self.config.navigate_seconds:g} s"
            ) from None
        except CommandFailed as error:
            raise NavigationFailed(f"{said}: {error.message}") from error
        finally:
            hold_up.cancel()
            self._is_asked = False
        if navigated.is_download or navigated.error_text == "net::ERR_ABORTED":
            return  # a download has its own notice; an aborted navigation leaves the page as it is
        if navigated.error_text:
            self._told_failure = navigated.loader_id  # its error page comes later, and is no news
            raise self._failure(url, navigated)

    def _end_hold_up(self) -> None:
        """A page is asked before it is left. As long as it does not answer, nothing is requested."""
        if not self.traffic.document_url(self._leaving_for):
            self.end_script()
            self.note("still_loading", "the page would not be left; its script was ended")

    def _on_leaving(self, event: NavigationStarted) -> None:
        if event.frame_id == self.target_id:
            self._leaving_for = event.loader_id

    def _failure(self, url: str, navigated: Navigated) -> NavigationFailed:
        """Why a navigation failed, at the address that it was led to."""
        failed = self.traffic.document_url(navigated.loader_id) or url
        why, is_refused = self._why(failed, navigated.error_text)
        said = url[:_SAID_LENGTH]
        if urldefrag(failed).url != urldefrag(url).url:
            said = f"{said} (which leads to {failed[:_SAID_LENGTH]})"
        return (EgressRefused if is_refused else NavigationFailed)(f"{said}: {why}")

    def _why(self, url: str, said: str) -> tuple[str, bool]:
        """What the proxy knows of a connection that failed, and whether the egress policy refused it."""
        if said == _FORM_RESULT:
            return f"{said}, this page was the answer to a form, which is not sent again", False
        failure = self._egress.failure(url) if said in _PROXY_SAID_NO else None
        return (failure.message, failure.is_refusal) if failure is not None else (said, False)

    async def revive(self, why: str) -> None:
        """Bring a crashed renderer back, at the URL where it died.

        Raises:
            TargetGone: it died again.
        """
        self.session.crashed = None
        self._ended.clear()
        self.traffic.clear()
        self.note("crashed", f"the page crashed and was loaded again{f': {why}' if why else ''}")
        try:
            await self.navigate(self.url)
        except NavigationFailed as error:
            self.note("navigation_failed", error.message)

    # --- what the browser tells ---------------------------------------------------------------------

    def _on_wanted(self, event: ScheduledNavigation | RequestedNavigation) -> None:
        """The page wants to go somewhere. Of one wish there may be an event of each kind."""
        if event.frame_id != self.target_id or event.url.split(":")[0] in _WITHIN_REACH:
            return
        self.traffic.end(self.target_id)  # a document that was still being read is never said to be complete
        if event.url != self._told_unopened:
            self._told_unopened = event.url
            self.note("navigation_failed", _not_opened(event.url))

    def _on_navigated(self, event: FrameNavigated) -> None:
        frame = event.frame
        if frame.id != self.target_id:
            return
        self._documents += 1
        if self._documents > self.config.most_documents and self._forget_hold is None:
            self._hold()
        self.url = (frame.unreachable_url or frame.url) + frame.url_fragment
        self.status = self._statuses.get(frame.loader_id)
        self.loader = frame.loader_id
        self.is_substitute = bool(frame.unreachable_url) or frame.url == BLANK
        # The error page of a navigation that was asked for may come before its reply is looked at.
        if frame.unreachable_url and not self._is_asked and frame.loader_id != self._told_failure:
            said = self._failures.get(frame.loader_id, "it could not be opened")
            why, _ = self._why(self.url, said)
            self.note("navigation_failed", f"{self.url[:_SAID_LENGTH]}: {why}")
        self._statuses.clear()
        self._failures.clear()
        self.changes = -1
        self.timers_set = 0
        self.points = {}

    def _hold(self) -> None:
        """Keep the tab at its document until the next action."""
        self._forget_hold = self.session.on("Fetch.requestPaused", RequestPaused, self._on_paused)
        self.session.send("Fetch.enable", {"patterns": [{"urlPattern": "*", "resourceType": "Document"}]})
        self.note(
            "still_loading", f"the page led on {self.config.most_documents} times; it is held here for now"
        )

    def _on_paused(self, event: RequestPaused) -> None:
        if event.frame_id != self.target_id:
            self.session.send("Fetch.continueRequest", {"requestId": event.request_id})
        else:  # a document whose successor is only made to wait is never drawn
            self.session.send("Fetch.failRequest", {"requestId": event.request_id, "errorReason": "Aborted"})

    def _on_within_document(self, event: NavigatedWithinDocument) -> None:
        if event.frame_id == self.target_id:
            self.url = event.url

    def _on_asked(self, _: EmptyReply) -> None:
        self.requests += 1

    def _on_response(self, event: ResponseReceived) -> None:
        if event.type != "Document" or event.frame_id != self.target_id:
            return
        status = event.response.status
        self._statuses[event.loader_id] = status
        if status in _NO_CONTENT:
            said = event.response.url[:_SAID_LENGTH]
            self.note("navigation_failed", f"{said}: answered {status}, no content; the page stays as it is")

    def _on_request_failed(self, event: RequestFailed) -> None:
        if event.type != "Document":
            return
        self._failures[event.request_id] = event.error_text
        if event.request_id == self.loader and not event.canceled:
            said = self.url[:_SAID_LENGTH]
            self.note("navigation_failed", f"{said}: the page broke off, {event.error_text}")

    def _on_dialog(self, event: DialogOpening) -> None:
        self._dialogs += 1
        if self._dialogs > self.config.dialogs_per_action:
            self.session.send("Runtime.terminateExecution")
            if self._dialogs == self.config.dialogs_per_action + 1:
                self.note("dialog", "the page would not stop opening dialogs; it may open no more")
        else:
            said = f'{event.type} "{event.message[:_SAID_LENGTH]}"'
            answer = (
                f'answered "{event.default_prompt[:_SAID_LENGTH]}"' if event.type == "prompt" else "accepted"
            )
            self.note("dialog", f"{said}: {answer}")
        self.session.send("Page.handleJavaScriptDialog", {"accept": True, "promptText": event.default_prompt})
        if self._dialogs > self.config.dialogs_per_action:
            self.session.send("Runtime.evaluate", {"expression": _NO_DIALOGS})

    def _on_download(self, event: DownloadWillBegin) -> None:
        name = event.suggested_filename or event.url
        self.note("download_refused", f'the download of "{name[:_SAID_LENGTH]}" was refused')

    def _on_file_chooser(self, event: FileChooser) -> None:
        if self.choosers is not None:
            self.choosers.append(event)
        else:
            how = "upload chooses one of the task's" if self.files else "files cannot be uploaded"
            self.note("action_failed", f"the page asked for a file; {how}")

    def _on_crashed(self, _: EmptyReply) -> None:
        self.session.crashed = TargetGone("the page crashed")
        self.worlds.forget()
        self._on_ended()
        self.session.connection.fail_session(self.session.id, self.session.crashed)

    def _on_ended(self) -> None:
        self.traffic.clear()
        self._ended.set()
