"""When is a page quiet? Found out from events, with a hard deadline, and the reason is kept.

Nothing is waited for but what is known to be under way or shows itself: loading and requests
(:mod:`~webgym.browser.traffic`), computing workers (:mod:`~webgym.browser.workers`), changes, animations that
end and signs of loading (``scripts/settle.js``), and timers that the action set off
(:mod:`~webgym.browser.timers`). Each kind has its own limit in :class:`~webgym.browser.config.BrowserConfig`;
docs/settling.md says how they play together.
"""

from __future__ import annotations

import asyncio
import math
import time
from typing import Literal, TypeAlias

import msgspec

from webgym.browser.isolated_worlds import DocumentActivity, DocumentGone
from webgym.browser.page import Page
from webgym.browser.timers import Timer
from webgym.core.errors import BrowserTimeout

Reason: TypeAlias = Literal["unchanged", "quiet", "long_poll", "loading", "busy", "deadline"]
"""Why a wait ended: ``Observation.settled``.

* ``unchanged``: nothing happened after the action.
* ``quiet``: all that was started has ended.
* ``long_poll``: quiet, but a request is left open that is too old to be waited for.
* ``loading``: quiet, but the page still shows that it is loading, which a notice says, or nothing at all.
* ``busy``: loaded, but the page never stopped changing.
* ``deadline``: still under way when time was up; a notice says so.
"""

_TOGETHER = 0.05
"""Timers that are due within this time, seconds, are waited for together."""


class _Quiet(msgspec.Struct, frozen=True):
    """What ``webgym.quiet`` found. The page's timers are counted since its document began.

    Attributes:
        planned: timers set before the action's first event; ``None`` if none was seen.
        target: number of the element that the action's first event went to; 0 if none was seen.
        typed: whether a key was among the events.
        early, timers: timers set when the wait began, and when it ended.
        handles: the same as ``timers``, our own included.
        loading: whether the page shows that it is loading.
        blank: whether it does so by showing nothing, as an empty page does.
    """

    reason: Literal["unchanged", "quiet", "busy"]
    changes: int
    planned: int | None
    target: int
    typed: bool
    early: int
    timers: int
    handles: int
    loading: bool
    blank: bool


async def settle(page: Page) -> Reason:
    """Wait until the page is quiet, ``settle_seconds`` at most.

    Raises:
        BrowserCrashed, TargetGone: there is no page any more.
    """
    reason: Reason
    try:
        async with asyncio.timeout(page.config.settle_seconds):
            reason = await _Settling(page).run()
    except (TimeoutError, BrowserTimeout):
        waiting = len(page.traffic)
        page.note(
            "still_loading",
            f"the page was still loading after {page.config.settle_seconds:g} s"
            + (f" ({waiting} requests in flight)" if waiting else ""),
        )
        reason = "deadline"
        page.post("overlook")
    page.traffic.give_up(all_of_it=reason == "deadline")
    return reason


async def settle_timed(page: Page, milliseconds: dict[str, float]) -> Reason:
    """:func:`settle`, and how long it took."""
    start = time.perf_counter()
    try:
        return await settle(page)
    finally:
        milliseconds["settle"] = (time.perf_counter() - start) * 1000


class _Settling:
    """One wait for a quiet page."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._config = page.config
        self._has_loaded = False
        self._patience = 0.0
        self._linger = 0.0
        self._first_quiet: float | None = None
        """When the page looked quiet first; timers are waited for from then on."""
        self._last_fruit = 0.0
        """When a timer that was waited for last brought something."""
        self._known_timers: int | None = None
        """Timers that the document had set when the trace was last read."""
        self._handles = 0
        """The same, our own included."""
        self._missed_at = -1
        """Changes of the document when some timers were known to be missing from the trace."""
        self._waited_until = 0.0
        """Timers that were due before this have fired, or will not."""
        self._awaited: list[Timer] = []
        self._began: dict[str, float] = {}
        """When timers of some code were first waited for while the page showed that it is loading."""
        self._vain: list[Timer] = []
        """Timers that brought nothing in this wait. It is one lesson, however many there are."""
        self._target = ""
        self._has_typed = False
        self._changes = page.changes

    async def run(self) -> Reason:
        page = self._page
        while True:
            self._has_loaded = self._has_loaded or not page.traffic.is_idle()
            page.workers.ask()
            await page.traffic.idle(self._patience)
            try:
                seen = await self._quiet()
            except DocumentGone:
                self._begin_document()
                continue
            if page.worlds.has_new_frames:
                await page.worlds.explore()
            if not page.traffic.is_idle(self._patience) or not await page.worlds.stand_still():
                continue
            if await self._has_waited(seen) or not await self._is_still(seen):
                continue
            return self._end(seen)

    async def _quiet(self) -> _Quiet:
        config = self._config
        seconds = {
            "tick": config.tick_seconds,
            "reaction": config.reaction_seconds,
            "quiet": config.quiet_seconds,
            "busy": config.busy_seconds,
            "stir": config.stir_seconds if self._page.changes >= 0 else config.busy_seconds,
            "linger": self._linger,
        }
        times = {name: value * 1000 for name, value in seconds.items()}
        since = -1 if self._has_loaded else self._page.changes
        return await self._page.run(
            "quiet",
            {"since": since, "blank": self._page.is_substitute, **times},
            reply=_Quiet,
            seconds=config.settle_seconds,
        )

    async def _is_still(self, seen: _Quiet) -> bool:
        """Whether nothing came while the timers were read, which takes a while."""
        if self._known_timers is None or seen.reason == "busy":
            return True
        try:
            still = await self._page.run("still", reply=DocumentActivity)
        except DocumentGone:
            return False
        return still.changes == seen.changes and self._page.traffic.is_idle(self._patience)

    def _begin_document(self) -> None:
        self._has_loaded = True
        self._first_quiet = self._known_timers = None
        self._awaited = []
        self._handles = 0
        self._patience = self._linger = 0.0

    def _end(self, seen: _Quiet) -> Reason:
        page = self._page
        page.changes, page.timers_set = seen.changes, seen.timers
        page.idlers.learn(self._vain, self._target, brought=False)
        if seen.loading:
            page.post("overlook")  # so it is told once
            if not seen.blank:
                page.note("still_loading", "the page still shows that it is loading")
            return "loading"
        if seen.reason == "quiet" and not page.traffic.is_empty:
            return "long_poll"
        return seen.reason

    # --- what is to come ----------------------------------------------------------------------------

    async def _has_waited(self, seen: _Quiet) -> bool:
        """Whether something was known to be under way, and time was given to it."""
        self._learn(seen)
        if seen.reason == "busy":
            return False
        if self._first_quiet is None:
            self._first_quiet = time.monotonic()
        if seen.loading and not self._patience:  # requests that have outlasted their time have more now
            self._patience = self._config.loading_seconds
            if not self._page.traffic.is_idle(self._patience):
                return True
        timer = await self._next_timer(seen)
        if timer is not None:
            until = timer.due + _TOGETHER
            due = (one.next(self._waited_until) for one in self._planned())
            self._awaited = [one for one in due if self._waited_until < one.due <= until]
            self._waited_until, self._changes = until, seen.changes
            await asyncio.sleep(max(0.0, timer.due - time.monotonic()))
            return True
        if seen.loading and not self._linger:
            self._linger = self._config.linger_seconds
            return True
        return False

    async def _next_timer(self, seen: _Quiet) -> Timer | None:
        """The next timer that is worth waiting for."""
        assert self._first_quiet is not None
        page, horizon = self._page, self._horizon(seen, self._first_quiet)
        if self._has_set_timers(seen):
            await self._read_timers(seen)
        elif self._known_timers is None:
            return None
        for timer in self._planned():
            if timer.repeats and not (seen.loading and 0 < timer.delay <= page.config.timer_seconds):
                continue
            due = timer.next(self._waited_until)
            if due.due > horizon:
                break
            if due.due > self._waited_until and self._is_worthwhile(due, seen):
                return due
        if self._missed_at != seen.changes or time.monotonic() > horizon:
            return None
        step = self._config.quiet_seconds  # something is planned, and nobody knows for when
        return Timer(due=time.monotonic() + step, delay=math.inf, repeats=False, root=page.acted)

    def _planned(self) -> list[Timer]:
        return self._page.timers.pending(self._page.acted)

    def _is_worthwhile(self, timer: Timer, seen: _Quiet) -> bool:
        # What is typed may always bring something: a search finds nothing for one word, much for two.
        if not seen.loading:
            return self._has_typed or not self._page.idlers.is_known(timer, self._target)
        # Code that sets the next timer whenever one fires may ask whether something is there, or be a clock.
        now = time.monotonic()
        return now - self._began.setdefault(timer.origin, now) < self._config.linger_seconds

    async def _read_timers(self, seen: _Quiet) -> None:
        # A document that began after the action has been watched from its first timer on.
        has_watched = self._known_timers is not None or self._page.changes < 0
        # What a timer brought that fired a moment ago came too late to be seen.
        self._waited_until = max(self._waited_until, time.monotonic() - self._config.tick_seconds)
        found = await self._page.timers.read()
        if found is None or (has_watched and found < seen.handles - self._handles):
            self._missed_at = seen.changes
        self._known_timers, self._handles = seen.timers, seen.handles

    def _has_set_timers(self, seen: _Quiet) -> bool:
        """Whether the page may have set timers since the trace was read, or since the action."""
        if self._known_timers is not None:
            return seen.timers != self._known_timers
        if self._has_loaded:
            return seen.timers > 0 or len(self._page.workers) > 0
        before = self._page.timers_set if seen.planned is None else seen.planned
        # A page that shows no reaction has set them in its listeners, or it has set none.
        return (seen.early if seen.reason == "unchanged" else seen.timers) != before

    def _horizon(self, seen: _Quiet, first: float) -> float:
        """Until when timers are waited for."""
        config = self._config
        if seen.loading:
            return first + config.loading_seconds
        if seen.reason == "unchanged":
            return first + config.silent_timer_seconds
        # One stage of several brought something: the next has as much time again, but a ticker has no more.
        return min(max(first, self._last_fruit), first + config.timer_seconds) + config.timer_seconds

    def _learn(self, seen: _Quiet) -> None:
        """Whether the timers that were waited for brought anything, and what the action went to."""
        if seen.planned is not None:
            self._target = f"{self._page.loader} {seen.target}"
        self._has_typed = self._has_typed or seen.typed
        timers, self._awaited = self._awaited, []
        if seen.changes == self._changes:
            self._vain += timers
        elif timers:
            self._page.idlers.learn(timers, self._target, brought=True)
            self._last_fruit = time.monotonic()
