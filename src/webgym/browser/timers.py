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
from collections.abc import Iterable

import msgspec

from webgym.browser.cdp import Connection
from webgym.browser.cdp_messages import CdpMessage

log = logging.getLogger(__name__)

_CATEGORIES = ["devtools.timeline", "disabled-by-default-devtools.timeline.stack"]
"""The second adds the stack trace to each event, which costs about ten microseconds per event."""
_MICROSECONDS = 1e6

_IDLE_WAITS = 2
"""After this many waits in a row without effect, for timers set by the same code after actions on the same
element, settling does not wait for them any more."""

_IDLE_WAITS_ANYWHERE = 5
"""The same, for actions on any element."""

_Key = tuple[int, str, int]
"""Process id, frame or thread, and the timer's id in it."""

TRACE_KILOBYTES = 256
"""Size of the trace buffer that timers are read from: the last second of a page with animations."""

TRACE_SECONDS = 0.5
"""Deadline for reading the trace. It takes 0.015 s, but 5 s after a process has joined the browser."""


class Timer(msgspec.Struct, frozen=True):
    """A timer that is set. Times are those of ``time.monotonic()``, in seconds.

    Attributes:
        due: when it fires, for the first time if it repeats.
        delay: time between setting and firing.
        repeats: whether it is an interval timer.
        root: when the first timer of its chain was set: a timer that fires may set the next one.
        origin: stack trace of the code that set it. The callers are included because a shared helper, such
            as a debounce function, sets timers of many kinds.
    """

    due: float
    delay: float
    repeats: bool
    root: float
    origin: str = ""

    def next(self, now: float) -> Timer:
        """The timer; if it repeats, with its next due time after ``now``."""
        if not (self.repeats and self.delay):
            return self
        times = max(0, math.floor((now - self.due) / self.delay) + 1)
        return msgspec.structs.replace(self, due=self.due + times * self.delay)


class _Call(CdpMessage, frozen=True):
    url: str = ""
    script_id: str = ""
    line_number: int = 0
    column_number: int = 0

    def __str__(self) -> str:
        return f"{self.url or self.script_id}:{self.line_number}:{self.column_number}"


class _Data(CdpMessage, frozen=True):
    timer_id: int = 0
    timeout: float = 0.0
    single_shot: bool = True
    frame: str = ""
    is_outermost_main_frame: bool = False
    stack_trace: tuple[_Call, ...] = ()


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


class _Complete(CdpMessage, frozen=True):
    data_loss_occurred: bool = False


_NAMES = frozenset({"TimerInstall", "TimerRemove", "TimerFire", "CommitLoad"})
_read_args = msgspec.json.Decoder(_Args).decode


class IdleTimers:
    """Timers without visible effect, identified by the code that sets them and the element that was acted on.
    Delay and code alone do not distinguish a search that waits for the next key from a click counter."""

    def __init__(self) -> None:
        self.waits: dict[tuple[object, ...], int] = {}
        """Number of waits in a row without effect."""

    def is_known(self, timer: Timer, target: str) -> bool:
        """Whether this timer is known to have no effect after an action on ``target``."""
        return any(self.waits.get(key, 0) >= most for key, most in self._keys(timer, target))

    def learn(self, timers: Iterable[Timer], target: str, *, had_effect: bool) -> None:
        """Record whether these timers, which fired together, had a visible effect."""
        for key in {key for timer in timers for key, _ in self._keys(timer, target)}:
            if had_effect:
                self.waits.pop(key, None)
            else:
                self.waits[key] = self.waits.get(key, 0) + 1

    def forget_elsewhere(self, target: str) -> None:
        """An action on ``target`` changed the page: what had no effect elsewhere may have one now."""
        self.waits = {key: count for key, count in self.waits.items() if key[-1] == target or len(key) == 1}

    @staticmethod
    def _keys(timer: Timer, target: str) -> tuple[tuple[tuple[object, ...], int], ...]:
        code = timer.origin or timer.delay
        return ((code, timer.delay, target), _IDLE_WAITS), ((code,), _IDLE_WAITS_ANYWHERE)


class Timers:
    """The timers of one browser's pages.

    Args:
        connection: the browser's connection.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._is_wanted = False
        self._is_on = False
        self._was_full = False
        """Whether the buffer of the last trace was full, so that its beginning was lost."""
        self._has_ended = asyncio.Event()
        self._has_ended.set()
        self._events: list[_Event] = []
        self._set: dict[_Key, Timer] = {}
        self._worker_fires: dict[float, float] = {}
        """When a worker's timer fired last, by when its chain began."""
        self._ended_at = 0.0
        """When the trace was ended last."""
        connection.on("Tracing.dataCollected", _Collected, lambda data: self._events.extend(data.value))
        connection.on("Tracing.tracingComplete", _Complete, self._on_complete)

    def start(self) -> None:
        """Start the trace. Call it when the page's renderer exists: a renderer that starts later delays the
        first reading by seconds."""
        self._is_wanted = True
        if self._is_on or not self._has_ended.is_set():
            return
        self._is_on = True
        trace = {
            "recordMode": "recordContinuously",
            "traceBufferSizeInKb": TRACE_KILOBYTES,
            "includedCategories": _CATEGORIES,
            "excludedCategories": ["*"],
        }
        self._connection.send("Tracing.start", {"transferMode": "ReportEvents", "traceConfig": trace})

    async def stop(self) -> None:
        """End the trace. Call it while the page's renderer exists."""
        self._is_wanted = False
        self._set.clear()
        self._worker_fires.clear()
        await self._end()

    async def read(self) -> float | None:
        """Read the trace and update the known timers. If that takes too long, they are not changed.

        Events while the trace is read, for some milliseconds, are missed.

        Returns:
            The number of timers set since the last reading; infinity if the beginning of the trace was lost,
            ``None`` if it could not be read.
        """
        is_read = await self._end()
        events, self._events = self._events, []
        if not is_read:
            return None
        self._apply(events)
        return math.inf if self._was_full else sum(event.name == "TimerInstall" for event in events)

    async def _end(self) -> bool:
        """End the trace and wait for its events; returns whether they came in time. If the trace is still
        wanted, it starts again."""
        if not self._is_on:
            return False
        self._is_on = False
        self._events.clear()
        self._has_ended.clear()
        self._ended_at = time.monotonic()
        self._connection.send("Tracing.end")
        try:
            async with asyncio.timeout(TRACE_SECONDS):
                await self._has_ended.wait()
        except TimeoutError:
            log.info("the browser's trace could not be read within %g s", TRACE_SECONDS)
            return False
        return True

    def _on_complete(self, complete: _Complete) -> None:
        self._was_full = complete.data_loss_occurred
        self._has_ended.set()
        if self._is_wanted:
            self.start()

    def pending(self, since: float) -> list[Timer]:
        """The pending timers of chains that began after ``since``, ordered by due time."""
        recent = (timer for timer in self._set.values() if timer.root >= since)
        return sorted(recent, key=lambda timer: timer.due)

    def has_worker_chain(self, since: float, seconds: float) -> bool:
        """Whether a worker's timer, of a chain that began after ``since``, fired in the last ``seconds``
        before the trace was read: the next one may have been set meanwhile."""
        late = self._ended_at - seconds
        return any(root >= since and at >= late for root, at in self._worker_fires.items())

    # --- updating the known timers ------------------------------------------------------------------

    def _apply(self, events: list[_Event]) -> None:
        firing: dict[int, tuple[float, float]] = {}
        """By thread: until when a timer's function runs, and when its chain began."""
        for event in sorted((it for it in events if it.name in _NAMES), key=lambda it: it.ts):
            data = _read_args(event.args).data
            place = data.frame or str(event.tid)
            key = (event.pid, place, data.timer_id)
            now = event.ts / _MICROSECONDS
            match event.name:
                case "TimerInstall":
                    until, root = firing.get(event.tid, (0.0, now))
                    self._set[key] = Timer(
                        due=now + data.timeout / 1000,
                        delay=data.timeout / 1000,
                        repeats=not data.single_shot,
                        root=root if now <= until else now,
                        origin=" < ".join(map(str, data.stack_trace)),
                    )
                case "TimerRemove":
                    self._set.pop(key, None)
                case "TimerFire":
                    fired = self._set.get(key)
                    if fired is not None and not fired.repeats:
                        del self._set[key]
                    root = fired.root if fired is not None else now  # it was set while the trace was read
                    firing[event.tid] = (now + event.dur / _MICROSECONDS, root)
                    if not data.frame:
                        self._worker_fires[root] = now + event.dur / _MICROSECONDS
                case "CommitLoad":  # a new document: the timers of the old one are cancelled
                    self._forget(event.pid, "" if data.is_outermost_main_frame else place)
        self._prune()

    def _forget(self, process: int, place: str) -> None:
        self._set = {
            key: timer for key, timer in self._set.items() if key[0] != process or place not in ("", key[1])
        }

    def _prune(self) -> None:
        """Remove overdue timers, whose firing was lost from the buffer."""
        old = time.monotonic() - TRACE_SECONDS
        self._set = {key: timer for key, timer in self._set.items() if timer.repeats or timer.due > old}
        self._worker_fires = {root: at for root, at in self._worker_fires.items() if at > old}
