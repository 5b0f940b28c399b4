"""Keeps an episode in one tab: what a page opens in a new window is opened in this tab instead.

A new window is attached to before it runs. Its first request, which gives the URL, is intercepted and never
sent: the window is closed, and the tab navigates to the URL.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Protocol

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import AttachedToTarget, Request, RequestPaused, WindowOpen
from webgym.browser.config import BrowserConfig
from webgym.browser.pdf import Pdfs
from webgym.browser.traffic import Traffic
from webgym.core.background import BackgroundTasks
from webgym.core.errors import BrowserError, NavigationFailed
from webgym.core.observation import NoticeKind

_QUOTED_LENGTH = 300
_REQUESTED = frozenset({"http", "https", "about"})
"""Schemes of windows that request a document, at once or when their page sets the URL."""


class Opener(Protocol):
    """The page that opens windows, as far as :class:`Popups` needs it: :class:`webgym.browser.page.Page`."""

    session: Session
    target_id: str
    config: BrowserConfig
    pdfs: Pdfs
    traffic: Traffic
    is_closed: bool

    def note(self, kind: NoticeKind, text: str) -> None:
        """Add a notice to the next observation."""
        ...

    def fail(self, error: NavigationFailed) -> None:
        """Add a notice that a document could not be opened, and the fault."""
        ...

    async def navigate(self, url: str, referrer: str = "") -> None:
        """Open a URL."""
        ...


class Popups:
    """The windows that one page opens."""

    def __init__(self, page: Opener) -> None:
        self._page = page
        self._open: dict[str, str] = {}
        """Session id by target id, of windows whose URL is not known yet."""
        self._unrequested: list[str] = []
        """URLs of this action's windows that will never send a request, such as ``mailto:``."""
        self._has_followed = False
        self._tasks = BackgroundTasks()
        page.session.on("Page.windowOpen", WindowOpen, self._on_window_open)

    def begin_action(self) -> None:
        """Start an action, which may follow one window."""
        self._has_followed = False
        self._unrequested.clear()

    def _on_window_open(self, event: WindowOpen) -> None:
        if event.url and event.url.split(":")[0] not in _REQUESTED:
            self._unrequested.append(event.url)
            for target_id in self._open:
                self._page.traffic.end(target_id)

    def adopt(self, attached: AttachedToTarget) -> None:
        """Handle a new window, which is attached to and does not run yet."""
        connection = self._page.session.connection
        session_id, target_id = attached.session_id, attached.target_info.target_id
        if self._page.is_closed:
            connection.send("Target.closeTarget", {"targetId": target_id})
            return
        self._open[target_id] = session_id
        if not self._unrequested:
            self._page.traffic.begin(target_id, self._page.config.minor_seconds)

        def on_request(paused: RequestPaused) -> None:
            self._close_window(target_id)
            self._follow(target_id, paused)

        connection.on("Fetch.requestPaused", RequestPaused, on_request, session_id)
        connection.send("Fetch.enable", {}, session_id)
        connection.send("Runtime.runIfWaitingForDebugger", {}, session_id)

    def forget(self, target_id: str) -> None:
        """Handle that a window is gone."""
        session_id = self._open.pop(target_id, None)
        if session_id is not None:
            self._page.session.connection.drop_session(session_id, BrowserError("the window was closed"))
            self._page.traffic.end(target_id)

    def close_blank(self) -> None:
        """Close the windows without a URL, with a notice."""
        for target_id in tuple(self._open):
            self._close_window(target_id)
            self._page.traffic.end(target_id)
            where = (
                f"for {self._unrequested.pop(0)[:_QUOTED_LENGTH]}" if self._unrequested else "that is empty"
            )
            self._page.note("popup", f"the page opened a window {where}; it was closed")

    async def close(self) -> None:
        """Cancel navigations to windows' URLs."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _close_window(self, target_id: str) -> None:
        session_id = self._open.pop(target_id, None)
        if session_id is None:
            return
        connection = self._page.session.connection
        connection.send("Target.closeTarget", {"targetId": target_id})
        connection.drop_session(session_id, BrowserError("the window was closed"))

    def _follow(self, target_id: str, paused: RequestPaused) -> None:
        url = paused.request.url
        if self._has_followed:
            self._page.traffic.end(target_id)
            self._page.note("popup", f"a further window was not opened: {url[:_QUOTED_LENGTH]}")
            return
        self._has_followed = True
        self._page.note("popup", f"a new window was opened in this tab: {url[:_QUOTED_LENGTH]}")
        self._tasks.start(self._navigate(target_id, paused))

    async def _navigate(self, target_id: str, paused: RequestPaused) -> None:
        request = paused.request
        try:
            with contextlib.suppress(BrowserError):  # the next action raises the same error
                async with self._replaying(request):
                    await self._page.navigate(request.url, request.headers.get("Referer", ""))
        except NavigationFailed as error:
            self._page.fail(error)
        finally:
            self._page.traffic.end(target_id)

    @asynccontextmanager
    async def _replaying(self, original: Request) -> AsyncIterator[None]:
        """Send the tab's next document request with the window's method, body and headers."""
        if original.method == "GET":
            yield
            return
        page = self._page
        is_first = True

        def on_request(paused: RequestPaused) -> None:
            nonlocal is_first
            if paused.is_response:
                return
            more: dict[str, Any] = {}
            if is_first and paused.frame_id == page.target_id:
                is_first = False  # redirects are requested in the usual way
                body = b"".join(part.data for part in original.post_data_entries)
                headers = {**paused.request.headers, **original.headers}
                more = {
                    "method": original.method,
                    "postData": base64.b64encode(body).decode(),
                    "headers": [{"name": name, "value": value} for name, value in headers.items()],
                }
            page.session.send("Fetch.continueRequest", {"requestId": paused.request_id, **more})

        forget = page.session.on("Fetch.requestPaused", RequestPaused, on_request)
        (at_response,) = page.pdfs.watching[1]["patterns"]
        documents = {"patterns": [{"resourceType": "Document"}, at_response]}
        await page.session.do("Fetch.enable", documents, seconds=page.config.execute_seconds)
        try:
            yield
        finally:
            forget()
            page.session.send(*page.pdfs.watching)
