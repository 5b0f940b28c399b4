"""The windows of an episode: a stack of live pages, the newest in front.

What a page opens in a new window or tab is a page of its own, attached to before it runs. The pages behind go
on living, so that a window and its opener can talk. A window that is closed, by itself or by going back at
its start, uncovers the page behind as it then is. The order changes only in :meth:`Windows.update`, between
an action and the look at what came of it: nobody acts on another page than the one that was seen.
"""

from __future__ import annotations

from webgym.browser.cdp import Session
from webgym.browser.cdp_messages import AttachedToTarget, DetachedFromTarget
from webgym.browser.page import Page

MOST_WINDOWS = 8
"""Most windows of an episode, the first page included, and most that one action opens."""


class Windows:
    """The windows of one episode, all in one browser context.

    Args:
        first: the episode's first page.
    """

    def __init__(self, first: Page) -> None:
        self._stack = [first]
        self._opener = first.target_id
        """The page that the action is done to, and that may open windows."""
        self._opened = 0
        self._has_refused = False
        self._arrived: list[Page] = []
        """Windows that were opened and were not in front yet."""
        self._closed: list[Page] = []

    @property
    def front(self) -> Page:
        """The page that the agent sees."""
        return self._stack[-1]

    @property
    def pages(self) -> tuple[Page, ...]:
        """All pages, in front or not."""
        return (*self._stack, *self._arrived)

    def begin_action(self) -> None:
        """Start an action: reset what is counted per action."""
        self._opened, self._has_refused, self._opener = 0, False, self.front.target_id
        self.front.notices.begin_action()
        self.front.dialogs.begin_action()
        for page in self.pages:
            page.begin_action()

    def adopt(self, attached: AttachedToTarget) -> None:
        """Handle a new window, which is attached to and does not run yet.

        Only a page that the agent acts on opens windows: one behind it could take its place for ever.
        """
        front, opener = self.front, attached.target_info.opener_id
        self._opened += 1
        if self._opened > MOST_WINDOWS or opener not in ("", self._opener, front.target_id):
            connection = front.session.connection
            # It has to run before it can be closed, or others wait, too.
            connection.send("Runtime.runIfWaitingForDebugger", {}, attached.session_id)
            connection.send("Target.closeTarget", {"targetId": attached.target_info.target_id})
            if not self._has_refused:
                front.note("popup", "a further window was not opened")
            self._has_refused = True
            return
        page = front.beside(Session(front.session.connection, attached.session_id), attached.target_info)
        self._arrived.append(page)
        front.requests += 1  # what was done to the page in front had an effect

    def forget(self, detached: DetachedFromTarget) -> None:
        """Handle that a page or a worker is gone."""
        for page in self.pages:
            page.workers.forget(detached)
            if page.session.id == detached.session_id:
                page.end()

    def update(self) -> bool:
        """Bring the newest window to the front, and drop those that were closed, with notices.

        Returns:
            Whether another page is in front than before. If all were closed, the first one stays.
        """
        before, arrived = self.front, self._arrived
        everything, self._arrived = self.pages, []
        for page in everything:
            if page.leads_nowhere:  # browsers close such a window, too
                page.discard()
        living = [page for page in everything if not page.is_gone]
        for page in living[1 : max(1, len(living) + 1 - MOST_WINDOWS)]:
            page.discard()
            page.note("popup", f"more than {MOST_WINDOWS} windows: the oldest but the first one was closed")
        self._stack = [page for page in living if not page.is_gone] or [before]
        self._stack[0].is_window = False
        if before.is_gone and self.front not in (before, *arrived):
            self.front.note("popup", "the window was closed; the page behind it is in front again")
        for page in arrived:
            what = "and closed it again" if page.is_gone else "which is in front now; go_back closes it"
            page.note("popup", f"the page opened a new window, {what}")
        self._closed += [page for page in everything if page not in self._stack]
        return self.front is not before

    def close_others(self) -> Page:
        """Close all windows but the first page, which is returned."""
        [first, *others] = self.pages
        first.dialogs.cancel()
        self._stack, self._arrived, first.is_window = [first], [], False
        for page in others:
            page.discard()
        self._closed += others
        return first

    async def close(self) -> None:
        """Stop the background tasks of all pages. They themselves are closed with their context."""
        self.front.dialogs.cancel()
        for page in (*self._closed, *self.pages):
            await page.close()
