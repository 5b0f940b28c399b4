"""A screenshot that is taken while the page is still settling.

Taking a screenshot takes as long as finding out that nothing more is loading, which is the usual case. So if
an action has started nothing that is still pending, the screenshot is requested at once, and used if the page
still looks the same when the wait is over (``scripts/early.js``). Otherwise it is discarded and a new one is
taken as usual. On a page whose last early screenshot was used, it is requested without finding out first
whether tasks are pending, which takes until the next frame.
"""

from __future__ import annotations

import asyncio

import msgspec

from webgym.browser.observe import Early, PageContent, capture, content_options
from webgym.browser.page import Page
from webgym.core.errors import BrowserError

_FINAL = frozenset({"unchanged", "quiet", "long_poll"})
"""Reasons for the end of the wait after which the page does not change any more."""


class EarlyScreenshot:
    """The early screenshot of one step.

    :meth:`begin` after the action and :meth:`end` after the wait; :meth:`drop` in any case.
    """

    def __init__(self, page: Page) -> None:
        self.content: PageContent | None = None
        """The content of the document, if the screenshot shows its current state."""
        self._page = page
        self._is_calm, page.is_calm = page.is_calm, False
        self._before = self._state()
        self._task: asyncio.Task[bytes | None] | None = None
        self._is_requested = False

    def _state(self) -> tuple[str, int]:
        return self._page.loader, self._page.requests

    @property
    def result(self) -> Early | None:
        """The screenshot and the document's content, if it was taken and shows the page's current state."""
        if self.content is None or self._before != self._state():
            return None
        return Early(self.content, self.picture)

    async def begin(self) -> None:
        """After the action: request the screenshot, unless something is known to be in progress."""
        page = self._page
        worlds = page.worlds  # the main frame does not see changes in other frames and workers
        has_more = worlds.has_new_frames or worlds.entered or len(page.workers) or page.options.cuts
        if has_more or not worlds.is_entered or page.happened:
            return
        if not page.traffic.is_idle() or self._before != self._state():
            return
        self._task = asyncio.create_task(self._take())
        await asyncio.sleep(0)  # this request reaches the page before those of the wait

    async def _take(self) -> bytes | None:
        """The screenshot, or ``None`` if the page is about to change."""
        page = self._page
        options = content_options(page) if page.options.mode == "marks" else None
        is_worth_it: bool | None = None
        try:
            seconds = page.config.busy_seconds
            is_worth_it = await page.run("beginEarly", options, self._is_calm, reply=bool, seconds=seconds)
        except BrowserError:
            return None  # reported by the wait or the observation
        finally:
            if is_worth_it is None:
                page.post("dropEarly")  # the page may still come to it
        if not is_worth_it:
            return None
        self._is_requested = True
        return await capture(page)

    @property
    def wanted(self) -> dict[str, bool] | None:
        """The content to read when the wait is over; ``None`` if no screenshot is on its way."""
        return content_options(self._page) if self._task is not None else None

    def end(self, settled: str) -> None:
        """After the wait: find out whether the screenshot shows the page's current state.

        Args:
            settled: why the wait ended.
        """
        page = self._page
        if not self._is_requested or settled not in _FINAL or page.result is None:
            return
        contents = (msgspec.json.decode(it, type=PageContent) for it in page.result.contents)
        complete = (it for it in contents if not (it.unknown or it.missing or it.frames))
        self.content = next(complete, None)
        page.is_calm = self.result is not None

    async def picture(self) -> bytes:
        """The screenshot. Raises as :func:`~webgym.browser.observe.capture` does."""
        assert self._task is not None
        image = await self._task
        assert image is not None, "the screenshot was requested before its content was read"
        return image

    async def drop(self) -> None:
        """Cancel the screenshot."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
