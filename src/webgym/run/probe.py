"""Asks every website of a task set whether it answers, at a polite rate: ``webgym tasks probe``.

The start page is opened as attempts open it, in the same browsers, and what was found goes to the same file.
That is also the checkpoint: a probe that was killed goes on with the hosts of which it has no row.
"""

from __future__ import annotations

import asyncio
import random
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Final, cast
from urllib.parse import urljoin
from urllib.robotparser import RobotFileParser

import msgspec

from webgym.agent.agent import AgentTraits
from webgym.browser.document import ReadRequest
from webgym.core.action import Navigate
from webgym.core.calls import call_queues
from webgym.core.errors import BrowserError, LeaseLost, NavigationFailed
from webgym.core.outcome import Outcome
from webgym.core.tables import Table
from webgym.core.task import Task
from webgym.core.trajectory import Arrival, Trajectory
from webgym.core.websites import host_or_text, site_or_text
from webgym.rollout.driver import Browsers, BrowserSession, EpisodeContext, EpisodeDriver, NoStore
from webgym.rollout.plan import Planned
from webgym.rollout.sessions import patiently
from webgym.rollout.site_health import SiteHealth, SiteRow
from webgym.run.choice import health_of
from webgym.run.config import RunConfig, Secrets, Tell, say
from webgym.run.services import open_services
from webgym.server.client import Session

_ROBOT: Final = "WebGym"
"""Name to which a robots.txt may speak."""

_ROBOTS_LINES: Final = 10_000


def table_of(tasks: Sequence[Task], rows: Iterable[SiteRow]) -> Table:
    """How many websites of a task set answer, and why the others do not, by what was last found there.

    Args:
        tasks: the set.
        rows: what was found.
    """
    last = {row.host: row for row in sorted(rows, key=lambda row: row.seen)}
    tasks_on = Counter(host_or_text(task.website) for task in tasks)
    hosts, on_them = Counter[str](), Counter[str]()
    for host, count in tasks_on.items():
        for name in _classes(last.get(host)):
            hosts[name] += 1
            on_them[name] += count
    order = sorted(hosts, key=lambda name: (not name.startswith("answers"), name))
    counts = ((name, (hosts[name], len(tasks_on)), (on_them[name], len(tasks))) for name in order)
    rows_of_text = [
        (name, f"{some:,}", f"{some / all_:.1%}", f"{few:,}", f"{few / total:.1%}")
        for name, (some, all_), (few, total) in counts
    ]
    return Table("", ("websites", "hosts", "share", "tasks", "share"), rows_of_text)


def _classes(row: SiteRow | None) -> list[str]:
    if row is None:
        return ["not asked"]
    if row.state != "open":
        return [row.code.replace("_", " ") or row.state]
    more = {"answers slowly": row.slow, "answers, and wants an account": row.has_login_wall}
    return ["answers", *(name for name, is_so in more.items() if is_so)]


async def probe(
    tasks: Sequence[Task],
    config: RunConfig,
    *,
    per_second: float,
    older_than_hours: float | None = None,
    robots: bool = False,
    secrets: Secrets | None = None,
    tell: Tell | None = None,
    advance: Callable[[int, int], object] = lambda _done, _total: None,
) -> Table:
    """Open one start page of every host of a task set; of hosts of one website, one after the other.

    Args:
        tasks: the tasks. Those of the offline web are left out.
        config: ``health.file`` is the file, ``collector.sessions`` the number of browsers.
        per_second: start pages that are opened per second, of all browsers together.
        older_than_hours: ask hosts again that were last asked so long ago; by default, none.
        robots: open no start page that its robots.txt asks WebGym, or all robots, not to open.
        secrets: tokens of servers that run elsewhere.
        tell: called with each line that the user should read.
        advance: called with the number of hosts asked so far, and of all to ask.

    Returns:
        How many websites answer.

    Raises:
        WebGymError: the browsers cannot be started or reached, or the file cannot be written. What was found
            is on disk.
    """
    live, health = [task for task in tasks if task.truth is None], health_of(config)
    sites = _due(live, await asyncio.to_thread(health.asked, older_than_hours))
    chosen, calls = [task for hosts in sites for task in hosts], call_queues(dict(config.limits.calls))
    if chosen:
        opened = open_services(config, secrets or Secrets(), chosen, tell, calls, attempts=len(chosen))
        async with opened as (_, client), asyncio.TaskGroup() as group:
            probing = _Probing(config, client, health, 1 / per_second, robots, tell)
            waiting = iter(sites)  # shared: whoever is free takes the next website

            async def work() -> None:
                for hosts in waiting:
                    for task in hosts:
                        await probing.ask(task)
                        advance(probing.done, len(chosen))

            for _ in range(config.collector.sessions):
                group.create_task(work())
    await asyncio.to_thread(health.tidy)
    return table_of(live, (await asyncio.to_thread(health.rows)).values())


def _due(tasks: Iterable[Task], asked: set[str]) -> list[list[Task]]:
    """A task of each host that is to be asked, by website, in random order: neighbours in a file often share
    a machine."""
    by_site: defaultdict[str, dict[str, Task]] = defaultdict(dict)
    for task in tasks:
        if (host := host_or_text(task.website)) not in asked:
            of_run = msgspec.structs.replace(task, identity={})
            by_site[site_or_text(task.website)].setdefault(host, of_run)
    sites = [list(hosts.values()) for _, hosts in sorted(by_site.items())]
    random.Random(0).shuffle(sites)
    return sites


@dataclass
class _Probing:
    """A probe in progress.

    Attributes:
        pause: from one start page to the next, seconds.
        robots: whether robots.txt is respected.
        done: number of hosts asked.
        next_at: when the next may be asked, event loop time.
    """

    config: RunConfig
    client: Browsers
    health: SiteHealth
    pause: float
    robots: bool
    tell: Tell | None
    done: int = field(default=0, init=False)
    next_at: float = field(default=0.0, init=False)

    async def ask(self, task: Task) -> None:
        """Open a start page when it is its turn, and record what was found; nothing, if the browser was
        lost."""
        now = asyncio.get_running_loop().time()
        self.next_at = max(self.next_at + self.pause, now)
        await asyncio.sleep(self.next_at - now)
        config, told = self.config, self.tell
        identity, limits, seed = config.browser.identity, config.attempt, config.seed
        context = EpisodeContext(
            store=NoStore(), config=limits, site_state=None, seed=seed, identity=identity
        )
        driver = EpisodeDriver(context, Planned(task, 0), AgentTraits("probe", "coordinates"))

        async def start() -> None:
            session = await self.client.open(driver.options())
            try:
                if not self.robots or await _may_open(session, driver):
                    await driver.start(session)
            except (NavigationFailed, BrowserError, LeaseLost) as error:
                driver.fail(error)
            finally:
                await session.close()

        await patiently(start, config.collector, tell=lambda why: say(told, why) if why else None)
        found = Trajectory(driver.episode(), Outcome.CANCELLED)
        await asyncio.to_thread(self.health.note, task.website, found)
        self.done += 1


async def _may_open(session: BrowserSession, driver: EpisodeDriver) -> bool:
    """Whether a website's robots.txt lets robots open the start page. Without one, they may."""
    seen = (await session.step(Navigate(urljoin(driver.start_url, "/robots.txt")))).observation
    if seen.status != HTTPStatus.OK:
        return True
    rules = RobotFileParser()
    rules.parse((await cast(Session, session).read(ReadRequest(lines=_ROBOTS_LINES))).text.splitlines())
    if rules.can_fetch(_ROBOT, driver.start_url):
        return True
    driver.arrival = Arrival("dead", "robots", "its robots.txt says so", identity=driver.identity)
    return False
