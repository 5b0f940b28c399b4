"""Asks every website of a task set whether it answers, at a polite rate: ``webgym tasks probe``.

The start page is opened as attempts open it, in the same browsers, and what was found goes to the same file.
That is also the checkpoint: a probe that was killed goes on with the hosts of which it has no row.
"""

from __future__ import annotations

import asyncio
import random
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import msgspec

from webgym.agent.agent import AgentTraits
from webgym.core.calls import call_queues
from webgym.core.errors import BrowserError, LeaseLost, NavigationFailed
from webgym.core.outcome import Outcome
from webgym.core.tables import Table
from webgym.core.task import Task
from webgym.core.trajectory import Trajectory
from webgym.core.websites import host_or_text, site_or_text
from webgym.rollout.driver import Browsers, EpisodeContext, EpisodeDriver, NoStore
from webgym.rollout.plan import Planned
from webgym.rollout.sessions import patiently
from webgym.rollout.site_health import SiteHealth, SiteRow
from webgym.run.choice import health_of
from webgym.run.config import RunConfig, Secrets, Tell, say
from webgym.run.services import open_services


class Classes(NamedTuple):
    """How many websites of a task set answer.

    Attributes:
        hosts: number of hosts by what was last found: ``answers``, ``refused``, why they are dead, or ``not
            asked``; and of those that answer, the ones that are ``slow`` or want an account (``log-in``).
        tasks: number of tasks on them.
    """

    hosts: Counter[str]
    tasks: Counter[str]

    def table(self) -> Table:
        """For people."""
        total, all_tasks = (
            sum(count for name, count in counts.items() if name not in ("slow", "log-in"))
            for counts in (self.hosts, self.tasks)
        )
        order = sorted(self.hosts, key=lambda name: (name != "answers", name in ("slow", "log-in"), name))
        rows = [
            (
                f"  of them {name}" if name in ("slow", "log-in") else name,
                f"{self.hosts[name]:,}",
                f"{self.hosts[name] / total:.1%}",
                f"{self.tasks[name]:,}",
                f"{self.tasks[name] / all_tasks:.1%}",
            )
            for name in order
        ]
        return Table("", ("websites", "hosts", "", "tasks", ""), rows)


def classes_of(tasks: Iterable[Task], rows: Iterable[SiteRow]) -> Classes:
    """Count the websites of tasks by what was last found at them."""
    last: dict[str, SiteRow] = {}
    for row in sorted(rows, key=lambda row: row.seen):
        last[row.host] = row
    on_host = Counter(host_or_text(task.website) for task in tasks)
    hosts, of_tasks = Counter[str](), Counter[str]()
    for host, count in on_host.items():
        for name in _names(last.get(host)):
            hosts[name] += 1
            of_tasks[name] += count
    return Classes(hosts, of_tasks)


def _names(row: SiteRow | None) -> list[str]:
    if row is None:
        return ["not asked"]
    if row.state != "open":
        return [row.code.replace("_", " ") or row.state]
    return ["answers", *["slow"] * (row.slow > 0), *["log-in"] * row.has_login_wall]


async def probe(
    tasks: Sequence[Task],
    config: RunConfig,
    *,
    per_second: float,
    older_than_hours: float | None = None,
    secrets: Secrets | None = None,
    tell: Tell | None = None,
    advance: Callable[[int, int], object] = lambda _done, _total: None,
) -> Classes:
    """Open one start page of every host of a task set; of hosts of one website, one after the other.

    Args:
        tasks: the tasks. Those of the offline web are left out.
        config: ``health.file`` is the file, ``collector.sessions`` the number of browsers.
        per_second: start pages that are opened per second, of all browsers together.
        older_than_hours: ask hosts again that were last asked so long ago; by default, none.
        secrets: tokens of servers that run elsewhere.
        tell: called with each line that the user should read.
        advance: called with the number of hosts asked so far, and of all to ask.

    Raises:
        WebGymError: the browsers cannot be started or reached, or the file cannot be written. What was found
            is on disk.
    """
    live = [task for task in tasks if task.truth is None]
    health = health_of(config)
    rows = await asyncio.to_thread(health.rows)
    sites = _due(live, health.asked_since(rows, older_than_hours))
    total = sum(map(len, sites))
    if rows:
        say(tell, f"{len({row.host for row in rows.values()}):,} hosts were asked before")
    calls = call_queues(dict(config.limits.calls))
    chosen = [task for hosts in sites for task in hosts]
    if chosen:
        async with open_services(config, secrets or Secrets(), chosen, tell, calls, attempts=total) as (
            _,
            client,
        ):
            await _Probing(config, client, health, per_second, tell, advance, total).run(sites)
    await asyncio.to_thread(health.tidy)
    found = await asyncio.to_thread(health.rows)
    return classes_of(live, found.values())


def _due(tasks: Iterable[Task], asked: set[str]) -> list[list[Task]]:
    """A task of each host that is to be asked, by website, in random order: neighbours in a file often share
    a machine."""
    by_site: defaultdict[str, dict[str, Task]] = defaultdict(dict)
    for task in tasks:
        host = host_or_text(task.website)
        if host not in asked:
            of_run = msgspec.structs.replace(task, identity={})
            by_site[site_or_text(task.website)].setdefault(host, of_run)
    sites = [list(hosts.values()) for _, hosts in sorted(by_site.items())]
    random.Random(0).shuffle(sites)
    return sites


class _Probing:
    """A probe in progress."""

    def __init__(
        self,
        config: RunConfig,
        client: Browsers,
        health: SiteHealth,
        per_second: float,
        tell: Tell | None,
        advance: Callable[[int, int], object],
        total: int,
    ) -> None:
        self._config = config
        self._client = client
        self._health = health
        self._pause = 1 / per_second
        self._tell = tell
        self._advance = advance
        self._total = total
        self._done = 0
        self._next = 0.0

    async def run(self, sites: Sequence[Sequence[Task]]) -> None:
        waiting = iter(sites)

        async def work() -> None:
            for hosts in waiting:  # shared: whoever is free takes the next website
                for task in hosts:
                    await self._turn()
                    await self._ask(task)
                    self._done += 1
                    self._advance(self._done, self._total)

        async with asyncio.TaskGroup() as group:
            for _ in range(min(self._config.collector.sessions, len(sites))):
                group.create_task(work())

    async def _turn(self) -> None:
        now = asyncio.get_running_loop().time()
        self._next = max(self._next + self._pause, now)
        await asyncio.sleep(self._next - now)

    async def _ask(self, task: Task) -> None:
        """Open a start page, and record what was found; nothing, if the browser was lost."""
        config = self._config
        context = EpisodeContext(
            store=NoStore(),
            config=config.attempt,
            site_state=None,
            seed=config.seed,
            identity=config.browser.identity,
        )
        driver = EpisodeDriver(context, Planned(task, 0), AgentTraits("probe", "coordinates"))

        async def open_and_start() -> None:
            session = await self._client.open(driver.options())
            try:
                await driver.start(session)
            except (NavigationFailed, BrowserError, LeaseLost) as error:
                driver.fail(error)
            finally:
                await session.close()

        await patiently(
            open_and_start, config.collector, tell=lambda why: say(self._tell, why) if why else None
        )
        found = Trajectory(driver.episode(), Outcome.CANCELLED)
        await asyncio.to_thread(self._health.note, task.website, found)
