"""A page that takes memory without end is ended before the machine is."""

from __future__ import annotations

import asyncio
import errno
import os
from asyncio.subprocess import PIPE

import pytest

from webgym.browser.config import BrowserConfig
from webgym.browser.memory import MemoryWatch, ProcessTable
from webgym.browser.slot import RECYCLE_BYTES
from webgym.core.action import BrowserAction, Navigate, Wait
from webgym.core.errors import BrowserOutOfMemory
from webgym.core.observation import Notice
from webgym.server.client import Session

from .conftest import CLICK, MIB, Around

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="session")]


async def steps(session: Session, *actions: BrowserAction) -> None:
    for action in actions:
        await session.step(action)


@pytest.mark.parametrize(
    "path",
    [
        "/memory/buffers",
        pytest.param("/dom/gigabyte", marks=pytest.mark.slow),
        pytest.param("/memory/heap", marks=pytest.mark.slow),
        pytest.param("/memory/title", marks=pytest.mark.slow),
        pytest.param("/dom/million", marks=pytest.mark.slow),
    ],
)
async def test_a_page_that_hogs_while_it_loads_ends_its_session(fault: Around, path: str) -> None:
    async with fault() as bench:
        session, _ = await bench.open("")
        with pytest.raises(BrowserOutOfMemory, match="500 MiB") as caught:
            await steps(session, Navigate(bench.pages + path), Wait(5))
        assert caught.value.hint


async def test_a_page_that_grows_is_loaded_again_and_the_agent_is_told(fault: Around) -> None:
    async with fault() as bench:
        session, slot = await bench.open("/memory/click")
        process = slot.process
        await session.execute(CLICK)
        crashes: list[Notice] = []
        while not crashes:
            view = await session.step(Wait(0.5))
            crashes = [notice for notice in view.observation.notices if notice.kind == "crashed"]
        [notice] = crashes
        assert "more than 500 MiB" in notice.text
        view = await session.step(Navigate(bench.pages + "/"))
        assert view.observation.title == "calm"
        assert slot.process is process, "the browser is still the same"
        await session.close()


async def test_a_worker_that_hogs_is_ended_too(fault: Around) -> None:
    async with fault() as bench:
        session, _ = await bench.open("")
        with pytest.raises(BrowserOutOfMemory):
            await steps(session, Navigate(bench.pages + "/memory/worker"), *[Wait(2)] * 20)


async def test_a_machine_without_memory_ends_the_largest(fault: Around) -> None:
    async with fault() as bench:
        (small, _), (large, slot) = await asyncio.gather(bench.open(), bench.open("/memory/some"))
        config = slot.config.model_copy(update={"reserve_bytes": 2**60})
        browsers = [each.process for each in bench.server.service.pool.slots if each.process is not None]
        with slot.awake():
            await MemoryWatch(config, lambda: browsers).check()
        assert (await small.step()).observation.notices == ()
        [notice] = (await large.step()).observation.notices
        assert "the machine had only" in notice.text
        await asyncio.gather(small.close(), large.close())


async def test_a_watch_that_cannot_look_for_a_while_goes_on(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    looks = 0

    async def check() -> None:
        nonlocal looks
        looks += 1
        if looks in (2, 3):
            raise OSError(errno.EMFILE, "no files")

    monkeypatch.setattr("webgym.browser.memory.MEMORY_LOOK_SECONDS", 0.001)
    watch = MemoryWatch(BrowserConfig(), tuple)
    monkeypatch.setattr(watch, "check", check)
    watching = asyncio.create_task(watch.run())
    async with asyncio.timeout(100):
        while looks < 5:
            await asyncio.sleep(0.001)
    watching.cancel()
    await asyncio.wait({watching})
    assert caplog.text.count("no files") == 1


@pytest.mark.parametrize("before", ["--type=zygote", "no type"])
async def test_a_renderer_is_known_as_one_also_if_it_was_met_as_it_was_forked(before: str) -> None:
    """Until it says what it is, a forked process has the command line of its parent."""
    becomes = ["bash", "-c", 'read; exec -a "$TITLE" sleep 60', before]
    process = await asyncio.create_subprocess_exec(
        *becomes, env={**os.environ, "TITLE": "--type=renderer"}, stdin=PIPE, start_new_session=True
    )
    assert process.stdin is not None
    try:
        processes = ProcessTable()
        assert processes.sizes([process.pid])[process.pid].renderer is None
        process.stdin.write(b"\n")
        async with asyncio.timeout(100):
            while processes.sizes([process.pid])[process.pid].renderer != process.pid:
                await asyncio.sleep(0.01)
        size = processes.sizes([process.pid])[process.pid]
        assert size.standing == 0
        assert size.largest == size.total > 0
    finally:
        process.kill()
        await process.wait()


async def test_a_browser_that_grew_is_replaced_at_the_end_of_the_episode(
    fault: Around, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with fault() as bench:
        session, slot = await bench.open()
        process = slot.process
        assert process is not None
        size = ProcessTable().sizes([process.pid])[process.pid]
        assert 20 * MIB < size.standing < RECYCLE_BYTES
        assert 5 * MIB < size.largest < size.total == size.standing + size.largest
        with slot.awake():
            await bench.until(lambda: process.standing_bytes)  # the watch has looked
        # Well below: the watch looks again, and may find a little less.
        monkeypatch.setattr("webgym.browser.slot.RECYCLE_BYTES", process.standing_bytes // 2)
        assert slot.needs_replacement
        await session.close()
        await bench.until(lambda: slot.process is not process and slot.is_warm)
