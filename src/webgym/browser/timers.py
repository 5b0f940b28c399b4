"""A page's pending timers: those that are set and have not fired yet.

A script in the page could only see them by replacing the page's own functions, which pages can detect. The
browser's trace contains every timer that is set, fires or is removed, in all frames and workers, and is not
visible to the page. It is recorded all the time in a small ring buffer, which costs almost nothing; reading
it takes some ten milliseconds, so it is read only if timers may have been set.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from typing import Any

import msgspec

from webgym.browser.cdp import Connection
from webgym.browser.cdp_messages import CdpMessage

log = logging.getLogger(__name__)

_MICROSECONDS = 1e6

_Key = tuple[int, str, int]
"""Process id, frame or thread, and the timer's id in it."""

TRACE_KILOBYTES = 256
"""Size of the trace buffer that timers are read from: the last second of a page with animations."""

TRACE_SECONDS = 0.5
"""Deadline for reading the trace. It takes 0.015 s, but 5 s after a process has joined the browser."""

TIMER_GROUP_SECONDS = 0.05
"""Timers that are due within this time of each other are awaited together."""

_MOST_MISSED = 100
"""Of more timers than this, the setting was lost from the buffer, and not while it was read."""


class Timer(msgspec.Struct, frozen=True):
    """A timer that is set. Times are those of ``time.monotonic()``, in seconds.

    Attributes:
        due: when it fires; never, for one that repeats, which is not awaited.
        root: when the first timer of its chain was set: a timer that fires may set the next one.
    """

    due: float
    root: float


class _Data(CdpMessage, frozen=True):
    timer_id: int = 0
    timeout: float = 0.0
    single_shot: bool = True
    frame: str = ""
    is_outermost_main_frame: bool = False


class _Args(msgspec.Struct, frozen=True):
    data: _Data = _Data()


class _Event(msgspec.Struct, frozen=True):
    name: str
    ts: float = 0.0
    dur: float = 0.0
    pid: int = 0
    tid: int = 0
    args: msgspec.Raw = msgspec.Raw(b"{}")


class _Collected(msgspec.Struct, frozen=True):
    value: tuple[_Event, ...]


_NAMES = frozenset({"TimerInstall", "TimerRemove", "TimerFire", "CommitLoad"})
_read_args = msgspec.json.Decoder(_Args).decode


class Timers:
    """The timers of one browser's pages.

    Args:
        connection: the browser's connection.
        is_shared: whether the browser is others' as well: it has one trace, so that no timers are known.
    """

    def __init__(self, connection: Connection, *, is_shared: bool = False) -> None:
        self._connection = connection
        self._is_shared = is_shared
        self._is_wanted = False
        self._is_on = False
        self._has_ended = asyncio.Event()
        self._has_ended.set()
        self._events: list[_Event] = []
        self._set: dict[_Key, Timer] = {}
        self._last_ids: dict[tuple[int, str], int] = {}
        """The last known timer of each process and frame or thread. Their ids count up."""
        self._missed: set[_Key] = set()
        """Timers that were set while the trace was read: nobody knows when they are due."""
        self._worker_fires: dict[float, float] = {}
        """When a worker's timer fired last, by when its chain began."""
        self._began_at = 0.0
        """When the trace was started last."""
        self._was_late = False
        """Whether the last reading was too late: what was set meanwhile is known by later timers' numbers."""
        connection.on("Tracing.dataCollected", _Collected, lambda data: self._events.extend(data.value))
        connection.on("Tracing.tracingComplete", CdpMessage, self._on_complete)

    def start(self) -> None:
        """Start the trace when the page's renderer exists: one that is later delays reading by seconds."""
        self._is_wanted = True
        if self._is_on or self._is_shared or not self._has_ended.is_set():
            return
        self._is_on, self._began_at = True, time.monotonic()
        trace = {
            "recordMode": "recordContinuously",
            "traceBufferSizeInKb": TRACE_KILOBYTES,
            "includedCategories": ["devtools.timeline"],
            "excludedCategories": ["*"],
        }
        self._connection.send("Tracing.start", {"transferMode": "ReportEvents", "traceConfig": trace})

    async def stop(self) -> None:
        """End the trace. Call it while the page's renderer exists."""
        self._is_wanted = self._was_late = False
        await self._end()
        for known in (self._set, self._last_ids, self._missed, self._events):
            known.clear()

    async def read(self, since: float, seconds: float) -> bool:
        """Read the trace, and update the known timers.

        Args:
            since: when the action began.
            seconds: what is lately.

        Returns:
            Whether to read it again soon, because another timer may be set: one was set while it was read, or
            one of a worker, whose changes nobody sees, has fired lately or is late, or this reading or the
            last was late, of which the events come with the next one.
        """
        now, began_at, was_late = time.monotonic(), self._began_at, self._was_late
        self._was_late = not await self._end()
        if self._was_late:
            return not self._is_shared
        events, self._events = self._events, []
        self._worker_fires.clear()
        if began_at < since:
            self._missed.clear()
        self._apply(events, missed_root=since if began_at > since else 0.0)
        has_fired = any(root >= since and at > now - seconds for root, at in self._worker_fires.items())
        overdue = (key for key, timer in self._set.items() if timer.root >= since and timer.due < now)
        is_late = any(place.isdecimal() for _, place, _ in overdue)
        return bool(self._missed) or has_fired or is_late or was_late

    def next_due(self, since: float, after: float) -> float | None:
        """When the next known timer is due, after ``after``, of a chain that began after ``since``."""
        dues = (timer.due for timer in self._set.values() if timer.root >= since)
        return min((due for due in dues if after < due < math.inf), default=None)

    async def _end(self) -> bool:
        """End the trace; returns whether its events came in time. Starts again if it is still wanted."""
        if not self._is_on:
            return False
        self._is_on = False
        self._has_ended.clear()
        self._connection.send("Tracing.end")
        try:
            async with asyncio.timeout(TRACE_SECONDS):
                await self._has_ended.wait()
        except TimeoutError:
            log.info("the browser's trace could not be read within %g s", TRACE_SECONDS)
            return False
        return True

    def _on_complete(self, _: CdpMessage) -> None:
        self._has_ended.set()
        if self._is_wanted:
            self.start()

    # --- updating the known timers ------------------------------------------------------------------

    def _apply(self, events: list[_Event], missed_root: float) -> None:
        firing: dict[int, tuple[float, float]] = {}
        """By thread: until when a timer's function runs, and when its chain began."""
        for event in sorted((it for it in events if it.name in _NAMES), key=lambda it: it.ts):
            data = _read_args(event.args).data
            place = data.frame or str(event.tid)
            key = (event.pid, place, data.timer_id)
            now, end = event.ts / _MICROSECONDS, (event.ts + event.dur) / _MICROSECONDS
            match event.name:
                case "TimerInstall":
                    until, root = firing.get(event.tid, (0.0, now))
                    due = now + data.timeout / 1000 if data.single_shot else math.inf
                    self._set[key] = Timer(due, root if now <= until else now)
                    self._note_missed(key, missed_root)
                case "TimerRemove":
                    self._set.pop(key, None)
                    self._missed.discard(key)
                case "TimerFire":
                    fired = self._set.get(key)
                    # Of one that is not known, the setting was missed, or lost from the buffer.
                    is_missed = fired is None and data.timer_id > self._last_ids.get(key[:2], 0)
                    if is_missed:
                        self._note_missed(key, missed_root)
                    self._missed.discard(key)
                    root = missed_root if is_missed else 0.0
                    if fired is not None:
                        root = fired.root
                        if fired.due < math.inf:
                            del self._set[key]
                    firing[event.tid] = (end, root)
                    if not data.frame:
                        self._worker_fires[root] = end
                case "CommitLoad":  # a new document: the timers of the old one are cancelled
                    self._forget(event.pid, "" if data.is_outermost_main_frame else place)
        # The firing of those that are overdue was lost from the buffer.
        old = time.monotonic() - TRACE_SECONDS
        self._set = {key: timer for key, timer in self._set.items() if timer.due > old}

    def _note_missed(self, key: _Key, missed_root: float) -> None:
        """A timer was set: those between the last known one and this are missed."""
        place, number = key[:2], key[2]
        last = self._last_ids.get(place, number)
        if missed_root and 0 < number - last <= _MOST_MISSED:
            self._missed |= {(*place, missed) for missed in range(last + 1, number)}
        self._last_ids[place] = number

    def _forget(self, process: int, place: str) -> None:
        def is_left(key: tuple[Any, ...]) -> bool:
            return key[0] != process or place not in ("", key[1])

        self._set = {key: timer for key, timer in self._set.items() if is_left(key)}
        self._missed = {key for key in self._missed if is_left(key)}
        self._last_ids = {key: last for key, last in self._last_ids.items() if is_left(key)}
