"""Did an action do anything? A page does not say so when it did not, and the picture of one that moves by
itself is another all the same."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any, Literal, TypeAlias

from webgym.browser.actions import point_of
from webgym.browser.cdp import CommandFailed
from webgym.browser.gestures import AnyAction
from webgym.browser.page import Page
from webgym.browser.pointer import Point
from webgym.browser.worlds import DocumentGone
from webgym.core.action import DoubleClick, LeftClick, RightClick, Scroll
from webgym.core.errors import ActionFailed, BrowserTimeout

Effect: TypeAlias = Literal["some", "none", "unseen"]
"""``unseen``: there is something whose changes only a picture shows."""


def effect_of(page: Page, action: AnyAction) -> AbstractAsyncContextManager[None]:
    """Tell the agent of a click or a scroll that has no effect: for the block, as :func:`traced` says."""
    match action:
        case LeftClick(target=target) | DoubleClick(target=target) | RightClick(target=target):
            with contextlib.suppress(ActionFailed):  # which is told anyway
                return traced(page, point_of(page, target), "the page did not react to it")
        case Scroll(direction=direction):
            return traced(page, None, f"nothing scrolled {direction}")
    return untraced(page)


@asynccontextmanager
async def untraced(page: Page) -> AsyncIterator[None]:
    """An action whose effect is not asked for. What changes after it changes by itself."""
    yield
    page.post("endTrace")


@asynccontextmanager
async def traced(page: Page, point: Point | None, said: str) -> AsyncIterator[None]:
    """Find out whether the block, an action and the wait for a quiet page, has an effect.

    That is: a change of the document that it did not show by itself before, another focus or selection, a
    value, a scroll, a plan for later, a request, an address, a window, or anything that there is a notice of.

    Args:
        point: where the action lands.
        said: what to tell the agent if there was none.
    """
    before = (page.url, page.loader, page.requests)
    has_begun = await _ask(page, "beginTrace", point, reply=bool)
    yield
    if not has_begun or page.happened or before != (page.url, page.loader, page.requests):
        page.post("endTrace")
        return
    found = await _ask(page, "endTrace", reply=Effect)
    if found is None or found == "some":
        return
    options = page.options
    has_looked_in = options.text or options.elements or options.mode == "marks"  # into shadow roots too
    if found == "unseen" or not has_looked_in or page.worlds.in_view:
        page.ineffective_if_same = said
    else:
        page.note("no_effect", said)


async def _ask(page: Page, function: str, *arguments: object, reply: Any) -> Any:
    """What the page says, if it has a moment. One that has none is told by other notices."""
    with contextlib.suppress(DocumentGone, CommandFailed, BrowserTimeout):
        return await page.run(function, *arguments, reply=reply, seconds=page.config.busy_seconds)
    return None
