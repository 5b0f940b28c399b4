"""A picture that is taken while the page is still waited for.

To take a picture takes as long as to find out that nothing more comes, and mostly nothing does. So where an
action has set nothing off that is yet to come, the picture is asked for at once, and kept if the page is
found to look the same when the wait is over (``scripts/early.js``). Otherwise it is thrown away, and the
page is looked at as ever.
"""

from __future__ import annotations

import asyncio

from webgym.browser.observe import Early, Seen, capture_marked, wanted_of
from webgym.browser.page import Page
from webgym.core.errors import BrowserError

_FINAL = frozenset({"unchanged", "quiet", "long_poll"})
"""Reasons for the end of a wait after which nothing is to come."""


class EarlyScreenshot:
    """The early picture of one step, if there is to be one.

    :meth:`begin` after the action and :meth:`end` after the wait; :meth:`drop` in any case.
    """

    def __init__(self, page: Page) -> None:
        self.seen: Seen | None = None
        """What the document says of itself, if the picture shows it as it is."""
        self._page = page
        self._before = self._state()
        self._task: asyncio.Task[bytes | None] | None = None

    def _state(self) -> tuple[str, int]:
        return self._page.loader, self._page.requests

    @property
    def result(self) -> Early | None:
        """The screenshot and what it shows, if it was taken and shows the page as it is."""
        if self.seen is None or self._before != self._state():
            return None
        return Early(self.seen, self.picture)

    async def begin(self) -> None:
        """The action is done: have the picture asked for, unless something is known to be under way."""
        page = self._page
        worlds = page.worlds  # frames and workers of which the tab's own frame hears nothing
        has_more = worlds.has_new_frames or worlds.entered or len(page.workers) or page.options.cuts
        if has_more or not worlds.is_entered or page.happened:
            return
        if not page.traffic.is_idle() or self._before != self._state():
            return
        self._task = asyncio.create_task(self._take())
        await asyncio.sleep(0)  # the page is asked before the wait asks it anything

    async def _take(self) -> bytes | None:
        """The picture, unless the page has more to come."""
        page = self._page
        wanted = wanted_of(page) if page.options.mode == "marks" else None
        try:
            if not await page.run("beginEarly", wanted, reply=bool, seconds=page.config.busy_seconds):
                return None
        except BrowserError:  # the wait, or the look, says what is wrong
            return None
        return await capture_marked(page)

    async def end(self, settled: str) -> None:
        """The wait is over: find out whether the picture is good.

        Args:
            settled: why it ended.
        """
        page = self._page
        if self._task is None or settled not in _FINAL:
            return
        try:
            found = await page.run(
                "endEarly", wanted_of(page), reply=tuple[Seen, ...], seconds=page.config.busy_seconds
            )
        except BrowserError:
            return
        self.seen = next((one for one in found if not (one.unknown or one.missing or one.frames)), None)

    async def picture(self) -> bytes:
        """The picture. Raises as :func:`~webgym.browser.observe.capture` does."""
        assert self._task is not None
        image = await self._task
        assert image is not None, "who has seen its frame has asked for it"
        return image

    async def drop(self) -> None:
        """Stop taking it."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
