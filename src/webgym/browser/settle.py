"""Waits until a page is quiet: decided by events, with a hard deadline; the reason is recorded.

It waits only for what is known to be in progress or visible: loading, requests and computing workers
(:mod:`~webgym.browser.traffic`), changes, finite animations and signs of loading (``scripts/settle.js``), and
timers that the action caused (:mod:`~webgym.browser.timers`). Each kind has its own limit in
:class:`~webgym.browser.config.BrowserConfig`;
docs/settling.md describes how they work together.
"""

from __future__ import annotations

import asyncio
import math
import time
from typing import Literal, TypeAlias

from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import ActionResult, Page
from webgym.browser.timers import TIMER_GROUP_SECONDS
from webgym.browser.traffic import LOADING_SECONDS
from webgym.core.errors import BrowserTimeout

Reason: TypeAlias = Literal["unchanged", "quiet", "long_poll", "loading", "busy", "deadline"]
"""Why a wait ended: ``Observation.settled``.

* ``unchanged``: nothing happened after the action.
* ``quiet``: everything that was started has ended.
* ``long_poll``: quiet, but a request is still open that counts as a long poll.
* ``loading``: quiet, but the page shows that it is loading, or nothing at all.
* ``busy``: loaded, but the page never stopped changing.
* ``deadline``: still in progress at the deadline.

A notice names what is still under way.
"""

TICK_SECONDS = 0.02
"""The interval in which a page's quiet time is counted. Unlike a clock, the count stops while the process is
stopped or starved of CPU time."""

REACTION_SECONDS = 0.04
"""How long to wait for a first reaction to an action."""

TIMER_SECONDS = 1.0
"""Settling waits for timers that the action caused if they are due within this time after the page became
quiet. Longer ones usually hide something again: a confirmation, a tooltip."""


class _Quiet(ActionResult, frozen=True):
    """The result of ``webgym.quiet``. Timers are counted since the document began.

    Attributes:
        reason: why the page counts as quiet.
        timers: timers set by now.
        loading: what shows that it is loading, and did not when the wait began: ``blank`` if that it shows
            nothing at all.
        changing: text of what never stopped changing; empty if it has none, ``None`` if nothing did.
    """

    reason: Literal["unchanged", "quiet", "busy"]
    timers: int
    loading: Literal["blank", "sign"] | None
    changing: str | None


async def settle(page: Page, wanted: dict[str, bool] | None = None) -> Reason:
    """Wait until the page is quiet, ``settle_seconds`` at most. Afterwards ``page.result`` is set, and a
    notice names what is still under way.

    Args:
        page: the page.
        wanted: the content of the page's observations, if a screenshot was requested.

    Raises:
        BrowserCrashed, TargetGone: the browser or the page is gone.
    """
    reason: Reason
    page.result = None
    awaited: list[str] = []
    try:
        async with asyncio.timeout(page.config.settle_seconds):
            reason = await _Settling(page, wanted, awaited).run()
    except (TimeoutError, BrowserTimeout):
        reason = "deadline"
        awaited = [f"not quiet after {page.config.settle_seconds:g} s"]
        page.post("overlook")
    page.note_still_loading("; ".join((*awaited, *page.traffic.still_open())))
    page.traffic.end_wait(is_over=reason == "deadline")
    return reason


async def settle_timed(
    page: Page, milliseconds: dict[str, float], wanted: dict[str, bool] | None = None
) -> Reason:
    """:func:`settle`; adds its wall time to ``milliseconds``."""
    start = time.perf_counter()
    try:
        return await settle(page, wanted)
    finally:
        milliseconds["settle"] = (time.perf_counter() - start) * 1000


class _Settling:
    """One wait for a quiet page.

    Args:
        page: the page.
        wanted: as in :func:`settle`.
        awaited: for what is under way at the end, requests excepted.
    """

    def __init__(self, page: Page, wanted: dict[str, bool] | None, awaited: list[str]) -> None:
        self._page = page
        self._config = page.config
        self._wanted = wanted
        self._awaited = awaited
        self._result: ActionResult | None = None
        self._is_new = True
        self._has_loaded = False
        self._patience = self._linger = 0.0
        self._first_quiet: float | None = None
        """When the page was first quiet; from then on the wait is for timers."""
        self._changed_at = 0.0
        """When it was first quiet after its last change."""
        self._waited_until = 0.0
        """Timers that were due before this have fired, or will not."""
        self._known_timers: tuple[int, dict[int, int]] | None = None
        """Number of timers that the document and its frames had set when the trace was last read."""
        self._before = self._changes = page.changes, dict(page.worlds.changes)
        """Number of changes of the document and its frames before the wait, and when it was last quiet."""

    async def run(self) -> Reason:
        page = self._page
        while True:
            self._has_loaded = self._has_loaded or not page.traffic.is_idle()
            page.workers.probe()
            await page.traffic.idle(self._patience)
            try:
                quiet = await self._quiet()
            except DocumentGone:
                self._begin_document()
                continue
            if page.worlds.has_new_frames:
                await page.worlds.explore()
            if not page.traffic.is_idle(self._patience) or not await page.worlds.wait_until_quiet():
                continue
            if await self._wait_for_more(quiet) or not await self._is_unchanged(quiet):
                continue
            return self._end(quiet)

    async def _quiet(self) -> _Quiet:
        config = self._config
        seconds = {
            "tick": TICK_SECONDS,
            "reaction": REACTION_SECONDS,
            "quiet": config.quiet_seconds,
            "busy": config.busy_seconds,
            "linger": self._linger,
        }
        since = -1 if self._has_loaded else self._page.changes
        more = {
            "since": since,
            "isNew": self._is_new,
            "isFirst": self._page.changes < 0,
            "blank": self._page.is_substitute,
            "wanted": self._wanted,
        }
        times = {name: value * 1000 for name, value in seconds.items()}
        self._is_new = False
        return await self._page.run("quiet", times | more, reply=_Quiet, seconds=config.settle_seconds)

    async def _is_unchanged(self, quiet: _Quiet) -> bool:
        """Whether the page has not changed while the timers were read, which takes some milliseconds."""
        if self._known_timers is None or quiet.reason == "busy":
            return True
        try:
            self._result = await self._page.run("result", self._wanted, reply=ActionResult)
        except DocumentGone:
            return False
        return self._result.changes == quiet.changes and self._page.traffic.is_idle(self._patience)

    def _begin_document(self) -> None:
        self._has_loaded = True
        self._first_quiet = self._known_timers = None
        self._patience = self._linger = 0.0

    def _end(self, quiet: _Quiet) -> Reason:
        page = self._page
        page.result = self._result or quiet
        page.changes, page.timers_set = quiet.changes, self._timers(quiet)
        if quiet.changing is not None:
            what = f'"{quiet.changing}"' if quiet.changing else "the page"
            self._awaited.append(f"{what} still changes")
        if quiet.loading == "sign":
            self._awaited.append("the page shows that it is loading")
        due = page.timers.next_due(page.acted, self._waited_until) if self._known_timers is not None else None
        due = due if due is not None and due < page.acted + self._config.settle_seconds else None
        # Other timers that are too late to be awaited hide a message again, or send a report.
        if due is not None and (quiet.loading or self._is_silent):
            self._awaited.append(f"a timer, due in {due - time.monotonic():.0f} s")
        if quiet.loading:
            return "loading"
        if quiet.reason == "quiet" and not page.traffic.is_empty:
            return "long_poll"
        return quiet.reason

    # --- pending requests and timers ----------------------------------------------------------------

    async def _wait_for_more(self, quiet: _Quiet) -> bool:
        """Wait for requests or timers that are in progress. Returns whether there were any."""
        now = time.monotonic()
        changes = quiet.changes, dict(self._page.worlds.changes)
        if self._first_quiet is None:
            self._first_quiet = now
        if changes != self._changes:
            self._changes, self._changed_at = changes, now
        if quiet.reason == "busy":
            return False
        if quiet.loading and not self._patience:  # requests that exceeded their limit have more time now
            self._patience = LOADING_SECONDS
            if not self._page.traffic.is_idle(self._patience):
                return True
        due = await self._next_timer(quiet)
        if due is not None and due <= self._horizon(quiet, self._first_quiet):
            self._waited_until = due + TIMER_GROUP_SECONDS
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            return True
        if quiet.loading and not self._linger:
            self._linger = self._config.linger_seconds
            return True
        return False

    async def _next_timer(self, quiet: _Quiet) -> float | None:
        """When the next timer is due that the action set off."""
        page, seconds = self._page, self._config.quiet_seconds
        again = math.inf
        if self._has_set_timers(quiet):
            self._known_timers = self._timers(quiet)
            # The effect of a timer that fired just now may not be visible yet.
            self._waited_until = max(self._waited_until, time.monotonic() - TICK_SECONDS)
            if await page.timers.read(page.acted, seconds):
                self._known_timers, again = None, time.monotonic() + seconds
        elif self._known_timers is None:
            return None
        due = page.timers.next_due(page.acted, self._waited_until)
        return again if due is None else min(due, again)

    def _has_set_timers(self, quiet: _Quiet) -> bool:
        """Whether the page may have set timers since the trace was read, or since it was last quiet."""
        page = self._page
        if len(page.workers):  # nobody counts theirs
            return True
        return self._timers(quiet) != (self._known_timers or page.timers_set)

    def _timers(self, quiet: _Quiet) -> tuple[int, dict[int, int]]:
        return quiet.timers, dict(self._page.worlds.timers)

    @property
    def _is_silent(self) -> bool:
        """Whether nothing has shown since the action."""
        return self._changes == self._before

    def _horizon(self, quiet: _Quiet, first: float) -> float:
        """Until when to wait for timers, ``time.monotonic()``."""
        if quiet.loading:
            return first + LOADING_SECONDS
        if self._is_silent:
            return first + self._config.silent_timer_seconds
        # If a timer changed the page, the next one has as much time again, but in total only twice the limit.
        return min(self._changed_at, first + TIMER_SECONDS) + TIMER_SECONDS
