"""Waits until a page is quiet: decided by events, with a hard deadline; the reason is recorded.

It waits only for what is known to be in progress or visible: loading and requests
(:mod:`~webgym.browser.traffic`), computing workers (:mod:`~webgym.browser.workers`), changes, finite
animations and signs of loading (``scripts/settle.js``), and timers that the action caused
(:mod:`~webgym.browser.timers`). Each kind has its own limit in :class:`~webgym.browser.config.BrowserConfig`;
docs/settling.md describes how they work together.
"""

from __future__ import annotations

import asyncio
import math
import time
from typing import Literal, TypeAlias

from webgym.browser.isolated_worlds import DocumentGone
from webgym.browser.page import ActionResult, Page
from webgym.browser.timers import Timer
from webgym.browser.traffic import LOADING_SECONDS
from webgym.core.errors import BrowserTimeout

Reason: TypeAlias = Literal["unchanged", "quiet", "long_poll", "loading", "busy", "deadline"]
"""Why a wait ended: ``Observation.settled``.

* ``unchanged``: nothing happened after the action.
* ``quiet``: everything that was started has ended.
* ``long_poll``: quiet, but a request is still open that counts as a long poll.
* ``loading``: quiet, but the page still shows that it is loading, which a notice says, or is blank.
* ``busy``: loaded, but the page never stopped changing.
* ``deadline``: still in progress at the deadline; a notice says so.
"""

_TIMER_GROUP_SECONDS = 0.05
"""Timers that are due within this time of each other are awaited together."""

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
        planned: timers set before the action's first event; ``None`` if no event was seen.
        target: number of the element that received the action's first event; 0 if no event was seen.
        typed: whether one of the events was a key.
        early, timers: timers set when the wait began, and when it ended.
        handles: the same as ``timers``, including those of WebGym's scripts.
        loading: whether the page shows that it is loading.
        blank: whether it does so by being blank.
        timer_effect: whether the awaited timers changed anything besides the document, such as a field's
            value; ``unseen`` if only a picture could tell.
        reacted: whether it has changed, other than by scrolling, since this was last asked.
    """

    reason: Literal["unchanged", "quiet", "busy"]
    planned: int | None
    target: int
    typed: bool
    early: int
    timers: int
    handles: int
    loading: bool
    blank: bool
    timer_effect: Literal["some", "none", "unseen"]
    reacted: bool


async def settle(page: Page, wanted: dict[str, bool] | None = None) -> Reason:
    """Wait until the page is quiet, ``settle_seconds`` at most. Afterwards ``page.result`` is set.

    Args:
        page: the page.
        wanted: the content of the page's observations, if a screenshot was requested.

    Raises:
        BrowserCrashed, TargetGone: the browser or the page is gone.
    """
    reason: Reason
    page.result = None
    try:
        async with asyncio.timeout(page.config.settle_seconds):
            reason = await _Settling(page, wanted).run()
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
    """One wait for a quiet page."""

    def __init__(self, page: Page, wanted: dict[str, bool] | None) -> None:
        self._page = page
        self._wanted = wanted
        self._result: ActionResult | None = None
        self._config = page.config
        self._has_loaded = False
        self._requests = page.requests
        self._patience = 0.0
        self._linger = 0.0
        self._first_quiet: float | None = None
        """When the page was first quiet; from then on the wait is for timers."""
        self._last_effect = 0.0
        """When an awaited timer last had an effect."""
        self._known_timers: tuple[int, dict[int, int]] | None = None
        """Number of timers that the document and its frames had set when the trace was last read."""
        self._handles = 0
        """The same, including those of WebGym's scripts."""
        self._missed_at = -1
        """Number of changes of the document when timers were known to be missing from the trace."""
        self._waited_until = 0.0
        """Timers that were due before this have fired, or will not."""
        self._awaited: list[Timer] = []
        self._first_awaited: dict[str, float] = {}
        """When timers set by the same code were first awaited while the page showed that it is loading."""
        self._ineffective: list[Timer] = []
        """Timers that had no effect in this wait. Together they count once."""
        self._target = ""
        self._has_typed = False
        self._has_reacted = False
        self._frame_changes = dict(page.worlds.changes)
        self._changes = self._all_changes(page.changes)
        page.worlds.begin_wait()

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
            "stir": config.stir_seconds if self._page.changes >= 0 else config.busy_seconds,
            "linger": self._linger,
        }
        times = {name: value * 1000 for name, value in seconds.items()}
        since = -1 if self._has_loaded else self._page.changes
        return await self._page.run(
            "quiet",
            {
                "since": since,
                "blank": self._page.is_substitute,
                "timed": bool(self._awaited),
                "wanted": self._wanted,
                **times,
            },
            reply=_Quiet,
            seconds=config.settle_seconds,
        )

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
        self._awaited = []
        self._handles = 0
        self._patience = self._linger = 0.0

    def _end(self, quiet: _Quiet) -> Reason:
        page = self._page
        page.result = self._result or quiet
        page.changes, page.timers_set = quiet.changes, quiet.timers
        page.frame_timers = dict(page.worlds.timers)
        page.idlers.learn(self._ineffective, self._target, had_effect=False)
        if self._has_reacted or page.worlds.changes != self._frame_changes:
            page.idlers.forget_elsewhere(self._target)
        if quiet.loading:
            page.post("overlook")  # so that it is reported once
            if not quiet.blank:
                page.note("still_loading", "the page still shows that it is loading")
            return "loading"
        if quiet.reason == "quiet" and not page.traffic.is_empty:
            return "long_poll"
        return quiet.reason

    # --- pending requests and timers ----------------------------------------------------------------

    async def _wait_for_more(self, quiet: _Quiet) -> bool:
        """Wait for requests or timers that are in progress. Returns whether there were any."""
        self._learn(quiet)
        if quiet.reason == "busy":
            return False
        if self._first_quiet is None:
            self._first_quiet = time.monotonic()
        if quiet.loading and not self._patience:  # requests that exceeded their limit have more time now
            self._patience = LOADING_SECONDS
            if not self._page.traffic.is_idle(self._patience):
                return True
        timer = await self._next_timer(quiet)
        if timer is not None:
            until = timer.due + _TIMER_GROUP_SECONDS
            pending = (it.next(self._waited_until) for it in self._pending())
            self._awaited = [it for it in pending if self._waited_until < it.due <= until]
            self._waited_until, self._changes = until, self._all_changes(quiet.changes)
            if self._awaited:
                self._page.post("beginTimer")
            await asyncio.sleep(max(0.0, timer.due - time.monotonic()))
            return True
        if quiet.loading and not self._linger:
            self._linger = self._config.linger_seconds
            return True
        return False

    async def _next_timer(self, quiet: _Quiet) -> Timer | None:
        """The next timer that is worth waiting for."""
        assert self._first_quiet is not None
        page, horizon = self._page, self._horizon(quiet, self._first_quiet)
        if self._has_set_timers(quiet):
            await self._read_timers(quiet)
        elif self._known_timers is None:
            return None
        for timer in self._pending():
            if timer.repeats and not (quiet.loading and 0 < timer.delay <= TIMER_SECONDS):
                continue
            upcoming = timer.next(self._waited_until)
            if upcoming.due > horizon:
                break
            if upcoming.due > self._waited_until and self._is_worthwhile(upcoming, quiet):
                return upcoming
        now, step = time.monotonic(), self._config.quiet_seconds
        is_missed = self._missed_at == quiet.changes  # a timer is set, but it is not known when it is due
        if now > horizon or not (is_missed or page.timers.has_worker_chain(page.acted, step)):
            return None
        return Timer(due=now + step, delay=math.inf, repeats=False, root=page.acted)

    def _pending(self) -> list[Timer]:
        return self._page.timers.pending(self._page.acted)

    def _is_worthwhile(self, timer: Timer, quiet: _Quiet) -> bool:
        # Typing may always have an effect: a search finds nothing for one word, and results for two.
        if not quiet.loading:
            return self._has_typed or not self._page.idlers.is_known(timer, self._target)
        # Code that sets the next timer whenever one fires may be polling, or be a clock.
        now = time.monotonic()
        return now - self._first_awaited.setdefault(timer.origin, now) < self._config.linger_seconds

    async def _read_timers(self, quiet: _Quiet) -> None:
        # The timers of a document that began after the action are all in the trace.
        has_watched = self._known_timers is not None or self._page.changes < 0
        # The effect of a timer that fired just now may not be visible yet.
        self._waited_until = max(self._waited_until, time.monotonic() - TICK_SECONDS)
        newly_set = await self._page.timers.read()
        if newly_set is None or (has_watched and newly_set < quiet.handles - self._handles):
            self._missed_at = quiet.changes
        self._known_timers, self._handles = self._timers(quiet), quiet.handles

    def _has_set_timers(self, quiet: _Quiet) -> bool:
        """Whether the page may have set timers since the trace was read, or since the action."""
        page = self._page
        if len(page.workers):  # nobody counts theirs
            return True
        if self._known_timers is not None:
            return self._timers(quiet) != self._known_timers
        frames = page.worlds.timers
        if any(count != page.frame_timers.get(world, 0) for world, count in frames.items()):
            return True
        if self._has_loaded:
            return quiet.timers > 0
        before = page.timers_set if quiet.planned is None else quiet.planned
        # A page that neither reacts nor asks for anything has set them in its event listeners, or not at all.
        is_inert = quiet.reason == "unchanged" and page.requests == self._requests
        return (quiet.early if is_inert else quiet.timers) != before

    def _timers(self, quiet: _Quiet) -> tuple[int, dict[int, int]]:
        return quiet.timers, dict(self._page.worlds.timers)

    def _all_changes(self, changes: int) -> tuple[int, dict[int, int]]:
        """Number of changes of the document, and of its frames."""
        return changes, dict(self._page.worlds.changes)

    def _has_changed(self, quiet: _Quiet) -> bool:
        """Whether anything has shown since the action."""
        page = self._page
        return quiet.changes != page.changes or page.worlds.changes != self._frame_changes

    def _horizon(self, quiet: _Quiet, first: float) -> float:
        """Until when to wait for timers, ``time.monotonic()``."""
        config = self._config
        if quiet.loading:
            return first + LOADING_SECONDS
        if not self._last_effect and not self._has_changed(quiet):
            return first + config.silent_timer_seconds
        # If a timer had an effect, the next one has as much time again, but in total only twice the limit.
        return min(max(first, self._last_effect), first + TIMER_SECONDS) + TIMER_SECONDS

    def _learn(self, quiet: _Quiet) -> None:
        """Record whether the awaited timers had an effect, and the target of the action."""
        if quiet.planned is not None:
            self._target = f"{self._page.loader} {quiet.target}"
        worlds = self._page.worlds
        if worlds.target:
            self._target = f"{self._page.loader} {worlds.target}"
        self._has_typed = self._has_typed or quiet.typed or worlds.has_typed
        self._has_reacted = self._has_reacted or quiet.reacted
        timers, self._awaited = self._awaited, []
        if self._all_changes(quiet.changes) != self._changes or quiet.timer_effect == "some":
            self._ineffective.clear()  # they led up to it
            if timers:
                self._page.idlers.learn(timers, self._target, had_effect=True)
                self._last_effect = time.monotonic()
        elif quiet.timer_effect == "none":
            self._ineffective += timers
