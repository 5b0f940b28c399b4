"""Websites that blocked the agent are left out for a while."""

from __future__ import annotations

from pathlib import Path

import pytest

from webgym.core.errors import ConfigError, StoreError
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.websites import host_of
from webgym.offline.config import SitesConfig
from webgym.rollout.blocklist import Blocklist, BlocklistConfig
from webgym.run.choice import choose_tasks
from webgym.run.collect import collect
from webgym.run.config import RunConfig, ServerChoice, TaskChoice
from webgym.tasks.formats import write_tasks


class Clock:
    now = 1_000_000.0

    def __call__(self) -> float:
        return self.now


def made(file: Path | None, clock: Clock, hours: float = 12.0) -> Blocklist:
    return Blocklist(BlocklistConfig(file=file, hours=hours), clock)


def test_a_website_is_left_out_for_twelve_hours(tmp_path: Path) -> None:
    clock, file = Clock(), tmp_path / "below" / "blocked.jsonl"
    made(file, clock).add("https://www.shop.example/a?b", "a challenge")
    blocklist = made(file, clock)
    assert blocklist.is_blocked("http://shop.example:8080/")
    assert not blocklist.is_blocked("https://mobile.shop.example/")  # another host has blocked nobody
    assert not blocklist.is_blocked("https://other.example/")
    (block,) = blocklist.blocked().values()
    assert (block.host, block.at, block.reason) == ("shop.example", clock.now, "a challenge")
    assert blocklist.description() == "shop.example until 1970-01-13 01:46 UTC"
    clock.now += 11 * 3600
    assert blocklist.is_blocked("shop.example")
    made(file, clock).add("shop.example", "again")
    clock.now += 11 * 3600
    assert blocklist.blocked()["shop.example"].reason == "again"
    clock.now += 3600
    assert not blocklist.is_blocked("shop.example")


def test_of_many_the_last_are_told_by_name(tmp_path: Path) -> None:
    clock = Clock()
    blocklist = made(tmp_path / "blocked.jsonl", clock)
    assert blocklist.description() == ""
    for number in range(7):
        clock.now += 60
        blocklist.add(f"s{number}.example", "x")
    told = blocklist.description().split(", ")
    assert [each.partition(" ")[0] for each in told[:5]] == [
        f"s{number}.example" for number in (6, 5, 4, 3, 2)
    ]
    assert told[5:] == ["and 2 others"]


def test_a_torn_line_swallows_nothing(tmp_path: Path) -> None:
    clock, file = Clock(), tmp_path / "blocked.jsonl"
    made(file, clock).add("a.example", "x")
    file.write_bytes(file.read_bytes() + b'{"host":"\xff","at":1,"why":""}\n{"host":"b.exam')
    made(file, clock).add("c.example", "x")
    assert set(made(file, clock).blocked()) == {"a.example", "c.example"}


def test_without_a_file_nothing_is_noted(tmp_path: Path) -> None:
    blocklist = made(None, Clock())
    blocklist.add("a.example", "x")
    assert blocklist.blocked() == {}
    with pytest.raises(StoreError):
        made(tmp_path, Clock()).blocked()


def test_tasks_of_blocked_websites_are_not_drawn(tmp_path: Path) -> None:
    rubric = Rubric((FactGroup(1, "", ("it is found",)),))
    tasks = [
        Task(f"made-up/{host}", "Find it.", f"https://{host}/", "Misc.", "News", rubric, "made-up")
        for host in ("a.example", "www.b.example", "c.example")
    ]
    write_tasks(tmp_path / "tasks.jsonl", tasks)
    kept = BlocklistConfig(file=tmp_path / "blocked.jsonl")
    config = RunConfig(tasks=TaskChoice(file=tmp_path / "tasks.jsonl"), blocklist=kept)
    Blocklist(kept).add("https://b.example/", "x")
    assert {task.id for task in choose_tasks(config).tasks} == {"made-up/a.example", "made-up/c.example"}
    for host in ("a.example", "c.example"):
        Blocklist(kept).add(host, "x")
    with pytest.raises(ConfigError, match="blocked"):
        choose_tasks(config)


async def test_a_run_says_who_is_left_alone_and_until_when(tmp_path: Path) -> None:
    kept = BlocklistConfig(file=tmp_path / "blocked.jsonl")
    config = RunConfig(
        server=ServerChoice(static=True),
        sites=SitesConfig(collection="small", per_family=1),
        tasks=TaskChoice(count=1),
        blocklist=kept,
    )
    Blocklist(kept).add(host := host_of(choose_tasks(config).tasks[0].website), "x")
    told: list[str] = []
    await collect(config, tmp_path / "run", tell=told.append)
    [line] = [line for line in told if line.startswith("left alone: ")]
    assert line.startswith(f"left alone: {host} until 20")
