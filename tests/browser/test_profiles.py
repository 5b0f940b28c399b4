"""Profiles: a living server's are never swept, a dead one's always."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from webgym.browser.profiles import ProfileRoot
from webgym.core.errors import BrowserLaunchFailed

HOLDER = """
import sys
from pathlib import Path
from webgym.browser.profiles import ProfileRoot
root = ProfileRoot(Path(sys.argv[1]))
print(root.new(), flush=True)
sys.stdin.read()
"""


async def test_what_is_in_use_is_not_swept(tmp_path: Path) -> None:
    mine, other = ProfileRoot(tmp_path), ProfileRoot(tmp_path)
    profile = mine.new()
    assert other.sweep() == []
    assert mine.sweep() == [], "not even by its owner"
    assert profile.is_dir()
    await mine.remove(profile)
    assert not mine.path.exists()
    again = mine.new()
    assert again.is_dir()
    await mine.remove(again)


@pytest.mark.parametrize("apart", [False, True], ids=["beside us", "in a container"])
def test_another_servers_is_swept_when_it_is_dead(tmp_path: Path, apart: bool) -> None:
    """Also one whose process ids mean nothing here, and ours nothing there."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path)]
    if apart:
        namespace = ["unshare", "--user", "--map-root-user", "--pid", "--fork", "--kill-child"]
        if subprocess.run([*namespace, "true"], capture_output=True, check=False).returncode != 0:
            pytest.skip("this machine does not let us make a namespace of processes")
        command = [*namespace, *command]
    holder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    profile = Path(holder.stdout.readline().strip())
    assert profile.is_dir()
    root = ProfileRoot(tmp_path)
    assert root.sweep() == []
    assert profile.is_dir()
    holder.kill()
    holder.communicate()
    while not (swept := root.sweep()):  # with --kill-child its child ends a moment later
        assert profile.is_dir()
    assert swept == [profile.parent]
    assert list(root.path.parent.iterdir()) == []


def test_a_sweep_takes_nothing_from_who_is_just_beginning(tmp_path: Path) -> None:
    """The folder is there before its lock is: whoever finds it swept makes another."""
    over = threading.Event()

    def sweep() -> None:
        other = ProfileRoot(tmp_path)
        while not over.is_set():
            other.sweep()

    sweeper = threading.Thread(target=sweep)
    sweeper.start()
    try:
        for _ in range(100):
            root = ProfileRoot(tmp_path)
            profile = root.new()
            (profile / "kept").touch()
            assert (profile / "kept").exists()
            asyncio.run(root.remove(profile))
    finally:
        over.set()
        sweeper.join()


async def test_a_temporary_folder_may_be_tidied_between_two_browsers(tmp_path: Path) -> None:
    root = ProfileRoot(tmp_path / "temporary")
    root.path.parent.rmdir()
    root.path.parent.parent.rmdir()
    profile = root.new()
    assert profile.is_dir()
    assert root.path.parent.stat().st_mode & 0o077 == 0
    await root.remove(profile)


def test_a_folder_of_somebody_elses_choosing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / f"webgym-{os.getuid()}").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(BrowserLaunchFailed, match="another user"):
        ProfileRoot(tmp_path)
