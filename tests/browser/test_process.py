"""A browser's process: what it is given, and that nothing stays of it, whatever goes wrong."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import resource
import shutil
import signal
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import psutil
import pytest
import pytest_asyncio

from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.process import BrowserProcess, launch
from webgym.browser.profiles import ProfileRoot
from webgym.browser.sandbox import SandboxState
from webgym.core.errors import BrowserLaunchFailed

OFF = SandboxState(False)
MUTE = Path("/bin/cat")
"""Starts and says nothing: a browser that does not come up."""
SECRETS = {
    "WEBGYM_TOKEN": "open-sesame-1",
    "OPENAI_API_KEY": "open-sesame-2",
    "AWS_SECRET_ACCESS_KEY": "open-sesame-3",
    "https_proxy": "http://me:open-sesame-4@proxy.invalid",
    "DATABASE_URL": "postgres://me:open-sesame-5@db.invalid",
}


@pytest_asyncio.fixture
async def egress() -> AsyncIterator[Egress]:
    async with Egress() as egress:
        yield egress


@pytest.fixture
def root(tmp_path: Path) -> ProfileRoot:
    return ProfileRoot(tmp_path)


def descriptors() -> list[int]:
    """The open ones, that of looking included."""
    with os.scandir("/proc/self/fd") as found:
        return [int(entry.name) for entry in found]


def children() -> list[int]:
    return [child.pid for child in psutil.Process().children()]


async def at_rest() -> tuple[int, list[int]]:
    """How many descriptors are open, and the children, once nothing of other tests is left to go."""
    await asyncio.to_thread(descriptors)  # so that the first thread of the pool is there
    gc.collect()
    return len(descriptors()), children()


@contextlib.contextmanager
def only(spare: int) -> Iterator[None]:
    """No more than so many files can be opened in this process."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    highest = max(descriptors())
    resource.setrlimit(resource.RLIMIT_NOFILE, (highest + 1 + spare, hard))
    taken = []
    try:
        with contextlib.suppress(OSError):
            while True:
                taken.append(os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC))
        for descriptor in taken[:spare]:
            os.close(descriptor)
        del taken[:spare]
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for descriptor in taken:
            os.close(descriptor)


async def start(executable: Path, root: ProfileRoot, egress: Egress) -> BrowserProcess:
    return await launch(BrowserConfig(launch_seconds=0.2), executable, root, OFF, egress.main)


@pytest.mark.browser
async def test_it_knows_no_secret_of_ours(
    executable: Path, root: ProfileRoot, egress: Egress, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in SECRETS.items():
        monkeypatch.setenv(name, value)
    browser = await launch(BrowserConfig(), executable, root, OFF, egress.main)
    try:
        for pid in browser.processes():  # some write their name over what they were given
            assert b"open-sesame" not in Path(f"/proc/{pid}/environ").read_bytes()
        given = Path(f"/proc/{browser.pid}/environ").read_bytes()
        assert f"TMPDIR={browser.profile}".encode() in given
        monkeypatch.setattr("resource.getrlimit", lambda _: (64, 64))  # as if that had ended it
        os.kill(browser.pid, signal.SIGKILL)
        async with asyncio.timeout(100):
            while browser.connection.lost is None:
                await asyncio.sleep(0.01)
        assert "only 64 files may be open" in str(browser.connection.lost)
    finally:
        await browser.kill()


@pytest.mark.browser
async def test_it_writes_into_its_profile_alone(
    executable: Path, egress: Egress, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Debian's ``chromium`` keeps crash reports and settings in folders of the user's."""
    ours = {"HOME": tmp_path, "XDG_CONFIG_HOME": tmp_path / "config", "XDG_CACHE_HOME": tmp_path / "cache"}
    for name, folder in ours.items():
        monkeypatch.setenv(name, str(folder))
    full = shutil.which("chromium")
    short = ProfileRoot()  # a socket is in it, whose path has an end
    browser = await launch(BrowserConfig(), Path(full) if full else executable, short, OFF, egress.main)
    given = Path(f"/proc/{browser.pid}/environ").read_bytes()
    await browser.kill()
    assert str(tmp_path).encode() not in given
    assert list(tmp_path.iterdir()) == []


async def test_when_files_run_out_nothing_is_left(root: ProfileRoot, egress: Egress) -> None:
    before, offspring = await at_rest()
    with only(0), pytest.raises(BrowserLaunchFailed, match="no socket"):
        await egress.open_listener()
    said = set()
    for spare in range(12):  # each fails at another point of the start
        with only(spare), pytest.raises(BrowserLaunchFailed) as caught:
            await start(MUTE, root, egress)
        said.add(caught.value.message.partition(":")[0])
        assert len(descriptors()) <= before + root.path.exists()
        assert children() == offspring
    assert len(said) == 3, "no profile; no process; no answer"
    with pytest.raises(BrowserLaunchFailed):
        await start(MUTE, root, egress)
    assert not root.path.exists(), (
        "what could not be removed for want of a descriptor is removed with the next"
    )


async def test_a_start_that_is_given_up_leaves_nothing(root: ProfileRoot, egress: Egress) -> None:
    before, offspring = await at_rest()
    for moments in range(12):
        starting = asyncio.create_task(start(MUTE, root, egress))
        for _ in range(moments):
            await asyncio.sleep(0.001)
        starting.cancel()
        with pytest.raises((asyncio.CancelledError, BrowserLaunchFailed)):
            await starting
        async with asyncio.timeout(100):  # an end goes on though nobody waits for it
            while root.path.exists() or len(descriptors()) > before or children() != offspring:
                await asyncio.sleep(0.005)


@pytest.mark.browser
async def test_an_end_that_is_given_up_goes_on(executable: Path, root: ProfileRoot, egress: Egress) -> None:
    browser = await launch(BrowserConfig(), executable, root, OFF, egress.main)
    for _ in range(2):
        ending = asyncio.create_task(browser.kill())
        await asyncio.sleep(0)
        ending.cancel()
        with pytest.raises(asyncio.CancelledError):
            await ending
    await browser.kill()
    assert browser.processes() == []
    assert not root.path.exists()
    assert browser.pid not in children(), "no zombie of ours"


async def test_where_no_profile_can_be_made_that_is_said(
    root: ProfileRoot, tmp_path: Path, egress: Egress
) -> None:
    root.path.parent.rmdir()
    root.path.parent.write_text("in the way")
    with pytest.raises(BrowserLaunchFailed, match="no profile can be made") as caught:
        await start(MUTE, root, egress)
    assert "browser.temporary_root" in caught.value.hint
