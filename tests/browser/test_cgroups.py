"""A cgroup per browser: its limits on a tree of files, its life in the kernel's own where there is one."""

from __future__ import annotations

import asyncio
import contextlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from webgym.browser.config import BrowserConfig
from webgym.browser.egress.proxy import Egress
from webgym.browser.memory import Cgroup, new_cgroup
from webgym.browser.process import launch
from webgym.browser.profiles import ProfileRoot
from webgym.browser.sandbox import SandboxState
from webgym.core.errors import BrowserOutOfMemory, ConfigError

OFF = SandboxState(False, "for a test")


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """What looks like a cgroup that was given to us."""
    (tmp_path / "cgroup.controllers").write_text("cpu memory pids\n")
    (tmp_path / "cgroup.subtree_control").write_text("")
    return tmp_path


@pytest.fixture
def real() -> Iterator[Path]:
    """A cgroup of the kernel's."""
    mounts = [line.split() for line in Path("/proc/self/mounts").read_text().splitlines()]
    found = next((Path(mount[1]) for mount in mounts if mount[2] == "cgroup2"), None)
    if found is None or not os.access(found, os.W_OK):
        pytest.skip("there is no cgroup of version 2 that can be divided")
    path = found / f"webgym-test-{os.getpid()}"
    try:
        path.mkdir()
    except OSError as error:
        pytest.skip(f"no cgroup can be made: {error.strerror}")
    yield path
    for child in path.iterdir():
        if child.is_dir():
            child.rmdir()  # fails if a browser left something in it
    path.rmdir()


def test_the_limits_are_those_of_the_settings(tree: Path) -> None:
    config = BrowserConfig(cgroup=tree, slot_bytes=10**9, slot_tasks=99)
    first, second = new_cgroup(config), new_cgroup(config)
    assert first is not None
    assert second is not None
    assert first.path != second.path
    assert (tree / "cgroup.subtree_control").read_text() == "+memory +pids"
    assert (first.path / "memory.max").read_text() == "2000000000\n"
    assert (first.path / "memory.oom.group").read_text() == "1\n"
    assert (first.path / "pids.max").read_text() == "99\n"
    assert new_cgroup(BrowserConfig()) is None


def test_what_is_no_cgroup_of_ours_is_refused(tree: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is not a cgroup that can be divided: No such file"):
        new_cgroup(BrowserConfig(cgroup=tmp_path / "none"))
    (tree / "cgroup.controllers").write_text("cpu\n")
    with pytest.raises(ConfigError, match="neither the memory nor the pids controller"):
        new_cgroup(BrowserConfig(cgroup=tree))


def test_what_dead_servers_left_is_removed(tree: Path) -> None:
    ended = subprocess.Popen(["true"])
    ended.wait()
    (tree / f"{ended.pid}-1").mkdir()
    (tree / "1-1").mkdir()
    (tree / "somebody's").mkdir()
    assert new_cgroup(BrowserConfig(cgroup=tree)) is not None
    assert {path.name for path in tree.iterdir() if path.is_dir()} >= {"1-1", "somebody's"}
    assert not (tree / f"{ended.pid}-1").exists()


def test_memory_that_ran_out_is_told_from_another_end(tmp_path: Path) -> None:
    group = Cgroup(tmp_path)
    assert not group.ran_out
    (tmp_path / "memory.events").write_text("low 0\noom 1\noom_kill 0\n")
    assert not group.ran_out
    (tmp_path / "memory.events").write_text("low 0\noom 1\noom_kill 7\n")
    assert group.ran_out


@pytest.mark.browser
async def test_a_browser_lives_and_ends_in_its_cgroup(
    real: Path, executable: Path, egress: Egress, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whatever left its process group ends with it, and the cgroup goes too."""
    group = Cgroup(real / "one")
    group.path.mkdir()
    monkeypatch.setattr("webgym.browser.process.new_cgroup", lambda _config: group)
    browser = await launch(BrowserConfig(), executable, ProfileRoot(), OFF, egress.main)
    inside = {int(pid) for pid in (group.path / "cgroup.procs").read_text().split()}
    assert set(browser.processes()) <= inside
    assert len(inside) > 2
    command = group.command(["sleep", "1000"])
    stray = await asyncio.to_thread(subprocess.Popen, command, start_new_session=True)
    while str(stray.pid) not in (group.path / "cgroup.procs").read_text().split():
        await asyncio.sleep(0.01)
    await browser.kill()
    assert await asyncio.to_thread(stray.wait) == -9
    assert not group.path.exists()


@pytest.mark.browser
async def test_a_browser_that_the_kernel_ended_for_its_memory_says_so(
    executable: Path, egress: Egress, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "memory.events").write_text("oom_kill 3\n")
    monkeypatch.setattr("webgym.browser.process.new_cgroup", lambda _config: Cgroup(tmp_path))
    browser = await launch(BrowserConfig(), executable, ProfileRoot(), OFF, egress.main)
    ended = asyncio.Event()
    browser.connection.when_lost(ended.set)
    with contextlib.suppress(ProcessLookupError):
        os.kill(browser.pid, 9)
    await ended.wait()
    assert isinstance(browser.connection.lost, BrowserOutOfMemory)
    await browser.kill()
