"""When is a page quiet? Found out from events, with a hard deadline, and the reason is kept.

Reasons: ``unchanged`` (nothing happened after the action), ``quiet`` (all that was started has ended),
``busy`` (loaded, but the page never stops changing), ``deadline`` (still loading when time was up).
``quiet`` becomes ``long_poll`` where a request is left open that is too old to be waited for.
"""

from __future__ import annotations

import asyncio
import time
from typing import Literal, TypeAlias

import msgspec

from webgym.browser.page import Page
from webgym.browser.worlds import DocumentGone
from webgym.core.errors import BrowserTimeout

Reason: TypeAlias = Literal["unchanged", "quiet", "long_poll", "busy", "deadline"]


class _Quiet(msgspec.Struct, frozen=True):
    reason: Literal["unchanged", "quiet", "busy"]
    changes: int


async def settle(page: Page) -> Reason:
    """Wait until the page is quiet, ``settle_seconds`` at most.

    Raises:
        BrowserCrashed, TargetGone: there is no page any more.
    """
    try:
        async with asyncio.timeout(page.config.settle_seconds):
            return await _settle(page)
    except (TimeoutError, BrowserTimeout):
        waiting = len(page.traffic)
        page.note(
            "still_loading",
            f"the page was still loading after {page.config.settle_seconds:g} s"
            + (f" ({waiting} requests in flight)" if waiting else ""),
        )
        return "deadline"


async def _settle(page: Page) -> Reason:
    config = page.config
    limits = [
        seconds * 1000 for seconds in (config.reaction_seconds, config.quiet_seconds, config.busy_seconds)
    ]
    has_loaded = False
    while True:
        has_loaded = has_loaded or not page.traffic.is_idle
        await page.traffic.idle()
        since = -1 if has_loaded else page.changes
        try:
            quiet = await page.run("quiet", since, *limits, reply=_Quiet, seconds=config.settle_seconds)
        except DocumentGone:
            has_loaded = True
            continue
        if page.worlds.has_new_frames:
            await page.worlds.explore()
        if not page.traffic.is_idle or not await page.worlds.stand_still():
            continue
        page.changes = quiet.changes
        if quiet.reason == "quiet" and not page.traffic.is_empty:
            return "long_poll"
        return quiet.reason


async def settle_timed(page: Page, milliseconds: dict[str, float]) -> Reason:
    """:func:`settle`, and how long it took."""
    start = time.perf_counter()
    try:
        return await settle(page)
    finally:
        milliseconds["settle"] = (time.perf_counter() - start) * 1000
