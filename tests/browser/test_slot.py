"""A slot's life: fresh state for every episode, and nothing left of a browser."""

from __future__ import annotations

import asyncio
import os
from asyncio.subprocess import DEVNULL
from pathlib import Path

import psutil
import pytest
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response

from webgym.browser.config import BrowserConfig, Cookie, PageOptions
from webgym.browser.egress.proxy import Egress
from webgym.browser.profiles import ProfileRoot
from webgym.browser.slot import Slot
from webgym.core.action import Navigate
from webgym.core.errors import BrowserLaunchFailed

from .conftest import Site

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

OPTIONS = PageOptions(text=True)


async def test_cookies_are_set_before_the_first_page(site: Site, shared_slot: Slot) -> None:
    async def show(request: Request) -> Response:
        return HTMLResponse(f"<p>{request.cookies.get('visitor')}</p>")

    options = PageOptions(text=True, cookies=(Cookie("visitor", "v-17", "127.0.0.1"),))
    await shared_slot.open(options)
    look = await shared_slot.step(Navigate(site.on("/show", show)))
    assert look.observation.text == "v-17"
    await shared_slot.close()


async def test_a_browser_is_replaced_after_its_share_of_episodes(
    executable: Path, profiles: ProfileRoot, egress: Egress
) -> None:
    slot = Slot(BrowserConfig(recycle_episodes=2), executable, profiles, egress)
    try:
        for _ in range(5):
            await slot.open(OPTIONS)
            await slot.close()
        assert slot.launches == 3
    finally:
        await slot.stop()


def group(pid: int) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) == pid and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return found


async def test_nothing_is_left_of_a_stopped_browser(executable: Path, tmp_path: Path, egress: Egress) -> None:
    root = ProfileRoot(tmp_path)
    slot = Slot(BrowserConfig(), executable, root, egress)
    await slot.open(OPTIONS)
    assert slot.process is not None
    pid = slot.process.pid
    assert len(group(pid)) >= 3
    assert list(root.path.iterdir())
    await slot.stop()
    await slot.stop()
    assert group(pid) == []
    assert not root.path.exists()
    with pytest.raises(ChildProcessError):
        os.waitpid(-pid, os.WNOHANG)  # noqa: ASYNC222 - no zombie of ours either, and it does not wait


@pytest.mark.parametrize("program", ["/no/such/chromium", "/bin/false", "/bin/cat"])
async def test_what_is_no_browser_is_a_typed_error(program: str, tmp_path: Path, egress: Egress) -> None:
    root = ProfileRoot(tmp_path)
    slot = Slot(BrowserConfig(launch_seconds=2), Path(program), root, egress)
    with pytest.raises(BrowserLaunchFailed):
        await slot.start()
    assert not root.path.exists()


async def test_the_sweep_ends_browsers_that_outlived_their_server(executable: Path, tmp_path: Path) -> None:
    folder = ProfileRoot(tmp_path).path.parent / "999999999-1" / "1-x" / "profile"
    folder.mkdir(parents=True)
    orphan = await asyncio.create_subprocess_exec(
        executable,
        "--no-sandbox",
        "--headless",
        f"--user-data-dir={folder}",
        "--remote-debugging-port=0",
        stdout=DEVNULL,
        stderr=DEVNULL,
        start_new_session=True,
    )
    async with asyncio.timeout(100):
        while len(group(orphan.pid)) < 3:
            await asyncio.sleep(0.02)
    await asyncio.to_thread(ProfileRoot(tmp_path).sweep)
    async with asyncio.timeout(100):
        while group(orphan.pid):
            await asyncio.sleep(0.02)
    await orphan.wait()
    assert not folder.exists()
