"""``webgym tasks probe``: which websites of a task set still answer."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.types import Receive, Scope, Send
from tests.conftest import Calls
from tests.rollout.test_attempt import Pages
from tests.rollout.test_summary import task
from tests.serving import serving

from webgym.browser.config import BrowserConfig
from webgym.core.action import BrowserAction
from webgym.core.errors import BrowserCrashed
from webgym.core.observation import Fault
from webgym.rollout.config import CollectorConfig
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.run import probe as module
from webgym.run.config import RunConfig
from webgym.run.probe import probe
from webgym.server.messages import SessionOptions, View
from webgym.tasks.formats import write_tasks

GONE, CRASHES = "http://gone.test/", "http://crashes.test/"
WEBSITES = ["http://a.test/", "http://m.a.test/", "http://b.test/", GONE, CRASHES, "http://c.test/"]
TASKS = [
    task(f"t{number}", 1, website=website) for number, website in enumerate([*WEBSITES, "http://b.test/x"])
]


class Slots:
    """Browsers that note what is open at the same time.

    Attributes:
        asked: the hosts whose start page was opened, in order.
        most: most pages of a website that were open at once.
        lost: the hosts whose browser crashes.
    """

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.most = 0
        self.lost = {"crashes.test"}
        self._open: dict[str, int] = {}
        self.hold = asyncio.Event()
        self.hold.set()

    async def open(self, options: SessionOptions | None = None) -> _Page:
        del options
        return _Page(self)


class _Page(Pages):
    def __init__(self, slots: Slots) -> None:
        super().__init__()
        self._slots = slots

    async def step(self, action: BrowserAction | None = None) -> View:
        url = action.url  # type: ignore[union-attr]
        host = url.split("/")[2]
        site = host.removeprefix("m.")
        if self.looks == 0:
            self._slots.asked.append(host)
        if host in self._slots.lost:
            raise BrowserCrashed("it crashed")
        self._slots._open[site] = self._slots._open.get(site, 0) + 1
        self._slots.most = max(self._slots.most, self._slots._open[site])
        await asyncio.sleep(0.01)
        await self._slots.hold.wait()
        self._slots._open[site] -= 1
        view = await super().step(action)
        if url == GONE:
            fault = Fault("connection", url, "net::ERR_NAME_NOT_RESOLVED", error="ERR_NAME_NOT_RESOLVED")
            return View(msgspec.structs.replace(view.observation, status=None, faults=(fault,)), view.image)
        return View(msgspec.structs.replace(view.observation, url=url, text="Welcome"), view.image)


@pytest.fixture
def slots(monkeypatch: pytest.MonkeyPatch) -> Slots:
    made = Slots()

    @asynccontextmanager
    async def opened(*_: object, **__: object) -> AsyncIterator[tuple[None, Slots]]:
        yield None, made

    monkeypatch.setattr(module, "open_services", opened)
    return made


def config(tmp_path: Path) -> RunConfig:
    return RunConfig(health=HealthConfig(file=tmp_path / "sites.jsonl"))


async def test_every_host_is_asked_once_and_a_website_never_twice_at_a_time(
    slots: Slots, tmp_path: Path
) -> None:
    shown: list[tuple[int, int]] = []
    found = await probe(
        TASKS, config(tmp_path), per_second=1000, advance=lambda done, total: shown.append((done, total))
    )
    assert sorted(slots.asked) == sorted(website.split("/")[2] for website in WEBSITES)
    assert slots.most == 1
    assert shown[-1] == (6, 6)
    assert found.rows == [
        ("answers", "4", "66.7%", "5", "71.4%"),
        ("name gone", "1", "16.7%", "1", "14.3%"),
        ("not asked", "1", "16.7%", "1", "14.3%"),
    ]
    slots.asked.clear()
    slots.lost.clear()
    found = await probe(TASKS, config(tmp_path), per_second=1000)  # the same again asks what is missing
    assert slots.asked == ["crashes.test"]
    assert [row[:2] for row in found.rows] == [("answers", "5"), ("name gone", "1")]
    await probe(TASKS, config(tmp_path), per_second=1000, older_than_hours=0)
    assert len(slots.asked) == 7


async def test_a_probe_that_is_killed_has_what_was_found_on_disk(slots: Slots, tmp_path: Path) -> None:
    def stop(done: int, _: int) -> None:
        if done == 2:
            slots.hold.clear()  # the others are in flight for ever

    running = asyncio.create_task(probe(TASKS, config(tmp_path), per_second=200, advance=stop))
    while slots.hold.is_set():
        await asyncio.sleep(0.01)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    asked, slots.asked = slots.asked, []
    slots.hold.set()
    slots.lost.clear()
    await probe(TASKS, config(tmp_path), per_second=1000)
    assert len(set(asked) | set(slots.asked)) == 6
    assert 3 <= len(slots.asked) <= 4


async def test_start_pages_are_opened_at_a_rate(slots: Slots, tmp_path: Path) -> None:
    loop = asyncio.get_running_loop()
    began = loop.time()
    await probe(TASKS, config(tmp_path), per_second=20)
    assert loop.time() - began >= 5 / 20


ROBOTS = {
    "closed": "User-agent: *\nDisallow: /\n",
    "closed-to-us": "User-agent: webgym\nDisallow: /\n\nUser-agent: *\nAllow: /\n",
    "inside": "User-agent: *\nDisallow: /admin\n",
    "none": "",
}


@pytest.mark.browser
async def test_a_robots_txt_is_respected_if_that_is_asked_for(tmp_path: Path) -> None:
    asked: list[str] = []

    async def website(scope: Scope, receive: Receive, send: Send) -> None:
        url = Request(scope).url
        name = (url.hostname or "").partition(".")[0]
        asked.append(f"{name}{url.path}")
        robots = Response(ROBOTS[name], 200 if ROBOTS[name] else 404, media_type="text/plain")
        await (robots if url.path == "/robots.txt" else HTMLResponse("Welcome"))(scope, receive, send)

    async with serving(lambda port: port, lambda _: website) as port:
        browser = BrowserConfig().allowing(f"*.robots.test=127.0.0.1:{port}")
        run = config(tmp_path).model_copy(
            update={"browser": browser, "collector": CollectorConfig(sessions=1)}
        )
        tasks = [task(name, 1, website=f"http://{name}.robots.test/") for name in ROBOTS]
        found = await probe(tasks, run, per_second=100, robots=True)
    assert [row[:2] for row in found.rows] == [("answers", "2"), ("robots", "2")]
    assert not {"closed/", "closed-to-us/"} & set(asked)
    assert {"inside/", "none/"} <= set(asked)
    health = SiteHealth(run.health, identity="desktop", now=lambda: 1e12)
    assert set(health.blocked()) == {"closed.robots.test", "closed-to-us.robots.test"}
    assert "closed.robots.test for good" in health.description()


@pytest.mark.browser
def test_the_command_asks_in_browsers_and_reports(calls: Calls, tmp_path: Path) -> None:
    tasks = [task(name, 1, website=f"http://{name}.test") for name in ("gone-1", "gone-2")]
    write_tasks(tmp_path / "tasks.jsonl", tasks)
    (tmp_path / "live.yaml").write_text("browser: {egress: {allow: ['*.test=nowhere']}}\n")
    out = tmp_path / "sites.jsonl"
    command = ["tasks", "probe", tmp_path / "tasks.jsonl", "--config", tmp_path / "live.yaml"]
    code, printed, told = calls.apart(*command, "--out", out, "--rate", "50", "--sessions", "1")
    assert code == 0, told
    assert "name gone" in printed
    assert "2 of 2 hosts asked" in told
    rows = [msgspec.json.decode(line) for line in out.read_bytes().splitlines()]
    assert {(row["host"], row["dead"], row["code"]) for row in rows} == {
        (f"gone-{number}.test", 1, "name_gone") for number in (1, 2)
    }
    code, _, told = calls.apart(*command)
    assert (code, "give --out" in told) == (2, True)
