"""Processes of a browser die or stop, between calls and during them."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from webgym.browser import process
from webgym.browser.cdp import CommandFailed
from webgym.browser.slot import Slot
from webgym.core.action import Navigate, Wait
from webgym.core.errors import BrowserCrashed, BrowserError, BrowserTimeout, LeaseLost

from .census import of_groups
from .conftest import CLICK, Around, Bench

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="session")]


def members(slot: Slot, kind: str) -> list[int]:
    """Processes of a slot by their type: ``browser``, ``renderer``, ``gpu-process``, ``zygote``."""
    assert slot.process is not None
    found = []
    for pid in of_groups({slot.process.pid}):
        try:
            line = Path(f"/proc/{pid}/cmdline").read_bytes()
        except (FileNotFoundError, ProcessLookupError):
            continue  # it ended while we looked
        if (b"--type=" in line and f"--type={kind}".encode() in line) or (
            line and b"--type=" not in line and kind == "browser" and b"/bin/sh" not in line
        ):
            found.append(pid)
    return found


def kill(slot: Slot, kind: str) -> None:
    pids = members(slot, kind)
    assert pids, f"no {kind} in the group"
    for pid in pids:
        os.kill(pid, signal.SIGKILL)


async def in_the_middle(bench: Bench, slot: Slot) -> None:
    """Until a call runs in the slot."""
    await bench.until(lambda: bench.server.service.gate.permits.running and not slot.is_frozen)


@pytest.mark.parametrize(
    ("kind", "when"),
    [
        ("group", "between calls"),
        ("browser", "during a call"),
        pytest.param("browser", "between calls", marks=pytest.mark.slow),
        pytest.param("group", "during a call", marks=pytest.mark.slow),
    ],
)
async def test_a_killed_browser(fault: Around, kind: str, when: str) -> None:
    async with fault() as bench:
        session, slot = await bench.open()
        assert slot.process is not None

        def strike() -> None:
            if kind == "group":
                assert slot.process is not None
                os.killpg(slot.process.pid, signal.SIGKILL)
            else:
                kill(slot, kind)

        if when == "between calls":
            strike()
            # Of a slot that is stopped, the rest of the group is noticed to be useless at the next call.
            await bench.until(lambda: not members(slot, "browser"))
            with pytest.raises(BrowserCrashed) as caught:
                await session.step()
        else:
            working = asyncio.create_task(session.step(Wait(10)))
            await in_the_middle(bench, slot)
            strike()
            with pytest.raises(BrowserCrashed) as caught:
                await working
        assert caught.value.hint
        with pytest.raises(LeaseLost):
            await session.metadata()


@pytest.mark.parametrize(
    "how", [pytest.param("killed", marks=pytest.mark.slow), "crashed", "killed during a call"]
)
async def test_a_lost_renderer_is_brought_back_and_the_agent_is_told(fault: Around, how: str) -> None:
    async with fault() as bench:
        session, slot = await bench.open("/calm/here")
        process = slot.process
        if how == "killed":
            kill(slot, "renderer")
        elif how == "crashed":
            with slot.awake():
                slot.page.session.send("Page.crash")
                await bench.until(lambda: slot.page.is_crashed)
        if how == "killed during a call":
            working = asyncio.create_task(session.step(Wait(3)))
            await in_the_middle(bench, slot)
            kill(slot, "renderer")
            view = await working
        else:
            view = await session.step()
        assert (view.observation.title, view.observation.url) == ("calm", bench.pages + "/calm/here")
        assert [notice.kind for notice in view.observation.notices] == ["crashed"]
        assert [(fault.kind, fault.url) for fault in view.observation.faults] == [
            ("renderer", bench.pages + "/calm/here")
        ]
        assert slot.process is process
        await session.close()


async def test_every_call_brings_a_lost_renderer_back(fault: Around) -> None:
    async with fault() as bench:
        session, slot = await bench.open()
        kill(slot, "renderer")
        assert (await session.metadata()).title == "calm"
        kill(slot, "renderer")
        assert (await session.screenshot()).startswith(b"\x89PNG")
        kill(slot, "renderer")
        assert (await session.navigate(bench.pages + "/on")).title == "calm"
        await session.close()


async def test_chromiums_own_crash_page(fault: Around) -> None:
    """The address bar's way is closed to agents."""
    async with fault() as bench:
        session, _ = await bench.open()
        view = await session.step(Navigate("chrome://crash"))
        assert [notice.kind for notice in view.observation.notices] == ["navigation_failed"]
        assert view.observation.title == "calm"
        await session.close()


@pytest.mark.parametrize("is_typed", [False, True])
async def test_a_page_that_crashes_whenever_it_is_loaded(fault: Around, is_typed: bool) -> None:
    """It ends the session; but an address that was typed after the first page is left."""
    async with fault() as bench:
        session, _ = await bench.open("/" if is_typed else "")
        deep = Navigate(bench.pages + "/dom/deep")
        if not is_typed:
            with pytest.raises(BrowserCrashed, match="again") as caught:
                await session.step(deep)
            assert caught.value.hint
            return
        view = await session.step(deep)
        assert [(fault.kind, fault.is_typed) for fault in view.observation.faults] == [("renderer", True)] * 2
        assert view.observation.url == "about:blank"
        assert (await session.step(Navigate(bench.pages + "/"))).observation.title == "calm"
        await session.close()


async def test_a_killed_gpu_process_is_replaced_by_the_browser(fault: Around) -> None:
    async with fault() as bench:
        session, slot = await bench.open()
        process = slot.process
        kill(slot, "gpu-process")
        for _ in range(2):
            view = await session.step(Navigate(bench.pages + "/on"))
            assert view.observation.title == "calm"
        assert slot.process is process
        await session.close()


@pytest.mark.slow
async def test_killed_zygotes_cost_at_most_the_session(fault: Around) -> None:
    """Without them no new renderer comes up in this browser."""
    async with fault() as bench:
        session, slot = await bench.open()
        kill(slot, "zygote")
        kill(slot, "renderer")
        with pytest.raises(BrowserError) as caught:
            await session.step()
        assert isinstance(caught.value, BrowserCrashed | BrowserTimeout)
        assert caught.value.hint


@pytest.mark.slow
async def test_a_gpu_process_that_dies_again_and_again(fault: Around) -> None:
    """Chromium gives up in the end; the holder is told, and not kept waiting."""
    async with fault() as bench:
        session, slot = await bench.open()
        told: BrowserError | None = None
        for _ in range(12):
            try:
                kill(slot, "gpu-process")
                await session.step(Navigate(bench.pages + "/on"))
            except (BrowserError, AssertionError) as error:
                told = error if isinstance(error, BrowserError) else None
                break
        if told is None:  # this build never gives up
            assert (await session.step()).observation.title == "calm"
        else:
            assert isinstance(told, BrowserCrashed | BrowserTimeout)
        await session.close()


@pytest.mark.parametrize("kind", [pytest.param("browser", marks=pytest.mark.slow), "renderer"])
async def test_a_process_that_stands_still_is_a_timeout(
    fault: Around, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "_FORK_SECONDS", 0.0)  # or it may be continued, as one that was being forked
    async with fault() as bench:
        session, slot = await bench.open()
        working = asyncio.create_task(session.step(Wait(1)))
        await in_the_middle(bench, slot)
        for pid in members(slot, kind):
            os.kill(pid, signal.SIGSTOP)
        with pytest.raises(BrowserTimeout) as caught:
            await working
        assert caught.value.hint


async def test_browsers_that_die_in_line_are_not_handed_out(fault: Around) -> None:
    async with fault() as bench:
        for slot in bench.server.service.pool.slots:
            assert slot.process is not None
            os.killpg(slot.process.pid, signal.SIGKILL)
        await bench.until(lambda: not any(slot.is_up for slot in bench.server.service.pool.slots))
        session, _ = await bench.open()
        assert (await session.step()).observation.title == "calm"
        await session.close()


async def test_what_another_server_leaves_when_it_dies_later_is_cleared_away(
    fault: Around, temporary: Path
) -> None:
    async with fault() as bench:
        left = next(temporary.glob("webgym-*")) / "999999999-dead"
        (left / "1-x" / "profile").mkdir(parents=True)
        await bench.until(lambda: not left.exists())


async def test_input_that_the_browser_refuses_is_told(fault: Around, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen in a soak, once in 400 steps: "Input.dispatchMouseEvent: Internal error", as a renderer went."""

    async def refuse(*_: object) -> None:
        raise CommandFailed("Input.dispatchMouseEvent: Internal error")

    async with fault() as bench:
        session, _ = await bench.open()
        with monkeypatch.context() as patch:
            patch.setattr("webgym.browser.gestures.carry_out", refuse)
            [notice] = (await session.step(CLICK)).observation.notices
        assert notice.kind == "action_failed"
        assert "Internal error" in notice.text
        notices = (await session.step(CLICK)).observation.notices
        assert [notice.kind for notice in notices] == ["no_effect"]  # it was carried out
        await session.close()
