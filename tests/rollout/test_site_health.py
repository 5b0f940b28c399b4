"""Which websites refuse or are dead is recorded, and they are left out for a while."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.rollout.running import small_run

from webgym.core.errors import ConfigError, StoreError
from webgym.core.identity import Identity
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Arrival, Episode, Trajectory
from webgym.core.websites import host_of
from webgym.rollout.site_health import HealthConfig, SiteHealth, SiteRow
from webgym.run.choice import choose_tasks
from webgym.run.collect import collect
from webgym.run.config import RunConfig, TaskChoice
from webgym.tasks.formats import write_tasks

HOUR = 3600


class Clock:
    now = 1_000_000.0

    def __call__(self) -> float:
        return self.now


def made(file: Path | None, clock: Clock, hours: float = 12.0, identity: str = "desktop") -> SiteHealth:
    return SiteHealth(HealthConfig(file=file, refused_hours=hours), identity=identity, now=clock)


def visit(arrival: Arrival, **traffic: int) -> Trajectory:
    """An attempt of which no more matters than what it found."""
    seen = Observation(
        "0" * 64, "http://a.test/", "", (1, 1), bytes={k.replace("_", "."): v for k, v in traffic.items()}
    )
    episode = Episode("t#0.0", "t", 0, 0, 0, "p", 0.0, 1.0, (), Ending.CANCELLED, seen, arrival=arrival)
    return Trajectory(episode, Outcome.CANCELLED)


OPEN = Arrival("open", identity="desktop")
REFUSED = Arrival("refused", why="status 403", identity="desktop")
GONE = Arrival("dead", "name_gone", "net::ERR_NAME_NOT_RESOLVED", identity="desktop")


def test_a_website_that_refuses_is_left_out_for_twelve_hours(tmp_path: Path) -> None:
    clock, file = Clock(), tmp_path / "below" / "sites.jsonl"
    made(file, clock).note("https://www.shop.example/a?b", visit(REFUSED))
    health = made(file, clock)
    (row,) = health.blocked().values()  # and no other host of the website
    assert (row.host, row.refused_at, row.why) == ("shop.example", clock.now, "status 403")
    assert health.description() == "shop.example until 1970-01-13 01:46 UTC"
    assert not made(file, clock, identity="shell").blocked()  # which it may let in
    clock.now += 11 * HOUR
    health.note("shop.example", visit(OPEN))  # a test task's attempt
    assert list(health.blocked()) == ["shop.example"]
    health.note("shop.example", visit(REFUSED))
    clock.now += 12 * HOUR - 1
    assert list(health.blocked()) == ["shop.example"]
    clock.now += 1
    assert not health.blocked()


def test_the_time_that_a_dead_website_is_left_out_grows_until_it_opens(tmp_path: Path) -> None:
    clock = Clock()
    health = made(tmp_path / "sites.jsonl", clock)
    for hours in (1, 6, 24, 168, 168):
        for _ in range(8):  # attempts at the same task find the same death
            health.note("gone.example", visit(GONE))
        clock.now += hours * HOUR - 1
        assert list(made(tmp_path / "sites.jsonl", clock, identity="shell").blocked()) == ["gone.example"]
        clock.now += 1
        assert not health.blocked()
        health.tidy()
    health.note("gone.example", visit(OPEN))
    health.note("gone.example", visit(GONE))
    clock.now += HOUR
    assert not health.blocked()


def test_rows_of_many_visits_add_up_to_one_of_each_host_identity_and_route(tmp_path: Path) -> None:
    clock, file = Clock(), tmp_path / "sites.jsonl"
    own, shared = tmp_path / "own.jsonl", HealthConfig(file=file)
    health = SiteHealth(shared, own, "desktop", clock)
    for arrival in (OPEN, REFUSED, GONE, msgspec.structs.replace(OPEN, has_login_wall=True, seconds=11)):
        clock.now += 1
        health.note("http://a.test/x", visit(arrival, a_test=100, www_a_test=20, ads_test=7))
    health.note("http://a.test/x", visit(msgspec.structs.replace(OPEN, route="proxy-1")))
    health.tidy()
    assert own.read_bytes() == file.read_bytes()
    first, second = map(msgspec.json.decode, file.read_bytes().splitlines())
    expected: dict[str, Any] = {"opened": 2, "refused": 1, "dead": 1, "slow": 1, "bytes": 480}
    expected |= {"host": "a.test", "identity": "desktop", "has_login_wall": True, "seen": clock.now}
    assert {name: first[name] for name in expected} == expected
    assert (second["route"], second["opened"]) == ("proxy-1", 1)
    file.unlink()
    own.unlink()
    assert health.rows() == {}


def test_of_many_the_last_are_told_by_name(tmp_path: Path) -> None:
    clock = Clock()
    health = made(tmp_path / "sites.jsonl", clock)
    assert health.description() == ""
    for number in range(7):
        clock.now += 60
        health.note(f"s{number}.example", visit(REFUSED))
    told = health.description().split(", ")
    assert [each.partition(" ")[0] for each in told[:5]] == [
        f"s{number}.example" for number in (6, 5, 4, 3, 2)
    ]
    assert told[5:] == ["and 2 others"]


def test_a_torn_line_swallows_nothing(tmp_path: Path) -> None:
    clock, file = Clock(), tmp_path / "sites.jsonl"
    made(file, clock).note("a.example", visit(REFUSED))
    file.write_bytes(file.read_bytes() + b'{"host":"\xff","at":1,"why":""}\n{"host":"b.exam')
    made(file, clock).note("c.example", visit(REFUSED))
    assert set(made(file, clock).blocked()) == {"a.example", "c.example"}


def test_without_a_file_nothing_is_noted(tmp_path: Path) -> None:
    health = made(None, Clock())
    health.note("a.example", visit(REFUSED))
    assert health.blocked() == {}
    with pytest.raises(StoreError):
        made(tmp_path, Clock()).blocked()


def refusal(host: str) -> SiteRow:
    now = 4e9  # Unix time, seconds
    return SiteRow(host, "desktop", refused=1, state="refused", refused_at=now, seen=now)


def test_tasks_of_websites_that_refuse_are_not_drawn(tmp_path: Path) -> None:
    rubric = Rubric((FactGroup(1, "", ("it is found",)),))
    tasks = [
        Task(f"made-up/{host}", "Find it.", f"https://{host}/", "Misc.", "News", rubric, "made-up")
        for host in ("a.example", "www.b.example", "c.example")
    ]
    write_tasks(tmp_path / "tasks.jsonl", tasks)
    kept = HealthConfig(file=tmp_path / "sites.jsonl")
    config = RunConfig(tasks=TaskChoice(file=tmp_path / "tasks.jsonl"), health=kept)
    SiteHealth(kept).add(refusal("b.example"))
    assert {task.id for task in choose_tasks(config).tasks} == {"made-up/a.example", "made-up/c.example"}
    for host in ("a.example", "c.example"):
        SiteHealth(kept).add(refusal(host))
    with pytest.raises(ConfigError, match="blocked"):
        choose_tasks(config)
    other = config.model_validate({**config.model_dump(), "attempt": {"identity": {"languages": ["de"]}}})
    assert len(choose_tasks(other).tasks) == 3


async def test_a_run_says_who_is_left_alone_and_until_when(tmp_path: Path) -> None:
    kept = HealthConfig(file=tmp_path / "sites.jsonl")
    config = small_run(1, health=kept)
    SiteHealth(kept).add(refusal(host := host_of(choose_tasks(config).tasks[0].website)))
    told: list[str] = []
    await collect(config, tmp_path / "run", tell=told.append)
    [line] = [line for line in told if line.startswith("left alone: ")]
    assert line.startswith(f"left alone: {host} until 20")
    (row,) = map(msgspec.json.decode, (tmp_path / "run" / "sites.jsonl").read_bytes().splitlines())
    assert (row["opened"], row["identity"]) == (1, "desktop")


def test_an_identity_has_a_name_that_says_what_is_set() -> None:
    assert Identity().label == Identity(languages=("en-US", "en")).label == "desktop"
    assert Identity(profile="shell").label == "shell"
    other = Identity(time_zone="Asia/Tokyo", credentials={"https://a.test": "$A"}).label
    assert other == Identity(time_zone="Asia/Tokyo").label != Identity(time_zone="Asia/Seoul").label
