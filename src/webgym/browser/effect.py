"""Whether an action had any effect.

A page does not report that it had none, and the screenshot of a page that moves by itself
differs in any case.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

from webgym.browser.actions import point_of
from webgym.browser.gestures import AnyAction
from webgym.browser.page import Page
from webgym.browser.pointer import Point
from webgym.core.action import DoubleClick, LeftClick, RightClick, Scroll, Wait
from webgym.core.errors import ActionFailed, BrowserError


class EffectCheck:
    """Detects clicks and scrolls without effect, and adds a notice of them to the next observation.

    An effect is a change of the document that did not occur by itself before, another focus or selection, a
    changed value, a scroll, a new timer, a request, another URL, a window, or any notice. Other actions are
    not checked. Parts that go on changing after an action are ignored at the next one.
    """

    def __init__(self, page: Page, action: AnyAction) -> None:
        self._page = page
        self._point: Point | None = None
        self._message = ""
        self._is_idle, self._is_scroll = isinstance(action, Wait), isinstance(action, Scroll)
        self._trace_started: asyncio.Task[bool | None] | None = None
        match action:
            case LeftClick(target=target) | DoubleClick(target=target) | RightClick(target=target):
                with contextlib.suppress(ActionFailed):  # reported when the action is carried out
                    self._point = point_of(page, target)
                    self._message = "the page did not react to it"
            case Scroll(direction=direction):
                self._message = f"nothing scrolled {direction}"

    async def begin(self) -> None:
        """Call before the action. The page handles this call before the action's, so it is not awaited."""
        self._before = self._state()
        if self._message:
            self._trace_started = asyncio.create_task(self._call_page("beginTrace", self._point, reply=bool))
            await (asyncio.sleep(0) if self._page.worlds.is_entered else self._trace_started)  # it is sent

    async def end(self) -> None:
        """Call after the page has settled: add a notice if the action had no effect."""
        page = self._page
        was_traced = self._trace_started and await self._trace_started
        if self._is_idle:
            page.post("beginTrace")  # what has gone on meanwhile does so by itself
        page.post("endTrace")
        if not was_traced or page.happened or self._before != self._state():
            return
        effect = page.result.effect if page.result else "some"
        if effect == "some":
            return
        options = page.options
        sees_shadow_roots = options.text or options.elements or options.mode == "marks"
        if effect == "unseen" or not sees_shadow_roots or page.worlds.in_view:
            page.ineffective_if_same = self._message
        elif self._is_scroll:
            page.ineffective_if_unscrolled = self._message
        else:
            page.note("no_effect", self._message)

    def _state(self) -> tuple[str, str, int]:
        return self._page.url, self._page.loader, self._page.requests

    async def _call_page(self, function: str, *arguments: object, reply: Any) -> Any:
        """The page's reply; ``None`` if it does not answer or is gone, which other notices report."""
        with contextlib.suppress(BrowserError):
            seconds = self._page.config.busy_seconds
            return await self._page.run(function, *arguments, reply=reply, seconds=seconds)
        return None
