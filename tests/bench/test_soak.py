"""``webgym bench soak``: a short one balances, and one that does not would be seen."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from asyncio.subprocess import DEVNULL, PIPE
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import msgspec
import psutil
import pytest
from tests.documented import documented

from webgym.bench.soak import Counts, SoakPlan, faults
from webgym.bench.soak.disk import Disk, small_disk
from webgym.bench.soak.leaks import Census, Process, leaked, left_behind
from webgym.bench.soak.target import Target, running_target
from webgym.core.errors import BrowserCrashed, BrowserError, LeaseLost, NoCapacity
from webgym.server.client import BrowserClient


def soaked(folder: Path, *arguments: str) -> tuple[subprocess.CompletedProcess[str], dict[str, object]]:
    done = subprocess.run(
        [sys.executable, "-m", "webgym", *arguments, "--json", str(folder / "soak.json")],
        capture_output=True,
        text=True,
        timeout=600,
    )
    return done, json.loads((folder / "soak.json").read_text()) if not done.returncode else {}


@pytest.mark.browser
def test_a_short_one_balances(tmp_path: Path) -> None:
    small = "--minutes 0.2 --clients 5 --slots 3 --workers 2 --faults 60 --seed 3".split()
    page = documented("webgym bench soak --minutes 10")
    page += documented("webgym bench soak --minutes 5 --seed 1")[2:]
    done, found = soaked(tmp_path, *page, *small, "--log", str(tmp_path / "log"))
    assert done.returncode == 0, done.stdout + done.stderr + (tmp_path / "log").read_text()
    assert "No problems: " in done.stdout
    assert "steps" in done.stderr, "a line now and then where there is no terminal"
    books = found["books"]
    assert isinstance(books, dict)
    assert books["opened"] > 0
    assert len(books["faults"]) > 3
    assert (tmp_path / "log").stat().st_size


async def test_an_interrupted_one_leaves_no_worker_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stopped worker does not see that its gateway ends, and would be left with its browsers for ever."""
    worker = await asyncio.create_subprocess_exec("sleep", "60")
    try:
        found = [Process(worker.pid, "worker", worker.pid, is_running=True)]
        monkeypatch.setattr(faults, "processes_of", lambda _: found)
        target = SimpleNamespace(pid=0, plan=SoakPlan(faults=60_000))
        caused = faults.Faults(cast(Target, target), Counts(), cast(Disk, None), "seed")
        caused._kinds = {"worker stopped": caused._kinds["worker stopped"]}
        running = asyncio.create_task(caused.run(60))
        process = psutil.Process(worker.pid)
        async with asyncio.timeout(10):
            while process.status() != psutil.STATUS_STOPPED:
                await asyncio.sleep(0.01)
        running.cancel()
        await asyncio.wait({running})
        assert process.status() != psutil.STATUS_STOPPED
    finally:
        worker.kill()
        await worker.wait()


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_long_one_balances(tmp_path: Path) -> None:
    long = ("--minutes", "4", "--faults", "30", "--seed", str(os.getpid()))
    done, _ = soaked(tmp_path, "bench", "soak", *long)
    assert done.returncode == 0, done.stdout + done.stderr


# --- what would be seen ---------------------------------------------------------------------------------


def test_a_session_that_nobody_accounts_for() -> None:
    books = Counts(opened=4, closed=1, vanished=1)
    books.count_lost(BrowserCrashed("gone"))
    assert (books.live, books.lost) == (1, Counter(browser_crashed=1))
    assert len(books.problems()) == 1
    books.closed += 1
    assert books.problems() == []


@pytest.mark.parametrize("error", [ValueError("no type"), BrowserError("too general")])
def test_an_error_that_says_nothing(error: Exception) -> None:
    books = Counts()
    books.count_refused(NoCapacity("all taken"))
    books.count_refused(LeaseLost("it ran out"))
    assert books.problems() == []
    books.count_refused(error)
    assert books.refused == Counter(no_capacity=1, lease_lost=1, untyped=1)
    assert len(books.problems()) == 1


def test_a_connection_that_is_never_hung_up_on() -> None:
    assert len(Counts(half_open=2, hung_up_on=1).problems()) == 1


BEFORE = Census(
    workers=1,
    browsers=2,
    zombies=0,
    strays=(),
    profiles=2,
    folders=1,
    others=(),
    descriptors={"gateway": {"socket": 3}, "worker": {"socket": 5, "pipe": 2}},
    megabytes=100.0,
)


@pytest.mark.parametrize(
    "more",
    [
        {"workers": 0},
        {"browsers": 3},
        {"browsers": 1},
        {"zombies": 1},
        {"strays": ("7 (stopped)",)},
        {"profiles": 3},
        {"folders": 2},
        {"others": ("core",)},
        {"descriptors": {"gateway": {"socket": 4}, "worker": {"socket": 5, "pipe": 2}}},
        {"descriptors": {"gateway": {"socket": 3}, "worker": {"socket": 4, "pipe": 3}}},
    ],
    ids=str,
)
def test_whatever_leaks_is_seen(more: dict[str, object]) -> None:
    assert leaked(BEFORE, BEFORE, 2) == []
    assert len(leaked(BEFORE, msgspec.structs.replace(BEFORE, **more), 2)) == 1


@pytest.mark.browser
async def test_a_leak_on_a_real_server_is_seen() -> None:
    """A session that stays, a process without a parent, a file: each is found, and gone when it is gone."""
    plan = SoakPlan(slots=1, workers=1)
    with small_disk(plan.disk_bytes) as disk:
        async with running_target(plan, disk.path, None, DEVNULL) as target:
            before, unready = await target.settled(None, 60)
            assert before is not None
            assert not unready
            async with BrowserClient(target.url, token=target.token) as client:
                session = await client.open()
                async with asyncio.timeout(20):
                    while [one.split(":")[0] for one in await target.at_rest()] != ["a lease", "slots"]:
                        await asyncio.sleep(0.05)
                await session.close()
            _, left = await target.settled(before, 60)
            assert not left
            stray = await asyncio.create_subprocess_exec(
                sys.executable, "-c", "input()", f"--user-data-dir={disk.path}/x", stdin=PIPE
            )
            (disk.path / "core").touch()
            async with asyncio.timeout(20):  # a gateway may ask its worker at this moment, by another socket
                while len((await target.settled(before, 0))[1]) != 2:
                    await asyncio.sleep(0.05)
            assert any(str(stray.pid) in one for one in left_behind(disk.path))
            (disk.path / "core").unlink()
            stray.kill()
            await stray.wait()
            _, left = await target.settled(before, 60)
            assert not left
        assert left_behind(disk.path) == []


def test_a_full_disk_is_full_and_then_not() -> None:
    with small_disk(4 * 1024 * 1024) as disk:
        if not disk.can_be_filled:
            pytest.skip(disk.why_not)
        disk.fill()
        with pytest.raises(OSError, match="No space left"):
            (disk.path / "more").mkdir()
        disk.clear()
        (disk.path / "more").write_bytes(b"x" * 8192)
    assert not disk.path.exists()
