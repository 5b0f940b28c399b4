"""How often is an observation final, and how long does it take to get there?

Every page of the hard web is opened and acted on in a fresh episode, once per round and per way of waiting,
in a shuffled order. When the wait ends the page is asked, in its own world, whether its content was final;
the page knows by itself, and keeps it in a variable that no way of waiting sees.
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
from webgym.settings import Settings
from webgym.tables import Table

_NOWHERE = LeftClick(Target(coordinate=(995, 500)))
_IDLE_CLICKS = 3
"""Clicks on nothing in an application before the action: what is learned of its noise must hide nothing."""


class SettleBench(Settings):
    """What is measured."""

    rounds: int = Field(default=3, gt=0)
    """Times that each page meets each way of waiting."""

    seed: int = 0
    """Of the order, and of each round's pace."""

    slots: int = Field(default=4, gt=0)
    """Browsers at once. Waiting costs next to nothing, so two per core do not disturb each other much."""

    pace: tuple[float, float] = (0.8, 1.25)
    """All times of all pages are multiplied by a number from this range, drawn once per page and round."""

    deadline_seconds: float = Field(default=10.0, gt=0)
    """Of the ways of waiting that wait for something."""

    idle_seconds: float = Field(default=0.5, gt=0)
    """How long the network is idle before it is called so, as Playwright has it."""

    truth_seconds: float = Field(default=5.0, gt=0)
    """For a page to say whether it is final."""


class Trial(msgspec.Struct, frozen=True):
    """One page, one way of waiting, once.

    Attributes:
        seconds: from the start of the action to the end of the wait.
        is_final: whether the page's content was final then.
        ideal: from the start of the action to the moment when it became final, seconds; ``None`` where
            it had not.
        reason: why the wait ended, if it says.
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
    """What a page's events say of its loading: the books of the other ways of waiting, apart from ours."""

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
        """Return when no document is being loaded."""
        while self.is_loading:
            self._changed.clear()
            await self._changed.wait()

    async def idle(self, seconds: float) -> None:
        """Return when no request has been in flight for so long."""
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
        await _evaluate(page, "0", bench.truth_seconds)  # what the action set off has been told by then
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
"""All ways of waiting, by the name in the table. A fixed pause begins when the action is carried out."""


# --- one trial ------------------------------------------------------------------------------------------


async def _evaluate(page: Page, expression: str, seconds: float) -> msgspec.Raw:
    params = {"expression": expression, "returnByValue": True}
    evaluated = await page.session.call("Runtime.evaluate", params, reply=Evaluated, seconds=seconds)
    return evaluated.result.value


async def truth(page: Page, seconds: float) -> float | None:
    """When the page became final, seconds since the epoch; ``None`` if it is not."""
    try:
        said = await _evaluate(page, TRUTH, seconds)
    except (CommandFailed, BrowserTimeout):
        return None  # on its way to another document, or busy
    milliseconds = msgspec.json.decode(said, type=float | None)
    return None if milliseconds is None else milliseconds / 1000


async def _do(page: Page, action: BrowserAction) -> None:
    page.begin_action()
    with contextlib.suppress(PageError):
        await perform(page, action)


async def run_trial(
    slot: Slot, hard: HardPage, way: str, origin: str, pace: float, bench: SettleBench, number: int = 0
) -> Trial:
    """One page in a fresh episode: act, wait, ask."""
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
    """Pages by their names, or by the names of their groups; all of them if there are none.

    Raises:
        ConfigError: there is no such page or group.
    """
    pages = [page for page in PAGES.values() if not names or {page.name, page.group} & set(names)]
    unknown = set(names) - {page.name for page in pages} - {page.group for page in pages}
    if unknown:
        raise ConfigError(
            f"there is no page {min(unknown)!r}", hint=f"a group ({', '.join(get_args(Group))}) or a page"
        )
    return pages


async def run(
    bench: SettleBench,
    pages: Sequence[HardPage],
    ways: Sequence[str],
    browser: Path | None,
    done: Callable[[Trial], None],
) -> list[Trial]:
    """:func:`measure` with a server and slots of its own, which are gone afterwards."""
    found = await asyncio.to_thread(find_browser, browser)
    async with contextlib.AsyncExitStack() as stack:
        site = await stack.enter_async_context(HardSite())
        allow = ("127.0.0.1", f"{OTHER_HOST}=127.0.0.1:{site.port}")
        egress = await stack.enter_async_context(Egress(EgressConfig(allow=allow)))
        slots = [Slot(BrowserConfig(), found.path, ProfileRoot(), egress) for _ in range(bench.slots)]
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
    """All pages with all ways of waiting, ``rounds`` times, in an order that the seed says.

    Args:
        slots: as many trials run at once.
        done: called with each trial when it has ended.
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
    """What one way of waiting did; seconds.

    Attributes:
        final: share of the observations that were final.
        p50, p95: from the start of the action to the end of the wait.
        over_p50, over_p95: beyond the moment at which the page was final, where it was.
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
    """One row per way of waiting, in the order of :data:`WAYS`."""
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
    """Over all pages, and group by group."""
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
        Table(f"Is the observation final, and when ({pages} pages)", columns, whole),
        Table("Final, and p50, by what is hard", ("pages", *ways), groups),
    ]


def _seconds(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.2f} s"


def misses(trials: Sequence[Trial], way: str = "ours") -> list[str]:
    """Names of the pages that were not always final when ``way`` ended."""
    return sorted({trial.page for trial in trials if trial.way == way and not trial.is_final})


def as_json(bench: SettleBench, trials: Sequence[Trial]) -> bytes:
    """Settings, rows and every trial."""
    rows = [asdict(row) for row in summarize(trials)]
    whole = {"bench": bench.model_dump(), "rows": rows, "trials": list(trials)}
    return msgspec.json.format(msgspec.json.encode(whole), indent=1)
