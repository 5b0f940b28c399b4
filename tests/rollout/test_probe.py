"""``webgym tasks probe``: which websites of a task set still answer."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
import pytest
from tests.rollout.test_attempt import Pages
from tests.rollout.test_summary import task
from typer.testing import CliRunner

from webgym.cli import app
from webgym.core.action import BrowserAction
from webgym.core.errors import BrowserCrashed
from webgym.core.observation import Fault
from webgym.core.task import Task
from webgym.rollout.site_health import HealthConfig
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
    assert found.hosts == {"answers": 4, "name gone": 1, "not asked": 1}
    assert found.tasks == {"answers": 5, "name gone": 1, "not asked": 1}
    assert ("answers", "4", "66.7%", "5", "71.4%") in found.table().rows
    slots.asked.clear()
    slots.lost.clear()
    found = await probe(TASKS, config(tmp_path), per_second=1000)  # the same again asks what is missing
    assert slots.asked == ["crashes.test"]
    assert found.hosts == {"answers": 5, "name gone": 1}
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


@pytest.mark.browser
def test_the_command_asks_in_browsers_and_reports(tmp_path: Path) -> None:
    tasks: list[Task] = [
        task("a", 1, website="http://gone-1.test"),
        task("b", 1, website="http://gone-2.test"),
    ]
    write_tasks(tmp_path / "tasks.jsonl", tasks)
    (tmp_path / "live.yaml").write_text("browser: {egress: {allow: ['*.test=nowhere']}}\n")
    out = tmp_path / "sites.jsonl"
    command = ["tasks", "probe", str(tmp_path / "tasks.jsonl"), "--out", str(out), "--rate", "50"]
    result = CliRunner().invoke(app, [*command, "--config", str(tmp_path / "live.yaml"), "--sessions", "1"])
    assert result.exit_code == 0, result.output
    assert "name gone" in result.stdout
    assert "2 of 2 hosts asked" in result.stderr
    rows = [msgspec.json.decode(line) for line in out.read_bytes().splitlines()]
    assert {(row["host"], row["dead"], row["code"]) for row in rows} == {
        (f"gone-{number}.test", 1, "name_gone") for number in (1, 2)
    }
    result = CliRunner().invoke(app, command[:3])
    assert result.exit_code != 0
