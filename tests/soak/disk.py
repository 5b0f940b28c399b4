"""A small disk that can be filled without affecting other programs."""

from __future__ import annotations

import contextlib
import itertools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_CHUNK = bytes(1024 * 1024)
_MOUNT_SECONDS = 10.0
_FILES = 8192
"""Maximum number of files on the disk: few, so that filling it is fast; a browser has about a hundred."""


class Disk:
    """A folder, if possible on its own file system.

    Attributes:
        path: the folder.
        why_not: why it has no file system of its own; empty if it has one.
    """

    def __init__(self, path: Path, why_not: str) -> None:
        self.path = path
        self.why_not = why_not
        self._ballast = path / "ballast"

    @property
    def can_be_filled(self) -> bool:
        """Whether the folder has its own file system."""
        return not self.why_not

    def fill(self) -> None:
        """Use up all free bytes and all free files. Blocks for a moment."""
        assert self.can_be_filled
        self._ballast.mkdir(exist_ok=True)
        with contextlib.suppress(OSError), (self._ballast / "bytes").open("ab", buffering=0) as file:
            while file.write(_CHUNK) == len(_CHUNK):
                pass
        with contextlib.suppress(OSError):
            for number in itertools.count():
                (self._ballast / str(number)).touch()

    def clear(self) -> None:
        """Free the space again."""
        shutil.rmtree(self._ballast, ignore_errors=True)


def _mount(path: Path, size: int) -> str:
    """Mount a file system in memory. Returns why that is not possible; empty if it was."""
    if os.geteuid() != 0:
        return "only root may mount a disk to fill"
    options = f"size={size},nr_inodes={_FILES},mode=700"
    command = ["mount", "-t", "tmpfs", "-o", options, "webgym-soak", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_MOUNT_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"no disk to fill: {error}"
    return f"no disk to fill: {done.stderr.strip()}" if done.returncode else ""


@contextmanager
def small_disk(size: int) -> Iterator[Disk]:
    """A folder that exists until the block ends, on a disk of ``size`` bytes if we may mount one."""
    path = Path(tempfile.mkdtemp(prefix="webgym-soak-"))
    why_not = _mount(path, size)
    try:
        yield Disk(path, why_not)
    finally:
        if not why_not:
            subprocess.run(["umount", "--lazy", str(path)], timeout=_MOUNT_SECONDS, check=False)
        with contextlib.suppress(OSError):
            shutil.rmtree(path)
