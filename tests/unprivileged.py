"""Running our code as a user without privileges, as it runs in production, whoever runs the tests."""

from __future__ import annotations

import functools
import os
import pwd
import shutil
import site
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SOURCE = Path(__file__).resolve().parent.parent / "src"

_UIDS = range(61_000, 61_100)
_OURS = "import webgym.cli, webgym.server, uvloop"


@contextmanager
def scratch() -> Iterator[Path]:
    """A folder that is the unprivileged user's; pytest's own are hidden from other users."""
    with tempfile.TemporaryDirectory(prefix="webgym-test-") as name:
        folder = Path(name)
        if os.geteuid() == 0:
            os.chown(folder, _uid(), _uid())
        yield folder


@functools.cache
def _uid() -> int:
    """A user who owns nothing and has no name."""
    taken = {user.pw_uid for user in pwd.getpwall()}
    return next(uid for uid in _UIDS if uid not in taken)


def _environment() -> dict[str, str]:
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "COLUMNS": "160"}
    if os.geteuid() == 0:
        environment["PYTHONPATH"] = os.pathsep.join([str(SOURCE), *site.getsitepackages()])
        environment["HOME"] = "/nonexistent"
    return environment


def _run(command: list[str], folder: Path | str, seconds: float) -> subprocess.CompletedProcess[str]:
    if os.geteuid() == 0:
        return subprocess.run(
            command,
            user=_uid(),
            group=_uid(),
            extra_groups=(),
            cwd=folder,
            env={**_environment(), "TMPDIR": str(folder)},
            capture_output=True,
            text=True,
            timeout=seconds,
            check=False,
        )
    environment = {**_environment(), "TMPDIR": str(folder)}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=seconds, check=False
    )


@functools.cache
def interpreter() -> str | None:
    """A Python of this version that the unprivileged user can run with our packages; ``None`` if there is
    none, as where the interpreter lies in root's own home."""
    if os.geteuid() != 0:
        return sys.executable
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    for candidate in (sys.executable, shutil.which(version, path="/usr/local/bin:/usr/bin")):
        if candidate is None:
            continue
        try:
            if _run([candidate, "-c", _OURS], "/", 60).returncode == 0:
                return candidate
        except PermissionError:
            continue
    return None


def python(folder: Path, *arguments: str, seconds: float = 100) -> subprocess.CompletedProcess[str]:
    """Run Python with our packages as the unprivileged user, in a folder of his."""
    program = interpreter()
    assert program is not None
    return _run([program, *arguments], folder, seconds)


def can_make_namespaces(folder: Path) -> bool:
    """Whether this machine lets such a user make namespaces of his own, with him as root in them."""
    return (
        _run(["unshare", "--user", "--map-root-user", "--pid", "--fork", "true"], folder, 20).returncode == 0
    )
