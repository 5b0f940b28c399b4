"""A page's pending timers: those that it has set and that are not due yet.

No script of ours can see them without replacing the page's own functions, which pages look for. The
browser's own trace names every timer that is set, fires or is removed, in all frames and workers, and the
page knows nothing of it. The trace runs all the time, in a small ring, which costs next to nothing; to read
it takes some ten milliseconds, so it is read only when something says that timers were set.
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
from webgym.browser.config import BrowserConfig

log = logging.getLogger(__name__)

_CATEGORIES = ["devtools.timeline", "disabled-by-default-devtools.timeline.stack"]
"""The second adds to each event by which lines of code it came about; it costs some ten microseconds each."""
_MICROSECONDS = 1e6

_VAIN_WAITS = 2
"""Waits in a row for the timers of some code, after actions on one element, that end the waiting for them."""

_VAIN_WAITS_ANYWHERE = 5
"""The same, whatever was acted on."""

_Key = tuple[int, str, int]
"""Process, frame or thread, and the number of a timer in it."""


class Timer(msgspec.Struct, frozen=True):
    """A timer that is set. Times are those of ``time.monotonic()``, in seconds.

    Attributes:
        due: when it fires, for the first time if it repeats.
        delay: between setting and firing.
        root: when the chain of timers began that it was set in; a timer that fires may set the next.
        origin: the lines of code that set it, the calling ones included: a function that many share, say one
            that delays others, is not all there is to tell them apart.
    """

    due: float
    delay: float
    repeats: bool
    root: float
    origin: str = ""

    def next(self, now: float) -> Timer:
        """The timer, if it repeats at its next time after ``now``."""
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
    is_main_frame: bool = False
    is_outermost_main_frame: bool = False
    stack_trace: tuple[_Call, ...] = ()


class _Args(msgspec.Struct, frozen=True):
    data: _Data = _Data()


class _Event(msgspec.Struct, frozen=True):
    name: str
    ph: str = ""
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
    """Timers that bring nothing to see, known by the code that sets them and by what was acted on. Neither
    the delay nor the line alone tells a search that waits for the next key from what counts clicks."""

    def __init__(self) -> None:
        self.vain: dict[tuple[object, ...], int] = {}
        """Waits in a row that brought nothing."""

    def is_known(self, timer: Timer, target: str) -> bool:
        """Whether this one is not worth waiting for after an action on ``target``."""
        return any(self.vain.get(key, 0) >= most for key, most in self._keys(timer, target))

    def learn(self, timers: Iterable[Timer], target: str, *, brought: bool) -> None:
        """Whether waiting for these, which fire together, brought anything."""
        for key in {key for timer in timers for key, _ in self._keys(timer, target)}:
            if brought:
                self.vain.pop(key, None)
            else:
                self.vain[key] = self.vain.get(key, 0) + 1

    @staticmethod
    def _keys(timer: Timer, target: str) -> tuple[tuple[tuple[object, ...], int], ...]:
        code = timer.origin or timer.delay
        return ((code, timer.delay, target), _VAIN_WAITS), ((code,), _VAIN_WAITS_ANYWHERE)


class Timers:
    """The timers of one browser's pages.

    Args:
        connection: the browser's.
        config: the slot's limits.
    """

    def __init__(self, connection: Connection, config: BrowserConfig) -> None:
        self._connection = connection
        self._buffer_kilobytes = config.trace_kilobytes
        self._seconds = config.trace_seconds
        self._is_wanted = False
        self._is_on = False
        self._was_full = False
        """Whether the last trace had lost its beginning."""
        self._has_ended = asyncio.Event()
        self._has_ended.set()
        self._events: list[_Event] = []
        self._set: dict[_Key, Timer] = {}
        connection.on("Tracing.dataCollected", _Collected, lambda data: self._events.extend(data.value))
        connection.on("Tracing.tracingComplete", _Complete, self._on_complete)

    def start(self) -> None:
        """Let the trace run. To be called when the page's renderer is there: one that comes later holds up
        the first reading by seconds."""
        self._is_wanted = True
        if self._is_on or not self._has_ended.is_set():
            return
        self._is_on = True
        trace = {
            "recordMode": "recordContinuously",
            "traceBufferSizeInKb": self._buffer_kilobytes,
            "includedCategories": _CATEGORIES,
            "excludedCategories": ["*"],
        }
        self._connection.send("Tracing.start", {"transferMode": "ReportEvents", "traceConfig": trace})

    async def stop(self) -> None:
        """End the trace. To be called while the page's renderer is there."""
        self._is_wanted = False
        self._set.clear()
        await self._end()

    async def read(self) -> float | None:
        """Read the trace and update the known timers. If that takes too long, they stay as they are.

        What happens while the trace is read, for some milliseconds, is not seen.

        Returns:
            How many timers were set since it was read last, at most: infinity if the ring has lost its
            beginning. ``None`` if it could not be read.
        """
        is_read = await self._end()
        events, self._events = self._events, []
        if not is_read:
            return None
        self._enter(events)
        return math.inf if self._was_full else sum(event.name == "TimerInstall" for event in events)

    async def _end(self) -> bool:
        """End the trace; whether it was there in time. It goes on once it has ended, if it is wanted."""
        if not self._is_on:
            return False
        self._is_on = False
        self._events.clear()
        self._has_ended.clear()
        self._connection.send("Tracing.end")
        try:
            async with asyncio.timeout(self._seconds):
                await self._has_ended.wait()
        except TimeoutError:
            log.info("the browser's trace could not be read within %g s", self._seconds)
            return False
        return True

    def _on_complete(self, complete: _Complete) -> None:
        self._was_full = complete.data_loss_occurred
        self._has_ended.set()
        if self._is_wanted:
            self.start()

    def pending(self, since: float) -> list[Timer]:
        """What is set and not fired, in chains that began after ``since``, the soonest first."""
        found = (timer for timer in self._set.values() if timer.root >= since)
        return sorted(found, key=lambda timer: timer.due)

    # --- the records --------------------------------------------------------------------------------

    def _enter(self, events: list[_Event]) -> None:
        firing: dict[int, tuple[float, float]] = {}
        """By thread: until when a timer's function runs, and where its chain began."""
        for event in sorted((one for one in events if one.name in _NAMES), key=lambda one: one.ts):
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
                    root = fired.root if fired is not None else now  # set while nobody looked
                    firing[event.tid] = (now + event.dur / _MICROSECONDS, root)
                case "CommitLoad":  # a new document: what the old one had planned is off
                    self._forget(event.pid, "" if data.is_outermost_main_frame else place)
        self._prune()

    def _forget(self, process: int, place: str) -> None:
        self._set = {
            key: timer for key, timer in self._set.items() if key[0] != process or place not in ("", key[1])
        }

    def _prune(self) -> None:
        """A timer whose end was lost from the ring is not kept for ever."""
        old = time.monotonic() - self._seconds
        self._set = {key: timer for key, timer in self._set.items() if timer.repeats or timer.due > old}
