"""How often observations are final, and how long the wait for them takes.

Every page is opened and acted on in a new episode, once per round and way of waiting, in a shuffled order.
When the wait ends, a script in the page reads whether its content was final: pages record this themselves,
in a variable that has no effect on any way of waiting.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import statistics
import time
from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import get_args

import msgspec
from benchmarks.settle.hardweb import OTHER_HOST, PAGES, TRUTH, Group, HardPage, HardSite
from pydantic import Field

from webgym.browser.actions import perform
from webgym.browser.cdp import CommandFailed, TargetGone
from webgym.browser.cdp_messages import Evaluated, FrameEvent, RequestDone, RequestFailed, RequestWillBeSent
from webgym.browser.config import BrowserConfig, PageOptions
from webgym.browser.egress.config import EgressConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.find import find_browser
from webgym.browser.page import Page
from webgym.browser.profiles import ProfileRoot
from webgym.browser.settle import settle
from webgym.browser.slot import Slot
from webgym.core.action import BrowserAction, LeftClick, Navigate, Target
from webgym.core.errors import BrowserTimeout, ConfigError, PageError
from webgym.core.settings import Settings
from webgym.core.tables import Table

_NOWHERE = LeftClick(Target(coordinate=(995, 500)))
_IDLE_CLICKS = 3
"""Clicks on empty space before the action, from which our way learns noise, which must not hide content."""


class SettleBench(Settings):
    """Settings of the benchmark."""

    rounds: int = Field(default=3, gt=0)
    """Number of trials per page and way of waiting."""

    seed: int = 0
    """Seed of the order and of the pace of each round."""

    slots: int = Field(default=4, gt=0)
    """Number of parallel browsers. Waiting needs little CPU, so two per core hardly disturb each other."""

    pace: tuple[float, float] = (0.8, 1.25)
    """Range of the factor of all times of a page, which is drawn per page and round."""

    deadline_seconds: float = Field(default=10.0, gt=0)
    """Time limit of the ways of waiting that wait for an event."""

    idle_seconds: float = Field(default=0.5, gt=0)
    """Time without requests after which the network counts as idle, as in Playwright."""

    truth_seconds: float = Field(default=5.0, gt=0)
    """Time limit of the script that reads whether a page is final."""


class Trial(msgspec.Struct, frozen=True):
    """A trial of a page with a way of waiting.

    Attributes:
        seconds: time from the start of the action to the end of the wait.
        is_final: whether the content of the page was final at that time.
        ideal: seconds from the start of the action until the content became final; ``None`` if it had not.
        reason: why the wait ended, if the way of waiting reports it.
    """

    page: str
    group: str
    way: str
    round: int
    seconds: float
    is_final: bool
    ideal: float | None
    reason: str


# --- ways of waiting ------------------------------------------------------------------------------------


class Watch:
    """Tracks the loading of a page by its events, for all ways of waiting except ours."""

    def __init__(self, page: Page) -> None:
        self._main = page.target_id
        self._requests: set[str] = set()
        self._changed = asyncio.Event()
        self.is_loading = False
        on = page.session.on
        on("Page.frameStartedLoading", FrameEvent, lambda event: self._load(event, True))
        on("Page.frameStoppedLoading", FrameEvent, lambda event: self._load(event, False))
        on("Network.requestWillBeSent", RequestWillBeSent, lambda event: self._begin(event.request_id))
        on("Network.loadingFinished", RequestDone, lambda event: self._end(event.request_id))
        on("Network.loadingFailed", RequestFailed, lambda event: self._end(event.request_id))

    def _load(self, event: FrameEvent, is_loading: bool) -> None:
        if event.frame_id == self._main:
            self.is_loading = is_loading
            self._changed.set()

    def _begin(self, request: str) -> None:
        self._requests.add(request)
        self._changed.set()

    def _end(self, request: str) -> None:
        self._requests.discard(request)
        self._changed.set()

    async def load(self) -> None:
        """Wait until no document is loading."""
        while self.is_loading:
            self._changed.clear()
            await self._changed.wait()

    async def idle(self, seconds: float) -> None:
        """Wait until no request has been in flight for ``seconds``."""
        while True:
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(None if self._requests else seconds):
                    await self._changed.wait()
                continue
            return


Wait = Callable[[Page, Watch, SettleBench], Awaitable[str]]


async def _ours(page: Page, _: Watch, __: SettleBench) -> str:
    return await settle(page)


def _fixed(seconds: float) -> Wait:
    async def wait(_: Page, __: Watch, ___: SettleBench) -> str:
        await asyncio.sleep(seconds)
        return "slept"

    return wait


async def _load(page: Page, watch: Watch, bench: SettleBench) -> str:
    with contextlib.suppress(CommandFailed):
        await _evaluate(
            page, "0", bench.truth_seconds
        )  # after this, events caused by the action have arrived
    try:
        async with asyncio.timeout(bench.deadline_seconds):
            await watch.load()
    except TimeoutError:
        return "deadline"
    return "loaded"


async def _network_idle(_: Page, watch: Watch, bench: SettleBench) -> str:
    try:
        async with asyncio.timeout(bench.deadline_seconds):
            await watch.load()
            await watch.idle(bench.idle_seconds)
    except TimeoutError:
        return "deadline"
    return "idle"


WAYS: dict[str, Wait] = {
    "ours": _ours,
    "fixed 1 s": _fixed(1.0),
    "fixed 10 s": _fixed(10.0),
    "load": _load,
    "network idle": _network_idle,
}
"""All ways of waiting, by name. A fixed pause starts when the action has been carried out."""


# --- trials ---------------------------------------------------------------------------------------------


async def _evaluate(page: Page, expression: str, seconds: float) -> msgspec.Raw:
    params = {"expression": expression, "returnByValue": True}
    evaluated = await page.session.call("Runtime.evaluate", params, reply=Evaluated, seconds=seconds)
    return evaluated.result.value


async def truth(page: Page, seconds: float) -> float | None:
    """The time at which the page became final, in seconds since the epoch; ``None`` if it is not final."""
    try:
        value = await _evaluate(page, TRUTH, seconds)
    except (CommandFailed, BrowserTimeout):
        return None  # navigating to another document, or busy
    milliseconds = msgspec.json.decode(value, type=float | None)
    return None if milliseconds is None else milliseconds / 1000


async def _do(page: Page, action: BrowserAction) -> None:
    page.begin_action()
    with contextlib.suppress(PageError):
        await perform(page, action)


async def run_trial(
    slot: Slot, hard: HardPage, way: str, origin: str, pace: float, bench: SettleBench, number: int = 0
) -> Trial:
    """Open a page in a new episode, act, wait, and read whether it is final."""
    await slot.open(PageOptions())
    try:
        page = slot.page
        watch = Watch(page)
        if hard.action != "open":
            await _do(page, Navigate(hard.url(origin, pace)))
            await settle(page)
        for _ in range(_IDLE_CLICKS if hard.group == "apps" else 0):
            await _do(page, _NOWHERE)
            await settle(page)
        began, start = time.time(), time.perf_counter()
        await _do(page, hard.act(origin, pace))
        try:
            reason = await WAYS[way](page, watch, bench)
        except TargetGone:
            reason = "crashed"
        seconds = time.perf_counter() - start
        at = await truth(page, bench.truth_seconds)
    finally:
        await slot.close()
    ideal = None if at is None else max(0.0, at - began)
    return Trial(hard.name, hard.group, way, number, seconds, at is not None, ideal, reason)


def chosen(names: Sequence[str]) -> list[HardPage]:
    """Select pages by name or by group; without names, all pages.

    Raises:
        ConfigError: a name is neither a page nor a group.
    """
    pages = [page for page in PAGES.values() if not names or {page.name, page.group} & set(names)]
    unknown = set(names) - {page.name for page in pages} - {page.group for page in pages}
    if unknown:
        raise ConfigError(
            f"unknown page {min(unknown)!r}", hint=f"give a page or a group ({', '.join(get_args(Group))})"
        )
    return pages


async def run(
    bench: SettleBench,
    pages: Sequence[HardPage],
    ways: Sequence[str],
    browser: Path | None,
    done: Callable[[Trial], None],
) -> list[Trial]:
    """Call :func:`measure` with a server and slots that exist only for this call."""
    chromium = await asyncio.to_thread(find_browser, browser)
    async with contextlib.AsyncExitStack() as stack:
        site = await stack.enter_async_context(HardSite())
        allow = ("127.0.0.1", f"{OTHER_HOST}=127.0.0.1:{site.port}")
        egress = await stack.enter_async_context(Egress(EgressConfig(allow=allow)))
        slots = [Slot(BrowserConfig(), chromium.path, ProfileRoot(), egress) for _ in range(bench.slots)]
        for slot in slots:
            stack.push_async_callback(slot.stop)
            await slot.start()
        return await measure(slots, site, pages, bench, ways=ways, done=done)


async def measure(
    slots: Sequence[Slot],
    site: HardSite,
    pages: Sequence[HardPage],
    bench: SettleBench,
    *,
    ways: Iterable[str] = WAYS,
    done: Callable[[Trial], None] = lambda _: None,
) -> list[Trial]:
    """Run all trials, in an order that is determined by the seed.

    Args:
        slots: each runs one trial at a time.
        site: serves the pages.
        pages: to be tried.
        bench: settings.
        ways: of waiting, to be tried.
        done: called with every trial when it has ended.
    """
    chance = random.Random(bench.seed)
    origin = f"http://127.0.0.1:{site.port}"
    plan = []
    for number in range(bench.rounds):
        paces = {page.name: round(chance.uniform(*bench.pace), 3) for page in pages}
        lot = [(page, way, paces[page.name], number) for page in pages for way in ways]
        chance.shuffle(lot)
        plan += lot
    plan.reverse()
    trials: list[Trial] = []

    async def work(slot: Slot) -> None:
        while plan:
            page, way, pace, number = plan.pop()
            trial = await run_trial(slot, page, way, origin, pace, bench, number)
            trials.append(trial)
            done(trial)

    async with asyncio.TaskGroup() as group:
        for slot in slots:
            group.create_task(work(slot))
    return trials


# --- the table ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Row:
    """Results of a way of waiting; times in seconds.

    Attributes:
        final: share of the observations that were final.
        p50, p95: quantiles of the time from the start of the action to the end of the wait.
        over_p50, over_p95: quantiles of the time by which the wait exceeded the ideal, of final observations.
    """

    way: str
    trials: int
    final: float
    p50: float
    p95: float
    over_p50: float
    over_p95: float


def _quantile(values: Sequence[float], share: float) -> float:
    if len(values) < 2:
        return values[0] if values else float("nan")
    return statistics.quantiles(values, n=100, method="inclusive")[round(share * 100) - 1]


def summarize(trials: Sequence[Trial]) -> list[Row]:
    """A row per way of waiting, in the order of :data:`WAYS`."""
    rows = []
    for way in WAYS:
        own = [trial for trial in trials if trial.way == way]
        if not own:
            continue
        seconds = [trial.seconds for trial in own]
        over = [trial.seconds - trial.ideal for trial in own if trial.ideal is not None]
        rows.append(
            Row(
                way,
                len(own),
                sum(trial.is_final for trial in own) / len(own),
                _quantile(seconds, 0.5),
                _quantile(seconds, 0.95),
                _quantile(over, 0.5),
                _quantile(over, 0.95),
            )
        )
    return rows


def settle_tables(trials: Sequence[Trial]) -> list[Table]:
    """Tables of all pages and by group of pages."""
    rows = summarize(trials)
    columns = ("way of waiting", "final", "p50", "p95", "over the ideal p50", "p95")
    whole = [
        (row.way, f"{row.final:.1%}", *map(_seconds, (row.p50, row.p95, row.over_p50, row.over_p95)))
        for row in rows
    ]
    groups = []
    for group in sorted({trial.group for trial in trials}, key=list(get_args(Group)).index):
        own = summarize([trial for trial in trials if trial.group == group])
        groups.append((group, *(f"{row.final:.0%}, {_seconds(row.p50)}" for row in own)))
    ways = tuple(row.way for row in rows)
    pages = len({trial.page for trial in trials})
    return [
        Table(f"Final observations and their delay ({pages} pages)", columns, whole),
        Table("Final observations and p50, by group of pages", ("pages", *ways), groups),
    ]


def _seconds(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.2f} s"


def misses(trials: Sequence[Trial], way: str = "ours") -> list[str]:
    """Names of the pages with a trial that was not final when ``way`` ended."""
    return sorted({trial.page for trial in trials if trial.way == way and not trial.is_final})


def as_json(bench: SettleBench, trials: Sequence[Trial]) -> bytes:
    """Settings, rows and all trials as JSON."""
    rows = [asdict(row) for row in summarize(trials)]
    whole = {"bench": bench.model_dump(), "rows": rows, "trials": list(trials)}
    return msgspec.json.format(msgspec.json.encode(whole), indent=1)
