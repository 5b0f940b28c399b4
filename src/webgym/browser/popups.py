"""There is one tab: what a page wants to open in a second window is opened in this one.

A new window is attached to before it runs. Its first request is held back, tells us the address, and
is never sent: the window is closed and the tab goes there itself.
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
from webgym.browser.traffic import Traffic
from webgym.core.errors import BrowserError, NavigationFailed
from webgym.core.observation import NoticeKind

_SAID_LENGTH = 300
_REQUESTED = frozenset({"http", "https", "about"})
"""Schemes of windows that ask for a document, at once or when their page says what for."""


class Opener(Protocol):
    """The page that opens windows, as far as :class:`Popups` needs it: :class:`webgym.browser.page.Page`."""

    session: Session
    target_id: str
    config: BrowserConfig
    traffic: Traffic
    is_closed: bool

    def note(self, kind: NoticeKind, text: str) -> None:
        """Tell the agent of something with the next observation."""
        ...

    async def navigate(self, url: str, referrer: str = "") -> None:
        """Open a URL."""
        ...


class Popups:
    """The windows that one page opens."""

    def __init__(self, page: Opener) -> None:
        self._page = page
        self._open: dict[str, str] = {}
        """Session by target, of windows that have not yet said where they go."""
        self._elsewhere: list[str] = []
        """Where windows of this action lead that a request will never be seen of."""
        self._has_followed = False
        self._tasks: set[asyncio.Task[None]] = set()
        page.session.on("Page.windowOpen", WindowOpen, self._on_wanted)

    def begin_action(self) -> None:
        """Each action may lead to one window."""
        self._has_followed = False
        self._elsewhere.clear()

    def _on_wanted(self, event: WindowOpen) -> None:
        if event.url and event.url.split(":")[0] not in _REQUESTED:
            self._elsewhere.append(event.url)
            for target_id in self._open:
                self._page.traffic.end(target_id)

    def adopt(self, attached: AttachedToTarget) -> None:
        """A new window is attached to and waits for us."""
        connection = self._page.session.connection
        session_id, target_id = attached.session_id, attached.target_info.target_id
        if self._page.is_closed:
            connection.send("Target.closeTarget", {"targetId": target_id})
            return
        self._open[target_id] = session_id
        if not self._elsewhere:
            self._page.traffic.begin(target_id, self._page.config.minor_seconds)

        def on_request(paused: RequestPaused) -> None:
            self._shut(target_id)
            self._follow(target_id, paused)

        connection.on("Fetch.requestPaused", RequestPaused, on_request, session_id)
        connection.send("Fetch.enable", {}, session_id)
        connection.send("Runtime.runIfWaitingForDebugger", {}, session_id)

    def forget(self, target_id: str) -> None:
        """A window is gone."""
        session_id = self._open.pop(target_id, None)
        if session_id is not None:
            self._page.session.connection.drop_session(session_id, BrowserError("the window was closed"))
            self._page.traffic.end(target_id)

    def close_blank(self) -> None:
        """Close the windows that never said where they go."""
        for target_id in tuple(self._open):
            self._shut(target_id)
            self._page.traffic.end(target_id)
            where = f"for {self._elsewhere.pop(0)[:_SAID_LENGTH]}" if self._elsewhere else "that is empty"
            self._page.note("popup", f"the page opened a window {where}; it was closed")

    async def close(self) -> None:
        """Stop following."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _shut(self, target_id: str) -> None:
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
            self._page.note("popup", f"a further window was not opened: {url[:_SAID_LENGTH]}")
            return
        self._has_followed = True
        self._page.note("popup", f"a new window was opened in this tab: {url[:_SAID_LENGTH]}")
        task = asyncio.get_running_loop().create_task(self._navigate(target_id, paused))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _navigate(self, target_id: str, paused: RequestPaused) -> None:
        request = paused.request
        try:
            with contextlib.suppress(BrowserError):  # whoever acts next meets the same error
                async with self._as_wanted(request):
                    await self._page.navigate(request.url, request.headers.get("Referer", ""))
        except NavigationFailed as error:
            self._page.note("navigation_failed", error.message)
        finally:
            self._page.traffic.end(target_id)

    @asynccontextmanager
    async def _as_wanted(self, wanted: Request) -> AsyncIterator[None]:
        """The tab's next document is asked for as the window asked for it: with its method and its body."""
        if wanted.method == "GET":
            yield
            return
        page = self._page
        is_first = True

        def on_request(paused: RequestPaused) -> None:
            nonlocal is_first
            more: dict[str, Any] = {}
            if is_first and paused.frame_id == page.target_id:
                is_first = False  # what it is redirected to is asked for in the usual way
                body = b"".join(part.data for part in wanted.post_data_entries)
                headers = {**paused.request.headers, **wanted.headers}
                more = {
                    "method": wanted.method,
                    "postData": base64.b64encode(body).decode(),
                    "headers": [{"name": name, "value": value} for name, value in headers.items()],
                }
            page.session.send("Fetch.continueRequest", {"requestId": paused.request_id, **more})

        forget = page.session.on("Fetch.requestPaused", RequestPaused, on_request)
        documents = {"patterns": [{"resourceType": "Document"}]}
        await page.session.do("Fetch.enable", documents, seconds=page.config.execute_seconds)
        try:
            yield
        finally:
            forget()
            page.session.send("Fetch.disable")
