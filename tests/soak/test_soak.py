"""``python -m tests.soak``: a short one finds no problems, and a leak would be seen."""

from __future__ import annotations

import asyncio
import json
import os
import sys
from asyncio.subprocess import DEVNULL, PIPE
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import msgspec
import psutil
import pytest
from tests.documented import documented
from tests.soak import faults
from tests.soak.counts import Counts
from tests.soak.disk import Disk, small_disk
from tests.soak.leaks import Census, Process, leaked, left_behind
from tests.soak.target import SoakPlan, Target, running_target

from webgym.core.errors import BrowserCrashed, BrowserError, NoCapacity
from webgym.server.client import BrowserClient


async def soaked(*words: str) -> tuple[int | None, str]:
    """The exit code of a soak in a process of its own, and what it printed."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "tests.soak", *words, cwd=Path(__file__).parents[2], stdout=PIPE
    )
    printed, _ = await process.communicate()
    return process.returncode, printed.decode()


@pytest.mark.browser
async def test_a_short_one_finds_no_problems(tmp_path: Path) -> None:
    small = "--minutes 0.2 --clients 5 --slots 3 --workers 2 --faults 60 --seed 3".split()
    page = documented("python -m tests.soak --minutes 5 --seed 1")
    code, printed = await soaked(*page, *small, "--log", str(tmp_path / "log"))
    assert code == 0, printed + (tmp_path / "log").read_text()
    found = json.loads(printed[: printed.index("No problems: ")])
    assert found["counts"]["opened"] > 0
    assert len(found["counts"]["faults"]) > 3
    assert (tmp_path / "log").stat().st_size


@pytest.mark.browser
@pytest.mark.slow
@pytest.mark.timeout(600)
async def test_a_long_one_finds_no_problems() -> None:
    code, printed = await soaked("--minutes", "4", "--faults", "30", "--seed", str(os.getpid()))
    assert code == 0, printed


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
        async with asyncio.timeout(100):
            while process.status() != psutil.STATUS_STOPPED:
                await asyncio.sleep(0.01)
        running.cancel()
        await asyncio.wait({running})
        assert process.status() != psutil.STATUS_STOPPED
    finally:
        worker.kill()
        await worker.wait()


def test_counts_that_do_not_add_up_are_problems() -> None:
    counts = Counts(opened=3, closed=1)
    counts.count_lost(BrowserCrashed("gone"))
    assert len(counts.problems()) == 1, "a session that nobody accounts for"
    counts.vanished += 1
    counts.count_refused(NoCapacity("all taken"))
    assert counts.problems() == []
    counts.count_refused(BrowserError("too general"))
    assert len(counts.problems()) == 1, "an error that does not say what failed"
    counts.half_open += 1
    assert len(counts.problems()) == 2, "a connection that the server did not close"


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
        {"profiles": 3},
        {"folders": 2},
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
        async with running_target(plan, disk.path, DEVNULL) as target:
            before, unready = await target.settled(None, 60)
            assert before is not None
            assert not unready
            async with BrowserClient(target.url, token=target.token) as client:
                session = await client.open()
                async with asyncio.timeout(100):
                    while [one.split(":")[0] for one in await target.at_rest()] != ["a lease", "slots"]:
                        await asyncio.sleep(0.05)
                await session.close()
            _, left = await target.settled(before, 60)
            assert not left
            stray = await asyncio.create_subprocess_exec(
                sys.executable, "-c", "input()", f"--user-data-dir={disk.path}/x", stdin=PIPE
            )
            (disk.path / "core").touch()
            async with asyncio.timeout(100):  # a gateway may ask its worker at this moment, by another socket
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
