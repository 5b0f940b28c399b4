"""Find a Chromium on this machine.

The first of these that prints its version is used:

1. an explicit setting: the argument, else the environment variable ``WEBGYM_BROWSER``;
2. Playwright's own headless shell, in its browsers folder;
3. the system's ``chromium-headless-shell``;
4. the system's ``chromium`` (or ``chromium-browser``);
5. Chrome.

The headless shell is preferred to the full browser because it needs about half the CPU per screenshot and
half the memory. For start-up only: it blocks on the file system and on short-lived processes.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from webgym.core.errors import BrowserNotFound

Kind: TypeAlias = Literal["headless-shell", "chromium", "chrome"]
Origin: TypeAlias = Literal["setting", "playwright", "system"]

ENVIRONMENT_VARIABLE = "WEBGYM_BROWSER"
"""Path of the browser's executable; overrides everything but an argument."""

INSTALL_HINT = (
    "run `make setup`, or `playwright install chromium-headless-shell`, or "
    f"`apt-get install chromium-headless-shell`, or set {ENVIRONMENT_VARIABLE} to an executable"
)

_SYSTEM_NAMES: tuple[str, ...] = (
    "chromium-headless-shell",
    "chromium",
    "chromium-browser",
    "google-chrome-stable",
    "google-chrome",
    "chrome",
)


@dataclass(frozen=True, slots=True)
class FoundBrowser:
    """A Chromium that starts.

    Attributes:
        path: its executable, absolute; symbolic links and wrapper scripts are left as they are.
        kind: a headless shell, or a full browser that needs ``--headless=new``.
        version: four numbers with dots, e.g. ``"156.0.8078.79"``.
        origin: where it was found.
    """

    path: Path
    kind: Kind
    version: str
    origin: Origin


VERSION_SECONDS = 15.0
"""Time limit for one browser to print its version; a cold disk takes a few seconds."""


FULL = Path("full")
"""Instead of an executable: the first full browser."""


def find_browser(explicit: Path | None = None, *, headed: bool = False) -> FoundBrowser:
    """The browser to start.

    Args:
        explicit: path of an executable. If it cannot be used, that is an error: no other one is searched for.
            :data:`FULL` searches for a full browser.
        headed: whether it has to show windows, which headless shells cannot.

    Raises:
        BrowserNotFound: there is no Chromium, or the explicit one cannot be used. The hint says what to do.
    """
    if explicit == FULL:
        explicit, headed, setting = None, True, ""
    else:
        setting = str(explicit or os.environ.get(ENVIRONMENT_VARIABLE, ""))
    if setting:
        return _examine(Path(setting).expanduser().absolute(), "setting")
    unusable: list[str] = []
    for path, origin in _candidates():
        if headed and "headless" in path.name:
            continue
        try:
            return _examine(path, origin)
        except BrowserNotFound as error:
            unusable.append(error.message)
    raise BrowserNotFound("; ".join(["no Chromium on this machine", *unusable]), hint=INSTALL_HINT)


def version_of(executable: Path) -> str:
    """The version of an executable, such as ``156.0.8078.108``, asked once; ``0`` if it does not say."""
    try:
        return _examine(executable, "setting").version
    except BrowserNotFound:  # starting it will say what is wrong
        return "0"


def playwright_browsers_folder() -> Path | None:
    """The folder of Playwright's browsers, whether or not it exists.

    ``PLAYWRIGHT_BROWSERS_PATH`` overrides the default; ``0`` means inside the package. ``None`` only if that
    is requested and the package is not installed.
    """
    setting = os.environ.get("PLAYWRIGHT_BROWSERS_PATH")
    if setting == "0":
        spec = importlib.util.find_spec("playwright")
        if spec is None or spec.origin is None:
            return None
        return Path(spec.origin).parent / "driver" / "package" / ".local-browsers"
    if setting:
        return Path(setting).expanduser().absolute()
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ms-playwright"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ms-playwright"


def run_bounded(command: Sequence[str | Path], seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a program to completion, or kill it and all its children after ``seconds``.

    Raises:
        subprocess.TimeoutExpired: it was killed.
        OSError: it could not be started.
    """
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            output, errors = process.communicate(timeout=seconds)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return subprocess.CompletedProcess(process.args, process.returncode, output, errors)


def _candidates() -> Iterator[tuple[Path, Origin]]:
    folder = playwright_browsers_folder()
    if folder is not None:
        for path in _playwright_shells(folder):
            yield path, "playwright"
    for name in _SYSTEM_NAMES:
        path_found = shutil.which(name)
        if path_found:
            yield Path(path_found).absolute(), "system"


def _playwright_shells(folder: Path) -> list[Path]:
    """Executables of completely downloaded headless shells, newest first."""

    def revision(installation: Path) -> int:
        digits = installation.name.rpartition("-")[2]
        return int(digits) if digits.isdigit() else -1

    # Playwright writes the marker last: a folder without it is an interrupted download.
    complete = [marker.parent for marker in folder.glob("chromium_headless_shell-*/INSTALLATION_COMPLETE")]
    names = ("chrome-headless-shell", "headless_shell")  # newer and older builds
    return [
        path
        for installation in sorted(complete, key=revision, reverse=True)
        for name in names
        for path in installation.glob(f"*/{name}")
    ]


def _examine(path: Path, origin: Origin) -> FoundBrowser:
    if not path.exists():
        raise BrowserNotFound(f"there is no browser at {path}", hint=_hint(origin))
    if not path.is_file() or not os.access(path, os.X_OK):
        raise BrowserNotFound(f"{path} is not an executable file", hint=_hint(origin))
    product, version = _product_and_version(path, path.stat().st_mtime_ns, origin)
    if "headless" in path.name:
        kind: Kind = "headless-shell"
    else:
        kind = "chrome" if "Chrome" in product else "chromium"
    return FoundBrowser(path=path, kind=kind, version=version, origin=origin)


@functools.lru_cache(maxsize=64)
def _product_and_version(path: Path, _changed: int, origin: Origin) -> tuple[str, str]:
    """Product and version as ``--version`` prints them. Cached, since it costs a process start."""
    try:
        answer = run_bounded([path, "--version"], VERSION_SECONDS)
    except subprocess.TimeoutExpired:
        reason = f"{path} did not print its version within {VERSION_SECONDS:g} s"
        raise BrowserNotFound(reason, hint=_hint(origin)) from None
    except OSError as error:
        raise BrowserNotFound(f"{path} does not start: {error.strerror}", hint=_hint(origin)) from error
    match = re.search(r"^(.*?)\s*(\d+\.\d+\.\d+\.\d+)", answer.stdout, re.MULTILINE)
    if answer.returncode != 0 or match is None:
        # The last line that a wrapper, a loader or a snap stub prints contains the reason.
        output = (answer.stderr.strip() or answer.stdout.strip() or "nothing").splitlines()[-1]
        raise BrowserNotFound(f"{path} is not a working Chromium, it printed: {output}", hint=_hint(origin))
    return match[1], match[2]


def _hint(origin: Origin) -> str:
    if origin == "setting":
        return f"correct the setting or {ENVIRONMENT_VARIABLE}, or remove it to have one found automatically"
    return INSTALL_HINT
