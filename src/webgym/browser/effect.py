"""Whether an action had any effect.

A page does not report that it had none, and the screenshot of a page that moves by itself
differs in any case.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any, Literal, TypeAlias

from webgym.browser.actions import point_of
from webgym.browser.gestures import AnyAction
from webgym.browser.page import Page
from webgym.browser.pointer import Point
from webgym.core.action import DoubleClick, LeftClick, RightClick, Scroll
from webgym.core.errors import ActionFailed, BrowserError

Effect: TypeAlias = Literal["some", "none", "unseen"]
"""``unseen``: there is something whose changes only a picture shows."""


class EffectCheck:
    """Tells the agent of a click or a scroll that has no effect.

    An effect is a change of the document that it did not show by itself before, another focus or selection, a
    value, a scroll, a plan for later, a request, an address, a window, or anything that there is a notice of.
    Of other actions it is not asked for. What changes after an action changes by itself.
    """

    def __init__(self, page: Page, action: AnyAction) -> None:
        self._page = page
        self._point: Point | None = None
        self._said = ""
        self._begun: asyncio.Task[bool | None] | None = None
        match action:
            case LeftClick(target=target) | DoubleClick(target=target) | RightClick(target=target):
                with contextlib.suppress(ActionFailed):  # which is told anyway
                    self._point = point_of(page, target)
                    self._said = "the page did not react to it"
            case Scroll(direction=direction):
                self._said = f"nothing scrolled {direction}"

    async def begin(self) -> None:
        """Before the action. What that asks the page is answered after our question, so we need not wait."""
        self._before = self._state()
        if self._said:
            self._begun = asyncio.create_task(self._ask("beginTrace", self._point, reply=bool))
            await (asyncio.sleep(0) if self._page.worlds.is_entered else self._begun)  # it is sent

    async def end(self) -> None:
        """After the wait for a quiet page: keep what there is to tell."""
        page = self._page
        has_begun = self._begun and await self._begun
        if not has_begun or page.happened or self._before != self._state():
            page.post("endTrace")
            return
        found = await self._ask("endTrace", reply=Effect)
        if found is None or found == "some":
            return
        options = page.options
        has_looked_in = options.text or options.elements or options.mode == "marks"  # into shadow roots too
        if found == "unseen" or not has_looked_in or page.worlds.in_view:
            page.ineffective_if_same = self._said
        else:
            page.note("no_effect", self._said)

    def _state(self) -> tuple[str, str, int]:
        return self._page.url, self._page.loader, self._page.requests

    async def _ask(self, function: str, *arguments: object, reply: Any) -> Any:
        """What the page says, if it has a moment. One that has none, or is gone, is told by other notices."""
        with contextlib.suppress(BrowserError):
            seconds = self._page.config.busy_seconds
            return await self._page.run(function, *arguments, reply=reply, seconds=seconds)
        return None
